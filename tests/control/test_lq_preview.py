from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from support.driven import driven_steps

from softrobot_env.beams.planar_arm import inertia_forces, make_planar_arm
from softrobot_env.control.reference_smoothing import begin_smoothing, memory_size, smoothed
from softrobot_env.control.registry import make_policy, policy_environment
from softrobot_env.envs.tracking import TrackingEnv
from softrobot_env.evaluation.metrics import tracking_metrics
from softrobot_env.evaluation.runner import Case, run
from softrobot_env.robots import ARM
from softrobot_env.tasks import make_task
from softrobot_env.tasks.trajectories import Step
from softrobot_env.thesis.arm.estimation import update_estimate
from softrobot_env.thesis.arm.timing import KNOTS, PERIOD

ARM_DATA = make_planar_arm(ARM)
LIMIT = np.full(3, 80.0)

#: Jump [m] of a reference, and largest acceleration [m/s2] of what replaces it.
JUMP, ACCELERATION = 5e-3, 10.0

# ---------------------------------------------------------------- estimation


def simulate(scale, force, inputs, duration, start):
    """States every ms of M a + k + s K (q + mu v) = B u + d, implicit with 20 steps per ms."""
    q, v, h = start.copy(), np.zeros(6), PERIOD / 20
    mass, gyroscopic = np.empty((6, 6)), np.empty(6)
    stiffness = scale * ARM_DATA.stiffness
    out = [(q.copy(), v.copy())]
    for k in range(round(duration / PERIOD)):
        for _ in range(20):
            inertia_forces(ARM_DATA, q, v, mass, gyroscopic)
            push = ARM_DATA.inputs @ inputs(k * PERIOD) + force - gyroscopic - stiffness * q
            system = mass + h * (ARM_DATA.damping_time + h) * stiffness * np.eye(6)
            v = np.linalg.solve(system, mass @ v + h * push)
            q = q + h * v
        out.append((q.copy(), v.copy()))
    return out


def estimate(states, inputs, adapt):
    force, information = np.zeros(6), np.zeros(2)
    for k, (before, after) in enumerate(pairwise(states)):
        pull = inputs(k * PERIOD), LIMIT
        known = adapt, information, force
        factor = update_estimate(ARM_DATA, PERIOD, *before, *after, *pull, *known)
    return factor, force


@pytest.mark.parametrize("scale", [0.5, 1.0, 1.6])
def test_stiffness_is_found_while_the_arm_moves(scale):
    def inputs(t):
        return np.array([6 + 3 * np.sin(8 * t), 5.0, 4 - 2 * np.sin(5 * t)])

    states = simulate(scale, np.zeros(6), inputs, 0.3, np.full(6, 1.0))
    factor, force = estimate(states, inputs, True)
    # What trust in the nominal stiffness is left after 0.3 s is some 10 %.
    assert abs(factor - scale) < 0.12 * abs(1 - scale) + 1e-3
    assert np.max(np.abs(force)) < 0.02 * np.max(ARM_DATA.inputs @ LIMIT)


def test_stiffness_is_found_within_a_few_milliseconds_of_the_start():
    """The arm springs off: what a controller sees when the robot is softer than it knew."""
    curvature = np.repeat([-5.0, -3.3, -1.7], 2)
    held = np.linalg.lstsq(ARM_DATA.inputs, ARM_DATA.stiffness * curvature, rcond=None)[0]
    states = simulate(0.5, np.zeros(6), lambda t: held, 0.02, curvature)
    assert estimate(states, lambda t: held, True)[0] == pytest.approx(0.5, abs=0.03)


def test_constant_forces_are_found():
    force = 0.02 * np.array([1.0, -1.0, 0.5, 0.5, -0.3, 0.2])
    states = simulate(1.0, force, lambda t: np.array([5.0, 5.0, 5.0]), 1.5, np.zeros(6))
    _, found = estimate(states, lambda t: np.array([5.0, 5.0, 5.0]), False)
    np.testing.assert_allclose(found, force, atol=1e-5)


def test_the_straight_arm_keeps_the_nominal_stiffness():
    """Nothing can be learned there, and nothing is made up."""
    states = simulate(0.5, np.zeros(6), lambda t: np.zeros(3), 0.5, np.zeros(6))
    assert estimate(states, lambda t: np.zeros(3), True)[0] == 1.0


# ---------------------------------------------------------------- jumps


def smooth(targets, ahead=0):
    """Path (T, 2) out of targets (T, 2) that the preview shows `ahead` steps before they come.

    Also (T, 2), what is said then of 20 steps later.
    """
    memory, here, later = np.zeros(memory_size(2)), [], []
    times = PERIOD * np.array([0.0, 1.0, 20.0])
    begin_smoothing(targets[0], memory)
    for k, target in enumerate(targets):
        points = np.array([targets[min(k + min(ahead, n), len(targets) - 1)] for n in (0, 1, 20)])
        smoothed(PERIOD, np.array(target), times, JUMP, ACCELERATION, memory, points)
        here.append(points[0])
        later.append(points[2])
    return np.array(here), np.array(later)


A, B, C = np.array([0.2, 0.4]), np.array([0.25, 0.36]), np.array([0.2, 0.35])


def test_announced_and_slow_references_pass_unchanged():
    t = PERIOD * np.arange(1000)
    targets = np.stack([0.2 + 0.1 * t, 0.4 - 0.02 * np.sin(3 * t)], axis=1)
    for ahead in (20, 0):  # slow ones need no announcement
        np.testing.assert_array_equal(smooth(targets, ahead)[0], targets)
    jump = np.array([A] * 50 + [B] * 50)
    np.testing.assert_array_equal(smooth(jump, ahead=20)[0], jump)


