"""The stability study: its verdicts, the timestep rule on maps, extreme cases, and the rig."""

from dataclasses import replace
from math import inf, pi
from types import SimpleNamespace

import numpy as np
import pytest

from softrobot_env.robots import ARM, RIG, SERVO_SPEED
from softrobot_env.scene.timestep import stability_limit
from studies.beams import make_beam
from studies.stability import extremes, rig, runs, shown
from studies.stability.map import BOUND, Family, map_rows, run_cell
from studies.stability.rig import MAP, MOTIONS, PERIOD, RULE, TRUSTED, Variation

STIFFNESSES = (1e-2, 1.0, 1e4)
TIMESTEPS = (1e-4, 2e-3, 2e-2)
CHAIN_OF_SIX, PCC = Family(runs.CHAIN, 6), Family("pcc", 3)


@pytest.fixture(scope="module")
def rows():
    """A coarse map with the rule on it."""
    return [
        row
        for damping in (0.0, 5.0)
        for row in map_rows(CHAIN_OF_SIX, damping, TIMESTEPS, STIFFNESSES, (0.5, 0.9, 1.2, 2.0))
    ]


# ------------------------------------------------------------- verdicts


def circle(time):
    return 0.1 * np.stack([np.cos(time), np.sin(time)], axis=1)


def judged(time, off, bound, after=inf, failure=None):
    """A run on a circle, off by (2,) [m] after some time, against the circle for 6 s."""
    known = np.linspace(0, 6, 400)
    tip = circle(time) + np.where(time > after if after < inf else time >= 0, 1, 0)[:, None] * off
    return runs.judge(
        runs.Trace(time, tip, failure, 0.0, 9), runs.Reference(known, circle(known), 0.0), bound
    )


@pytest.mark.parametrize(
    ("time", "off", "bound", "outcome"),
    [
        (np.linspace(0, 6, 50), (0.003, 0.004), 0.0051, runs.STABLE),
        (np.linspace(0, 6, 50), (0.003, 0.004), 0.0049, runs.WRONG),
        (np.array([0.0, 2 * pi]), (0.0, 0.0), 0.01, runs.WRONG),  # right by chance, once a turn
        (np.array([0.0, 0.01, 0.02]), (0.0, 0.0), 1e-3, runs.STABLE),  # cut short
    ],
)
def test_a_run_is_judged_by_its_distance_to_the_truth(time, off, bound, outcome):
    assert judged(time, off, bound).outcome == outcome


def test_a_verdict_says_how_wrong_and_when():
    verdict = judged(np.linspace(0, 6, 61), (0.037, 0.0), 0.01, after=2.95)
    assert verdict.e_max == pytest.approx(0.037, abs=1e-9)
    assert verdict.failure.startswith("finite but wrong: tip 37 mm from the refined run at t = ")


def test_instants_after_the_truth_count_for_failures_only():
    time = np.linspace(0, 12, 100)
    assert judged(time, (1.0, 1.0), 0.01, after=6.1).outcome == runs.STABLE
    failed = judged(time, (1.0, 1.0), 0.01, 6.1, "diverged at t = 9 s")
    assert (failed.outcome, failed.e_max) == (runs.DIVERGED, None)


@pytest.mark.parametrize(
    ("family", "stiffness", "damping", "integrator", "timestep", "outcome"),
    [
        (CHAIN_OF_SIX, 1e4, 0.0, "implicitfast", 0.02, runs.DIVERGED),
        # Stable for any step, but damps all motion: after a period it hardly swings.
        (CHAIN_OF_SIX, 1.0, 0.0, "discrete", 0.05, runs.WRONG),
        (PCC, 1.0, 0.0, "implicit_euler", 0.05, runs.WRONG),
        (PCC, 1.0, 5.0, "rk4", 0.02, runs.DIVERGED),
    ],
)
def test_provoked_failures_are_named(
    family, stiffness, damping, integrator, timestep, outcome, capfd
):
    row = run_cell(family, stiffness, damping, integrator, timestep)
    assert (row.stable, row.outcome) == (False, outcome)
    if outcome == runs.DIVERGED:
        assert row.e_max is None and row.failure.startswith("diverged at t = ")
    else:
        assert row.e_max > BOUND and row.failure.startswith("finite but wrong: tip ")
    said = "".join(capfd.readouterr())
    assert "MuJoCo" not in said and "WARNING" not in said


