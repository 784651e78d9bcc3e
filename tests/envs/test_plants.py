"""Beam models in place of the MuJoCo chain: the arm's environment, and plants of any robot."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from numpy.testing import assert_allclose

from softrobot_env.beams.registry import MUJOCO, BeamPlant
from softrobot_env.envs.simulation.plants import BeamPlant as SteppedPlant
from softrobot_env.envs.simulation.plants import MujocoPlant
from softrobot_env.envs.tracking import TrackingEnv
from softrobot_env.robots import ARM, ROBOTS, centerline
from softrobot_env.scene.build import build_scene
from softrobot_env.scene.servos import Servos
from softrobot_env.tasks import make_task

#: Compiling the other plants takes half a minute each; the models are tested in tests/beams.
EACH = ["pcc", *(pytest.param(n, marks=pytest.mark.slow) for n in ("cosserat", "ancf"))]


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


@pytest.mark.parametrize("task", ["swing", "lshape"])
def test_the_start_is_the_equilibrium_of_the_tendons(task):
    """A channel's tension bends each piece by its moment arm, up to where it ends."""
    observation, info = environment("pcc", task).reset()
    piece = ARM.length / 6
    ends = [[(k + 0.5) * piece < t.end for k in range(6)] for t in ARM.tendons]
    arms = np.array([t.offset[0] for t in ARM.tendons])[:, None] * ends
    curvature = info["tendon_tension"] @ arms / ARM.bending_stiffness
    np.testing.assert_allclose(observation["curvature"], curvature, rtol=1e-8)
    tip = centerline(ARM, curvature)[-1, ::2]
    np.testing.assert_allclose(observation["tip_position"], tip, atol=1e-6)
    lengths = [t.end for t in ARM.tendons] - arms @ curvature * piece
    np.testing.assert_allclose(observation["tendon_length"], lengths, atol=1e-9)
    for rate in ("curvature_rate", "tip_velocity"):
        np.testing.assert_array_equal(observation[rate], 0)


def test_an_impossible_start_curvature_is_refused():
    env = TrackingEnv("swing", plant=BeamPlant("pcc", pieces=3))
    env.reset(options={"start_curvature": [1.0, 1.0, 2.0, 2.0, 3.0, 3.0]})
    with pytest.raises(ValueError, match=r"PCC with 3 coordinates cannot take .* more pieces"):
        env.reset(options={"start_curvature": [1.0, 2.0, 2.0, 2.0, 3.0, 3.0]})


# ---------------------------------------------------------------- motion


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


@pytest.mark.parametrize("step", [1e-2, 2.5e-3, 2.5e-4])
def test_a_fixed_step_is_used(step):
    env = TrackingEnv("swing", plant=BeamPlant("pcc", step=step))
    env.reset()
    env.step(np.zeros(3, np.float32))
    assert env.simulation.plant._work.counters[0] == round(0.01 / step)


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


# ---------------------------------------------------------------- any robot

SPACE = slice(0, 3)
#: Control period [s], and control periods of a motion.
PERIOD, STEPS = 0.02, 10

#: Robot, how it is driven, whether it twists, pieces for each of its own, and controls [m or N].
CASES = {
    "rig_equivalent": ("length", False, 4, [0.010, 0.0, 0.002]),
    "silicone_rod": ("length", False, 1, [0.006, 0.0, 0.002]),
    "hanging_trunk": ("tension", True, 1, [12.0, 0.0, 3.0, 0.0, 7.0, 0.0]),
}


def pulled(plant, drive, control):
    """Tips (k, 3) [m] of a motion from rest, then what is measured in equilibrium, by name."""
    servos = Servos(0.1, np.zeros(len(control)), np.zeros(len(control)))
    servos = servos if drive == "length" else None
    simulation = plant.simulation({})
    if servos is not None:
        simulation.drive_by(servos)
    simulation.reset(plant.equilibrium(0 * control), 0 * control)
    readout, tips = plant.readout(simulation, servos), []
    for _ in range(STEPS):
        (simulation.ctrl if servos is None else servos.command)[:] = control
        assert simulation.advance() and readout.update() is None
        tips.append(tip_of(simulation, readout))
    simulation.reset(plant.equilibrium(control), control)
    assert readout.update() is None
    return (
        np.array(tips),
        tip_of(simulation, readout),
        bends(readout.curvature(), plant),
        readout.tendon_tension(),
        bends(readout.curvature_rate(), plant),
    )


def bends(curvature, plant):
    """Beta and gamma of each piece; a chain that twists has torsion besides."""
    return curvature.reshape(plant.pieces, -1)[:, :2].ravel()


def tip_of(simulation, readout):
    if simulation.data is None:
        return readout.tip_position()
    return simulation.data.sensordata[:3].copy()


def found(name, model, pieces):
    """The same of a named robot and model."""
    drive, torsion, _, control = CASES[name]
    way = {"bending": "spatial", "torsion": torsion, "actuation": drive}
    if model == "chain":
        plant = MujocoPlant(ROBOTS[name], PERIOD, pieces=pieces, **way)
    else:
        beam = BeamPlant(model, pieces=pieces)
        plant = SteppedPlant(ROBOTS[name], PERIOD, beam, axes=SPACE, **way)
    return pulled(plant, drive, np.array(control))


