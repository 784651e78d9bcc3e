"""Servos with a force, spools and wires against SciPy, closed forms and the balance of energy."""

from dataclasses import replace

import mujoco
import numpy as np
import pytest
from scipy.optimize import brentq
from support.motor_truth import OneJoint

from softrobot_env.envs.simulation.batch import BatchSimulation
from softrobot_env.robots import ROBOTS, Drive, RobotParams, Tendon
from softrobot_env.robots.twin import Twin, nominal_twin
from softrobot_env.scene.build import build_scene, vary_scene
from softrobot_env.scene.config import SceneConfig
from softrobot_env.scene.inverse import InverseStatics
from softrobot_env.scene.servos import Servos
from softrobot_env.scene.simulation import Simulation
from softrobot_env.scene.tangent import StaticForces

PERIOD, LENGTH = 0.01, 0.2

# Estimates are compared with true errors here.
pytestmark = pytest.mark.filterwarnings("ignore::softrobot_env.scene.timestep.TimestepWarning")


def one_joint(drive, **tendon):
    """A robot that bends at one hinge, on one tendon."""
    given = {"stiffness": 3000.0, "pretension": 1.0} | tendon
    return RobotParams(
        "one",
        length=LENGTH,
        outer_radius=0.006,
        inner_radius=0.0,
        youngs_modulus=3e7,
        density=1100.0,
        damping_time=0.02,
        pieces=1,
        tendons=(Tendon("a", (0.01, 0.0), LENGTH, 0, 60.0, **given),),
        drive=drive,
    )


def scene(robot, **options):
    hinge = {"rule": "midpoint"} if robot.name == "one" else {}
    config = SceneConfig(robot, actuation="length", control_period=PERIOD, **hinge, **options)
    return build_scene(config)


def held(built, twin=None):
    """A simulation at rest under command 0, and its servos."""
    twin = twin or nominal_twin(built.config.robot)
    simulation, servos = Simulation(built), Servos.of(twin, PERIOD)
    simulation.drive_by(servos)
    posture = built.equilibrium(twin.rest_offset, by_servos=True)
    simulation.reset(posture, servos.horn)
    return simulation, servos


def truth(built):
    """The same joint in numbers, from the model's mass, springs and arm alone."""
    model, drive = built.model, built.config.robot.drive
    data, mass = mujoco.MjData(model), np.zeros((1, 1))
    mujoco.mj_forward(model, data)
    mujoco.mj_fullM(model, data, mass)
    (tendon,) = built.config.robot.tendons
    return OneJoint(
        inertia=mass[0, 0],
        damping=model.dof_damping[0],
        spring=model.jnt_stiffness[0],
        arm=-data.ten_J[0],
        stiffness=tendon.stiffness,
        pretension=tendon.pretension,
        seating=drive.seating,
        mass=drive.reflected_mass,
        gain=drive.gain,
        velocity_gain=drive.velocity_gain,
        limit=drive.force_limit,
        friction=drive.gear_friction,
        layers=drive.layers,
    )


def followed(simulation, servos, commands):
    """States (k, 4) as of `OneJoint.motion`, and estimated errors (k,) [m]."""
    states, estimates = [], []
    for command in commands:
        servos.command[:] = command
        assert simulation.advance()
        data = simulation.data
        states.append((data.qpos[0], data.qvel[0], servos.motor[0], servos.turning[0]))
        estimates.append(simulation.integration_error)
    return np.array(states), np.array(estimates)


def start(simulation, servos):
    return simulation.posture[0], 0.0, servos.motor[0], 0.0


USUAL = Drive("length", gain=2e4, velocity_gain=200.0, reflected_mass=0.8)
STEPS = np.repeat([6e-3, -1e-3, 8e-3], 12)


# ---------------------------------------------------------------- motion


