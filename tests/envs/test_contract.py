"""What every environment promises and libraries rely on: every id, single, vectorised, real."""

import copy
import pickle
from array import array
from contextlib import closing, contextmanager
from fractions import Fraction
from functools import partial
from math import ceil

import gymnasium
import mujoco
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env
from gymnasium.vector import AutoresetMode
from support.episodes import POLICIES, hold, pumping, steps, switching, uniform
from support.example_robots import EVERY_ROBOT
from support.processes import in_a_fork
from support.real_episodes import live_rig
from support.rig_episodes import flatten

from softrobot_env.beams.registry import BeamPlant
from softrobot_env.envs.observations.table import known_of
from softrobot_env.envs.randomization import Randomization
from softrobot_env.envs.rewards import TERMS
from softrobot_env.registration import (
    ANY_ROBOT,
    ENVIRONMENTS,
    GRIPPER_ENVIRONMENTS,
    REAL_ENVIRONMENTS,
    RIG_ENVIRONMENTS,
)
from softrobot_env.robots import ARM

SWING = "SoftRobot/ArmSwing-v0"
SLOW = pytest.mark.slow  # models that take half a minute to compile

TASKS = [*ENVIRONMENTS, *RIG_ENVIRONMENTS]
SIMULATED = [*TASKS, *ANY_ROBOT]
REAL = [pytest.param(i, marks=pytest.mark.realtime(late=0.4)) for i in REAL_ENVIRONMENTS]

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


# ---------------------------------------------------------------- determinism, copies


@pytest.mark.parametrize("env_id", TASKS)
def test_episode_does_not_depend_on_the_seed(env_id, make_env):
    env = make_env(env_id, observe="all")
    assert flatten(env.reset(seed=1)) == flatten(env.reset(seed=2))


COPIES = {"pickle": lambda env: pickle.loads(pickle.dumps(env)), "deepcopy": copy.deepcopy}
SITUATIONS = {
    "nominal": {},
    "varied": {"youngs_modulus": 1.5, "density": 0.7},
    "rubbing and disturbed": {"tendon_friction": 1.0, "delay": 0.02, "sensor_noise": 1.0},
}


# Tendons that rub and actions at random: after each jump the speed may be wrong for a moment.
@pytest.mark.filterwarnings("ignore::softrobot_env.scene.timestep.TimestepWarning")
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
    [
        ("SoftRobot/ArmStep-v0", "1/1000"),
        *((env_id, x) for env_id in ENVIRONMENTS for x in ("1/49", "13/100")),
    ],
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
DEFAULT = tuple(
    name for name in known_of(ARM) if not name.startswith(("tendon", "reference_acceleration"))
)


@pytest.mark.parametrize(
    ("options", "names"),
    [
        ({"observe": "all"}, known_of(ARM)),
        ({}, DEFAULT),
        *(({"observe": (name,)}, (name,)) for name in known_of(ARM)),
        ({"observe": ["reference", "curvature"]}, ("reference", "curvature")),
    ],
    ids=str,
)
def test_observe_chooses(options, names, make_env):
    env, full = make_env(**options), make_env(observe="all")
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


@pytest.mark.parametrize("period", [0.01, 0.2])
@pytest.mark.parametrize("env_id", TASKS)
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


@contextmanager
def made(env_id, **options):
    """An environment by its id; a real one with a board in memory that needs no clock."""
    if env_id not in REAL_ENVIRONMENTS:
        with closing(gymnasium.make(env_id, **options)) as env:
            yield env
        return
    with live_rig(partial(gymnasium.make, env_id), **options) as env:
        yield env


def still(env):
    return np.zeros(env.action_space.shape, np.float32)


def assert_flat(info):
    for name, value in info.items():
        if isinstance(value, np.ndarray):
            assert value.dtype == np.float64, name
        else:
            assert type(value) in (np.float64, str, bool), name


# ---------------------------------------------------------------- info


@pytest.mark.parametrize("env_id", [*SIMULATED, *REAL])
def test_info_is_flat_with_the_same_keys_at_every_step(env_id):
    with made(env_id) as env:
        reported = [env.reset(seed=0)[1], *(env.step(still(env))[4] for _ in range(5))]
    for info in reported:
        assert list(info) == list(reported[0])
        assert_flat(info)
    assert set(TERMS) < set(reported[0]) and all(reported[0][name] == 0 for name in TERMS)


@pytest.mark.parametrize("observe_as", ["dict", "vector"])
@pytest.mark.parametrize("env_id", SIMULATED)
def test_a_failed_step_shows_what_was_seen_before_it_and_says_why(env_id, observe_as):
    with made(env_id, observe_as=observe_as) as env:
        last, first = env.reset()
        env.unwrapped.data.qvel[0] = np.nan
        observation, _, terminated, _, info = env.step(still(env))
    assert observation is not last and flatten(observation) == flatten(last)
    assert terminated and info.pop("failure") and list(info) == list(first)
    assert_flat(info)


