"""Servos against the definitions of rate limit and play, and against a small-step simulation."""

import copy
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
NONE = np.zeros(3)


def servos(speed=0.1, offset=NONE, backlash=NONE):
    return ServoLaw(speed, np.asarray(offset, float), np.asarray(backlash, float))


def held(path):
    """(20, 3): after the row of now, and the last row holds."""
    horns = path[1:] if len(path) > 1 else path
    return np.concatenate((horns, np.repeat(horns[-1:], len(TIMES) - len(horns), axis=0)))


def test_the_horn_turns_at_its_speed_and_stops_at_the_command():
    drive = servos()
    horns = held(drive.move(np.array([5e-4, -3e-3, 0.0]), TIMES))
    np.testing.assert_allclose(horns[:, 0], np.minimum(0.1 * TIMES, 5e-4), atol=1e-15)
    np.testing.assert_allclose(horns[:, 1], -0.1 * TIMES, atol=1e-15)
    np.testing.assert_array_equal(horns[:, 2], 0)
    # It goes on where it was.
    horns = held(drive.move(np.array([5e-4, -3e-3, 0.0]), TIMES))
    np.testing.assert_allclose(horns[:, 1], np.maximum(-2e-3 - 0.1 * TIMES, -3e-3), atol=1e-15)


@pytest.mark.parametrize("way", [0.0, 4.9e-4, 5e-4, 2e-3, 1.0])
def test_only_instants_of_motion_are_returned(way):
    horns = servos().move(np.array([0.0, way, 0.0]), TIMES)
    needed = np.flatnonzero(way - 1e-15 <= 0.1 * TIMES)
    assert len(horns) == 1 + (needed[0] + 1 if len(needed) else len(TIMES))
    np.testing.assert_array_equal(horns[0], 0)


def test_offset_adds_to_the_command():
    drive = servos(offset=[1e-3, 0.0, -1e-3])
    drive.start(np.full(3, 5e-3))
    np.testing.assert_allclose(drive.horn, [6e-3, 5e-3, 4e-3], atol=1e-15)
    for _ in range(5):
        horns = drive.move(np.zeros(3), TIMES)
    np.testing.assert_allclose(horns[-1], [1e-3, 0.0, -1e-3], atol=1e-15)


def test_play_is_crossed_before_the_horn_moves():
    width = 4e-4
    drive = servos(speed=1.0, backlash=[width] * 3)
    there = [drive.move(np.full(3, x), TIMES)[-1, 0] for x in np.linspace(0, 2e-3, 41)]
    back = [drive.move(np.full(3, x), TIMES)[-1, 0] for x in np.linspace(2e-3, 0, 41)]
    way = np.linspace(0, 2e-3, 41)
    np.testing.assert_allclose(there, np.maximum(way - width / 2, 0), atol=1e-12)
    np.testing.assert_allclose(
        back, np.minimum(2e-3 - width / 2, way[::-1] + width / 2), atol=1e-12
    )


@pytest.mark.slow
def test_small_steps_give_the_same_motion():
    """The play of a motor simulated one microsecond at a time."""
    speed, half, rng = 0.13, 1e-4, np.random.default_rng(0)
    drive = servos(speed, backlash=[2 * half] * 3)
    motor, horn = np.zeros(3), np.zeros(3)
    for _ in range(20):
        command = rng.uniform(-3e-3, 3e-3, 3)
        fast = held(drive.move(command, TIMES))
        slow = []
        for _ in TIMES:
            for _ in range(1000):
                motor = motor + np.clip(command - motor, -speed * 1e-6, speed * 1e-6)
                horn = np.where(motor - half > horn, motor - half, horn)
                horn = np.where(motor + half < horn, motor + half, horn)
            slow.append(horn)
        np.testing.assert_allclose(fast, slow, atol=1e-12)


# ---------------------------------------------------------------- servos that drive simulations


OFFSETS, BACKLASHES = np.array([1e-4, -2e-4, 0.0]), np.array([2e-4, 0.0, 1e-3])


def rig(**changes):
    return build_scene(replace(SCENES["rig"], **changes))


def driven(scene, speed):
    """A simulation at rest, and the servos that drive it."""
    simulation, servos = Simulation(scene), Servos(speed, OFFSETS, BACKLASHES)
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
    for command in commands(40):
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
    batch, servos = BatchSimulation(scene, count, threads), Servos(0.1, OFFSETS, BACKLASHES, count)
    batch.drive_by(servos)
    everyone = np.arange(count)
    batch.reset(everyone, np.tile(scene.model.qpos0, (count, 1)), servos.horn)
    singles = [driven(scene, 0.1) for _ in everyone]
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


def test_servos_that_do_not_fit_are_refused():
    scene = rig()
    with pytest.raises(ValueError, match=r"drives \(2, 3\), .* got \(3, 3\)"):
        BatchSimulation(scene, 2).drive_by(Servos(0.1, OFFSETS, BACKLASHES, 3))
    with pytest.raises(ValueError, match=r"drives \(3,\), .* got \(2,\)"):
        Simulation(scene).drive_by(Servos(0.1, OFFSETS[:2], BACKLASHES[:2]))
    arm = build_scene(SCENES["arm"])
    with pytest.raises(ValueError, match="this scene's in tension"):
        Simulation(arm).drive_by(Servos(0.1, np.zeros(6), np.zeros(6)))


def test_a_copy_has_servos_of_its_own():
    simulation, servos = driven(rig(), 0.1)
    servos.command[:] = 2e-3
    simulation.advance()
    other, others = copy.deepcopy((simulation, servos))
    others.command[:] = -2e-3
    before = servos.horn.copy()
    other.advance()
    np.testing.assert_array_equal(servos.horn, before)
    assert np.all(others.horn < before)
    np.testing.assert_array_equal(other.ctrl, others.horn)


def test_every_robot_may_have_servo_errors_of_its_own():
    scene, count = rig(), 2
    offsets, backlashes = np.array([OFFSETS, -OFFSETS]), np.array([BACKLASHES, 2 * BACKLASHES])
    servos = Servos(0.1, offsets, backlashes, count)
    batch = BatchSimulation(scene, count)
    batch.drive_by(servos)
    batch.reset(np.arange(count), np.tile(scene.model.qpos0, (count, 1)), servos.horn)
    laws = [ServoLaw(0.1, *errors) for errors in zip(offsets, backlashes, strict=True)]
    times = Simulation(scene).step_times
    for command in commands(20):
        servos.command[:] = command
        batch.advance()
        for i, law in enumerate(laws):
            law.move(command, times)
            np.testing.assert_allclose(servos.horn[i], law.horn, rtol=0, atol=1e-16)