def test_a_jump_becomes_a_motion_of_bounded_acceleration():
    path, _ = smooth([A] * 5 + [B] * 400)
    along = (path - A) @ (B - A) / np.sum((B - A) ** 2)
    assert np.all(np.diff(along) >= -1e-15) and along[5] < 1e-6
    np.testing.assert_allclose(path[-1], B, atol=1e-15)
    acceleration = np.linalg.norm(np.diff(path, 2, axis=0), axis=1) / PERIOD**2
    assert acceleration.max() == pytest.approx(ACCELERATION, rel=0.01)


def test_a_second_jump_goes_on_smoothly():
    path, _ = smooth([A] * 5 + [B] * 60 + [C] * 600)
    velocity = np.diff(path, axis=0) / PERIOD
    acceleration = np.diff(velocity, axis=0) / PERIOD
    assert np.linalg.norm(acceleration, axis=1).max() < 2 * ACCELERATION
    assert np.abs(np.diff(acceleration, axis=0)).max() < 0.1 * ACCELERATION
    np.testing.assert_allclose(path[-1], C, atol=1e-15)


def test_what_is_ahead_is_what_comes():
    here, later = smooth([A] * 5 + [B] * 400)
    np.testing.assert_allclose(later[5:300], here[25:320], atol=1e-12)


# ---------------------------------------------------------------- closed loop


def driven(name, task, spoil, **options):
    """Actions (k, 3) and errors (k,) [m] of an episode whose sample 1000 is spoilt."""
    env = TrackingEnv(task, observe="all", **policy_environment(name))
    policy = make_policy(name, ARM, PERIOD)

    def shown(k, seen):
        return seen | spoil(seen) if k == 1000 else seen

    _, actions, _, after = zip(*driven_steps(env, policy, 1900, shown, **options), strict=True)
    off = [seen["tip_position"] - seen["reference"] for seen in after]
    return np.array(actions), np.linalg.norm(off, axis=1)


@pytest.mark.parametrize("name", ["lq_preview", "lq_adaptive"])
@pytest.mark.parametrize("size", [0.1, 2.0, np.nan, 1e200])
def test_one_bad_sample_does_no_lasting_harm(name, size):
    _, errors = driven(
        name, "lshape", lambda seen: {"curvature": seen["curvature"] + size}, duration=3.0
    )
    assert errors[1000:].max() < 5e-3 and errors[1500:].max() < 0.3e-3


def test_the_stiffness_found_survives_a_bad_sample():
    """Half as stiff as it knew: a missing observation must not bring the nominal one back."""
    lost, vary = {"tip_position": np.full(2, np.nan)}, {"youngs_modulus": 0.5}
    actions, errors = driven("lq_adaptive", "swing", lambda _: lost, vary=vary, duration=2.0)
    assert 80 * np.abs(np.diff(actions[990:], axis=0)).max() < 1.0
    assert errors[1000:].max() < 0.3e-3


def test_a_jump_that_the_preview_shows_is_met_in_the_middle():
    """Half of it before, half after, as an optimum has it."""
    task = make_task("step")
    late = replace(task, trajectory=LateStep(A3, B3), duration=1.5)
    adaptive, best = (run(Case(late, name)).rollout for name in ("lq_adaptive", "mpc_preview"))
    assert tracking_metrics(adaptive).e_rms < 2 * tracking_metrics(best).e_rms
    moved = np.linalg.norm(adaptive.tip - np.array(A3), axis=1)
    at_jump = moved[np.searchsorted(adaptive.time, 0.5)]
    assert 0.3 < at_jump / np.linalg.norm(np.subtract(B3, A3)) < 0.7


@pytest.fixture(params=["lq_preview", "lq_adaptive"])
def at_rest(request):
    """A policy, and what it observes at the start of the step, with the reference there."""
    env = TrackingEnv("step", observe="all", **policy_environment(request.param))
    observation, _ = env.reset()
    tip = observation["tip_position"]
    still = {"reference": tip.copy(), "reference_preview": np.tile(tip, len(KNOTS))}
    return make_policy(request.param, ARM, PERIOD), observation | still


def test_an_announced_jump_is_no_motion(at_rest):
    """The law is linear in a jump a period ahead: a speed of 8 m/s to it saturates all."""
    policy, observation = at_rest
    jump = np.array([1.0, 0.0])
    actions = []
    for size in (0.0, 6e-3, 8e-3):
        ahead = observation["reference_preview"] + size * np.tile(jump, len(KNOTS))
        action, state = policy.predict(observation | {"reference_preview": ahead}, None)
        assert state.status in (None, "")
        actions.append(action)
    six, eight = actions[1] - actions[0], actions[2] - actions[0]
    assert np.abs(six).max() > 1e-3
    np.testing.assert_allclose(eight, 8 / 6 * six, atol=1e-6)


def test_estimates_do_not_span_lost_observations(at_rest):
    """What was measured before a gap does not matter after it: no force explains the change."""
    policy, observation = at_rest
    moving = observation | {"curvature_rate": np.linspace(5.0, 20.0, ARM.pieces)}
    lost = moving | {"curvature": np.full(ARM.pieces, np.nan)}
    actions = []
    for before in (observation, moving):
        state = None
        for seen in (before, lost, moving):
            action, state = policy.predict(seen, state)
        actions.append(action)
    np.testing.assert_allclose(actions[0], actions[1], atol=1e-9)


class LateStep(Step):
    """A step after half a second."""

    def position(self, t):
        return super().position(np.asarray(t) - 0.5)


#: Start and target of the 50 mm step.
A3, B3 = make_task("step").trajectory.start, make_task("step").trajectory.target