@pytest.mark.parametrize(
    "changes",
    [
        {},
        {"force_limit": 6.0},
        {"gear_friction": 1.5},
        {"seating": 2e-3},
        {"spool_radius": 4e-3, "wire_diameter": 1e-3},
        {"force_limit": 7.0, "gear_friction": 0.7, "seating": 5e-4},
    ],
    ids=", ".join,
)
def test_a_joint_and_its_motor_move_as_by_scipy(changes):
    """And ever closer as the accuracy asks for it."""
    drive = replace(USUAL, **{"seating": 1e-12} | changes)
    errors = []
    for accuracy in ("0.1%", "0.002%"):
        simulation, servos = held(scene(one_joint(drive), accuracy=accuracy))
        joint = truth(simulation.scene)
        exact = joint.motion(STEPS, PERIOD, start(simulation, servos))
        states, estimates = followed(simulation, servos, STEPS)
        error = np.abs(states[:, 0] - exact[:, 0]).max() * LENGTH / 2
        assert error < max(estimates[-1], 1e-7)
        errors.append(error)
    assert errors[0] < 2 * 0.001 * LENGTH
    assert errors[1] < 5e-5 * LENGTH


def test_estimates_bound_the_errors_of_random_servos():
    rng = np.random.default_rng(20)
    bounded, tried = 0, 12
    for _ in range(tried):
        gain, mass = 10 ** rng.uniform(3.3, 5), 10 ** rng.uniform(-2, 1)
        drive = Drive(
            "length",
            gain=gain,
            reflected_mass=mass,
            velocity_gain=2 * rng.uniform(0.3, 1.2) * np.sqrt(gain * mass),
            force_limit=rng.uniform(3, 20),
            gear_friction=rng.choice([0.0, 0.5]),
            seating=10 ** rng.uniform(-4, -2.5),
        )
        simulation, servos = held(scene(one_joint(drive)))
        commands = np.repeat(rng.uniform(-2e-3, 8e-3, 3), 10)
        exact = truth(simulation.scene).motion(commands, PERIOD, start(simulation, servos))
        states, estimates = followed(simulation, servos, commands)
        error = np.abs(states[:, 0] - exact[:, 0]).max() * LENGTH / 2
        bounded += error <= estimates[-1]
        assert error < 3 * estimates[-1]
    assert bounded >= tried - 1


def test_a_stalled_motor_pulls_no_more_than_its_limit():
    drive = replace(USUAL, force_limit=5.0, seating=3e-4)
    simulation, servos = held(scene(one_joint(drive)))
    for command in np.linspace(0, 0.03, 400):
        servos.command[:] = command
        assert simulation.advance()
    assert servos.effort == pytest.approx(5.0, rel=1e-12)
    assert simulation.data.actuator_force == pytest.approx(5.0, rel=1e-3)
    for _ in range(200):
        assert simulation.advance()
        assert simulation.data.actuator_force <= 5.0 * (1 + 1e-4)
    assert simulation.data.actuator_force == pytest.approx(5.0, rel=1e-6)


def test_a_gear_sticks_without_creeping():
    """At rest off the command, by less than friction, for a minute."""
    simulation, servos = held(scene(one_joint(replace(USUAL, gear_friction=2.0))))
    servos.command[:] = 5e-3
    for _ in range(300):
        assert simulation.advance()
    place, posture = servos.motor.copy(), simulation.posture
    off = USUAL.gain * (5e-3 - place) - simulation.data.actuator_force
    assert 0 < abs(off[0]) <= 2.0
    for _ in range(6000):
        assert simulation.advance()
    np.testing.assert_array_equal(servos.motor, place)
    np.testing.assert_allclose(simulation.posture, posture, rtol=0, atol=1e-9)


