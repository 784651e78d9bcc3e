"""Batches of any robot are its single simulations, and are measured as they are."""

from dataclasses import replace

import mujoco
import numpy as np
import pytest
from numpy.testing import assert_allclose
from support.routed_robots import HELICAL, TWO

from softrobot_env.envs.simulation import batch as module
from softrobot_env.envs.simulation.batch import BatchSimulation
from softrobot_env.envs.simulation.plants import MujocoPlant
from softrobot_env.robots import EXAMPLES, Base, Disc, RobotParams, find_robot
from softrobot_env.robots.variations import neutral
from softrobot_env.scene.build import build_scene
from softrobot_env.scene.config import SceneConfig, TipSensors
from softrobot_env.scene.integration.layout import LONGEST
from softrobot_env.scene.registry import SCENES, scene_of
from softrobot_env.scene.servos import Servos

COUNT, VARIED = 3, 1
ALL = slice(0, 3)

#: Two sections, a disc, and a base that points aside.
_UP_AND_DOWN = replace(
    TWO.vary(tendon_radius=0.5),
    discs=(Disc.uniform(0.25, 0.03, 0.02, 0.004),),
    gravity=(0.0, 0.0, -9.81),
    base=Base(direction=(0.3, 0.2, -1.0)),
)

#: The helical robot bends, twists and shortens its tendon on the way; half of a robot's pieces.
CONFIGS = {
    **{name: scene_of(find_robot(name)) for name in EXAMPLES},
    **{name: SCENES[name] for name in ("arm", "rig")},
    "helical": SceneConfig(HELICAL, sensors=(TipSensors(),), bending="spatial", torsion=True),
    "two": SceneConfig(_UP_AND_DOWN, sensors=(TipSensors(),), bending="spatial", torsion=True),
    "coarse": replace(SCENES["rig"], robot=replace(SCENES["rig"].robot, pieces=2)),
}
VARIATION = {
    "youngs_modulus": 1.2,
    "density": 0.9,
    "damping_time": 1.3,
    "tendon_radius": 1.07,
    "tendon_friction": 0.03,
}


def plant_of(config, **changes):
    options = {
        name: getattr(config, name)
        for name in ("pieces", "bending", "torsion", "actuation", "control_period")
    }
    return MujocoPlant(config.robot, axes=ALL, **(options | changes))


class Pair:
    """A batch, and the single simulation of one of its robots, driven and measured alike."""

    def __init__(self, plant, variation):
        model, which = plant.nominal.model, np.arange(COUNT)
        self.batch, self.single = BatchSimulation(plant.nominal, COUNT), plant.simulation(variation)
        values = {
            name: np.array([value])
            for name, value in (neutral(robots_only=True) | variation).items()
        }
        self.batch.vary(np.array([VARIED]), values)
        self.servos = [None, None]
        start = np.zeros(model.nu)
        if plant.config.actuation == "length":
            errors = 0.1, np.full(model.nu, 1e-4), np.full(model.nu, 3e-4)
            self.servos = Servos(*errors, COUNT), Servos(*errors)
            self.batch.drive_by(self.servos[0])
            self.single.drive_by(self.servos[1])
            start = self.servos[1].horn
        self.batch.reset(which, np.zeros((COUNT, model.nq)), np.tile(start, (COUNT, 1)))
        self.single.reset(model.qpos0, start)
        measured = zip((self.batch, self.single), self.servos, strict=True)
        self.many, self.one = (plant.readout(*pair) for pair in measured)

    def advance(self, inputs):
        for simulation, servos in zip((self.batch, self.single), self.servos, strict=True):
            (simulation.ctrl if servos is None else servos.command)[:] = inputs
        assert not self.batch.advance().any() and self.single.advance()
        self.many.update()
        assert self.one.update() is None and not self.many.outside.any()


