"""The test rig's environment, what a twin adds to it, and the same rig behind pulses and counts."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from support.rig_episodes import TWINS, rig, steps

from softrobot_env.envs.observations.table import OBSERVABLES
from softrobot_env.envs.rendering import lifted
from softrobot_env.envs.simulation.virtual_rig import VirtualRig
from softrobot_env.envs.tracking import TrackingEnv
from softrobot_env.evaluation.run import run_episode
from softrobot_env.robots import CAMERA_PERIOD, EQUIVALENT_RIG, RIG
from softrobot_env.robots.twin import Twin, nominal_twin, rig3d_twin
from softrobot_env.scene.registry import SCENES
from softrobot_env.tasks import Task, make_task
from softrobot_env.thesis.envs import RigEnv

# ---------------------------------------------------------------- the two checkers, spaces


def test_what_a_lab_does_not_measure_is_not_observed_unless_asked_for():
    lacking = {"sensors", "motor_force", "anchor_tension"}
    unmeasured = {"curvature", "curvature_rate", "tendon_tension", *lacking}
    assert set(RigEnv().observation_space) == set(OBSERVABLES) - unmeasured
    assert set(rig().observation_space) == set(OBSERVABLES) - lacking
    assert rig().observation_space == rig(twin=1).observation_space


def test_environments_simulate_the_registered_scenes():
    assert rig().scene.config == SCENES["rig"]
    assert TrackingEnv("swing").scene.config == SCENES["arm"]


# ---------------------------------------------------------------- determinism, copies, memory


def test_only_the_camera_of_a_twin_depends_on_the_seed():
    env = rig(twin=0)
    one, two = env.reset(seed=1)[0], env.reset(seed=2)[0]
    different = {name for name in one if np.any(one[name] != two[name])}
    assert different == {"tip_position", "tip_velocity"}


# ---------------------------------------------------------------- records


class Constant:
    """Policy that pulls at one tendon."""

    def predict(self, observation, state=None, episode_start=None, deterministic=True):
        return np.array([0.3, 0.0, 0.0], np.float32), state


@TWINS
def test_run_episode_records_x_and_y(twin):
    env = rig(twin=twin)
    record = run_episode(env, Constant(), seed=0, options={"duration": 1.0})
    assert record.tip.shape == record.reference.shape == (51, 3)
    assert record.curvature.shape == (51, 2)
    np.testing.assert_array_equal(record.tip[:, 2], 0)
    assert record.tip[-1, 0] > 0.03
    np.testing.assert_allclose(record.tip[-1, :2], env.data.site("tip").xpos[:2], atol=1e-12)
    np.testing.assert_allclose(record.error[-1], env._error, rtol=1e-12)


OTHER = replace(RIG, name="other", pieces=2)


@TWINS
def test_starts_are_equilibria(twin):
    start = np.array([0.012, -0.006, -0.002])
    env = rig(twin=twin, control_period=0.05)
    observation, info = env.reset(options={"start_length": start})
    np.testing.assert_allclose(observation["previous_action"], start / 0.03)
    tip = env.data.site("tip").xpos.copy()
    assert np.hypot(*tip[:2]) > 0.05
    for _ in range(10):
        *_, info = env.step((start / 0.03).astype(np.float32))
    np.testing.assert_allclose(env.data.site("tip").xpos, tip, atol=2e-6)
    np.testing.assert_allclose(info["tendon_length"], start + env.twin.servo_offset, atol=1e-9)


def test_other_options_keep_the_tasks_own_robot_and_start():
    start = (0.012, -0.006, -0.002)
    own = replace(make_task("triangle", period=2.0), robot=OTHER, start_input=start)
    env = rig(own)
    observation, _ = env.reset(options={"task": {"period": 3.0}})
    assert observation["curvature"].shape == (4,)
    np.testing.assert_allclose(observation["previous_action"], np.array(start) / 0.03)
    assert env.current_task.robot == OTHER


@pytest.mark.parametrize("broken", ["position", "velocity", "acceleration"])
def test_references_that_are_not_finite_are_refused(broken):
    """A path at rest on the axis, one of whose functions is not a number from 0.5 s on."""

    def function(late):
        return lambda t: np.where(np.asarray(t)[:, None] < 0.5, 0.0, late) * np.ones(3)

    parts = dict.fromkeys(("position", "velocity", "acceleration", "path"), function(0.0))
    path = SimpleNamespace(**parts | {broken: function(np.nan)})
    with pytest.raises(ValueError, match="must be finite"):
        RigEnv(Task("broken", RIG, path, 1.0, (0.0,) * 3, axes="xy"))


def test_a_twin_of_another_robot_may_be_given():
    twin = Twin(OTHER, 0.1, (0.0,) * 3, (0.0,) * 3)
    env = rig(replace(make_task("triangle"), robot=OTHER), twin=twin)
    assert env.twin is twin


def test_curvature_of_the_robots_pieces():
    """Two pieces of the robot on four of the chain, in a posture of known bends."""
    task = replace(make_task("triangle"), robot=replace(RIG, pieces=2))
    env = rig(task)
    env.reset()
    layout = env.scene.layout
    for station, (piece, weight) in enumerate(zip(layout.piece, layout.weights, strict=True)):
        env.data.joint(f"hinge{station}").qpos = weight * (3.0 if piece < 2 else 5.0)
        env.data.joint(f"side{station}").qpos = weight * (-1.0 if piece < 2 else 2.0)
    env._readout.update()
    np.testing.assert_allclose(env._readout.bend, [3.0, -1.0, 5.0, 2.0], rtol=1e-12)


def test_references_are_drawn_on_the_dome():
    """The height of an arc of the angle that puts the head's output there."""
    angle = np.array([1e-6, 0.3, 1.2])
    distance = 0.18 * (1 - np.cos(angle)) / angle + 0.022 * np.sin(angle)
    height = 0.18 * np.sin(angle) / angle + 0.022 * np.cos(angle)
    points = np.stack([distance * np.cos(2.0), distance * np.sin(2.0)], axis=1)
    placed = lifted(RIG, points)
    np.testing.assert_array_equal(placed[:, :2], points)
    np.testing.assert_allclose(placed[:, 2], height, atol=2e-5)


