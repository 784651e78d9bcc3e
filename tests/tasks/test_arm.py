"""Tasks: the audit's coordinates, and starts in equilibrium on the reference."""

import numpy as np
import pytest
from scipy.optimize import minimize

from softrobot_env.beams.constant_curvature import ConstantCurvatureStatics
from softrobot_env.control.feedforward.statics import least_norm
from softrobot_env.robots import ARM
from softrobot_env.tasks import ALL_TASKS, STEP_WIDTHS, TASKS, UNSEEN_TASKS, make_task

STATICS = ConstantCurvatureStatics(ARM)


def at(task, *times):
    """Reference (n, 2) in (x, z) [m]."""
    return task.trajectory.position(np.array(times))[:, [0, 2]]


def curve_parameter(task):
    """Equal-force parameter a = F r_t / EI of the start."""
    return np.array(task.start_input) * 0.025 / ARM.bending_stiffness


@pytest.mark.parametrize(
    ("name", "width"),
    [("step", w) for w in STEP_WIDTHS] + [(name, None) for name in ALL_TASKS if name != "step"],
)
def test_the_start_input_holds_the_tip_on_the_reference(name, width):
    task = make_task(name, width)
    start = at(task, -1.0)[0]  # before the jump, for the step
    # Start inputs are given to 1e-8 N, and a newton moves the tip by less than 0.1 m.
    np.testing.assert_allclose(STATICS.tip(np.array(task.start_input)), start, atol=2e-9)


# ---------------------------------------------------------------- step


@pytest.mark.parametrize(
    ("width", "target", "parameter"),
    [
        (0.05, (0.22034, 0.43478), 0.766),
        (0.1, (0.26056, 0.40482), 0.933),
        (0.2, (0.32888, 0.32963), 1.276),
    ],
)
def test_step_of_the_audit(width, target, parameter):
    """The printed targets belong to the rounded parameters, not to the exact widths."""
    task = make_task("step", width)
    assert task.step_width == width
    before, after = at(task, -1e-6, 0.0)
    assert np.hypot(*(after - before)) == pytest.approx(width, abs=1e-12)
    np.testing.assert_allclose(before, (0.17669, 0.45946), atol=5.1e-6)
    np.testing.assert_allclose(curve_parameter(task), 0.6, rtol=1e-12)
    np.testing.assert_allclose(task.start_input, 5.05, atol=5e-3)
    force = parameter * ARM.bending_stiffness / 0.025
    np.testing.assert_allclose(STATICS.tip(np.full(3, force)), target, atol=5.1e-6)
    # Half a digit of the parameter moves the tip by 5e-4 * 0.3 m.
    assert np.hypot(*(after - target)) < 1.5e-4


def test_step_runs_five_seconds_by_50_mm_unless_asked():
    assert make_task("step").step_width == 0.05
    assert make_task("step").duration == 5.0
    assert make_task("step").label == "step 50 mm"
    assert make_task("swing").label == "swing"


# ---------------------------------------------------------------- swing


@pytest.mark.parametrize("sign", [1, -1])
def test_swing_waypoints_of_the_audit(sign):
    task = make_task("swing")
    arc = np.array([0.0, 0.125, 0.25, 0.375, 0.5])
    points = at(task, *(5 + sign * arc / 0.1))
    np.testing.assert_allclose(
        points[:, 0], sign * np.array([0, 0.1230, 0.2344, 0.3230, 0.3794]), atol=5.1e-5
    )
    np.testing.assert_allclose(points[:, 1], [0.5, 0.4809, 0.4252, 0.3378, 0.2269], atol=5.1e-5)


def test_swing_start_and_rest_of_the_audit():
    task = make_task("swing")
    np.testing.assert_allclose(curve_parameter(task), -1.6714, atol=5e-5)
    np.testing.assert_allclose(np.abs(task.start_input), 14.08, atol=5e-3)
    np.testing.assert_allclose(at(task, 0.0)[0], (-0.37936, 0.22687), atol=5.1e-6)
    np.testing.assert_allclose(at(task, 10.0, 12.0, 15.0), [(0.37936, 0.22687)] * 3, atol=5.1e-6)
    assert task.duration == 15.0


