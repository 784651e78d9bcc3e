"""Rods in space of the accuracy benchmark: their truths, their rows and their goals."""

import numpy as np
import pytest

from softrobot_env.core.equilibrium import EquilibriumError
from studies.accuracy import space
from studies.accuracy.cases import BENDING, COSSERAT, DISTRIBUTED, SHEAR
from studies.accuracy.space import HEADINGS, STEEL, TPU, beam_tip, cases_of, chain_tip


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
        patch.setattr(space, "CONTESTANTS", (None, COSSERAT))
        names = ("wrenches", "sag_0deg", "sag_45deg")
        return [row for name in names for row in space.case_rows(name, TPU, quick=True)]


def test_no_direction_is_worse_than_another(rows):
    goals = list(space.goal_rows(rows))
    assert [goal.limit for goal in goals] == [0.25e-3, 1.5]
    assert all(goal.met is (goal.value <= goal.limit) for goal in goals)
    assert goals[1].met


def test_what_is_not_solved_is_said_and_not_averaged(monkeypatch, rows):
    def fail(*_):
        raise EquilibriumError("none")

    monkeypatch.setattr(space, "beam_tip", fail)
    found = space.case_rows("circle", TPU, quick=True)
    lost = [row for row in found if row.model == "cosserat"]
    assert [row.kind for row in lost] == ["note"]
    assert lost[0].reference == "1 of 1 not solved: none" and lost[0].e_mean is None