# Of a control period that is long for the arm.
@pytest.mark.filterwarnings("ignore::softrobot_env.scene.timestep.TimestepWarning")
@pytest.mark.parametrize("mode", AutoresetMode)
@pytest.mark.parametrize("env_id", SIMULATED)
def test_info_of_many_has_the_keys_of_one(env_id, mode):
    ranges = Randomization(density=(0.9, 1.1), sensor_noise=(1.0, 2.0))
    options = {"randomization": ranges, "control_period": 0.1}
    with made(env_id, **options) as single:
        _, one = single.reset(seed=0)
    options |= {"num_envs": 2, "max_episode_steps": 3}
    many = gymnasium.make_vec(env_id, autoreset_mode=mode, **options)
    _, first = many.reset(seed=0)
    assert {name for name in first if name[0] != "_"} == set(one)
    assert {name[1:] for name in first if name[0] == "_"} == set(one)
    last = {"final_obs", "_final_obs", "final_info", "_final_info"}
    for k in range(3):
        *_, truncated, info = many.step(still(many))
        assert truncated.tolist() == [k == 2] * 2
        assert set(info) - last == set(first)
        assert all(not isinstance(v, dict) for k, v in info.items() if k not in last)
    assert ("final_info" in info) == (mode == AutoresetMode.SAME_STEP)


# ---------------------------------------------------------------- making


@pytest.mark.parametrize("env_id", [*SIMULATED, *REAL])
def test_an_unknown_argument_is_told_as_python_does_with_those_allowed(env_id):
    message = "got an unexpected keyword argument 'frameskip'; allowed are .*control_period"
    real = env_id in REAL_ENVIRONMENTS
    for make in (gymnasium.make,) if real else (gymnasium.make, gymnasium.make_vec):
        with pytest.raises(TypeError, match=message) as caught:
            make(env_id, frameskip=1)
        assert "\n" not in str(caught.value)


@pytest.mark.parametrize("env_id", [*SIMULATED, *REAL])
def test_direct_bases_and_spec(env_id):
    with made(env_id) as env:
        assert gymnasium.Env in type(env.unwrapped).__bases__
        assert env is env.unwrapped, "no wrapper"
        steps = ceil(env.task.duration / env.control_period - 1e-9)
        assert env.spec.max_episode_steps == steps
        assert env.spec.nondeterministic == (env_id in REAL_ENVIRONMENTS)
        assert env.spec.id == env_id


@pytest.mark.parametrize("env_id", SIMULATED)
def test_many_as_gymnasium_defines_them(env_id):
    for mode in AutoresetMode:
        many = gymnasium.make_vec(env_id, num_envs=2, autoreset_mode=mode)
        assert many.metadata["autoreset_mode"] is many.autoreset_mode is mode
        again = gymnasium.make_vec(many.spec)
        assert again.autoreset_mode is mode and again.num_envs == 2
        assert again.spec.max_episode_steps == many.spec.max_episode_steps
    assert gymnasium.vector.VectorEnv in type(many).__bases__
    assert type(many).metadata["autoreset_mode"] is AutoresetMode.NEXT_STEP


# ---------------------------------------------------------------- bounds of observations

#: Light, stiff and undamped, heavy and soft: the tips are the fastest there are.
EXTREMES = (
    {"youngs_modulus": 5.0, "density": 0.1, "damping_time": 0.0},
    {"youngs_modulus": 0.2, "density": 10.0, "damping_time": 0.0},
    {"density": 0.1, "damping_time": 0.1, "tension_gain": 2.0},
    {"youngs_modulus": 50.0, "density": 0.1, "damping_time": 0.0},
)


@pytest.mark.filterwarnings("ignore::softrobot_env.scene.timestep.TimestepWarning")
@pytest.mark.parametrize("vary", EXTREMES, ids=str)
@pytest.mark.parametrize("policy", [pumping, switching])
def test_extreme_motion_stays_within_the_bounds(policy, vary):
    with made("SoftRobot/ArmSwing-v0", observe="all") as env:
        env.reset(seed=0, options={"vary": vary})
        most = 0.0
        for observation, _, failed, _, info in steps(env, policy, 60):
            assert env.observation_space.contains(observation)
            if failed:
                assert "curvature" in info["failure"]  # folded, and not too fast
                break
            share = {n: np.abs(v) / env.observation_space[n].high for n, v in observation.items()}
            most = max(most, *share["tip_velocity"], *share["curvature_rate"])
        assert most < 0.5