@pytest.mark.parametrize("name", CASES)
def test_pcc_becomes_the_chain_of_as_many_pieces(name):
    """They differ by where the mass is and how a piece is curved: both of second order."""
    length, number = ROBOTS[name].length, CASES[name][2] * ROBOTS[name].pieces
    rest, motion = [], []
    for pieces in (number, 2 * number):
        chain, pcc = found(name, "chain", pieces), found(name, "pcc", pieces)
        rest.append(np.linalg.norm(chain[1] - pcc[1]) / length)
        motion.append(np.linalg.norm(chain[0] - pcc[0], axis=1).max() / length)
    assert np.linalg.norm(chain[0] - chain[0][0], axis=1).max() > 0.03 * length
    assert rest[1] < rest[0] / 3 < 0.001
    assert motion[1] < motion[0] / 3 < 0.001
    # A chain that twists shares out a piece's bend to its neighbours, by the order of its hinges.
    assert_allclose(pcc[2], chain[2], atol=0.01 * np.abs(chain[2]).max())
    assert_allclose(pcc[3], chain[3], rtol=0.002)
    assert_allclose(pcc[4], 0, atol=1e-9)


@pytest.mark.parametrize("name", CASES)
def test_a_posture_of_some_curvature(name):
    _, torsion, _, _ = CASES[name]
    robot = replace(ROBOTS[name], pieces=3) if ROBOTS[name].is_uniform else ROBOTS[name]
    way = {"bending": "spatial", "torsion": torsion}
    plant = SteppedPlant(robot, PERIOD, BeamPlant("pcc"), axes=SPACE, **way)
    wanted = np.random.default_rng(8).uniform(-2, 2, 2 * robot.pieces)
    simulation = plant.simulation({})
    simulation.reset(plant.bent(wanted), np.zeros(len(robot.tendons)))
    readout = plant.readout(simulation)
    assert_allclose(readout.curvature(), wanted, atol=1e-6)
    # What is drawn looks like it: hinges in place of arcs err to second order.
    drawn = build_scene(plant.config).tip(simulation.posture)
    assert_allclose(drawn, readout.tip_position(), atol=0.01 * robot.length)


@pytest.mark.parametrize(
    ("name", "model", "way"),
    [
        ("hanging_trunk", "pcc", {"axes": SPACE, "bending": "spatial"}),
        ("arm", "pcc", {}),
        pytest.param("arm", "cosserat", {}, marks=pytest.mark.slow),
        pytest.param("arm", "ancf", {}, marks=pytest.mark.slow),
    ],
)
def test_rates_are_derivatives(name, model, way):
    plant = SteppedPlant(ROBOTS[name], PERIOD, BeamPlant(model), **way)
    simulation = plant.simulation({})
    rng = np.random.default_rng(5)
    for _ in range(4):
        simulation.ctrl[:] = [rng.uniform(0, 0.2 * t.tension_limit) for t in plant.robot.tendons]
        assert simulation.advance()
    model, q, v = simulation.plant, simulation.q, simulation.v
    now, h = model.measure(q, v), 1e-5
    ahead, behind = (model.measure(q + step * v, v) for step in (h, -h))
    for value, rate in (("tip_position", now.tip_velocity), ("curvature", now.curvature_rate)):
        slope = (getattr(ahead, value) - getattr(behind, value)) / (2 * h)
        assert_allclose(rate, slope, rtol=1e-5, atol=1e-6 * np.abs(rate).max())
        assert np.abs(rate).max() > 1e-3


def test_measured_are_the_axes_that_are_asked_for():
    robot, tips = ROBOTS["hanging_trunk"], []
    for axes in (SPACE, slice(0, 2), slice(0, 3, 2)):
        plant = SteppedPlant(robot, PERIOD, BeamPlant("pcc"), axes=axes, bending="spatial")
        simulation = plant.simulation({})
        simulation.reset(plant.equilibrium(np.array([3.0, 0, 1.0, 0, 2.0, 0])), np.zeros(6))
        tips.append(plant.readout(simulation).tip_position())
    assert_allclose(tips[1], tips[0][:2])
    assert_allclose(tips[2], tips[0][::2])
    assert 0.25 < tips[0][2] < 0.27  # it hangs from 0.6 m


def test_a_sharp_bend_to_both_sides_at_once_is_reported():
    robot = replace(ROBOTS["silicone_rod"], pieces=3)
    plant = SteppedPlant(robot, PERIOD, BeamPlant("pcc"), axes=SPACE, bending="spatial")
    simulation = plant.simulation({})
    curvature = np.zeros(6)
    curvature[2:4] = 0.75 * robot.curvature_limit
    simulation.reset(plant.bent(curvature), np.zeros(3))
    said = plant.readout(simulation).update()
    assert said.startswith("left the workspace: curvature 70.71 1/m of piece 2 of 3")


@pytest.mark.parametrize(
    ("model", "name", "options", "message"),
    [
        ("ancf", "rig", {}, "'rig' has a head, which plant 'ancf' has no sections for; take pcc"),
        ("ancf", "hanging_trunk", {}, "ANCF needs a backbone of one section"),
        ("pcc", "silicone_rod", {"bending": "planar"}, "PCC with axes 'planar' moves in the x-z"),
        ("pcc", "hanging_trunk", {"actuation": "length"}, "needs a finite stiffness to be driven"),
    ],
)
def test_what_a_model_lacks_is_refused_by_name(model, name, options, message):
    way = {"bending": "spatial", **options}
    with pytest.raises(ValueError, match=message):
        SteppedPlant(ROBOTS[name], PERIOD, BeamPlant(model), axes=SPACE, **way)
