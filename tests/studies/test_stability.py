"""The stability study: its extreme cases, and how runs are judged in them."""

from dataclasses import replace

import numpy as np
import pytest

from softrobot_env.core.motion import State
from softrobot_env.evaluation.models.runs import WRONG_SHARE, Verdict
from softrobot_env.robots import ARM
from studies.stability import extremes
from studies.stability.extremes import CHAIN


@pytest.mark.parametrize(
    ("case", "n", "bound"),
    [  # the first two have exact shapes
        (extremes.curl(), 24, 1e-3),
        (extremes.follower(), 24, 1e-3),
        (extremes.tension_limit(), 12, WRONG_SHARE * ARM.length),
        (extremes.slack_taut(), 6, WRONG_SHARE * ARM.length),
        (extremes.straight(1e-12), 6, WRONG_SHARE * ARM.length),
        (extremes.longest_pair("one_piece"), 2, WRONG_SHARE * ARM.length),
    ],
    ids=lambda x: getattr(x, "name", ""),
)
def test_chain_survives_extreme_cases(case, n, bound):
    own, rule = extremes.rows_of(case, CHAIN, n)
    assert (own.integrator, rule.integrator) == ("extrapolation", "implicitfast")
    for row in (own, rule):
        assert row.verdict == Verdict.ACCURATE and row.error < bound, row.why


@pytest.mark.parametrize("model", [CHAIN, "pcc"])
@pytest.mark.parametrize("damping", [0.0, 1e-3])
def test_free_oscillation_follows_the_linear_solution(damping, model):
    for row in extremes.oscillation_rows(model, 6, damping, 20.0):
        assert row.verdict == Verdict.ACCURATE, row.why
        # implicitfast lets the force act half a step early: the phase is off by pi / 500 at most.
        assert row.error < 2e-3 * ARM.length * 0.02


def of_one_piece(model, **options):
    """The row of a tension step with options that spoil it."""
    case = replace(extremes.longest_pair("spoilt"), duration=1.0)
    robot = extremes.damped(case.robot, 0.0)
    case = replace(case, robot=robot)
    truth, built = extremes.refined(case, model, 2), case.build(model, 2, **options)
    about = {"case": case.name, "model": model, "n": 2, "reference": truth.text, "bound": 0.025}

    def error(tips):
        return np.linalg.norm(tips - truth.tips, axis=1).max()

    return extremes.run(built, case.start(built), case.moved, error, **about)


# Of the refined run, which is asked for 0.01 mm.
@pytest.mark.filterwarnings("ignore::softrobot_env.scene.timestep.TimestepWarning")
@pytest.mark.parametrize(
    ("model", "options", "verdict", "why"),
    [  # discrete and implicit Euler are stable for any step, but damp all motion
        (CHAIN, {"integrator": "discrete", "timestep": 0.01}, Verdict.WRONG, None),
        ("pcc", {"method": "implicit_euler", "step": 0.05}, Verdict.WRONG, None),
        ("pcc", {"method": "rk4", "step": 0.2}, Verdict.REPORTED, "diverged"),
    ],
)
def test_provoked_failures_are_named(model, options, verdict, why, capfd):
    row = of_one_piece(model, **options)
    assert row.verdict == verdict
    assert row.error is None if why else row.error > row.bound
    assert row.why == why or why in row.why
    assert "WARNING" not in "".join(capfd.readouterr())


def test_a_beam_that_adapts_its_steps_is_compared_with_an_independent_run():
    """A refined run that adapted its steps too would agree to rounding, whatever its error."""
    (row,) = extremes.rows_of(extremes.longest_pair("one_piece"), "pcc", 1)
    assert min(row.uncertainty, row.error) > 1e-9
    assert row.verdict == Verdict.ACCURATE


def test_a_case_starts_with_its_angle():
    case = extremes.straight(1e-3)
    built = case.build(CHAIN, 6)
    assert isinstance(case.start(built), State)
    assert np.all(case.start(built).q == 1e-3) and np.all(built.model.start().q == 0)