@pytest.mark.parametrize("ids", [ENVIRONMENTS, RIG_ENVIRONMENTS], ids=["arm", "rig"])
def test_spaces_of_a_robot_are_alike_and_of_useful_size(ids, make_env):
    space, *others = (make_env(i, observe="all").observation_space for i in ids)
    assert all(other == space for other in others)
    assert {box.dtype for box in space.values()} == {np.dtype(np.float64)}
    # Sound in the material of both robots is at some 25 m/s.
    assert 100 < space["tip_velocity"].high.max() < 2000
    assert 1e4 < space["curvature_rate"].high.max() < 1e7


@pytest.mark.parametrize("env_id", ["SoftRobot/ArmSwing-v0", "SoftRobot/RigTriangle-v0"])
@pytest.mark.parametrize("what", ["tip speed", "norm of the hinge rates"])
def test_what_is_faster_than_the_bounds_is_a_failure(env_id, what):
    """Hinges that turn against each other leave the tip at rest."""
    with made(env_id, observe="all") as env:
        env.reset()
        model, data, readout = env.unwrapped.model, env.unwrapped.data, env.unwrapped._readout
        jacobian, limits = np.zeros((3, model.nv)), readout._measures
        mujoco.mj_jacSite(model, data, jacobian, None, model.site("tip").id)
        rates = np.random.default_rng(0).standard_normal(model.nv)
        unit = np.linalg.norm((jacobian @ rates)[env.unwrapped.axes]) / limits.speed
        if what != "tip speed":
            rates -= np.linalg.pinv(jacobian) @ jacobian @ rates
            unit = np.linalg.norm(rates) / limits.turning
        for factor in (0.9, 1.1):
            data.qvel[:] = rates * factor / unit
            mujoco.mj_forward(model, data)
            reported = readout.update()
            assert reported is None if factor < 1 else what in reported


def test_many_fail_by_the_same_bounds():
    many = gymnasium.make_vec("SoftRobot/ArmSwing-v0", num_envs=3, observe="all")
    many.reset()
    limits = many._exact._measures
    many.simulation.qvel[1] = 2 * limits.turning
    many._exact.update()
    assert many._exact.outside.tolist() == [False, True, False]
    assert "norm of the hinge rates" in many._exact.what_left(1, 0.0)


# ---------------------------------------------------------------- copies, processes


@pytest.mark.parametrize("way", [copy.copy, copy.deepcopy, pickle.dumps])
def test_many_are_not_copied(way):
    many = gymnasium.make_vec(SIMULATED[0], num_envs=2)
    with pytest.raises(TypeError, match="cannot be copied or pickled"):
        way(many)


def test_many_refuse_a_forked_child_and_go_on_here():
    many = gymnasium.make_vec(SIMULATED[0], num_envs=2)
    many.reset()
    reported = "RuntimeError: these simulations belong to process"
    assert in_a_fork(lambda: many.step(still(many))).startswith(reported)
    assert in_a_fork(many.reset).startswith(reported)
    assert in_a_fork(many.simulation._batch._delete) == ""
    many.step(still(many))


@pytest.mark.realtime(late=0.4)
def test_a_forked_child_does_not_drive_the_real_robot():
    with made(*REAL_ENVIRONMENTS) as env:
        env.reset()
        for act in (lambda: env.step(still(env)), env.reset):
            assert in_a_fork(act).startswith("RuntimeError: this robot is driven by process")
        assert env.step(still(env))[4]["device_state"] == "running"


def test_one_steps_in_a_forked_child():
    with made(SIMULATED[0]) as env:
        env.reset()
        assert in_a_fork(lambda: env.step(still(env))) == ""


# ---------------------------------------------------------------- the checkers


#: Ids and options; the real robot comes to rest before every one of many episodes.
CHECKED = [*EVERY_ROBOT.args[1], *(pytest.param(i, {}, id=i) for i in GRIPPER_ENVIRONMENTS)]
CHECKED += [
    pytest.param(i, {}, marks=[*REAL[0].marks, pytest.mark.slow], id=i) for i in REAL_ENVIRONMENTS
]
CHECKED += [pytest.param(SIMULATED[0], {"plant": BeamPlant("pcc")}, id="pcc")]


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("observe_as", ["dict", "vector"])
@pytest.mark.parametrize(("env_id", "options"), CHECKED)
def test_the_checkers_have_nothing_to_say(env_id, options, observe_as):
    with made(env_id, observe="all", observe_as=observe_as, **options) as env:
        check_env(env.unwrapped, skip_render_check=True)
        sb3 = pytest.importorskip("stable_baselines3.common.env_checker", reason="needs extra rl")
        sb3.check_env(env, warn=observe_as == "vector" or env_id not in GRIPPER_ENVIRONMENTS)
