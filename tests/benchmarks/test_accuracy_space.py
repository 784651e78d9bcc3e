"""Rods in space of the accuracy benchmark: their truths, their rows and their goals."""

from dataclasses import replace
from io import StringIO

import numpy as np
import pytest
from rich.console import Console

from softrobot_env.benchmarks.accuracy import tables
from softrobot_env.benchmarks.accuracy.cases.beam_models import COSSERAT, DISTRIBUTED
from softrobot_env.benchmarks.accuracy.rows import BENDING, SHEAR
from softrobot_env.benchmarks.accuracy.space import statics
from softrobot_env.benchmarks.accuracy.space.cases import HEADINGS, STEEL, TPU, cases_of
from softrobot_env.benchmarks.accuracy.space.statics import beam_tip, chain_tip, name_of
from softrobot_env.core.equilibrium import EquilibriumError


def off(found, case):
    return float(np.linalg.norm(found[0] - case.tip))


@pytest.mark.parametrize("robot", [TPU, STEEL], ids=lambda r: r.name)
@pytest.mark.parametrize("name", HEADINGS)
def test_the_chain_converges_to_every_exact_tip_by_second_order(name, robot):
    case = cases_of(name, robot, BENDING, quick=True)[0]
    coarse, fine = (off(chain_tip(case, "gauss2", n), case) for n in (12, 24))
    assert np.linalg.norm(case.tip - [0, 0, robot.length]) > 0.05 * robot.length
    assert fine < 1.5e-3 * robot.length
    assert 3.0 < coarse / fine < 20.0


@pytest.mark.parametrize("name", ["wrenches", "helix_dead", "force_dead"])
def test_models_of_two_families_converge_to_the_same_exact_tips(name):
    for contestant in (DISTRIBUTED, COSSERAT):
        case = cases_of(name, STEEL, contestant.physics, quick=True)[-1]
        coarse, fine = (off(beam_tip(case, contestant, n), case) for n in (12, 24))
        assert fine < 2e-3 * STEEL.length and coarse / fine > 3.0


def test_random_wrenches_pull_to_all_sides_and_differ():
    cases = cases_of("wrenches", TPU, BENDING)
    tips = np.array([case.tip for case in cases])
    assert np.ptp(tips, axis=0).min() > 0.2 * TPU.length
    for case in cases:
        assert np.linalg.norm(case.robot.gravity) == pytest.approx(9.81)
        assert {load.station for load in case.loads} == {TPU.length / 2, TPU.length}


def test_shear_and_extension_hardly_matter_to_slender_rods():
    rigid, soft = (cases_of("force_dead", TPU, physics)[0].tip for physics in (BENDING, SHEAR))
    assert 0 < np.linalg.norm(rigid - soft) < 2e-3 * TPU.length


@pytest.fixture(scope="module")
def rows():
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(statics, "CONTESTANTS", (None, COSSERAT))
        names = ("wrenches", "sag_0deg", "sag_45deg")
        return [row for name in names for row in statics.case_rows(name, TPU, quick=True)]


def test_no_direction_is_worse_than_another(rows):
    goals = list(statics.goal_rows(rows))
    assert [goal.limit for goal in goals] == [0.25e-3, 1.5]
    assert all(goal.met is (goal.value <= goal.limit) for goal in goals)
    assert goals[1].met


def test_rows_have_the_mean_of_all_wrenches_and_their_cost(rows):
    row = rows[0]
    assert row.case == name_of("wrenches", TPU) and row.kind == "static"
    assert 0 < row.e_mean < row.e_max and row.wall_time > 0


def test_what_is_not_solved_is_said_and_not_averaged(monkeypatch, rows):
    def fail(*_):
        raise EquilibriumError("none")

    monkeypatch.setattr(statics, "beam_tip", fail)
    found = statics.case_rows("circle", TPU, quick=True)
    lost = [row for row in found if row.model == "cosserat"]
    assert [row.kind for row in lost] == ["note"]
    assert lost[0].reference == "1 of 1 not solved: none" and lost[0].e_mean is None
    page = Console(width=120, file=StringIO())
    page.print(tables.tables([*rows, *lost, replace(rows[0], case="goal", kind="other")]))
    text = page.file.getvalue()
    assert "TPU rod in space, length / radius 80" in text
    assert any("cosserat" in line and "none" in line for line in text.splitlines())
