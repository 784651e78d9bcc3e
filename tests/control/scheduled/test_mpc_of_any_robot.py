"""Model predictive control of any robot: its programs against dense ones, and its closed loop."""

from dataclasses import replace

import gymnasium
import numpy as np
import pytest
from scipy.optimize import lsq_linear

import softrobot_env  # noqa: F401  (registers the environments)
from softrobot_env.control.scheduled.law import build_table
from softrobot_env.control.scheduled.lq_preview import LQPreview, Preview
from softrobot_env.control.scheduled.mpc import PREVIEW, THESIS, Constrained, ScheduledMPC
from softrobot_env.control.scheduled.operating_points import find_points
from softrobot_env.control.scheduled.plan_gains import RegulatorCost, deviation_cost, plan_gains
from softrobot_env.control.scheduled.table import row_size
from softrobot_env.control.scheduled.timing import Timing, timing_of
from softrobot_env.robots import ARM, find_robot
from softrobot_env.thesis.arm.mpc_optimisation import BoundedSolver

ROD = find_robot("silicone_rod")
TIMING = timing_of(ROD)


@pytest.fixture(scope="module")
def points():
    return find_points(ROD, most=12, candidates=60)


@pytest.fixture(scope="module")
def table(points):
    return build_table(ROD, Constrained(ROD), points)


@pytest.fixture(scope="module")
def law(table):
    return ScheduledMPC(ROD, TIMING.period, table)


def still(law, table, **changed):
    """At rest at the first operating point, with the reference there."""
    tip = table.tips[0]
    seen = {
        "curvature": table.rows[0, table.m : table.m + table.n],
        "curvature_rate": np.zeros(table.n),
        "tip_position": tip,
        "reference": tip,
        "reference_preview": np.tile(tip, len(law._law.times) - 1),
        "previous_action": table.rows[0, : table.m],
        "tendon_length": table.rows[0, : table.m] * law._own.input_scale,
    }
    return seen | changed


# ---------------------------------------------------------------- gains


def rolled(regulator, start, way, count):
    """Cost of inputs (count m,) from a state, as c + 2 g v + v H v, beyond them best without end.

    Written out step by step, for a reference that is 0 now and `way` (d,) from the next step on.
    """
    states, order = len(regulator.a), regulator.b.shape[1]
    by_input, free = np.zeros((states, count * order)), start.copy()
    hessian = np.kron(np.eye(count), regulator.change)
    gradient = np.zeros(count * order)
    for k in range(count):
        by_input = regulator.a @ by_input
        by_input[:, k * order : (k + 1) * order] += regulator.b
        free = regulator.a @ free
        hessian += by_input.T @ regulator.weight @ by_input
        gradient += by_input.T @ (regulator.weight @ free - regulator.position.T @ way)
    return hessian, gradient


def test_unbound_plan_is_the_dense_optimum_over_a_long_horizon(points):
    """Two hundred steps by least squares, without Riccati's equation, from states at random."""
    timing = Timing(TIMING.first, TIMING.period, (TIMING.period,), (TIMING.period, 0.006, 0.015))
    point, directions = points.points[3], points.directions
    regulator = RegulatorCost(ROD).at(point, directions, timing)
    regulator.velocity_weight = 0.0
    n, m = len(point.curvature), len(point.action)
    rng = np.random.default_rng(0)
    start, way = 0.1 * rng.normal(size=2 * n + m), 1e-3 * rng.normal(size=len(directions))
    hessian, gradient = rolled(regulator, start, way, 200)
    inputs = np.linalg.solve(hessian, -gradient).reshape(200, m)
    dense = start[-m:] + np.cumsum(inputs, axis=0)[[0, 5, 14]]
    gains = plan_gains(regulator, timing, directions)
    inner = 3 * m * (2 * n + m)
    feedback = gains[:inner].reshape(3 * m, -1) * np.concatenate([regulator.size, np.ones(m)])
    ahead = gains[inner:].reshape(3 * m, 3)
    planned = np.tile(start[-m:], 3) - feedback @ start + ahead @ directions.T @ way
    scale = np.abs(dense).max()
    np.testing.assert_allclose(planned.reshape(3, m), dense, atol=2e-3 * scale)


