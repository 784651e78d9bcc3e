"""Excitations stay within limits, say what they do, and leave a robot at rest."""

from dataclasses import replace

import numpy as np
import pytest

from softrobot_env.envs.recording import RecordEpisodes
from softrobot_env.envs.tracking import TrackingEnv
from softrobot_env.identification.excitation import (
    Excitation,
    at_rests,
    directions,
    excite,
    plan,
    resting_task,
)
from softrobot_env.identification.replay import replay
from softrobot_env.robots import RIG, ROBOTS
from softrobot_env.robots.actuation import robot_inputs

PERIOD = 0.02
SHORT = Excitation(kinds=("pulls", "steps", "random"), levels=2, rest=0.4, decay=0.5, duration=3)


def test_a_pull_lets_the_other_tendons_out_by_what_the_bend_takes():
    """A uniform bend changes lengths by moment arm towards it times angle, up to a tendon's end."""
    robot = ROBOTS["ftdcr_v4"]
    ends = robot.of_tendons("end")
    for pulled, way in zip(robot.tendons, directions(robot).values(), strict=True):
        towards = np.array(pulled.offset) / np.hypot(*pulled.offset)
        moment_arms = robot.of_tendons("offset") @ towards
        wanted = moment_arms * np.minimum(ends, pulled.end)
        scale = robot_inputs(robot).input_scale
        # Integrals over 200 parts of a length.
        assert way == pytest.approx(wanted / np.abs(wanted / scale).max(), abs=0.01 * scale.min())


@pytest.mark.parametrize("robot", [RIG, ROBOTS["planar_finger"]], ids=lambda robot: robot.name)
def test_a_plan_starts_and_ends_at_rest_and_keeps_to_amplitude_and_speed(robot):
    found = plan(robot, SHORT, PERIOD)
    rest = -robot_inputs(robot).input_centre / robot_inputs(robot).input_scale
    actions = found.actions
    assert actions[-1] == pytest.approx(rest, abs=1e-12)
    jumps = np.char.startswith(found.labels, "step")  # and dither
    far = np.abs(actions - rest).max(axis=1)
    assert far[~jumps].max() <= SHORT.amplitude + 1e-9 and far.max() < SHORT.amplitude + 0.02
    rates = np.abs(np.diff(actions, axis=0, prepend=rest[None])) / PERIOD
    assert rates[~jumps].max() <= SHORT.speed * (1 + 1e-9) and rates[jumps].max() > SHORT.speed
    poses = [name for name in dict.fromkeys(found.labels) if name != "random"]
    assert len(poses) == 2 * len(directions(robot))
    assert (found.measured.max() + 1) == len(directions(robot)) * (4 + 2) + 1


def test_slow_drives_make_a_slow_plan():
    drive = replace(RIG.drive, speed=0.001)
    plans = [plan(r, SHORT, PERIOD) for r in (RIG, replace(RIG, drive=drive))]
    assert plans[1].duration > 3 * plans[0].duration
    rates = np.abs(np.diff(plans[1].actions, axis=0)).max(axis=1)[
        ~np.char.startswith(plans[1].labels[1:], "step")
    ]
    assert rates.max() * robot_inputs(RIG).input_scale[0] / PERIOD <= 0.8 * 0.001 * (1 + 1e-9)


def run(robot, excitation, given=None):
    """What happened, and the recording."""
    planned = plan(robot, excitation, PERIOD)
    task = resting_task(robot, planned.duration)
    env = RecordEpisodes(TrackingEnv(task, control_period=PERIOD, observe="all"))
    stopped = excite(env, planned, given or excitation)
    env.close()
    return stopped, env.recording, planned


def test_a_robot_stays_within_its_limits_and_is_at_rest_where_that_is_said():
    finger = ROBOTS["planar_finger"]
    slow = replace(SHORT, kinds=("pulls",), levels=1, radius=0.03, tension=0.4)
    stopped, recording, planned = run(finger, slow)
    assert stopped is None and len(recording.times) == len(planned.actions) + 1
    limits = finger.of_tendons("tension_limit")
    assert np.all(recording.commands <= 0.4 * limits)
    far = np.linalg.norm(recording.markers[:, 0, ::2] - recording.markers[0, 0, ::2], axis=1)
    assert 0.5 * 0.03 < far.max() < 1.25 * 0.03
    static, moved = at_rests(recording, planned)
    assert static.static and len(static.times) == 2 * len(directions(finger)) and moved < 1e-4
    assert replay(static, finger).distance.max() < moved + 1e-9


def test_a_robot_is_stopped_where_it_passes_a_limit():
    finger = ROBOTS["planar_finger"]
    for narrow, said in (
        (replace(SHORT, radius=0.005), "the tip is 6"),
        (replace(SHORT, tension=0.1), "pulls"),
    ):
        stopped, recording, planned = run(finger, SHORT, narrow)
        assert said in stopped and len(recording.times) < len(planned.actions) / 4


def test_what_cannot_be_done_is_refused():
    finger = ROBOTS["planar_finger"]
    with pytest.raises(ValueError, match="kinds"):
        Excitation(kinds=("dance",))
    with pytest.raises(ValueError, match="an episode at most 3600 s"):
        plan(finger, replace(SHORT, rest=1000.0), PERIOD)
    with pytest.raises(ValueError, match="has no tendons to pull"):
        plan(replace(finger, tendons=()), SHORT, PERIOD)
    with pytest.raises(ValueError, match="breaks a limit however little it moves"):
        plan(finger, replace(SHORT, radius=1e-9), PERIOD)
    _, recording, planned = run(finger, replace(SHORT, kinds=("random",), rest=0.0, duration=0.5))
    with pytest.raises(ValueError, match="never rested"):
        at_rests(recording, planned)