# ---------------------------------------------------------------- servos


def test_servos_wind_at_their_speed():
    env = rig(control_period=0.02)
    env.reset()
    *_, info = env.step(np.array([1.0, -0.05, 0.0], np.float32))
    speed = nominal_twin(EQUIVALENT_RIG).servo_speed
    np.testing.assert_allclose(info["tendon_length"], [0.02 * speed, -1.5e-3, 0], atol=1e-9)
    for _ in range(20):
        observation, *_, info = env.step(np.array([1.0, -0.05, 0.0], np.float32))
    np.testing.assert_allclose(info["tendon_length"], [0.03, -1.5e-3, 0], atol=1e-9)
    np.testing.assert_array_equal(observation["tendon_length"], info["tendon_length"])


def test_offsets_and_backlash_of_a_twin_are_applied_and_not_read_by_potentiometers():
    twin = replace(
        nominal_twin(EQUIVALENT_RIG), servo_offset=(1e-3, 0.0, 0.0), backlash=(0.0, 4e-4, 0.0)
    )
    env = rig(twin=twin)
    observation, info = env.reset()
    np.testing.assert_allclose(info["tendon_length"], [1e-3, 0, 0], atol=1e-15)
    np.testing.assert_allclose(observation["tendon_length"], 0, atol=1e-15)
    for _ in range(5):
        observation, *_, info = env.step(np.array([0.1, 0.1, 0.1], np.float32))
    np.testing.assert_allclose(info["tendon_length"], [4e-3, 2.8e-3, 3e-3], atol=1e-9)
    np.testing.assert_allclose(observation["tendon_length"], 3e-3, atol=1e-9)


# ---------------------------------------------------------------- twins and their camera


def test_a_seed_stands_for_its_twin():
    env = rig(twin=5)
    assert env.twin == rig3d_twin(5)
    assert env.task.robot is RIG
    assert env.scene.config.robot == env.twin.robot
    assert rig().twin == nominal_twin(EQUIVALENT_RIG)
    np.testing.assert_allclose(
        env.model.tendon_frictionloss[:3], [t.friction for t in env.twin.robot.tendons]
    )


@pytest.mark.parametrize("delay", [0, 1, 3])
def test_the_camera_sees_late_and_not_exactly(delay):
    noise = 3e-4
    twin = replace(
        nominal_twin(EQUIVALENT_RIG), camera_noise=noise, camera_delay=delay * 0.02 + 0.004
    )
    env, exact = rig(twin=twin), rig()
    observation, info = env.reset(seed=0)
    truth, seen, speed = [info["tip_position"]], [observation["tip_position"]], []
    exact.reset()
    for (observation, *_, info), (other, *_) in zip(
        steps(env, 300), steps(exact, 300), strict=True
    ):
        np.testing.assert_array_equal(info["tip_position"], other["tip_position"])
        error = np.hypot(*(other["tip_position"] - other["reference"]))
        assert info["error"] == pytest.approx(error, rel=1e-12)
        truth.append(info["tip_position"])
        seen.append(observation["tip_position"])
        speed.append(observation["tip_velocity"])
    np.testing.assert_allclose(speed, np.diff(seen, axis=0) / 0.02, atol=1e-12)
    error = np.array(seen[delay:]) - truth[: len(truth) - delay]
    assert np.std(error) == pytest.approx(noise, rel=0.1)
    assert abs(np.mean(error)) < 4 * noise / np.sqrt(error.size)