def test_first_planned_action_is_that_of_lq(points):
    settings = replace(PREVIEW, preview=0.25)
    own = settings.timing(ROD)
    point, directions = points.points[2], points.directions
    n, m, knots = len(point.curvature), len(point.action), len(own.knots)
    lq = Preview(ROD)(point, directions, TIMING)
    plan = Constrained(ROD, settings)(point, directions, TIMING)
    inner, count = 2 * n + m, len(own.nodes)
    np.testing.assert_allclose(plan[: m * inner], lq[: m * inner], rtol=1e-9, atol=1e-12)
    first = plan[count * m * inner :][: 3 * m * knots]
    np.testing.assert_allclose(first, lq[m * inner :], rtol=1e-9, atol=1e-9 * np.abs(lq).max())


def test_cost_of_deviations_is_what_they_cost_step_by_step(points):
    """By running both plans for long, each with the best feedback after the last node."""
    timing = PREVIEW.timing(ROD)
    regulator = RegulatorCost(ROD).at(points.points[1], points.directions, timing)
    m, rng = regulator.b.shape[1], np.random.default_rng(1)
    hessian = deviation_cost(regulator, timing)
    costs = []
    off = rng.normal(size=(2, len(timing.nodes), m))
    start = 0.1 * rng.normal(size=len(regulator.a))
    for more in (np.zeros_like(off[0]), *off):
        costs.append(_cost(regulator, timing, start, more))
    one, two = (more.ravel() @ hessian @ more.ravel() for more in off)
    assert (costs[1] - costs[0]) / (costs[2] - costs[0]) == pytest.approx(one / two, rel=1e-5)


def _cost(regulator, timing, start, off):
    """Of the LQ plan from a state, plus deviations (c, m) of the actions at the nodes."""
    nodes = np.array([0.0, *timing.nodes])
    last, m = round(nodes[-1] / timing.period), off.shape[1]
    best, state, cost = start.copy(), start.copy(), 0.0
    for k in range(last + 3000):
        wanted = best[-m:] - regulator.feedback @ best
        best = regulator.a @ best - regulator.b @ regulator.feedback @ best
        if k < last:
            time = (k + 1) * timing.period
            more = [np.interp(time, nodes, [0.0, *column]) for column in off.T]
            change = wanted + more - state[-m:]
        else:
            change = -regulator.feedback @ state
        state = regulator.a @ state + regulator.b @ change
        cost += state @ regulator.weight @ state + change @ regulator.change @ change
    return cost


def test_gains_are_as_many_as_files_are_checked_for(table):
    before = row_size(table.n, table.m, len(table.directions))
    assert table.rows.shape[1] == before + Constrained(ROD).count(table.n, table.m, 2)


# ---------------------------------------------------------------- programs


def test_bounded_solver_with_rows_agrees_with_a_transformed_problem():
    """Rows that are invertible make a problem with bounds alone, in other unknowns."""
    rng = np.random.default_rng(3)
    factor, rows = rng.normal(size=(8, 5)), rng.normal(size=(5, 5)) + 3 * np.eye(5)
    goal = 3 * rng.normal(size=8)
    back = np.linalg.inv(rows)
    expected = back @ lsq_linear(factor @ back, goal, (-0.2, 0.3), tol=1e-14).x
    wide = np.full(5, 1e3)
    bounds = np.concatenate([-wide, np.full(5, -0.2)]), np.concatenate([wide, np.full(5, 0.3)])
    found = BoundedSolver()(factor.T @ factor, -factor.T @ goal, *bounds, rows)
    np.testing.assert_allclose(found, expected, atol=1e-6)


def test_resting_robot_keeps_its_action(law, table):
    seen = still(law, table)
    action, state = law.predict(seen)
    np.testing.assert_allclose(action, seen["previous_action"], atol=2e-3)
    assert state.status is None


def test_servos_are_not_asked_for_more_than_their_speed(law, table):
    seen = still(law, table)
    seen["reference"] = seen["reference"] + [0.03, 0.0, 0.0]
    seen["reference_preview"] = np.tile(seen["reference"], len(law._law.times) - 1)
    _, state = law.predict(still(law, table))
    action, state = law.predict(seen, state)
    change = np.abs(action - seen["previous_action"])
    limit = ROD.drive.speed * TIMING.period / law._own.input_scale
    assert np.all(change <= limit * (1 + 1e-5))


