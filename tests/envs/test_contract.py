"""What every environment promises, checked over every registered id."""

import copy
import pickle
from array import array
from fractions import Fraction
from functools import partial
from math import ceil

import gymnasium
import mujoco
import numpy as np
import pytest
from gymnasium.vector import AsyncVectorEnv
from support.episodes import POLICIES, hold, steps, switching, uniform
from support.many import alike
from support.rig_episodes import flatten

from softrobot_env.beams.registry import BeamPlant
from softrobot_env.envs.observations.table import known_of
from softrobot_env.registration import ENVIRONMENTS, RIG_ENVIRONMENTS
from softrobot_env.robots import ARM

SWING = "SoftRobot/ArmSwing-v0"
SLOW = pytest.mark.slow  # models that take half a minute to compile

#: What all families of simulated robots promise.
FAMILIES = {
    "arm": (SWING, {}, ()),
    "in space": ("SoftRobot/Track-v0", {"robot": "hanging_trunk"}, ()),
    "rig": ("SoftRobot/RigReach-v0", {}, ()),
    # A picture of several instants.
    "twin": ("SoftRobot/RigReach-v0", {"twin": 1, "control_period": 0.004}, ()),
    "pcc": (SWING, {"plant": BeamPlant("pcc")}, ()),
    "cosserat": (SWING, {"plant": BeamPlant("cosserat")}, SLOW),
    "ancf": (SWING, {"plant": BeamPlant("ancf")}, SLOW),
}


@pytest.fixture(params=[pytest.param(name, marks=FAMILIES[name][2]) for name in FAMILIES])
def make_one(request, make_env):
    """Factory of environments of one family that observe all."""
    env_id, options, _ = FAMILIES[request.param]
    return lambda: make_env(env_id, observe="all", **options)


# ---------------------------------------------------------------- spaces


def driven(*policies):
    """Families with each of some policies.

    Rods that stretch go without those in which tensions jump from none to full: minutes a period.
    """
    cases = [
        pytest.param(family, policy, marks=marks)
        for family, (_, _, marks) in FAMILIES.items()
        for policy in policies
        if marks != SLOW or policy in ("hold", "uniform")
    ]
    return pytest.mark.parametrize(("make_one", "policy"), cases, indirect=["make_one"])


@driven(*POLICIES)
def test_observations_stay_inside_the_space(policy, make_one):
    env = make_one()
    observation, _ = env.reset(seed=1)
    assert env.observation_space.contains(observation)
    for observation, reward, terminated, truncated, info in steps(env, POLICIES[policy], 150):
        assert env.observation_space.contains(observation)
        assert isinstance(reward, float) and np.isfinite(reward)
        assert type(terminated) is type(truncated) is bool
        assert ("failure" in info) == terminated and not (terminated and truncated)
        assert np.all(info["tendon_tension"] >= 0)
    assert not (terminated and policy == "hold")


def test_episodes_end_by_time_or_where_a_pump_drives_the_arm_out(env_id, make_env):
    env = make_env(env_id, observe="all")
    for policy in ("hold", "pumping"):
        env.reset(seed=1)
        *_, (_, _, terminated, truncated, info) = steps(env, POLICIES[policy])
        assert (terminated, truncated) == (policy == "pumping", policy == "hold")
        assert ("failure" in info) == terminated


@pytest.mark.parametrize("ids", [ENVIRONMENTS, RIG_ENVIRONMENTS], ids=["arm", "rig"])
def test_spaces_are_finite_and_alike(ids, make_env):
    environments = [make_env(i, observe="all") for i in ids]
    first = environments[0]
    for env in environments:
        assert env.observation_space == first.observation_space
        assert env.action_space == first.action_space
    for name, box in first.observation_space.items():
        assert np.all(np.isfinite([box.low, box.high])), name
        assert np.all(box.low < box.high), name
        assert box.dtype == np.float64, name
        assert box.shape == (box.shape[0],), name
    assert first.action_space == gymnasium.spaces.Box(-1, 1, (3,), np.float32)


# ---------------------------------------------------------------- determinism, copies