def test_energy_never_grows_while_a_command_holds():
    """Of joint, wire, motor and loop; friction, damping and the limit only take from it."""
    rng = np.random.default_rng(7)
    for _ in range(10):
        drive = replace(
            USUAL,
            reflected_mass=10 ** rng.uniform(-1, 0.7),
            velocity_gain=10 ** rng.uniform(1, 2.5),
            force_limit=rng.uniform(4, 30),
            gear_friction=rng.uniform(0, 2),
            seating=10 ** rng.uniform(-4, -2.5),
        )
        simulation, servos = held(scene(one_joint(drive), accuracy="0.01%"))
        joint, command = truth(simulation.scene), rng.uniform(-2e-3, 8e-3)
        before = joint.energy(command, *start(simulation, servos))
        first = before
        states, _ = followed(simulation, servos, np.full(60, command))
        for state in states:
            now = joint.energy(command, *state)
            assert now <= before + 2e-4 * first
            before = now


def test_a_dead_time_shifts_the_motion():
    """By whole periods exactly, by others as a command given later."""
    commands = np.repeat([4e-3, 1e-3, 6e-3], 8)
    prompt, _ = followed(*held(scene(one_joint(USUAL))), commands)
    late, _ = followed(*held(scene(one_joint(replace(USUAL, command_delay=0.02)))), commands)
    np.testing.assert_allclose(late[2:], prompt[:-2], rtol=0, atol=1e-6)
    half, _ = followed(
        *held(scene(one_joint(replace(USUAL, command_delay=0.005)), accuracy="0.01%")), commands
    )
    joint = truth(scene(one_joint(USUAL)))
    simulation, servos = held(scene(one_joint(USUAL)))
    fine = np.concatenate(([0.0], np.repeat(commands, 2)))
    exact = joint.motion(fine, PERIOD / 2, start(simulation, servos))[1::2]
    np.testing.assert_allclose(half[:, 0], exact[:, 0], rtol=0, atol=2e-4)


def test_a_motor_rests_within_a_count():
    drive = replace(USUAL, encoder_step=4e-4)
    simulation, servos = held(scene(one_joint(drive)))
    servos.command[:] = 5e-3
    for _ in range(300):
        assert simulation.advance()
    error = 5e-3 - servos.motor - simulation.data.actuator_force / USUAL.gain
    assert error == pytest.approx(2e-4, rel=1e-3)


def counted(joint, command, count, state, step=2e-5, duration=1.5):
    """Where the motor is [m] in the last tenth, by a loop that reads middles of whole counts."""
    (angle, rate, x, u), places = state, []
    for k in range(round(duration / step)):
        read = (np.floor(x / count) + 0.5) * count
        pull = joint.tension(angle, x)
        rate += (
            step
            * (joint.arm * pull - joint.damping * rate - joint.spring * angle)
            / (joint.inertia)
        )
        free = u + step * joint.load(command + x - read, angle, x, u) / joint.mass
        u = np.sign(free) * max(abs(free) - step * joint.friction / joint.mass, 0.0)
        angle, x = angle + step * rate, x + step * u
        if k * step > 0.9 * duration:
            places.append(x)
    return np.array(places)


@pytest.mark.parametrize("friction", [0.0, 0.5, 3.0])  # of 4 N that the loop jumps by
@pytest.mark.parametrize("share", [0.0, 0.4, 0.8])
def test_a_loop_that_reads_whole_counts_rests_within_one_of_a_dead_zone(share, friction):
    count = 2e-4
    command = 5e-3 + share * count
    built = scene(one_joint(replace(USUAL, encoder_step=count, gear_friction=friction)))
    simulation, servos = held(built)
    begun = start(simulation, servos)
    servos.command[:] = command
    for _ in range(150):
        assert simulation.advance()
    places = counted(truth(built), command, count, begun)
    assert np.abs(places - servos.motor).max() < count
    assert np.ptp(places) < 0.1 * count


def test_a_stiff_servo_is_the_ideal_one():
    robot = ROBOTS["silicone_rod"]
    ways = []
    for drive in (robot.drive, replace(robot.drive, gain=1e9, velocity_gain=0.0)):
        simulation, servos = held(scene(replace(robot, drive=drive), bending="spatial"))
        way = []
        for command in ((4e-3, 0, 0), (0, 5e-3, 0), (0, 0, 3e-3)):
            for _ in range(8):
                servos.command[:] = command
                assert simulation.advance()
                way.append(simulation.posture)
        ways.append(way)
    np.testing.assert_allclose(ways[1], ways[0], rtol=0, atol=3e-4)


