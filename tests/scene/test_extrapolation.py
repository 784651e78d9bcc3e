"""Our own integrator against MuJoCo's Runge-Kutta steps, and against its own promises."""

import warnings
from dataclasses import replace

import mujoco
import numpy as np
import pytest

from softrobot_env.robots import ARM, RIG, RobotParams
from softrobot_env.robots.actuation import TendonMap
from softrobot_env.scene.build import build_scene
from softrobot_env.scene.config import SceneConfig, TipSensors
from softrobot_env.scene.integration.layout import FEWEST as FEWEST_PLACE
from softrobot_env.scene.integration.layout import MOST, RATE, WORST
from softrobot_env.scene.integration.probe import probe
from softrobot_env.scene.simulation import Simulation
from softrobot_env.scene.timestep import TimestepWarning, linearize, slowest

PERIOD = 0.01
MAP = TendonMap(ARM)


def steps(periods, seed=0, amplitude=0.5):
    """Tensions (periods, 6) [N]: random steps of +-amplitude, held for 100 ms."""
    rng = np.random.default_rng(seed)
    reduced = rng.uniform(-amplitude, amplitude, (periods // 10, 3)) * MAP.input_scale
    return np.repeat(MAP.tension(reduced), 10, axis=0)


def scene(robot=ARM, **options):
    return build_scene(SceneConfig(robot, sensors=(TipSensors(),), **options))


def tips(built, controls, kick=0.0):
    """Tip (periods, 3) [m] from the straight pose with a velocity, and the simulation."""
    simulation = Simulation(built)
    simulation.reset(built.model.qpos0, controls[0])
    simulation.data.qvel[:] = kick
    mujoco.mj_forward(simulation.model, simulation.data)
    found = np.empty((len(controls), 3))
    for k, row in enumerate(controls):
        simulation.ctrl[:] = row
        assert simulation.advance()
        found[k] = simulation.data.sensordata[:3]
    return found, simulation


def runge_kutta(built, controls, substeps, kick=0.0):
    """The same by MuJoCo's steps of order four."""
    model = built.model.__copy__()
    model.opt.integrator, model.opt.timestep = mujoco.mjtIntegrator.mjINT_RK4, PERIOD / substeps
    data, found = mujoco.MjData(model), np.empty((len(controls), 3))
    data.qvel[:] = kick
    for k, row in enumerate(controls):
        data.ctrl[:] = row
        mujoco.mj_step(model, data, substeps)
        mujoco.mj_forward(model, data)
        found[k] = data.sensordata[:3]
    return found


def distance(one, other):
    """[m]"""
    return np.linalg.norm(one - other, axis=1).max()


VARIATIONS = [
    {},
    {"damping_time": 0.5, "youngs_modulus": 0.5},
    {"damping_time": 0.1, "youngs_modulus": 0.5, "density": 2.0},
]


@pytest.mark.parametrize("variation", VARIATIONS)
def test_accuracy_is_kept_against_runge_kutta(variation):
    """Where implicitfast's 2 ms are 3 to 200 mm off; the truth has steps of 50 µs or less."""
    built, controls = scene(ARM.vary(**variation)), steps(60)
    truth = runge_kutta(built, controls, 400)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", TimestepWarning)
        found, simulation = tips(built, controls)
    error = distance(found, truth)
    assert error < 0.5e-3
    assert error < 3 * simulation.integration_error


@pytest.mark.parametrize("rows", [2, 3, 4])
def test_rows_of_the_extrapolation_are_its_order(rows):
    """With steps of equal length and no jump of a control within the motion."""
    soft = ARM.vary(damping_time=0.5)

    def error(substeps):
        config = SceneConfig(
            soft, sensors=(TipSensors(),), control_period=PERIOD / substeps, accuracy=1e3
        )
        simulation = Simulation(build_scene(config))
        simulation._integration.memory[0, :, FEWEST_PLACE] = rows
        simulation._integration.memory[0, :, MOST] = rows
        bent = 0.05 * np.ones(simulation.model.nq)
        simulation.reset(bent, np.zeros(6))
        for _ in range(20 * substeps):
            simulation.advance()
        return np.append(simulation.data.qpos, simulation.data.qvel)

    truth = error(32)
    coarse, fine = (np.abs(error(k) - truth).max() for k in (2, 4))
    assert np.log2(coarse / fine) == pytest.approx(rows, abs=0.45)


def test_the_estimate_finds_motions_that_part():
    """Full tensions make a hardly damped arm snap: far off at default, and it says so."""
    wild = ARM.vary(damping_time=0.1, youngs_modulus=0.5)
    controls = np.sign(steps(120, seed=0)) * 80.0
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", TimestepWarning)
        truth, _ = tips(scene(wild, accuracy=2e-6), controls)
    with pytest.warns(TimestepWarning, match=r"may be .* mm off, 0\.5 mm are wanted"):
        found, simulation = tips(scene(wild), controls)
    assert simulation.integration_error > distance(found, truth) / 5


def test_a_bounded_cost_is_told_and_stays_stable():
    """Stiff, undamped, on stiff tendons: no step of a 256th period is short enough."""
    tendons = tuple(replace(t, stiffness=1e7, tension_limit=1e5) for t in ARM.tendons)
    robot = replace(ARM, tendons=tendons, damping_time=0.0, youngs_modulus=1e9)
    built = scene(robot, actuation="length")
    simulation = Simulation(built)
    simulation.reset(built.model.qpos0, np.zeros(6))
    with pytest.warns(TimestepWarning, match="small errors grow"):
        for k in range(12):
            simulation.ctrl[0] = 0.01 * (k % 2)
            assert simulation.advance()
    assert simulation._integration.memory[0, 0, WORST] > 1
    assert np.abs(simulation.data.qpos).max() < 10


@pytest.mark.parametrize("bending", ["planar", "spatial"])
def test_ball_joints_and_gravity(bending):
    """A hanging rod whose positions are quaternions, against Runge-Kutta."""
    rod = RobotParams("rod", 0.4, 4e-3, 0.0, 2e6, 1100.0, 5e-3, 4, gravity=(0.0, 0.0, 9.81))
    torsion = bending == "spatial"
    built = scene(rod, rule="balanced2", bending=bending, torsion=torsion)
    assert (built.model.nq > built.model.nv) == torsion
    kick = np.random.default_rng(0).standard_normal(built.model.nv)
    found, _ = tips(built, np.zeros((30, 0)), kick)
    truth = runge_kutta(built, np.zeros((30, 0)), 200, kick)
    assert distance(found, truth) < 1e-3 * rod.length


@pytest.mark.parametrize(("given", "metres"), [(2e-4, 2e-4), ("0.2%", 1e-3), ("0.0003", 3e-4)])
def test_an_accuracy_in_metres(given, metres):
    config = SceneConfig(ARM, accuracy=given)
    assert config.wanted_accuracy == pytest.approx(metres)
    assert build_scene(config).timestep.accuracy == pytest.approx(metres)


@pytest.mark.parametrize("robot", [ARM, RIG], ids=lambda r: r.name)
def test_the_slowest_frequency_is_about_the_chains(robot):
    winding = robot is RIG
    built = scene(robot, bending="spatial", actuation="length" if winding else "tension")
    exact = linearize(built.model).frequencies()[0]
    assert slowest(robot, winding) == pytest.approx(exact, rel=0.35)
    assert built.timestep.pace.rate > exact
    assert RATE


def test_the_probe_measures_error_and_cost():
    found = probe(scene())
    assert found.error < 0.5e-3
    assert 4 <= found.evaluations < 12
    assert found.cost > 0
    crude = probe(scene(timestep=2e-3, integrator="implicitfast"))
    assert crude.error > 10 * found.error


def test_huge_accelerations_of_a_small_stiff_robot_are_no_divergence():
    """A steel wire in its fastest oscillation, against that of the linear chain."""
    wire = RobotParams("wire", 0.01, 2e-4, 0.0, 2e11, 8000.0, 0.0, 8)
    chain = linearize(scene(wire).model)
    fastest = chain.frequencies()[-1]
    built = scene(wire, control_period=2 * np.pi / fastest / 20, accuracy=1e-9)
    modes = np.linalg.eig(np.linalg.solve(chain.mass, chain.stiffness))
    shape = modes.eigenvectors[:, np.argmax(modes.eigenvalues.real)].real
    start = 2e-4 * shape / np.abs(shape).max()
    simulation, largest = Simulation(built), 0.0
    simulation.reset(start, np.zeros(0))
    for _ in range(20):
        assert simulation.advance(), simulation.failure()
        largest = max(largest, np.abs(simulation.data.qacc).max())
    assert largest > 1e10  # MuJoCo's bound
    gap = simulation.data.qpos - start * np.cos(fastest * simulation.time)
    assert np.abs(gap).max() < 0.01 * np.abs(start).max()
