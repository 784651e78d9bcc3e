"""How accurate and how stable the models of any robot are (`softrobot benchmark --robot`)."""

import json
from dataclasses import replace
from math import log2

import numpy as np
import pytest

from softrobot_env.cli import main
from softrobot_env.evaluation.models import accuracy, stability
from softrobot_env.evaluation.models.runs import (
    Verdict,
    converged,
    excitation,
    extrapolate,
    front,
    verdict_of,
)
from softrobot_env.robots import ARM, RIG, find_robot, write_robot
from softrobot_env.scene.build import build_scene
from softrobot_env.scene.registry import scene_of


def test_limits_are_exact_for_their_series():
    found = {n: np.array([2.0 + 3 / n**2 - 5 / n**4, 1 / n**2]) for n in (2, 4, 8)}
    assert converged(found, 2) == pytest.approx([2.0, 0.0], abs=1e-12)
    limit = extrapolate(lambda n: found[n], (2, 4, 8), "limit")
    second = converged({n: found[n] for n in (4, 8)}, 2)
    assert limit.uncertainty == pytest.approx(abs(second[0] - 2.0))


@pytest.mark.parametrize(
    ("error", "failure", "warning", "verdict"),
    [
        (1e-3, None, None, "accurate"),
        (2e-3, None, None, "inaccurate"),
        (2e-3, None, "said so", "warned"),
        (1e-3, None, "said so", "accurate"),
        (0.06, None, None, "wrong"),
        (np.nan, None, None, "wrong"),
        (None, None, None, "unjudged"),
        (None, "diverged", None, "reported"),
    ],
)
def test_a_verdict_says_whether_an_error_was_announced(error, failure, warning, verdict):
    found = verdict_of(error, 1e-3, 1.0, failure=failure, warning=warning)
    assert found == Verdict(verdict)


def test_all_drives_of_a_robot_take_steps_within_their_range():
    for robot in (ARM, RIG):
        scene = build_scene(scene_of(robot))
        low, high = scene.model.actuator_ctrlrange.T
        half, all_of_it = (excitation(scene, 0.5, share) for share in (0.5, 1.0))
        assert half.duration == pytest.approx(0.5)
        assert np.all(half.controls >= low)
        assert np.all(half.controls <= high)
        assert all_of_it.controls - half.rest == pytest.approx(2 * (half.controls - half.rest))
        assert len(half.poses) == 5  # a step is held for 0.1 s


@pytest.fixture(scope="module")
def of_the_arm():
    return accuracy.measure(ARM, quick=True)


def rest(rows, model):
    return {row.n: row for row in rows if row.kind == "rest" and row.model == model}


def test_the_limit_of_the_chain_is_the_arc_that_pcc_gives_exactly(of_the_arm):
    # The arm's tendons bend each third of it to an arc, and nothing else pulls.
    known = {row.model: row.share for row in of_the_arm if row.kind == "limit"}
    uncertainty = known["rest, bending: uncertainty"]
    assert uncertainty < 1e-6
    assert all(row.share <= uncertainty for row in rest(of_the_arm, "pcc").values())


@pytest.mark.parametrize("model", ["mujoco_chain", "cosserat"])
def test_errors_at_rest_fall_with_the_square_of_the_pieces(of_the_arm, model):
    *_, coarse, fine = rest(of_the_arm, model).values()
    assert log2(coarse.e_max / fine.e_max) == pytest.approx(2, abs=0.05)


def test_shear_and_stretch_are_told_apart_from_errors(of_the_arm):
    limits = {row.model: row.share for row in of_the_arm if row.kind == "limit"}
    assert limits["rest: what shear and stretch change"] > 0.01
    assert limits["rest, shear: uncertainty"] < 1e-5


def test_no_run_of_a_front_is_beaten(of_the_arm):
    runs = [row for row in of_the_arm if row.kind == "motion" and row.model == "mujoco_chain"]
    best = front(runs, "e_max", "cost")
    assert 1 < len(best) < len(runs)
    for row in best:
        assert not [r for r in runs if r.cost < row.cost and r.e_max < 0.8 * row.e_max]


# Under full pull the rod folds.
@pytest.mark.filterwarnings("ignore::softrobot_env.scene.resolution.ResolutionWarning")
def test_what_a_user_asks_for_is_judged_and_announced():
    rows = stability.measure(find_robot("silicone_rod"), quick=True)
    asked = {(r.integrator, r.timestep, r.stiffness_scale, r.damping_scale): r for r in rows}
    soft = asked["implicitfast", 5e-3, 0.1, 0.1]
    assert soft.verdict == Verdict.REPORTED
    assert "diverged" in soft.why
    assert soft.error is None
    unseen = asked["implicitfast", 5e-3, 0.1, 1.0]
    assert unseen.verdict == Verdict.WARNED  # the rule knows the limit of its twelve pieces
    assert unseen.share > 0.05
    own = [row for row in rows if row.case == "own"]
    assert {row.pieces for row in own} == {3, 6, 12, 24}
    # Seldom more than what is asked for, and then by little or with a warning: where a soft rod is
    # hardly damped, the integrator damps what it does not follow, and says so.
    for row in own:
        if row.verdict != Verdict.UNJUDGED:
            assert row.error < row.asked * (6 if row.verdict == Verdict.WARNED else 1.2)


@pytest.mark.parametrize("friction", [pytest.param(0, marks=pytest.mark.slow), 0.1])
def test_a_robot_of_ones_own_is_measured(tmp_path, friction):
    file, rubs = tmp_path / "mine.toml", {"friction": friction}
    tendons = tuple(replace(tendon, **rubs) for tendon in RIG.tendons)
    write_robot(replace(RIG, name="mine", pieces=2, tendons=tendons, sensors=()), file)
    for what in ("accuracy", "stability"):
        given = ["benchmark", what, "--robot", str(file), "--quick", "--out", str(tmp_path)]
        assert main(given) == 0
        rows = json.loads((tmp_path / what / "report.json").read_text())["rows"]
        made = {path.name for path in (tmp_path / what).iterdir()}
        assert made >= {"report.json", "report.md", f"{what}.png"}
        if what == "accuracy":
            measured = {row["model"] for row in rows if row["kind"] == "motion"}
            beams = set() if friction else {"pcc", "cosserat"}
            assert measured == {"mujoco_chain"} | beams
            assert friction == 0 or any("no friction" in (row["note"] or "") for row in rows)