def inputs_of(plant, periods, seed=0):
    """Steps (periods, nu) that hold for four periods, of tensions [N] or lengths [m]."""
    rng, tendons = np.random.default_rng(seed), plant.robot.tendons
    size = [0.01] * len(tendons)
    if plant.config.actuation == "tension":
        size = [0.2 * tendon.tension_limit for tendon in tendons]
    return np.repeat(rng.uniform(0, size, (periods // 4, len(tendons))), 4, axis=0)


@pytest.mark.filterwarnings("ignore::softrobot_env.scene.timestep.TimestepWarning")  # inputs jump
@pytest.mark.parametrize("variation", [{}, VARIATION], ids=["nominal", "varied"])
@pytest.mark.parametrize("name", CONFIGS)
def test_a_robot_of_a_batch_is_the_single_one(name, variation):
    plant = plant_of(CONFIGS[name])
    pair = Pair(plant, variation)
    for inputs in inputs_of(plant, 12):
        pair.advance(inputs)
        assert_allclose(pair.batch.qpos[VARIED], pair.single.posture, rtol=0, atol=1e-10)
        for what in ("tip_position", "tip_velocity", "curvature", "curvature_rate"):
            many, one = getattr(pair.many, what)(), getattr(pair.one, what)()
            assert_allclose(many[VARIED], one, rtol=1e-9, atol=1e-9, err_msg=what)
        for what in ("tendon_tension", "tendon_length", "true_length"):
            many, one = getattr(pair.many, what)(), getattr(pair.one, what)()
            assert_allclose(many[VARIED], one, rtol=1e-9, atol=1e-10, err_msg=what)
        estimates = pair.batch.integration_error[VARIED], pair.single.integration_error
        assert estimates[0] == pytest.approx(estimates[1], rel=1e-6)
    assert np.abs(pair.single.posture).max() > 1e-3
    others = np.abs(pair.batch.qpos[0] - pair.batch.qpos[VARIED]).max()
    assert others > 1e-5 if variation else others == 0


@pytest.mark.parametrize(
    ("name", "changes"),
    [
        *((name, {}) for name in ("ftdcr_v4", "rig", "arm")),
        *((name, {"integrator": "implicitfast", "timestep": 2e-4}) for name in ("rig", "arm")),
        ("hanging_trunk", {"integrator": "implicitfast", "timestep": 2e-4}),
        ("arm", {"rule": "gauss3", "pieces": 12, "control_period": 0.004}),
    ],
)
def test_measurements_are_mujocos_at_the_end_of_a_period(name, changes):
    """By MuJoCo's own functions, of the state that was reached and not of the step before it."""
    plant = plant_of(CONFIGS[name], **changes)
    pair, scene = Pair(plant, {}), plant.nominal
    model, data = scene.model, mujoco.MjData(scene.model)
    for inputs in inputs_of(plant, 4):
        pair.advance(inputs)
    data.qpos[:], data.qvel[:] = q, v = pair.batch.qpos[0], pair.batch.qvel[0]
    data.ctrl[:] = pair.batch.ctrl[0]
    mujoco.mj_forward(model, data)
    jacobian = np.zeros((3, model.nv))
    mujoco.mj_jacSite(model, data, jacobian, None, model.site("tip").id)
    truth = {
        "tip_position": data.site("tip").xpos,
        "tip_velocity": jacobian @ data.qvel,
        "tendon_tension": data.actuator_force,
    }
    if name == "arm":  # angles of hinges in a plane add up
        small = 1e-3
        mean = [
            scene.curvature(x)[:, 1].reshape(plant.pieces, -1).mean(axis=1) for x in (q, small * v)
        ]
        truth |= {"curvature": mean[0], "curvature_rate": mean[1] / small}
        truth["tendon_length"] = scene.tendon_length(q)
    for what, wanted in truth.items():
        many, one = getattr(pair.many, what)()[0], getattr(pair.one, what)()
        assert_allclose(many, wanted, rtol=1e-9, atol=1e-12, err_msg=what)
        assert_allclose(one, wanted, rtol=1e-9, atol=1e-9, err_msg=what)
    assert np.ptp(data.actuator_force) > 0.01 and np.abs(v).max() > 0.01


def test_a_twisting_robot_is_measured_in_three_directions():
    """In a posture of known bends and twist."""
    plant = plant_of(CONFIGS["helical"])
    batch = BatchSimulation(plant.nominal, 2)
    readout, layout = plant.readout(batch), plant.layout
    own = plant.config.robot.pieces
    wanted = np.random.default_rng(0).uniform(-2, 2, (own, 3))
    piece = layout.piece // (layout.pieces // own)
    angles = wanted[piece] * layout.weights[:, None]
    for column, kind in enumerate(("hinge", "side", "twist")):
        for station, angle in enumerate(angles[:, column]):
            at = plant.nominal.model.joint(f"{kind}{station}").qposadr[0]
            batch.qpos[1, at] = angle
    readout.update()
    assert_allclose(readout.curvature()[1].reshape(own, 3), wanted, rtol=1e-12)
    assert not readout.curvature()[0].any()
    assert not readout.outside.any()


@pytest.mark.parametrize(
    ("bend", "twist", "out"),
    [(0.6, 0.0, False), (0.8, 0.0, True), (0.6, 0.99, False), (0.0, 1.01, True)],
)
def test_bend_of_both_directions_and_twist_are_limited(bend, twist, out):
    """Towards both sides by a share of the limit each: together that is sqrt(2) times it."""
    plant = plant_of(CONFIGS["helical"])
    batch, limit = BatchSimulation(plant.nominal, 2), plant.robot.curvature_limit
    readout, model = plant.readout(batch), plant.nominal.model
    for kind, share in (("hinge", bend), ("side", -bend), ("twist", twist)):
        for station, weight in enumerate(plant.layout.weights):
            if plant.layout.piece[station] == 0:
                at = model.joint(f"{kind}{station}").qposadr[0]
                batch.qpos[0, at] = share * limit * weight
    readout.update()
    assert readout.outside.tolist() == [out, False]
    text = readout.what_left(0, 0.1)
    assert text is None if not out else "curvature" in text


def test_measured_pieces_have_to_be_pieces_of_the_chain():
    with pytest.raises(ValueError, match="do not divide the robot's own 12"):
        MujocoPlant(TWO, 0.01, bending="spatial", torsion=True, pieces=(8, 4))


@pytest.mark.parametrize(
    ("count", "cost", "threads"),
    [(1, 1.0, 1), (2, 1e-2, 2), (16, 22e-6, 4), (16, 10e-6, 2), (7, 11e-6, 1), (256, 22e-6, 4)],
)
def test_threads_have_enough_to_do(monkeypatch, count, cost, threads):
    """80 µs of work each, on four cores."""
    monkeypatch.setattr(module, "usable_cores", lambda: 4)
    monkeypatch.setattr(module, "step_cost", lambda _: cost)
    assert module.threads_for(None, count) == threads


def test_a_batch_chooses_its_threads_unless_they_are_given():
    scene = build_scene(SCENES["arm"])
    assert BatchSimulation(scene, 1).threads == 1
    assert BatchSimulation(scene, 2, threads=2).threads == 2
    assert 1e-6 < module.step_cost(scene) < 1e-2


def test_a_varied_robot_has_the_intervals_of_a_single_one():
    """A rod that swings within control periods, and variations that swing slower or not at all."""
    rod = RobotParams("rod", 0.1, 0.01, 0.0, 1e10, 2000.0, 1e-6, 3)
    plant = MujocoPlant(rod, axes=ALL, control_period=0.02)
    variations = ({}, {"youngs_modulus": 0.25}, {"damping_time": 50.0})
    batch, every = BatchSimulation(plant.nominal, len(variations)), neutral(robots_only=True)
    rows = [every | variation for variation in variations]
    batch.vary(np.arange(3), {name: np.array([row[name] for row in rows]) for name in every})
    for k, variation in enumerate(variations):
        alone = plant.simulation(variation)._integration.memory[0]
        assert_allclose(batch._integration.memory[k], alone, rtol=1e-12)
    longest = batch._integration.memory[:, 0, LONGEST]
    assert longest[1] == pytest.approx(2 * longest[0])
    assert longest[2] == 0.02
