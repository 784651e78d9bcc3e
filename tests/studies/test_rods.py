"""MuJoCo's own rods: stiffness by formulas, and the order of their errors; ours beside them."""

import json
import os
from dataclasses import asdict, replace
from math import pi

import numpy as np
import pytest

from softrobot_env.evaluation.models.runs import Limit
from studies.accuracy import mujoco_rods, rods
from studies.accuracy.space import STEEL, TPU
from studies.beams import weightless
from studies.lab import select
from studies.truths.analytic import (
    bent_rod,
    euler_bernoulli_deflection,
    euler_bernoulli_frequency,
    section,
)
from studies.truths.falling_rod import falling_tips

FLEX, CABLE = rods.FLEX, rods.CABLE

#: The cable needs an older MuJoCo, which is not installed with the package.
MODELS = [
    FLEX,
    pytest.param(
        CABLE,
        marks=pytest.mark.skipif(
            rods._OLDER not in os.environ, reason=f"{rods._OLDER} names no older MuJoCo"
        ),
    ),
]


def tips(model, rod, sizes=(6, 12)):
    """Tips (3,) at rest by number of edges or links."""
    given = {"model": model, "rod": asdict(rod), "repeats": 1, "share": rods.SHARES[model]}
    found = rods.ask([{**given, "n": n} for n in sizes])
    assert not any("failure" in answer for answer in found), found
    return [np.array(answer["tips"]) for answer in found]


@pytest.mark.parametrize("robot", [TPU, STEEL], ids=lambda r: r.name)
@pytest.mark.parametrize("model", MODELS)
def test_small_loads_bend_and_twist_as_ei_and_gj(model, robot):
    """F L^3 / (3 EI), M L^2 / (2 EI), and the twist by a moment along the rod.

    A small force across that follows the tip goes round with the twisted section, by M L / GJ,
    less what the moment itself bends the rod aside, about M L / (4 EI): the exact rod has both.
    """
    stiffness, length = section(robot, None), robot.length
    force = 1e-3 * stiffness.bending / length**2
    moment, small = 1e-3 * stiffness.bending / length, rods.plain(robot)
    (bent,) = tips(model, replace(small, force=(force, 0, 0)), (24,))
    assert bent[0] == pytest.approx(force * length**3 / 3 / stiffness.bending, rel=4e-3)
    (bent,) = tips(model, replace(small, moment=(0, moment, 0)), (24,))
    assert bent[0] == pytest.approx(moment * length**2 / 2 / stiffness.bending, rel=4e-3)
    wrench = {"force": (force, 0.0, 0.0), "moment": (0.0, 0.0, 0.5 * stiffness.torsion / length)}
    (bent,) = tips(model, replace(small, **wrench, follows=True), (12,))
    exact, other = (
        rods._followed(replace(robot, poisson_ratio=nu), **wrench).tip for nu in (0.4, 0.3)
    )
    turned, expected, wrong = (np.arctan2(tip[1], tip[0]) for tip in (bent, exact, other))
    assert turned == pytest.approx(expected, rel=0.02)
    assert abs(wrong - expected) > 0.05 * expected


@pytest.mark.parametrize("model", MODELS)
@pytest.mark.parametrize("name", ["sag", "force", "arc", "pull"])
def test_errors_fall_by_second_order(name, model):
    case = rods.rests(TPU)[name]
    rod = rods.plain(case.robot, next(iter(case.loads), None))
    coarse, fine = (np.linalg.norm(tip - case.tip) for tip in tips(model, rod))
    assert fine < 0.03 * TPU.length and 3.0 < coarse / fine < 6.5


@pytest.mark.parametrize("model", MODELS[1:])
def test_the_cable_is_of_first_order_where_it_bends_and_twists_unless_ei_is_gj(model):
    for robot, low, high in ((TPU, 1.8, 2.2), (replace(TPU, poisson_ratio=0.0), 3.6, 4.4)):
        case = rods.rests(robot)["helix"]
        rod = rods.plain(case.robot, case.loads[0])
        coarse, fine = (np.linalg.norm(tip - case.tip) for tip in tips(model, rod))
        assert low < coarse / fine < high