def test_backlash_is_crossed_without_load():
    """Pulled in, the horn is half a gap behind; let out, it stays until the gap is crossed."""
    drive, gap = replace(USUAL, speed=0.05), 6e-4
    built = scene(one_joint(drive))
    simulation, servos = held(built, Twin(built.config.robot, drive.speed, (0.0,), (gap,)))
    for command in (5e-3, 4.6e-3):
        servos.command[:] = command
        for _ in range(150):
            assert simulation.advance()
        if command == 5e-3:
            horn = servos.horn.copy()
            assert servos.motor - horn == pytest.approx(gap / 2, rel=1e-6)
    np.testing.assert_allclose(servos.horn, horn, rtol=0, atol=1e-12)
    assert servos.motor == pytest.approx(4.6e-3, abs=1e-8)


def test_robots_of_a_batch_are_as_alone():
    drive = replace(
        ROBOTS["silicone_rod"].drive,
        gain=2e4, velocity_gain=200.0, reflected_mass=0.5, force_limit=8.0, gear_friction=0.3,
        seating=5e-4, spool_radius=0.01, wire_diameter=5e-4, command_delay=0.013, backlash=2e-4,
    )  # fmt: skip
    built = scene(replace(ROBOTS["silicone_rod"], drive=drive), bending="spatial")
    twin, count = nominal_twin(built.config.robot), 3
    batch, servos = BatchSimulation(built, count, 2), Servos.of(twin, PERIOD, count)
    batch.drive_by(servos)
    simulation, own = held(built)
    batch.reset(np.arange(count), np.tile(simulation.posture, (count, 1)), servos.horn)
    np.testing.assert_array_equal(batch.actuator_force[1], simulation.data.actuator_force)
    for command in np.random.default_rng(0).uniform(-1e-3, 8e-3, (20, 3)):
        servos.command[:], own.command[:] = command, command
        assert simulation.advance()
        assert not batch.advance().any()
        for robot in range(count):
            np.testing.assert_array_equal(batch.qpos[robot], simulation.posture)
            np.testing.assert_array_equal(servos.motor[robot], own.motor)
    assert own.pulled == pytest.approx(own.horn + drive.layers * own.horn**2, rel=1e-12)


# ---------------------------------------------------------------- rest


@pytest.mark.parametrize("command", [-1e-3, 2e-3, 6e-3, 0.02])
@pytest.mark.parametrize("limit", [4.0, np.inf])
def test_rest_is_the_balance_of_joint_wire_and_motor(command, limit):
    """By two nested searches for a root."""
    drive = replace(USUAL, force_limit=limit, seating=2e-3, spool_radius=4e-3, wire_diameter=8e-4)
    built = scene(one_joint(drive))
    joint = truth(built)

    def motor(angle):
        return brentq(
            lambda x: joint.load(command, angle, x, 0.0), -0.05, command + 1e-9, xtol=1e-15
        )

    def excess(angle):
        return joint.arm * joint.tension(angle, motor(angle)) - joint.spring * angle

    angle = brentq(excess, -1.0, 3.0, xtol=1e-14)
    found = built.equilibrium(np.array([command]), by_servos=True)
    assert found == pytest.approx(angle, abs=1e-8)
    simulation, servos = Simulation(built), Servos.of(nominal_twin(built.config.robot), PERIOD)
    simulation.drive_by(servos)
    servos.start(np.array([command]))
    simulation.reset(found, servos.horn)
    assert servos.motor == pytest.approx(motor(angle), abs=1e-9)
    for _ in range(20):
        assert simulation.advance()
    assert simulation.posture == pytest.approx(angle, abs=1e-6)


