"""The stability benchmark: its verdicts, the timestep rule on a small map, and extreme cases."""

from math import pi
from types import SimpleNamespace

import numpy as np
import pytest

from softrobot_env.beams.model import State
from softrobot_env.robots import ARM
from studies.beams import make_beam
from studies.stability import extremes, shown
from studies.stability.map import (
    BOUND,
    Family,
    limit_rows,
    map_rows,
    rule_rows,
    run_cell,
    scaled_arm,
)
from studies.stability.runs import (
    CHAIN,
    DIVERGED,
    NOT_CONVERGED,
    STABLE,
    WRONG,
    BeamSystem,
    Plan,
    Reference,
    Trace,
    judge,
)

STIFFNESSES = (1e-2, 1.0, 1e4)
TIMESTEPS = (1e-4, 2e-3, 2e-2)


@pytest.fixture(scope="module")
def chain():
    return Family(CHAIN, 6)


@pytest.fixture(scope="module")
def pcc():
    return Family("pcc", 3)


@pytest.fixture(scope="module")
def rows(chain):
    """A coarse map with the rule on it."""
    return [
        row
        for damping in (0.0, 5.0)
        for row in (
            *map_rows(chain, damping, TIMESTEPS, STIFFNESSES),
            *rule_rows(chain, damping, STIFFNESSES),
            *limit_rows(chain, damping, (0.5, 0.9, 1.2, 2.0)),
        )
    ]


def circle(time, radius=0.1):
    return radius * np.stack([np.cos(time), np.sin(time)], axis=1)


def trace_of(time, tip, failure=None):
    return Trace(time, tip, DIVERGED if failure else None, failure, 0.0, len(time))


@pytest.fixture(scope="module")
def truth():
    time = np.linspace(0, 6, 400)
    return Reference(time, circle(time), 0.0)


def test_judge_measures_the_distance_to_the_truth(truth):
    time = np.linspace(0, 6, 50)
    off = trace_of(time, circle(time) + np.array([0.003, 0.004]))
    verdict = judge(off, truth, 0.0051)
    assert (verdict.outcome, verdict.failure) == (STABLE, None)
    assert verdict.e_max == pytest.approx(0.005, abs=1e-9)
    assert judge(off, truth, 0.0049).outcome == WRONG


def test_judge_says_how_wrong_and_when(truth):
    time = np.linspace(0, 6, 61)
    tip = circle(time)
    tip[30] += [0.037, 0.0]
    verdict = judge(trace_of(time, tip), truth, 0.01)
    assert verdict.failure == "finite but wrong: tip 37 mm from the refined run at t = 3 s"


def test_judge_is_not_fooled_by_few_instants_that_are_right(truth):
    """Once per turn the tip of a run at rest meets the circle."""
    time = np.array([0.0, 2 * pi])
    lucky = trace_of(time, circle(time))
    assert judge(lucky, truth, 0.01).outcome == WRONG


def test_a_run_cut_short_is_compared_while_it_lasts(truth):
    time = np.array([0.0, 0.01, 0.02])
    assert judge(trace_of(time, circle(time)), truth, 1e-3).outcome == STABLE


def test_instants_after_the_truth_count_for_failures_only(truth):
    time = np.linspace(0, 12, 100)
    tip = circle(time)
    tip[time > 6.1] += 1.0
    assert judge(trace_of(time, tip), truth, 0.01).outcome == STABLE
    failed = judge(trace_of(time, tip, "diverged at t = 9 s"), truth, 0.01)
    assert (failed.outcome, failed.e_max) == (DIVERGED, None)


def test_scaled_arm_keeps_the_damping_ratio_and_the_tensions_allowed():
    for stiffness in STIFFNESSES:
        robot = scaled_arm(stiffness, 0.3)
        assert robot.first_frequency == pytest.approx(ARM.first_frequency * stiffness**0.5)
        assert robot.damping_time * pi * robot.first_frequency == pytest.approx(0.3)
        assert robot.tendons[0].tension_limit == pytest.approx(80 * stiffness)


def test_equal_steps_per_period_move_equally(chain):
    """The similarity that lets all stiffnesses share one refined run, checked on the runs."""
    errors = [
        run_cell(chain, stiffness, 0.1, "implicitfast", 2e-3 * stiffness**-0.5).e_max
        for stiffness in STIFFNESSES
    ]
    np.testing.assert_allclose(errors, errors[1], rtol=1e-3)


def test_references_are_far_more_accurate_than_the_bound(rows):
    assert max(row.uncertainty for row in rows if row.uncertainty) < 0.05 * BOUND


def test_provoked_divergence_is_named_with_its_time(chain, capfd):
    row = run_cell(chain, 1e4, 0.0, "implicitfast", 0.02)
    assert (row.stable, row.outcome, row.e_max) == (False, DIVERGED, None)
    assert row.failure.startswith("diverged at t = ")
    assert "MuJoCo" not in "".join(capfd.readouterr())
    assert "WARNING" not in "".join(capfd.readouterr())


def test_provoked_wrong_run_is_finite_and_beyond_the_bound(chain):
    # discrete is stable for any step, but damps all motion: after a period it hardly swings.
    row = run_cell(chain, 1.0, 0.0, "discrete", 0.05)
    assert row.outcome == WRONG
    assert row.e_max > BOUND
    assert row.failure.startswith("finite but wrong: tip ")


