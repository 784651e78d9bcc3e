"""The thesis benchmark: its rows against closed forms, the audit and known orders; its outputs."""

from math import cos, sin

import numpy as np
import pytest

from softrobot_env.robots import CANTILEVER_WEAK
from studies import thesis
from studies.lab import select
from studies.thesis import MODELS, QUICK_PIECES, build
from studies.truths import thesis_values as values

pytestmark = pytest.mark.slow

FIGURES = {*(f"2.{k}" for k in (4, 5, 6, 8, 9, *range(11, 23))), "tab2.2", "tab2.3"}


@pytest.fixture(scope="module")
def rows():
    found = thesis.STUDY.run(quick=True)
    assert {row.figure for row in found} == FIGURES
    assert all((row.x is None) == (row.x_name is None) for row in found)
    assert all(row.y is not None or row.note for row in found)
    return found


def audited(rows, figure, y_name):
    """Rows of a quantity with a number of the audit."""
    found = [r for r in rows if (r.figure, r.y_name) == (figure, y_name)]
    return [r for r in found if r.audit is not None]


def check_audit(rows, figure, y_name, tolerance):
    compared = audited(rows, figure, y_name)
    assert compared
    assert [r.y for r in compared] == pytest.approx([r.audit for r in compared], rel=tolerance)
    return compared


def value(rows, y_name, **fields):
    found = [r for r in rows if r.y_name == y_name]
    (row,) = select(found, **fields)
    return row.y


def test_deflections_are_those_of_the_audit(rows):
    # The audit's tolerance for discrete models is 0.5 %; its numbers are rounded to 0.05 %.
    compared = check_audit(rows, "2.11", "tip_deflection_m", 1e-3)
    assert {r.model for r in compared} >= {*MODELS, "elastica", "exact_rod", "timoshenko"}
    check_audit(rows, "2.11", "pieces_for_5_percent", 0.0)
    stiff = value(rows, "relative_to_euler_bernoulli", figure="2.11", model="pcc")
    assert stiff == pytest.approx(0.01267 / 0.012739 - 1, abs=2e-4)


def test_centrelines_end_at_the_deflections(rows):
    for model in MODELS:
        mine = [r for r in rows if (r.figure, r.model) == ("2.12", model)]
        assert (mine[0].x, mine[0].y) == (0, 0)
        known = values.known("2.11", "tip_deflection_m", "weak", model, 5)
        assert mine[-1].y == pytest.approx(known.audit, rel=1e-3)


def test_weighting_functions_are_the_printed_ones(rows):
    printed = {
        "xi_1": lambda t: 1.0,
        "xi_2": lambda t: (2 / (1 + cos(t))) ** 0.5,
        "xi_3": lambda t: 1 / cos(t),
        "xi_4": lambda t: 2 / (1 + cos(t)),
        "xi_5": lambda t: t / sin(t) if t else 1.0,
    }
    mine = [r for r in rows if r.figure == "2.5"]
    assert {r.case for r in mine} == set(printed)
    for row in mine:
        assert row.y == pytest.approx(printed[row.case](row.x), rel=1e-12)


def test_weighting_matters_as_much_as_printed(rows):
    assert len(check_audit(rows, "2.6", "tip_deflection_m", 1e-4)) == 10
    assert len(check_audit(rows, "2.6", "spread_m", 5e-3)) == 4
    check_audit(rows, "2.6", "change_from_3_to_5_pieces_m", 5e-3)
    for row in select(rows, y_name="spread_m", case="printed"):
        assert row.y == pytest.approx(row.thesis, rel=5e-3)


def test_projection_stops_the_drift(rows):
    worst = {r.case: r.y for r in rows if r.y_name == "largest_norm_violation"}
    for tolerance, printed in ("0.001", 3.88e-5), ("1e-05", 1.35e-5):
        assert worst[f"Radau, projected, {tolerance}"] < printed
        assert worst[f"Radau, not projected, {tolerance}"] > (
            20 * worst[f"Radau, projected, {tolerance}"]
        )
    free = [r for r in rows if r.case == "BDF, not projected, 0.001" and r.x is not None]
    assert free[-1].y > 10 * free[0].y


def test_quadrature_needs_order_eight_and_ours_is_exact(rows):
    for case in ("legendre, against exact", "legendre, against order 20"):
        assert value(rows, "first_order_below_1e-3", case=case) == values.ORDER
    assert value(rows, "relative_rms_error", case="chebyshev, against exact") < 1e-9
    # Gauss-Legendre integrates the square root at the rim to order 3 only.
    errors = [
        value(rows, "relative_rms_error", case="legendre, against exact", x=x) for x in (4.0, 8.0)
    ]
    assert 2 < np.log2(errors[0] / errors[1]) < 4
    times = {r.x: r.y for r in rows if r.figure == "2.9" and r.case == "legendre"}
    # The order counts along the element alone: the section's moments are known beforehand. The
    # ratio is about three, which a busy machine does not measure reliably.
    assert times[20.0] > 1.2 * times[4.0]


