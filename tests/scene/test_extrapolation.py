"""Our own integrator against MuJoCo's Runge-Kutta steps, and against its own promises."""

import warnings
from dataclasses import replace

import mujoco
import numpy as np
import pytest
from scipy.linalg import eigh

from softrobot_env.core.motion import State
from softrobot_env.robots import ARM, RIG, RobotParams, Tendon
from softrobot_env.robots.actuation import TendonMap
from softrobot_env.robots.loads import Load
from softrobot_env.scene.build import build_scene
from softrobot_env.scene.chain import posture
from softrobot_env.scene.config import SceneConfig, TipSensors
from softrobot_env.scene.integration.layout import FEWEST as FEWEST_PLACE
from softrobot_env.scene.integration.layout import MOST, RATE, WORST
from softrobot_env.scene.integration.probe import probe
from softrobot_env.scene.simulation import WORRYING, Simulation
from softrobot_env.scene.timestep import TimestepWarning, bent_beam, linearize, slowest

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


def test_dampers_between_the_pieces_follow_every_step():
    """Those of the velocities at the start of a long period would be 0.04 mm off."""
    rod = RobotParams("rod", 0.4, 0.005, 0.0, 7e6, 1200.0, 0.02, 6, gravity=(9.81, 0.0, 0.0))
    built = scene(rod, rule="coupled2", control_period=5 * PERIOD, accuracy=1e-6)
    assert built.model.tendon_damping.any()
    found, simulation = tips(built, np.zeros((8, 0)))
    truth = runge_kutta(built, np.zeros((40, 0)), 800)[4::5]
    assert distance(found, truth) < simulation.integration_error < 1e-6


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
    assert simulation.integration_error > distance(found, truth) / 2


def slack(damping_ratio, stiffness):
    """A planar rod with a long and a short tendon, so many times as stiff as it is."""
    rod = RobotParams("slack", 0.16, 0.003, 0.0, 3e8, 2300.0, 0.0, 8)
    rod = replace(rod, damping_time=damping_ratio / (np.pi * rod.first_frequency))
    places = ((0.002, rod.length), (-0.002, rod.length / 2))
    tendons = [
        Tendon(
            f"tendon{k}", (x, 0.0), end, 0, 150.0,
            stiffness=stiffness * rod.bending_stiffness / (end * x**2),
        )
        for k, (x, end) in enumerate(places)
    ]  # fmt: skip
    return replace(rod, tendons=tuple(tendons))


# Estimates are wary of kinks.
@pytest.mark.filterwarnings("ignore::softrobot_env.scene.timestep.TimestepWarning")
@pytest.mark.parametrize(
    ("damping_ratio", "curvature"), [(0.012, 8.0), (0.2, 8.0), (0.2, -10.0), (0.01, 10.0)]
)
def test_accuracy_is_kept_where_tendons_slacken(damping_ratio, curvature):
    """Let go from an arc [1/m], stiff tendons go slack and taut within steps again and again."""
    config = SceneConfig(slack(damping_ratio, 100.0), control_period=0.036, actuation="length")
    built = build_scene(config)
    start = State(
        posture(built.model, np.outer(built.layout.weights, [curvature])),
        np.zeros(built.model.nv),
    )
    fine = [replace(config, integrator="implicitfast", timestep=0.036 / n) for n in (2000, 4000)]
    found, half, quarter = (
        one.tip(one.simulate(0.36, None, start, samples=0.036).q)
        for one in (built, *map(build_scene, fine))
    )
    assert distance(found, 2 * quarter - half) < config.wanted_accuracy


@pytest.mark.parametrize("stiffness", [0.1, 1.0, 10.0, 100.0])
def test_tendons_do_not_damp(stiffness):
    """The damping ratio is at most that of the chain's first mode with its tendons held."""
    robot = slack(0.1, stiffness)
    chain = linearize(scene(robot, actuation="length").model)
    squares, modes = eigh(chain.stiffness, chain.mass)
    first = modes[:, 0] @ chain.damping @ modes[:, 0] / (2 * np.sqrt(squares[0]))
    ratio = float(bent_beam(robot, True).damping_ratio({}))
    assert ratio < 1.1 * first
    assert ratio > 0.8 * first or stiffness > 1


def test_a_bounded_cost_is_told_and_stays_stable():
    """Stiff, undamped, on stiff tendons: no step of a 256th period is short enough."""
    tendons = tuple(replace(t, stiffness=1e7, tension_limit=1e5) for t in ARM.tendons)
    robot = replace(ARM, tendons=tendons, damping_time=0.0, youngs_modulus=1e9)
    built = scene(robot, actuation="length")
    simulation = Simulation(built)
    simulation.reset(built.model.qpos0, np.zeros(6))
    with pytest.warns(TimestepWarning, match="fast modes are damped"):
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


# ---------------------------------------------------------------- hardly damped motion