def test_rule_is_stable_everywhere(rows):
    picks = [row for row in rows if row.case in ("rule", "rule_asked")]
    failed = [r for r in picks if not r.stable]
    assert len(picks) == 2 * len(STIFFNESSES) * 6
    assert not failed, failed
    for row in picks:
        assert (0.01 / row.timestep) == pytest.approx(round(0.01 / row.timestep), rel=1e-9)


def test_limit_separates_stable_from_diverging_runs(rows):
    """Except for implicit, whose error in undamped motion comes first."""
    around = [r for r in rows if r.case == "limit" and r.integrator != "implicit"]
    assert {row.integrator for row in around} == {"implicitfast", "Euler", "RK4"}
    for row in around:
        ratio = row.timestep / row.stability_limit
        assert row.stable == (ratio < 1), row


def test_safe_step_ends_before_the_first_failure():
    def cell(timestep, stable):
        return SimpleNamespace(timestep=timestep, stiffness_scale=1.0, stable=stable)

    cells = [cell(0.1, True), cell(0.4, True), cell(0.2, True), cell(0.3, False)]
    in_periods = shown.safe_step(cells, shown.first_period)
    assert in_periods == pytest.approx(0.2 * ARM.first_frequency)
    assert shown.safe_step([cell(0.1, False)]) is None


def test_implicit_euler_with_a_huge_step_is_finite_but_wrong(pcc):
    row = run_cell(pcc, 1.0, 0.0, "implicit_euler", 0.05)
    assert row.outcome == WRONG
    assert row.e_max > BOUND


def test_explicit_method_on_a_damped_beam_diverges(pcc):
    row = run_cell(pcc, 1.0, 5.0, "rk4", 0.02)
    assert (row.outcome, row.e_max) == (DIVERGED, None)


def test_failed_newton_iteration_is_named(pcc):
    beam = make_beam(pcc.model, ARM, 3)
    start = State(beam.rest() + 3 / ARM.length, np.full(3, 1e6))
    trace = BeamSystem(beam, start, np.zeros(6)).run(Plan("implicit_euler", 0.1, 10, 0.1))
    assert trace.outcome == NOT_CONVERGED
    assert trace.failure.startswith("Newton's iteration did not converge at t = ")


EXACT = [extremes.curl(), extremes.follower()]


@pytest.mark.parametrize("case", EXACT, ids=lambda case: case.name)
def test_extreme_loads_agree_with_exact_shapes(case):
    row = extremes.run_case(case, CHAIN, 24)
    assert row.stable
    assert row.e_max < 1e-3


def test_follower_force_agrees_with_small_deflections():
    x, z = extremes.follower_tip(2.0, 5.0, 1e-3)
    assert x == pytest.approx(1e-3 * 2.0**3 / (3 * 5.0), rel=1e-6)
    assert z == pytest.approx(2.0, rel=1e-6)


CASES = [
    (extremes.tension_limit(), 12),
    (extremes.slack_taut(), 6),
    (extremes.straight(0.0), 6),
    (extremes.straight(1e-12), 6),
    (extremes.longest_pair("one_piece"), 2),
]


@pytest.mark.parametrize(("case", "n"), CASES, ids=lambda x: getattr(x, "name", x))
def test_chain_survives_extreme_cases(case, n):
    row = extremes.run_case(case, CHAIN, n)
    assert row.stable, row.failure


def test_rounding_at_the_straight_start_does_not_matter():
    exact, rounded = (
        extremes.run_case(extremes.straight(angle), CHAIN, 6).e_max for angle in (0.0, 1e-12)
    )
    assert rounded == pytest.approx(exact, rel=1e-6)


@pytest.mark.parametrize("damping", [0.0, 1e-3])
def test_free_oscillation_follows_the_linear_solution(damping):
    row = extremes.oscillation_row(CHAIN, 6, damping, 20.0)
    assert row.stable, row.failure
    # implicitfast lets the force act half a step early: the phase is off by pi / 500 at most.
    assert row.e_max < 2e-3 * ARM.length * 0.02


def test_growing_oscillation_fails():
    time = np.linspace(0, 20, 400)
    tip = np.stack([np.exp(0.01 * time) * np.cos(5 * time), 0 * time], axis=1)
    assert extremes._amplitude_growth(trace_of(time, tip)) > 1.1


def test_linear_solution_solves_the_oscillators_equation():
    time, w, damping = np.linspace(0, 3, 20001), 5.0, 0.1
    x = extremes._linear(time, w, damping, 2 * damping / w)
    v, a = np.gradient(x, time), np.gradient(np.gradient(x, time), time)
    residual = a + 2 * damping * w * v + w**2 * x
    assert np.max(np.abs(residual[5:-5])) < 1e-4 * w**2
    assert x[0] == 1
    assert v[0] == pytest.approx(0, abs=1e-2)


def test_adaptive_run_is_compared_with_an_independent_one():
    """A refined run that adapted its steps too would agree to rounding, whatever its error."""
    row = extremes.run_case(extremes.longest_pair("one_piece"), "pcc", 1, "sdirk4 adaptive")
    assert row.uncertainty > 1e-9
    assert row.e_max > 1e-9
    assert row.stable
