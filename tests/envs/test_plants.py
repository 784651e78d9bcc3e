"""A beam model in place of the MuJoCo chain: the same environment, another plant."""

from dataclasses import replace
from functools import cache
from importlib.util import find_spec

import numpy as np
import pytest

from softrobot_env.beams.registry import MUJOCO, PLANTS, BeamPlant
from softrobot_env.cli import main
from softrobot_env.control.registry import POLICIES, make_policy, policy_environment
from softrobot_env.envs.tracking import TrackingEnv
from softrobot_env.evaluation.run import run_episode
from softrobot_env.robots import ARM, centerline
from softrobot_env.tasks import make_task
from studies.truths.continuum_arc import continuum_arc

BEAMS = tuple(
    name
    for name in PLANTS
    if name != MUJOCO and find_spec(f"softrobot_env.beams.{name}") is not None
)
#: Compiling the other plants takes half a minute each; the models are tested in tests/beams.
EACH = [n if n == "pcc" else pytest.param(n, marks=pytest.mark.slow) for n in BEAMS]
ENDS = np.array([0.5 / 3, 1 / 3, 0.5])


@cache
def environment(name, task="swing", **options):
    """One environment a plant and task, so that models are built once."""
    plant = None if name == MUJOCO else BeamPlant(name)
    return TrackingEnv(task, observe="all", plant=plant, **options)


def episode(env, seed, count):
    """Results of random actions."""
    rng = np.random.default_rng(seed)
    return [env.step(rng.uniform(-0.3, 0.3, 3).astype(np.float32)) for _ in range(count)]


# ---------------------------------------------------------------- the contract


@pytest.mark.parametrize("name", EACH)
def test_observables_have_the_chains_names_and_shapes(name):
    chain, env = environment(MUJOCO), environment(name)
    assert env.action_space == chain.action_space
    assert list(env.observation_space) == list(chain.observation_space)
    for key, box in chain.observation_space.items():
        ours = env.observation_space[key]
        assert ours.shape == box.shape and ours.dtype == box.dtype
        if name == "pcc" or key not in ("tip_position", "tendon_length"):
            assert ours == box, key
        else:
            assert np.all(ours.low < box.low) and np.all(ours.high > box.high), key


# ---------------------------------------------------------------- postures


def inextensible(robot, force, moment):
    """Stretch and curvature of a piece that only bends."""
    return 1.0, moment / robot.bending_stiffness


def compressed(robot, force, moment):
    """The same for a rod that is linear in both."""
    return 1 + force / (robot.youngs_modulus * robot.area), moment / robot.bending_stiffness


def continuum(robot, force, moment):
    """The same for a continuum; one tendon at the outer radius does what the tendons do here."""
    return continuum_arc(robot, 0.0, -force, -moment / force)


#: Beam theory of a piece under an axial force and a moment, by plant.
THEORY = {"pcc": inextensible, "cosserat": compressed, "ancf": continuum}


def closed_form(robot, tension, theory):
    """Curvature and stretch (6,) and tip (2,) under tensions in continuous channels.

    A channel's tension bends by its moment arm and compresses the fibre, up to where it ends.
    """
    middles = robot.length / 6 * (np.arange(6) + 0.5)
    inside = np.array([[s < t.end for s in middles] for t in robot.tendons])
    moment_arm = np.array([t.offset[0] for t in robot.tendons])
    forces, moments = -tension @ inside, (moment_arm * tension) @ inside
    pieces = [theory(robot, f, m) for f, m in zip(forces, moments, strict=True)]
    stretch, curvature = (np.array(x) for x in zip(*pieces, strict=True))
    points = centerline(robot, curvature, points=400)[:, ::2]
    chords = np.diff(points, axis=0) * np.repeat(stretch, 400)[:, None]
    return curvature, stretch, chords.sum(axis=0)