def test_the_stiffness_at_rest_is_the_derivative():
    robot = replace(
        ROBOTS["silicone_rod"],
        drive=Drive("length", gain=3e3, seating=2e-3, spool_radius=8e-3, wire_diameter=8e-4),
    )
    built = scene(robot, bending="spatial")
    rng = np.random.default_rng(1)
    for by_servos in (False, True):
        forces = StaticForces(built.model, by_servos)
        q, command = 0.02 * rng.standard_normal(built.model.nq), rng.uniform(0, 4e-3, 3)
        forces.force(q, command)
        tangent, by_controls, step = forces.tangent(), forces.by_controls(), 1e-6
        for k in range(3):
            off = step * np.eye(3)[k]
            change = forces.force(q, command + off) - forces.force(q, command - off)
            np.testing.assert_allclose(by_controls[:, k], change / (2 * step), rtol=1e-5, atol=1e-6)
        off = 1e-6 * rng.standard_normal(built.model.nv)
        change = forces.force(q + off, command) - forces.force(q - off, command)
        np.testing.assert_allclose(tangent @ off, change / 2, rtol=1e-5, atol=1e-10)


def test_a_spool_winds_a_spiral():
    """A wire of diameter d on a radius r lies on r + d turns: the length is the integral."""
    drive = replace(USUAL, spool_radius=5e-3, wire_diameter=1e-3)
    for command in (-0.01, 0.02):
        turns = np.linspace(0, command / (2 * np.pi * 5e-3), 20001)
        radius = 5e-3 + 1e-3 * turns
        wound = np.trapezoid(2 * np.pi * radius, turns)
        assert command + drive.layers * command**2 == pytest.approx(wound, rel=1e-9)


def test_inverse_statics_know_wires_and_spools():
    robot = replace(
        ROBOTS["silicone_rod"],
        drive=Drive("length", seating=1e-3, spool_radius=8e-3, wire_diameter=8e-4),
    )
    built = scene(robot, bending="spatial")
    inverse = InverseStatics(built)
    tip = built.tip(built.equilibrium())
    points = tip + np.array([[0.01, 0.005, 0.0], [-0.01, 0.0, 0.0]])
    found = inverse.solve(points)
    assert found.errors.max() < inverse.tolerance
    for inputs, point in zip(found.inputs, points, strict=True):
        there = built.tip(inverse.posture(inputs))
        np.testing.assert_allclose(there[:2], point[:2], rtol=0, atol=1e-7)


# ---------------------------------------------------------------- refusals


@pytest.mark.parametrize(
    ("drive", "message"),
    [
        ({"kind": "tension", "gain": 1e3}, "only tendons driven by length have gain"),
        ({"kind": "length", "force_limit": 5.0}, "force_limit belong to servos with a gain"),
        ({"kind": "length", "wire_diameter": 1e-3}, "needs a spool_radius"),
        ({"kind": "length", "gain": -1.0}, "gain must be None or from"),
    ],
)
def test_what_does_not_fit_is_refused(drive, message):
    with pytest.raises(ValueError, match=message):
        Drive(**drive)


def test_plants_without_motors_refuse_them():
    robot = one_joint(USUAL)
    with pytest.raises(ValueError, match="need our own integrator"):
        scene(robot, integrator="implicitfast")
    with pytest.raises(ValueError, match="servos let out up to"):
        one_joint(replace(USUAL, spool_radius=1e-3, wire_diameter=1e-3))


def test_the_force_of_servos_varies():
    robot = one_joint(replace(USUAL, force_limit=5.0, seating=1e-3))
    assert robot.vary(servo_force=0.5).drive.force_limit == 2.5
    weak = vary_scene(scene(robot), {"servo_force": 0.5})
    q = weak.equilibrium(np.array([0.03]), by_servos=True)
    joint = truth(weak)
    assert joint.spring * q == pytest.approx(2.5 * joint.arm, rel=1e-9)
