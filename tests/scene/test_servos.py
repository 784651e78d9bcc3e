"""Servos against the definitions of rate limit and backlash, and against small steps."""

from dataclasses import replace

import numpy as np
import pytest
from support.servo_law import ServoLaw

from softrobot_env.envs.simulation.batch import BatchSimulation
from softrobot_env.scene.build import build_scene
from softrobot_env.scene.registry import SCENES
from softrobot_env.scene.servos import Servos
from softrobot_env.scene.simulation import Simulation

TIMES = 1e-3 * np.arange(1, 21)


def test_small_steps_give_the_same_motion_as_the_law():
    """The backlash of motors simulated ten microseconds at a time."""
    speed, half, rng = 0.13, 1e-4, np.random.default_rng(0)
    offset = np.array([1e-3, 0.0, -1e-3])
    drive = ServoLaw(speed, offset, np.full(3, 2 * half))
    motor, horn = drive.motor, drive.horn
    for _ in range(10):
        command = rng.uniform(-3e-3, 3e-3, 3)
        path = drive.move(command, TIMES)
        assert len(path) == len(TIMES) + 1 or np.allclose(drive.motor, command + offset)
        slow = [horn]
        for _ in TIMES:
            for _ in range(100):
                motor = motor + np.clip(command + offset - motor, -speed * 1e-5, speed * 1e-5)
                horn = np.clip(horn, motor - half, motor + half)
            slow.append(horn)
        held = np.minimum(np.arange(len(TIMES) + 1), len(path) - 1)
        np.testing.assert_allclose(path[held], slow, atol=1e-12)


# ---------------------------------------------------------------- servos that drive simulations


OFFSETS, BACKLASHES = np.array([1e-4, -2e-4, 0.0]), np.array([2e-4, 0.0, 1e-3])


def rig(**changes):
    return build_scene(replace(SCENES["rig"], **changes))


def driven(scene, speed, offsets=OFFSETS, backlashes=BACKLASHES):
    """A simulation at rest, and the servos that drive it."""
    simulation, servos = Simulation(scene), Servos(speed, offsets, backlashes)
    simulation.drive_by(servos)
    simulation.reset(scene.model.qpos0, servos.horn)
    return simulation, servos


def commands(count, seed=0):
    """Steps (count, 3) [m] of all sizes, some of them none."""
    rng = np.random.default_rng(seed)
    sizes = 10 ** rng.uniform(-5, -2, (count, 1)) * rng.integers(0, 2, (count, 1))
    return np.cumsum(sizes * rng.uniform(-1, 1, (count, 3)), axis=0).clip(-0.01, 0.01)


@pytest.mark.parametrize(
    ("speed", "integrator"),
    [(0.03, None), (0.13, None), (2.0, None), (np.inf, None), (0.1, "implicitfast"), (0.1, "RK4")],
)
def test_simulations_are_driven_by_the_law(speed, integrator):
    """Horns, and so the motion, are those of the closed form along its path."""
    scene = rig(integrator=integrator)
    simulation, servos = driven(scene, speed)
    by_hand, law = Simulation(scene), ServoLaw(speed, OFFSETS, BACKLASHES)
    by_hand.reset(scene.model.qpos0, law.horn)
    for command in commands(40 if integrator is None else 10):
        servos.command[:] = command
        assert simulation.advance()
        assert by_hand.advance_through(law.move(command, by_hand.step_times))
        np.testing.assert_allclose(servos.motor, law.motor, rtol=0, atol=1e-16)
        np.testing.assert_allclose(servos.horn, law.horn, rtol=0, atol=1e-16)
        np.testing.assert_array_equal(simulation.ctrl, servos.horn)
        np.testing.assert_allclose(servos.reading, law.motor - OFFSETS, rtol=0, atol=1e-16)
        np.testing.assert_allclose(simulation.posture, by_hand.posture, rtol=0, atol=1e-12)
    assert np.abs(simulation.posture).max() > 0.01


@pytest.mark.parametrize("threads", [1, 3])
def test_every_robot_of_a_batch_has_its_own_servos(threads):
    scene, count = rig(), 5
    everyone = np.arange(count)
    errors = [(OFFSETS * (-1) ** k, BACKLASHES * k) for k in everyone]
    batch = BatchSimulation(scene, count, threads)
    servos = Servos(0.1, *(np.array(both) for both in zip(*errors, strict=True)), count)
    batch.drive_by(servos)
    batch.reset(everyone, np.tile(scene.model.qpos0, (count, 1)), servos.horn)
    singles = [driven(scene, 0.1, *own) for own in errors]
    wanted = np.stack([commands(20, seed) for seed in everyone], axis=1)
    for k, command in enumerate(wanted):
        if k == 10:  # two of them start anew
            again = np.array([1, 3])
            servos.start(command[again], again)
            batch.reset(again, np.tile(scene.model.qpos0, (2, 1)), servos.horn[again])
            for i in again:
                singles[i][1].start(command[i])
                singles[i][0].reset(scene.model.qpos0, singles[i][1].horn)
        servos.command[:] = command
        assert not batch.advance().any()
        for i, (simulation, own) in enumerate(singles):
            own.command[:] = command[i]
            assert simulation.advance()
            np.testing.assert_array_equal(batch.qpos[i], simulation.posture)
            np.testing.assert_array_equal(servos.horn[i], own.horn)
            np.testing.assert_array_equal(servos.reading[i], own.reading)
            np.testing.assert_array_equal(batch.ctrl[i], own.horn)
            np.testing.assert_array_equal(batch.actuator_force[i], simulation.data.actuator_force)