@driven("uniform", "pumping")
def test_episodes_repeat_bitwise(policy, make_one):
    env, other = make_one(), make_one()
    runs = []
    for each in (env, other, env):  # a new environment, and the same one again
        start = each.reset(seed=7)
        runs.append(flatten((*start, *steps(each, POLICIES[policy], 100))))
    assert runs[0] == runs[1] == runs[2]


def test_seed_sets_the_generator(make_one):
    env = make_one()
    sampled = []
    for seed in (3, 3, 4):
        env.reset(seed=seed)
        sampled.append(env.np_random.random())
    assert sampled[0] == sampled[1] != sampled[2]
    assert env.np_random_seed == 4
    env.reset()
    assert env.np_random_seed == 4


@pytest.mark.parametrize("env_id", [*ENVIRONMENTS, *RIG_ENVIRONMENTS])
def test_episode_does_not_depend_on_the_seed(env_id, make_env):
    env = make_env(env_id, observe="all")
    assert flatten(env.reset(seed=1)) == flatten(env.reset(seed=2))


COPIES = {"pickle": lambda env: pickle.loads(pickle.dumps(env)), "deepcopy": copy.deepcopy}
SITUATIONS = {
    "nominal": {},
    "varied": {"youngs_modulus": 1.5, "density": 0.7},
    "rubbing and disturbed": {"tendon_friction": 1.0, "delay": 0.02, "sensor_noise": 1.0},
}


@pytest.mark.parametrize("situation", SITUATIONS)
def test_copies_continue_bitwise_and_are_independent(situation, make_one):
    env, vary = make_one(), dict(SITUATIONS[situation])
    fresh = [make_copy(env) for make_copy in COPIES.values()]
    for each in fresh:
        with pytest.raises(gymnasium.error.ResetNeeded):
            each.step(hold(each, None, None))
    if env.model is None and "tendon_friction" in vary:
        vary["tendon_friction"] = 0.0  # beam models have none
    env.reset(seed=0, options={"vary": vary})
    list(steps(env, uniform, 20))
    copies = [make_copy(env) for make_copy in COPIES.values()]
    # Side by side: none moves another.
    for expected, *found in zip(*(steps(e, switching, 20) for e in (env, *copies)), strict=True):
        assert all(flatten(result) == flatten(expected) for result in found)
    copies[-1].reset(options={"vary": {"density": 2.0}})
    continued = flatten(tuple(steps(env, uniform, 10, seed=1)))
    assert continued == flatten(tuple(steps(copies[0], uniform, 10, seed=1)))
    # Both go on to the same next episode, of the nominal robot.
    assert flatten(copies[0].reset()) == flatten(env.reset())
    expected = flatten(env.reset(seed=0))
    assert all(flatten(each.reset(seed=0)) == expected for each in (*fresh, copies[-1]))


# ---------------------------------------------------------------- time


@pytest.mark.parametrize(
    ("env_id", "fraction"),
    [(SWING, "1/1000"), *((env_id, x) for env_id in ENVIRONMENTS for x in ("1/49", "13/100"))],
)
def test_episode_lasts_as_long_as_the_task(env_id, fraction, make_env):
    period = float(Fraction(fraction))
    env = make_env(env_id, control_period=period)
    _, info = env.reset()
    assert info["time"] == 0
    results = list(steps(env, hold))
    for number, (*_, terminated, truncated, info) in enumerate(results, start=1):
        assert not terminated
        assert truncated == (number == len(results))
        assert info["time"] == pytest.approx(number * period, abs=1e-9)
    count = len(results)
    assert gymnasium.make(env.spec).spec.max_episode_steps == env.spec.max_episode_steps == count
    for _ in range(2):
        with pytest.raises(gymnasium.error.ResetNeeded, match="reset"):
            env.step(hold(env, None, None))
    # Exact: 15 / (1 / 49) is a little over 735 in floating point.
    assert count == ceil(Fraction(env.task.duration) / Fraction(fraction))
    assert env.data.time == pytest.approx(count * period, rel=1e-9)
    assert env.model.opt.timestep <= period
    env.reset()
    env.step(hold(env, None, None))


# ---------------------------------------------------------------- actions

ACTIONS = (0.5, -0.25, 1.0)