@pytest.mark.parametrize("period", [0.001, 0.004, 0.01, 0.05])
def test_pictures_come_90_a_second_each_at_the_next_control_instant(period):
    """Exact pictures, two periods late: each new one is the truth of then."""
    env = rig(
        twin=replace(nominal_twin(EQUIVALENT_RIG), camera_delay=2 * period), control_period=period
    )
    _, info = env.reset()
    truth, taken, before = [info["tip_position"]], [], None
    action = np.array([0.5, 0.2, -0.3], np.float32)
    for k in range(1, round(1 / period)):
        observation, *_, info = env.step(action)
        truth.append(info["tip_position"])
        if k < 2 or np.array_equal(observation["tip_position"], before):
            continue
        before = observation["tip_position"]
        np.testing.assert_array_equal(before, truth[k - 2])
        taken.append(k - 2)
        if len(taken) > 2:
            way = truth[taken[-1]] - truth[taken[-2]]
            speed = way / (period * (taken[-1] - taken[-2]))
            np.testing.assert_allclose(observation["tip_velocity"], speed, atol=1e-9)
    frame = max(1 / 90, period)
    late = period * np.array(taken[1:]) - frame * np.arange(1, len(taken))
    assert np.ptp(late) < 1.001 * period
    assert len(taken) == pytest.approx(1 / frame, abs=3)


def test_an_exact_twin_needs_no_camera():
    _, info = rig().reset()
    assert "tip_position" not in info


# ---------------------------------------------------------------- the virtual rig

TWIN = rig3d_twin(3)


@pytest.fixture
def virtual():
    return VirtualRig(TWIN)


def hold(virtual, command, seconds):
    for _ in range(round(seconds / virtual.tick)):
        assert virtual.advance(command) is None


def test_it_moves_as_the_environment_does(virtual):
    """Same twin, same commands held for 20 ms, some quick: only the timestep differs."""
    env = RigEnv("reach", twin=TWIN)
    env.reset(seed=0)
    rng, worst = np.random.default_rng(1), 0.0
    action = np.zeros(3)
    for k in range(50):
        change = (0.3 if k % 10 == 0 else 0.05) * rng.standard_normal(3)
        action = np.clip(action + change, -0.3, 0.3).astype(np.float32)
        observation, *_, info = env.step(action)
        hold(virtual, env.length_scale * action.astype(float), env.control_period)
        assert observation["tendon_length"] == pytest.approx(virtual.length, abs=1e-12)
        worst = max(worst, np.hypot(*(virtual.tip - info["tip_position"])))
    assert np.hypot(*virtual.tip) > 0.03
    assert worst < 0.3e-3


def test_without_power_the_servos_stay(virtual):
    hold(virtual, np.array([0.01, 0.0, 0.0]), 0.3)
    assert virtual.length == pytest.approx([0.01, 0.0, 0.0])
    hold(virtual, None, 0.1)
    assert virtual.length == pytest.approx([0.01, 0.0, 0.0])


def test_a_stuck_servo_stays_and_the_others_move(virtual):
    virtual.stuck.add(1)
    hold(virtual, np.full(3, 0.004), 0.2)
    assert virtual.length == pytest.approx([0.004, 0.0, 0.004])


def test_pictures_are_late_and_noisy_around_the_tip(virtual):
    pictures = []
    for _ in range(3000):
        virtual.advance(np.zeros(3))
        pictures += [virtual.picture] if virtual.picture else []
    ages = [picture[0] for picture in pictures]
    assert len(pictures) == pytest.approx(3000 * virtual.tick / CAMERA_PERIOD, abs=2)
    assert min(ages) >= CAMERA_PERIOD - 1e-9 and max(ages) <= CAMERA_PERIOD + virtual.tick + 1e-9
    errors = np.array([picture[1] for picture in pictures]) - virtual.tip
    assert errors.std() == pytest.approx(TWIN.camera_noise, rel=0.15)
    assert np.abs(errors.mean(axis=0)).max() < 4 * TWIN.camera_noise / np.sqrt(len(errors))


def test_sensors_tell_the_direction_of_the_bend(virtual):
    straight = np.array(virtual.adc())
    hold(virtual, np.array([0.01, -0.005, -0.005]), 1.0)
    change = np.array(virtual.adc()) - straight
    bend = np.array([change[0] - change[2], change[1] - change[3]])
    # Pairs of opposite sensors see the same bend.
    assert change[0] == pytest.approx(-change[2], abs=12)
    assert change[1] == pytest.approx(-change[3], abs=12)
    assert np.argmax(np.abs(bend)) == np.argmax(np.abs(virtual.tip))
    assert np.sign(bend[np.argmax(np.abs(bend))]) == np.sign(
        virtual.tip[np.argmax(np.abs(virtual.tip))]
    )