@pytest.mark.parametrize("task", ["swing", "lshape"])
@pytest.mark.parametrize("name", EACH)
def test_the_start_is_the_equilibrium_of_beam_theory(name, task):
    env = environment(name, task)
    observation, info = env.reset()
    curvature, stretch, tip = closed_form(ARM, info["tendon_tension"], THEORY[name])
    exact = name == "pcc"
    np.testing.assert_allclose(observation["tip_position"], tip, atol=1e-6 if exact else 2.5e-3)
    np.testing.assert_allclose(
        observation["curvature"], curvature, rtol=1e-8 if exact else 0.13, atol=0
    )
    np.testing.assert_array_equal(observation["curvature_rate"], 0)
    np.testing.assert_array_equal(observation["tip_velocity"], 0)
    piece = ARM.length / 6
    lengths = [
        sum(
            (stretch[k] - t.offset[0] * curvature[k]) * piece
            for k in range(6)
            if (k + 0.5) * piece < t.end
        )
        for t in ARM.tendons
    ]
    np.testing.assert_allclose(observation["tendon_length"], lengths, atol=1e-9 if exact else 1e-3)


def test_the_chain_starts_where_pcc_does():
    """Its hinges shorten an arc of piece angle a by the share (1/3 - 0.3) a^2 / 4 and less."""
    for task in ("swing", "lshape", "step"):
        ours = environment("pcc", task).reset()[0]
        chain = environment(MUJOCO, task).reset()[0]
        np.testing.assert_allclose(ours["curvature"], chain["curvature"], rtol=1e-6)
        angle = np.max(np.abs(chain["curvature"])) * ARM.length / 6
        bound = ARM.length * (1 / 3 - 0.3) * angle**2 / 4
        assert np.linalg.norm(ours["tip_position"] - chain["tip_position"]) < bound


@pytest.mark.parametrize("name", EACH)
def test_a_start_curvature_is_what_is_measured(name):
    env = environment(name)
    wanted = np.array([3.0, 1.0, -2.0, -1.0, 0.5, 2.0])
    observation, _ = env.reset(options={"start_curvature": wanted})
    np.testing.assert_allclose(observation["curvature"], wanted, atol=1e-6)
    np.testing.assert_array_equal(observation["curvature_rate"], 0)
    tip = centerline(ARM, wanted)[-1, ::2]
    np.testing.assert_allclose(
        observation["tip_position"], tip, atol=1e-9 if name == "pcc" else 3e-3
    )


def test_an_impossible_start_curvature_is_refused():
    env = TrackingEnv("swing", plant=BeamPlant("pcc", pieces=3))
    env.reset(options={"start_curvature": [1.0, 1.0, 2.0, 2.0, 3.0, 3.0]})
    with pytest.raises(ValueError, match=r"PCC with 3 coordinates cannot take .* more pieces"):
        env.reset(options={"start_curvature": [1.0, 2.0, 2.0, 2.0, 3.0, 3.0]})


# ---------------------------------------------------------------- motion


def test_pcc_swings_like_the_chain():
    records = []
    for name in (MUJOCO, "pcc"):
        env = environment(name)
        policy = make_policy("feedforward", ARM, env.control_period)
        records.append(run_episode(env, policy))
    chain, pcc = records
    assert np.max(np.linalg.norm(chain.tip - pcc.tip, axis=1)) < 1.2e-3
    assert np.max(pcc.error) > 5e-3  # it does lag behind
    assert pcc.failure is None