# ---------------------------------------------------------------- L-shape


def test_lshape_of_the_audit():
    task = make_task("lshape")
    corners = [(0.24, 0.42), (0.24, 0.30), (0.35, 0.30), (0.35, 0.30)]
    np.testing.assert_allclose(at(task, 0.0, 5.0, 10.0, 15.0), corners, atol=1e-15)
    speed = np.linalg.norm(task.trajectory.velocity(np.array([2.0, 7.0, 12.0])), axis=1)
    np.testing.assert_allclose(speed, [0.024, 0.022, 0.0], rtol=1e-12)
    assert task.duration == 15.0


@pytest.mark.parametrize(
    ("name", "options"), [("lshape", {}), ("random", {"seed": 0}), ("random", {"seed": 1})]
)
def test_tasks_start_with_the_least_norm(name, options):
    """Against a general optimiser that knows only the tip; odd seeds are on the other side."""
    task = make_task(name, **options)
    target = at(task, 0.0)[0]
    assert np.sign(target[0]) == (-1 if options.get("seed") == 1 else 1)
    constraint = {"type": "eq", "fun": lambda u: 10 * (STATICS.tip(u) - target)}
    guesses = np.random.default_rng(0).uniform(-15, 15, (10, 3))
    found = [
        minimize(lambda u: u @ u, u, constraints=constraint, options={"ftol": 1e-13}, tol=1e-12)
        for u in guesses
    ]
    norms = [np.linalg.norm(f.x) for f in found if f.success]
    assert len(norms) > 3
    assert min(norms) == pytest.approx(np.linalg.norm(task.start_input), abs=1e-5)


# ---------------------------------------------------------------- unseen tasks

#: Every unseen task, and random paths on both sides.
UNSEEN = [(name, {}) for name in UNSEEN_TASKS] + [
    ("random", {"seed": seed}) for seed in range(1, 5)
]

#: Largest input [N] that holds the tip on an unseen path; the limit is 80 N.
_MODERATE = 50.0


@pytest.mark.parametrize(("name", "options"), UNSEEN)
def test_the_arm_at_rest_reaches_every_point_with_moderate_tension(name, options):
    task = make_task(name, speed=0.4, **options)
    inputs = np.array(task.start_input)
    before = inputs
    for point in at(task, *np.linspace(0, task.duration, 801)):
        inverse = least_norm(STATICS, point, inputs)
        assert inverse.reached
        # Points are below 5 mm apart, for which some 10 N are enough: no jump to another branch.
        assert np.max(np.abs(inverse.inputs - inputs)) < 10.0
        inputs = inverse.inputs
        assert np.max(np.abs(inputs)) < _MODERATE
    np.testing.assert_allclose(inputs, before, atol=1e-5)  # laps end where they began


@pytest.mark.parametrize("name", UNSEEN_TASKS)
@pytest.mark.parametrize("speed", [0.05, 0.4])
def test_unseen_tasks_run_at_their_speed_and_rest_at_the_end(name, speed):
    task = make_task(name, speed=speed)
    times = np.linspace(0, task.duration, 20_001)
    velocity = np.linalg.norm(task.trajectory.velocity(times), axis=1)
    assert velocity.max() == pytest.approx(speed, rel=1e-4)
    assert np.all(velocity[times > task.duration - 1.0] == 0)
    assert velocity[0] == 0
    # Twice as slow is the same path; only the ramps do not stretch.
    half = make_task(name, speed=speed / 2)
    assert half.duration - 1.5 == pytest.approx(2 * (task.duration - 1.5))


def test_unseen_tasks_are_named_by_seed_and_speed():
    assert make_task("circle", speed=0.05).label == "circle 0.05 m/s"
    assert make_task("random", speed=0.2, seed=3).label == "random 3 0.2 m/s"
    assert not set(TASKS) & set(UNSEEN_TASKS)
    assert make_task("random", seed=3) == make_task("random", seed=3)
    assert make_task("random", seed=3).trajectory != make_task("random", seed=5).trajectory