#: A nearly undamped rod of 635 Hz, its first period [s], and a force [N] that bends it far.
_ROD = RobotParams("rod", 0.1, 0.01, 0.0, 1e10, 2000.0, 0.0, 3)
_SWING = 2 * np.pi / slowest(_ROD, False)
_PUSH = 0.24 * _ROD.bending_stiffness / _ROD.length**2
ROD = replace(_ROD, damping_time=2 * 0.002 * _SWING / (2 * np.pi))
TENDON = Tendon("tendon", (0.008, 0.0), 0.1, 0, 1e5)


@pytest.mark.parametrize(
    ("driven", "periods"),
    [*(("load", k) for k in (3.2, 8.4, 10.4, 30.3, 100.7)), ("tension", 15.4), ("tension", 30.3)],
)
def test_fast_motion_within_a_control_period_is_told(driven, periods):
    """Steps as long as the period would damp it, those of the shadow as well."""
    if driven == "load":
        options, control = {"loads": (Load("push", 0.1, force=(_PUSH, 0.0, 0.0)),)}, np.ones(1)
    else:
        options, control = {}, np.array([0.05 * _PUSH / 0.008])
    robot = ROD if driven == "load" else replace(ROD, tendons=(TENDON,))
    config = SceneConfig(robot, control_period=periods * _SWING, **options)
    built, duration = build_scene(config), 4 * config.control_period
    fine = build_scene(replace(config, integrator="RK4", timestep=_SWING / 200))
    truth = fine.simulate(duration, control, samples=config.control_period)
    with warnings.catch_warnings(record=True) as told:
        warnings.simplefilter("always", TimestepWarning)
        found = built.simulate(duration, control, samples=config.control_period)
    errors = np.linalg.norm(built.tip(found.q) - built.tip(truth.q), axis=1)
    assert np.all(errors < 2 * found.integration_error + 1e-9)
    assert told or errors.max() < built.timestep.accuracy


def energy_of(simulation):
    """Of motion, springs and weight [J]."""
    mujoco.mj_energyPos(simulation.model, simulation.data)
    mujoco.mj_energyVel(simulation.model, simulation.data)
    return simulation.data.energy.sum()


def let_go(curvature, duration):
    """The arm without damping, let go from an arc [1/m]; its energy [1] after each period."""
    built = scene(replace(ARM, damping_time=0.0))
    simulation = Simulation(built)
    straight = energy_of(simulation)
    bent = posture(built.model, np.outer(built.layout.weights, [curvature]))
    simulation.reset(bent, np.zeros(6))
    energies, estimates = [energy_of(simulation)], [0.0]
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", TimestepWarning)
        for _ in range(round(duration / PERIOD)):
            assert simulation.advance()
            energies.append(energy_of(simulation))
            estimates.append(simulation.integration_error / built.timestep.accuracy)
    return (np.array(energies) - straight) / (energies[0] - straight), np.array(estimates)


@pytest.mark.parametrize("duration", [8.0, pytest.param(60.0, marks=pytest.mark.slow)])
@pytest.mark.parametrize("curvature", [2.0, 0.3, 0.03])
def test_undamped_motion_gains_no_energy_and_tells_what_it_loses(curvature, duration):
    """Modes faster than the steps are damped, at most by what is told before."""
    energies, estimates = let_go(curvature, duration)
    assert energies.max() < 1.01
    assert energies.min() > 0.8
    lost = np.flatnonzero(np.abs(energies - 1) > 0.05)
    assert not len(lost) or estimates[lost[0] - 1] > WORRYING


def test_wrong_speeds_of_an_undamped_arm_are_told():
    """Against Runge-Kutta: positions are right for seconds, speeds of fast modes are not."""
    built = scene(replace(ARM, damping_time=0.0))
    model, accuracy = built.model.__copy__(), built.timestep.accuracy
    model.opt.integrator, model.opt.timestep = mujoco.mjtIntegrator.mjINT_RK4, PERIOD / 100
    simulation, data = Simulation(built), mujoco.MjData(model)
    bent = posture(built.model, np.outer(built.layout.weights, [0.3]))
    simulation.reset(bent, np.zeros(6))
    data.qpos[:] = bent
    speed_error = np.empty(100)
    with pytest.warns(TimestepWarning):
        for k in range(100):
            assert simulation.advance()
            mujoco.mj_step(model, data, 100)
            mujoco.mj_forward(model, data)
            gap = simulation.data.sensordata - data.sensordata
            speed_error[k] = np.linalg.norm(gap[3:])
    assert np.linalg.norm(gap[:3]) < WORRYING * accuracy
    told = simulation.integration_error * slowest(built.config.robot, False)
    assert accuracy * slowest(built.config.robot, False) < speed_error.max() < 2 * told


def test_damping_decides_whether_swings_bound_the_steps():
    """A robot whose swings are gone within a control period may cross it in one interval."""
    damped = replace(ROD, damping_time=2 * 0.1 * _SWING / (2 * np.pi))
    periods = dict.fromkeys((ROD, damped), 30 * _SWING) | {ARM: PERIOD}
    swings = [scene(robot, control_period=t).timestep.pace.swing for robot, t in periods.items()]
    assert swings[0] == pytest.approx(_SWING)
    assert swings[1] == np.inf
    assert swings[2] > 100 * PERIOD