@pytest.mark.parametrize("model", MODELS)
def test_motion_meets_the_truth_as_steps_and_edges_refine(model):
    robot, times = rods.falling(TPU), 0.01 * np.arange(31)
    down, along = falling_tips(robot, 9.81, times, terms=4).T
    exact = np.stack([np.cos(0.5) * down, np.sin(0.5) * down, along], axis=1)
    about = {"model": model, "rod": asdict(rods.plain(robot)), "repeats": 1}
    about |= {"samples": 30, "period": 0.01}
    runs = [{**about, "n": n, "timestep": h} for n, h in ((6, 2e-3), (12, 5e-4))]
    coarse, fine = (np.abs(np.array(a["tips"]) - exact).max() for a in rods.ask(runs))
    assert fine < 0.45 * coarse and fine < 0.01 * robot.length


def test_the_falling_rod_swings_at_its_first_frequency_and_rests_where_it_sags():
    frequency = euler_bernoulli_frequency(
        TPU.length, section(TPU, None).bending, TPU.mass_per_length
    )
    times = np.linspace(0, 1.35 / frequency, 136)
    swing = falling_tips(replace(TPU, damping_time=0.0), 1e-4, times, terms=3)[:, 0]
    middle = euler_bernoulli_deflection(
        TPU.length, section(TPU, None).bending, TPU.mass_per_length * 1e-4
    )
    up, _, again, *_ = times[np.flatnonzero(np.diff(np.sign(swing - middle)))]
    assert again - up == pytest.approx(1 / frequency, rel=0.015)  # a sample is 0.01 of it
    damped = replace(TPU, damping_time=2 / (2 * pi * frequency))
    rest = falling_tips(damped, 9.81, np.array([0.0, 4 / frequency]), terms=4)[-1]
    weight = (TPU.mass_per_length * 9.81, 0.0)
    exact = bent_rod(TPU.length, section(TPU, None), weight=weight).tip
    np.testing.assert_allclose(rest, exact, atol=1e-5)


def test_what_diverges_and_what_is_absent_is_said(monkeypatch):
    monkeypatch.delenv(rods._OLDER, raising=False)
    truth = Limit(np.zeros(3), 0.0, "none")
    (row,) = rods._their_rows(CABLE, "case", truth, [{"n": 6}])
    assert row.kind == "note" and "MuJoCo 4.0 has no cable" in row.reference
    follower = replace(
        rods.plain(weightless(TPU)), moment=(0.0, 0.05, 0.05), follows=True, damping_time=0.1
    )
    request = {"rod": asdict(follower), "repeats": 1, "n": 6, "timestep": 0.01}
    (row,) = rods._their_rows(FLEX, "case", truth, [{**request, "period": 0.01, "samples": 300}])
    assert row.kind == "note" and "diverged with a timestep of 10 ms" in row.reference


def test_requests_and_answers_are_plain_json():
    rod = rods.plain(TPU, rods.rests(TPU)["pull"].loads[0])
    asked = {"model": FLEX, "rod": asdict(rod), "n": 6, "repeats": 1, "share": 0.1}
    (found,) = rods.ask([json.loads(json.dumps(asked))])
    assert json.loads(json.dumps(found)) == found and found["integrator"] == "discrete"
    assert mujoco_rods.Rod(**json.loads(json.dumps(asked["rod"]))).mass == pytest.approx(rod.mass)


def test_ours_are_measured_beside_them(monkeypatch):
    monkeypatch.setattr(rods, "ask", lambda requests: [])
    found = rods.rest_rows("pull", rods.rests(TPU)["pull"], quick=True)
    chain = select(found, model=rods.CHAIN)
    assert [row.n for row in chain] == [6, 12] and chain[1].e_mean < 1e-3 * TPU.length
    assert len(select(found, kind="note")) == 2