#: Sequences and arrays of other kinds, and what is a rounding beyond the bounds: its meaning.
SAME_ACTIONS = [
    *((kind(ACTIONS), ACTIONS) for kind in (list, tuple, partial(array, "f"), partial(array, "d"))),
    *((np.array([1, -1, 0], kind), (1.0, -1.0, 0.0)) for kind in ("f4", "f8", "f2", "i8", "i1")),
    *((np.array([1 + x, -1 - x, 0.3]), (1, -1, 0.3)) for x in (1e-7, 9e-7)),
]


@pytest.mark.parametrize(("given", "meant"), SAME_ACTIONS, ids=str)
def test_actions_are_taken_as_what_they_mean(given, meant, make_env):
    env, other = make_env(), make_env()
    many, others = (gymnasium.make_vec(SWING, num_envs=2) for _ in range(2))
    for each in (env, other, many, others):
        each.reset()
    assert flatten(env.step(given)) == flatten(other.step(np.array(meant)))
    assert flatten(many.step([given, given])) == flatten(others.step(np.array([meant, meant])))


# ---------------------------------------------------------------- observations


#: Unless told otherwise.
_DEFAULT = tuple(
    name for name in known_of(ARM) if not name.startswith(("tendon", "reference_acceleration"))
)


@pytest.mark.parametrize(
    ("observe", "names"),
    [
        ("all", known_of(ARM)),
        (_DEFAULT, _DEFAULT),
        *(((name,), (name,)) for name in known_of(ARM)),
        (["reference", "curvature"], ("reference", "curvature")),
    ],
    ids=str,
)
def test_observe_chooses(observe, names, make_env):
    env, full = make_env(observe=observe), make_env(observe="all")
    full.reset()
    env.reset()
    for (observation, *_), (everything, *_) in zip(
        steps(env, uniform, 5), steps(full, uniform, 5), strict=True
    ):
        assert set(observation) == set(names)
        # FlattenObservation relies on the order.
        assert list(observation) == list(env.observation_space)
        for name, value in observation.items():
            np.testing.assert_array_equal(value, everything[name])


def test_default_observables(make_env):
    assert set(make_env().observation_space) == set(_DEFAULT)


DISCRETISATIONS = {
    "default": {},
    "one hinge a piece": {"rule": "midpoint"},
    "uneven hinges": {"rule": "gauss3", "pieces": 9},
    "fine": {"pieces": 12, "control_period": 0.004},
    "one substep": {"control_period": 0.002},
    "RK4": {"integrator": "RK4", "timestep": 5e-5, "control_period": 0.005},
}


@pytest.mark.parametrize("name", DISCRETISATIONS)
def test_sensors_are_current(name, make_env):
    """Every read-out belongs to the state at the end of the step, not to the one before it."""
    env = make_env("SoftRobot/ArmStep-v0", observe="all", **DISCRETISATIONS[name])
    env.reset()
    model = env.model
    pieces = env.observation_space["curvature"].shape[0]
    stations = np.cumsum(model.body_pos[1:, 2])[: model.nv]
    piece = (stations / (0.5 / pieces)).astype(int)
    assert np.all(np.bincount(piece) == model.nv / pieces)
    tip = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_SITE, "tip")
    jacobian = np.zeros((3, model.nv))
    for observation, *_, info in steps(env, uniform, 20):
        data = copy.copy(env.data)
        mujoco.mj_forward(model, data)
        mujoco.mj_jacSite(model, data, jacobian, None, tip)
        x, y, z = data.site_xpos[tip]
        # Rounding: the same kinematics in another order.
        close = partial(np.testing.assert_allclose, rtol=1e-10, atol=1e-12)
        close(observation["tip_position"], [x, z])
        assert abs(y) < 1e-12
        close(observation["tip_velocity"], (jacobian @ data.qvel)[[0, 2]])
        close(observation["curvature"], np.bincount(piece, data.qpos) / (0.5 / pieces))
        close(observation["curvature_rate"], np.bincount(piece, data.qvel) / (0.5 / pieces))
        bend = [np.sum(data.qpos[stations < end]) for end in (0.5 / 3, 1 / 3, 0.5)]
        lengths = [
            end - r * b
            for end, b in zip((0.5 / 3, 1 / 3, 0.5), bend, strict=True)
            for r in (0.025, -0.025)
        ]
        close(observation["tendon_length"], lengths)
        close(info["tendon_length"], lengths)
        close(info["error"], np.hypot(*(observation["tip_position"] - observation["reference"])))