@pytest.mark.slow
def test_circle_beyond_the_speed_of_servos_is_followed_better_than_by_lq(points, law):
    lq = LQPreview(ROD, TIMING.period, build_table(ROD, Preview(ROD), points))
    assert followed(ROD, law, 0.5) < 0.5 * followed(ROD, lq, 0.5)


def test_tensions_of_a_planar_arm_end_at_their_limits():
    arm = replace(ARM, name="short", length=0.3, pieces=4, tendons=_two_pairs())
    table = build_table(arm, Constrained(arm), find_points(arm, most=6, candidates=30))
    law = ScheduledMPC(arm, timing_of(arm).period, table)
    seen = still(law, table)
    flat = {name: seen[name][[0, 2]] for name in ("tip_position", "reference")}
    knots = len(law._law.times) - 1
    seen |= flat | {"reference_preview": np.tile(flat["reference"], knots)}
    action, state = law.predict(seen)
    np.testing.assert_allclose(action, seen["previous_action"], atol=2e-3)
    far = flat["reference"] + [0.1, 0.0]
    for _ in range(20):
        action, state = law.predict(
            seen | {"reference": far, "reference_preview": np.tile(far, knots)}, state
        )
    assert np.abs(action).max() == pytest.approx(1.0, abs=1e-6)
    assert state.status == "tension limit reached"


def _two_pairs():
    pairs = [t for t in ARM.tendons if t.group < 2]
    return tuple(replace(t, end=0.15 * (t.group + 1), tension_limit=15.0) for t in pairs)


def followed(robot, policy, share):
    """Mean error [m] on a circle at a share of the first mode's rate."""
    task = gymnasium.make("SoftRobot/Track-v0", robot=robot, task="circle").unwrapped.task
    speed = task.trajectory.curve.top_rate * 2 * np.pi * share / timing_of(robot).first
    env = gymnasium.make(
        "SoftRobot/Track-v0",
        robot=robot,
        task="circle",
        speed=speed,
        observe=policy.requires,
        control_period=timing_of(robot).period,
        preview=policy._law.times[1:].tolist(),
    )
    seen, state, errors, over = env.reset(seed=0)[0], None, [], False
    while not over:
        action, state = policy.predict(seen, state)
        seen, _, failed, late, _ = env.step(action)
        errors.append(np.linalg.norm(seen["tip_position"] - seen["reference"]))
        over = failed or late
    return np.mean(errors)


# ---------------------------------------------------------------- refusals


def test_thesis_settings_need_no_preview(points):
    timing = THESIS.timing(ROD)
    table = build_table(ROD, Constrained(ROD, THESIS), points)
    law = ScheduledMPC(ROD, TIMING.period, table, THESIS)
    assert law.hold == round(timing.period / TIMING.period) and not timing.knots
    assert "reference_preview" not in law.requires
    seen = still(law, table)
    action, _ = law.predict(seen)
    np.testing.assert_allclose(action, seen["previous_action"], atol=2e-3)


def test_other_previews_and_references_are_refused(law, table):
    with pytest.raises(ValueError, match="needs an environment with preview="):
        law.predict(still(law, table, reference_preview=np.zeros(6)))
    with pytest.raises(ValueError, match="of three coordinates"):
        law.predict(still(law, table, reference=np.zeros(1), tip_position=np.zeros(1)))


def test_periods_that_are_no_part_of_its_own_are_refused(table):
    with pytest.raises(ValueError, match=r"model predictive control decides every 0\.001 s"):
        ScheduledMPC(ROD, 0.003, table)


def test_bad_observations_keep_the_action(law, table):
    seen = still(law, table)
    _, state = law.predict(seen)
    bad = still(law, table, curvature=np.full(table.n, np.nan))
    action, state = law.predict(bad, state)
    np.testing.assert_allclose(action, seen["previous_action"], atol=1e-7)
    assert state.status.startswith("observation not finite")