@pytest.mark.parametrize("name", EACH)
def test_the_default_tolerance_is_enough(name):
    """Against a hundred times tighter: far below what models differ by."""
    loose, tight = (TrackingEnv("swing", plant=BeamPlant(name, tolerance=t)) for t in (None, 1e-7))
    loose.reset(), tight.reset()
    errors = []
    for k in range(60):  # full tension against the bend, then with it: fast motion
        action = np.full(3, -0.4 if (k // 20) % 2 else 0.2, np.float32)
        (one, *_), (other, *_) = loose.step(action), tight.step(action)
        errors.append(np.max(np.abs(one["tip_position"] - other["tip_position"])))
    assert 0 < max(errors) < 2e-4


def test_a_fixed_step_is_used():
    """Jumps of the inputs excite stiff modes, which cost an L-stable method part of its order."""
    tips = []
    for step in (1e-2, 2.5e-3, 2.5e-4, None):
        env = TrackingEnv("swing", plant=BeamPlant("pcc", step=step, tolerance=1e-10))
        env.reset()
        tips.append(episode(env, 0, 10)[-1][0]["tip_position"])
        if step is not None:
            assert env.simulation.plant._work.counters[0] == round(0.01 / step)
    errors = [np.linalg.norm(tip - tips[-1]) for tip in tips[:-1]]
    assert 1e-3 > errors[0] > 3 * errors[1] > 9 * errors[2]


@pytest.mark.parametrize(
    "policy", [pytest.param(p, marks=pytest.mark.slow if "mpc" in p else ()) for p in POLICIES]
)
@pytest.mark.parametrize("name", EACH)
def test_policies_run(name, policy):
    options = {"control_period": 0.01, **policy_environment(policy)}
    env = TrackingEnv("lshape", observe="all", plant=BeamPlant(name), **options)
    controller = make_policy(policy, ARM, env.control_period)
    record = run_episode(env, controller, options={"duration": 0.1})
    assert record.failure is None
    assert len(record.time) == 1 + round(0.1 / env.control_period)
    if name == "pcc":
        assert np.max(record.error) < 0.03


@pytest.mark.parametrize("name", EACH)
def test_a_varied_plant_is_that_of_the_varied_robot(name):
    scales = {"youngs_modulus": 0.75, "density": 2.0, "damping_time": 0.5}
    env = environment(name)
    env.reset(options={"vary": scales})
    start = env.simulation.q.copy()
    varied = episode(env, 4, 5)
    task = replace(make_task("swing"), robot=ARM.vary(**scales))
    other = TrackingEnv(task, observe="all", plant=BeamPlant(name))
    other.reset()
    other.simulation.reset(start, env.reset(options={"vary": scales})[1]["tendon_tension"])
    expected = episode(other, 4, 5)
    for (one, *_), (two, *_) in zip(varied, expected, strict=True):
        np.testing.assert_array_equal(one["tip_position"], two["tip_position"])
    env.reset()
    nominal = episode(env, 4, 5)
    assert np.linalg.norm(nominal[-1][0]["tip_position"] - varied[-1][0]["tip_position"]) > 1e-3


# ---------------------------------------------------------------- failures


@pytest.mark.parametrize("name", ["pcc", pytest.param("cosserat", marks=pytest.mark.slow)])
def test_leaving_the_workspace_ends_the_episode(name):
    """Thrown into a sharper bend from just inside the limit, which a continuum cannot reach."""
    env = environment(name)
    env.reset(options={"start_curvature": np.full(6, 39.5)})
    simulation = env.simulation
    further = simulation.plant.bent(np.full(6, 39.6))
    simulation.v[:] = (further - simulation.q) * 5000
    assert env._readout.update() is None
    observation, _, terminated, truncated, info = env.step(np.ones(3, np.float32))
    assert (terminated, truncated) == (True, False)
    assert info["failure"].startswith("left the workspace: curvature ")
    assert "+-40 1/m at t = 0.010 s" in info["failure"]
    assert env.observation_space.contains(observation)


# ---------------------------------------------------------------- pictures and commands


def test_what_is_drawn_has_the_measured_curvature():
    env = environment("pcc")
    observation, _ = env.reset()
    frame = env._frame()
    np.testing.assert_allclose(
        frame.qpos.reshape(6, -1).sum(axis=1) * 12, observation["curvature"], rtol=1e-12
    )
    assert env.scene is env.model is env.data is None


def test_bad_plants_are_named(capsys):
    with pytest.raises(ValueError, match="pcc, cosserat, ancf"):
        BeamPlant("fem")
    with pytest.raises(SystemExit):
        main(["evaluate", "--plant", "fem"])
    text = capsys.readouterr().err
    assert all(name in text for name in PLANTS)