@pytest.mark.parametrize("period", [0.01, 0.2])
@pytest.mark.parametrize("env_id", [*ENVIRONMENTS, *RIG_ENVIRONMENTS])
def test_reference_is_the_trajectory(env_id, period, make_env):
    preview = (0.0, 0.033, 0.1, 2.0)
    env = make_env(env_id, observe="all", control_period=period, preview=preview)
    start, trajectory = env.reset(), env.task.trajectory
    for observation, *_, info in [start, *[*steps(env, hold, 200)][::5]]:
        now, later = np.array([info["time"]]), info["time"] + np.array(preview)
        for name, values in (
            ("reference", trajectory.position(now)),
            ("reference_velocity", trajectory.velocity(now)),
            ("reference_acceleration", trajectory.acceleration(now)),
            ("reference_preview", trajectory.position(later)),
        ):
            # Instants are rounded to 1 ns.
            expected = values[:, env.axes].ravel()
            np.testing.assert_allclose(observation[name], expected, atol=1e-8, err_msg=name)


def test_velocity_just_after_a_kink_at_any_period(make_env):
    """1245 periods are 5 s but for rounding: the corner of the L, whose second leg runs along x."""
    period = 0.004016064257028112
    env = make_env("SoftRobot/ArmLShape-v0", control_period=period)
    env.reset()
    observation, *_ = list(steps(env, hold, 1245))[-1]
    np.testing.assert_allclose(observation["reference_velocity"], [0.022, 0.0], atol=1e-12)


# ---------------------------------------------------------------- nothing is shared


def arrays(result):
    """Arrays of an observation or info, nested dicts included."""
    for value in result.values():
        if isinstance(value, dict):
            yield from arrays(value)
        elif isinstance(value, np.ndarray) and value.dtype == float:
            yield value


def assert_unshared(env, untouched):
    """What is written into results reaches neither the environment nor other results."""
    (observation, info), _ = env.reset(seed=0), untouched.reset(seed=0)
    rng, written = np.random.default_rng(3), []
    for k in range(30):
        for value in (*arrays(observation), *arrays(info)):
            value[...] = 1e9 + k
            written.append((value, 1e9 + k))
        info.clear()
        action = uniform(env, None, rng)
        expected = flatten(untouched.step(action.copy()))
        result = env.step(action)
        assert flatten(result) == expected
        action[:] = 0.5  # the environment kept no view of it
        observation, *_, info = result
    assert flatten(env.reset()) == flatten(untouched.reset())
    assert all(np.all(value == number) for value, number in written)


def test_written_results_reach_nothing_else(make_one):
    assert_unshared(make_one(), make_one())


def test_written_results_of_many_reach_nothing_else():
    assert_unshared(*(gymnasium.make_vec(SWING, num_envs=2, observe="all") for _ in range(2)))


# ---------------------------------------------------------------- Gymnasium's wrappers, vectors


@pytest.mark.filterwarnings("ignore::softrobot_env.scene.timestep.TimestepWarning")
@pytest.mark.slow  # copies by pickle, which the processes get, are tested above
def test_asynchronous_environments(make_env):
    """Two copies side by side, through the automatic reset, equal to one alone."""
    name = "SoftRobot/ArmStep-v0"
    factory = partial(gymnasium.make, f"softrobot_env:{name}", control_period=0.2)
    # Forking a process with running threads is deprecated; a fresh one costs an import.
    vector = AsyncVectorEnv([factory] * 2, context="spawn")
    singles = {i: make_env(name, control_period=0.2) for i in range(2)}
    try:
        resets = vector.reset(seed=0), {i: env.reset(seed=i) for i, env in singles.items()}
        rows = np.random.default_rng(0).uniform(-0.5, 0.5, (60, 2, 3)).astype(np.float32)
        list(alike(vector, singles, resets, rows, rtol=0, atol=0))  # 25 steps an episode
    finally:
        vector.close()