def test_failed_newton_iteration_is_named():
    beam = make_beam("pcc", ARM, 3)
    system = runs.BeamSystem(beam, beam.rest() + 3 / ARM.length, np.zeros(6))
    system.start = system.start._replace(v=np.full(3, 1e6))
    trace = system.run(runs.Plan("implicit_euler", 0.1, 10, 0.1))
    assert trace.outcome == runs.NOT_CONVERGED
    assert trace.failure.startswith("Newton's iteration did not converge at t = ")


# ------------------------------------------------------------- the map and the rule


def test_equal_steps_per_period_move_equally():
    """The similarity that lets all stiffnesses share one refined run, checked on the runs."""
    errors = [
        run_cell(CHAIN_OF_SIX, stiffness, 0.1, "implicitfast", 2e-3 * stiffness**-0.5).e_max
        for stiffness in STIFFNESSES
    ]
    np.testing.assert_allclose(errors, errors[1], rtol=1e-3)


def test_rule_is_stable_everywhere(rows):
    assert max(row.uncertainty for row in rows if row.uncertainty) < 0.05 * BOUND
    picks = [row for row in rows if row.case in ("rule", "rule_asked")]
    assert len(picks) == 2 * len(STIFFNESSES) * 6
    assert not [row for row in picks if not row.stable]
    for row in picks:
        assert (0.01 / row.timestep) == pytest.approx(round(0.01 / row.timestep), rel=1e-9)


def test_limit_separates_stable_from_diverging_runs(rows):
    """Except for implicit, whose error in undamped motion comes first."""
    around = [r for r in rows if r.case == "limit" and r.integrator != "implicit"]
    assert {row.integrator for row in around} == {"implicitfast", "Euler", "RK4"}
    for row in around:
        assert row.stable == (row.timestep < row.stability_limit), row


def test_safe_step_ends_before_the_first_failure():
    def cell(timestep, stable):
        return SimpleNamespace(timestep=timestep, stiffness_scale=1.0, stable=stable)

    cells = [cell(0.1, True), cell(0.4, True), cell(0.2, True), cell(0.3, False)]
    assert shown.safe_step(cells, shown.first_period) == pytest.approx(0.2 * ARM.first_frequency)
    assert shown.safe_step([cell(0.1, False)]) is None


# ------------------------------------------------------------- extreme cases


@pytest.mark.parametrize(
    ("case", "n", "bound"),
    [  # the first two have exact shapes
        (extremes.curl(), 24, 1e-3),
        (extremes.follower(), 24, 1e-3),
        (extremes.tension_limit(), 12, inf),
        (extremes.slack_taut(), 6, inf),
        (extremes.straight(1e-12), 6, inf),
        (extremes.longest_pair("one_piece"), 2, inf),
    ],
    ids=lambda x: getattr(x, "name", ""),
)
def test_chain_survives_extreme_cases(case, n, bound):
    row = extremes.run_case(case, runs.CHAIN, n)
    assert row.stable and row.e_max < bound, row.failure


@pytest.mark.parametrize("damping", [0.0, 1e-3])
def test_free_oscillation_follows_the_linear_solution(damping):
    row = extremes.oscillation_row(runs.CHAIN, 6, damping, 20.0)
    assert row.stable, row.failure
    # implicitfast lets the force act half a step early: the phase is off by pi / 500 at most.
    assert row.e_max < 2e-3 * ARM.length * 0.02


def test_growing_oscillation_fails():
    time = np.linspace(0, 20, 400)
    tip = np.stack([np.exp(0.01 * time) * np.cos(5 * time), 0 * time], axis=1)
    assert extremes._amplitude_growth(runs.Trace(time, tip, None, 0.0, 400)) > 1.1