def test_bending_frequencies_are_those_of_the_audit(rows):
    assert len(check_audit(rows, "2.13", "frequency_Hz", 5e-4)) == 2 * (3 * 4 + 2)
    far = audited(rows, "2.13", "relative_to_euler_bernoulli")
    assert [r.y for r in far] == pytest.approx([r.audit for r in far], abs=6e-4) and len(far) == 3


def test_torsion_is_that_of_the_closed_form(rows):
    # One element of ANCF twists its section out of shape; it converges with the fourth power.
    assert len(check_audit(rows, "2.14", "twist_rad", 6e-3)) == 2 + 4 * len(QUICK_PIECES)
    assert len(check_audit(rows, "2.15", "frequency_Hz", 5e-3)) == 2 + 2 * 4 + 1
    for ratio in (0.0, 0.49):
        # sqrt(G / rho) / (4 L) of a shaft, which the discretised frequencies approach as 1 / n^2.
        shear = CANTILEVER_WEAK.youngs_modulus / (2 * (1 + ratio))
        exact = (shear / CANTILEVER_WEAK.density) ** 0.5 / (4 * CANTILEVER_WEAK.length)
        for model in MODELS:
            one, five = (
                value(rows, "frequency_Hz", case=f"nu = {ratio:g}", model=model, n=n) - exact
                for n in (1, 5)
            )
            assert one / five == pytest.approx(25, rel=0.1)


def test_random_states_are_admissible_and_evaluations_counted():
    rod = build("cosserat", CANTILEVER_WEAK, 2)
    q, v = thesis.random_states(rod, 10)
    assert rod.constraint_drift(q) < 1e-15
    p, rate = (x.reshape(10, 2, 7)[..., 3:] for x in (q, v))
    assert np.max(np.abs(np.sum(p * rate, axis=-1))) < 1e-15
    assert thesis.evaluation_time(rod) > 1e-8
    planar = build("pcc", CANTILEVER_WEAK, 3)
    motion = planar.simulate(0.2, method="rk4", step=0.01)
    # Four stages a step, the first of which is the last acceleration, which is counted then.
    assert thesis.evaluations(planar, motion) == 4 * motion.steps
    implicit = planar.simulate(0.2, method="implicit_euler", step=0.01)
    assert thesis.evaluations(planar, implicit) == implicit.residuals + 4 * implicit.matrices


def test_total_time_is_number_times_time(rows):
    products = select(rows, figure="2.18", case="product", y_name="computation_time_s")
    assert len(products) == len(MODELS) * len(QUICK_PIECES)
    for row in products:
        about = {"model": row.model, "n": row.n}
        one = value(rows, "evaluation_time_s", figure="2.16", case="compiled", **about)
        assert row.y == pytest.approx(value(rows, "evaluations", figure="2.17", **about) * one)
    fast = [row.n for row in select(products, model="ancf") if row.y < 5]
    assert value(rows, "most_pieces_in_real_time", figure="2.18") == max(fast, default=0)


@pytest.mark.parametrize(
    ("figure", "names", "least"),
    [
        ("2.22", ("largest_radius_m", "last_tip_x_m", "last_tip_y_m", "last_tip_z_m"), 1),
        ("2.20", ("mean_distance_m", "largest_distance_m"), 4),
    ],
)
def test_spiral_is_that_of_the_audit(rows, figure, names, least):
    # The audit's absolute tolerance is 0.1 mm, also for differences of differences.
    for name in names:
        compared = audited(rows, figure, name)
        assert len(compared) >= least
        assert [r.y for r in compared] == pytest.approx([r.audit for r in compared], abs=1e-4)


def test_implicit_euler_steps_are_the_printed_ones_in_metres(rows):
    for k, step in enumerate(values.EULER_STEPS):
        mine = select(rows, case=f"implicit_euler, {step:g} s")
        between = select(mine, y_name="mean_error_between_m")
        for row in () if k == 0 else mine[:2]:  # the first one does not divide the motion
            assert row.y == pytest.approx(row.audit, abs=5e-6)
        assert [r.y for r in between] == pytest.approx([r.audit for r in between], rel=0.15)
        assert [r.audit for r in between] == pytest.approx([1e3 * r.thesis for r in between])
        assert len(between) == 1 and len(mine) == 3
    for accuracy, step in ((10, 0.16), (1, 0.024)):
        case = f"implicit_euler, {accuracy} mm"
        assert value(rows, "step_s", model="pcc", case=case) == pytest.approx(step, rel=0.1)
    for case in ("sdirk4, 0.9 mm", "dormand_prince, 0.9 mm"):
        assert value(rows, "mean_error_m", model="pcc", case=case) < 0.9e-3