def test_adaptive_run_is_compared_with_an_independent_one():
    """A refined run that adapted its steps too would agree to rounding, whatever its error."""
    row = extremes.run_case(extremes.longest_pair("one_piece"), "pcc", 1, "sdirk4 adaptive")
    assert min(row.uncertainty, row.e_max) > 1e-9
    assert row.stable


# ------------------------------------------------------------- the rig


JOINTS = 4


def test_variation_changes_what_it_says():
    robot = Variation(1e4, 0.5, 0.1, 10.0, 0.3).robot()
    assert robot.bending_stiffness == pytest.approx(0.5 * RIG.bending_stiffness)
    assert robot.damping_time == pytest.approx(0.1 * RIG.damping_time)
    for tendon in robot.tendons:
        assert (tendon.stiffness, tendon.pretension, tendon.friction) == (9.8e6, 10.0, 0.3)
    assert Variation().robot() == RIG


@pytest.mark.parametrize("name", MOTIONS)
def test_servos_wind_at_their_speed_and_return(name):
    path = np.array([MOTIONS[name](k * PERIOD) for k in range(round(rig.DURATION / PERIOD))])
    speed = np.abs(np.diff(path, axis=0, prepend=np.zeros((1, 3)))) / PERIOD
    assert np.max(speed) == pytest.approx(SERVO_SPEED)
    np.testing.assert_allclose(path[-1], 0, atol=1e-15)
    np.testing.assert_allclose(path[19].sum(), 0, atol=1e-15)  # a bend pulls in what it lets out


@pytest.fixture(scope="module")
def steel():
    varied = Variation(1e4)
    system = varied.system(JOINTS)
    return varied, system, rig.reference(varied, system)


@pytest.mark.slow
def test_chattering_tensions_are_wrong_though_the_tip_is_right(steel):
    limit = stability_limit("implicitfast", steel[1].linear)
    row = rig.run(*steel, "implicitfast", PERIOD / np.floor(PERIOD / (1.5 * limit)), MAP)
    assert row.outcome == runs.WRONG and row.e_max < row.e_bound
    assert row.e_tension > 5 and "tensions" in row.failure


def test_nothing_is_judged_by_refined_runs_that_differ():
    time = np.linspace(0, 1, 20)
    still = runs.Trace(time, np.zeros((20, 3)), None, 0.0, 20, np.zeros((20, 3)))
    truth = runs.Reference(still.time, still.tip, 0.5 * TRUSTED, still.tension)
    assert rig.judged(still, truth)[0].outcome == runs.STABLE
    for uncertainty in (2 * TRUSTED, inf):
        verdict, error = rig.judged(still, replace(truth, uncertainty=uncertainty))
        assert (verdict.outcome, verdict.e_max, error) == (runs.NO_TRUTH, None, None)
    gone = replace(still, failure="diverged at t = 1 s")
    assert rig.judged(gone, replace(truth, uncertainty=inf))[0].outcome == runs.DIVERGED


@pytest.mark.slow
def test_undamped_rig_with_stiff_tendons_has_no_truth():
    stiff, nylon = (Variation(c, damping_scale=0.0) for c in (1e2, 1.0))
    assert rig.reference(stiff, stiff.system(JOINTS)).uncertainty > TRUSTED
    assert rig.reference(nylon, nylon.system(JOINTS)).uncertainty < TRUSTED / 10


@pytest.mark.slow
@pytest.mark.parametrize(
    "varied",
    [
        Variation(),
        Variation(1e-2),
        Variation(1e2, motion="slack", pretension=0.0),
        Variation(1e4, pretension=10.0),
        Variation(1e4, damping_scale=0.1, motion="slack"),
        Variation(1.0, 100.0),
        Variation(1.0, damping_scale=0.0),
        Variation(friction=0.3),
    ],
    ids=str,
)
def test_rule_keeps_the_rig_stable(varied):
    system = varied.system(JOINTS)
    choice = runs.rule_choice(system, friction=varied.friction > 0)
    truth = rig.reference(varied, system)
    row = rig.run(varied, system, truth, choice.integrator, choice.timestep, RULE)
    assert row.stable, row.failure
    assert row.uncertainty < TRUSTED
