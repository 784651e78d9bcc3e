"""The spatial test rig on the command line: evaluate, render and inspect."""

import json

import numpy as np
import pytest

from softrobot_env.cli import main
from softrobot_env.evaluation.rollout import Rollout
from softrobot_env.robots.twin import rig3d_twin
from softrobot_env.tasks import EVERY_TASK, OPTIONS, defaults, make_task
from softrobot_env.thesis.envs import RigEnv

FAST = ["--option", "period=0.5", "--control-period", "0.05"]


def evaluated(out, *arguments):
    """Rows of a run, without plots unless asked for."""
    assert main(["evaluate", *arguments, "--out", str(out), "--overwrite"]) == 0
    return json.loads((out / "report.json").read_text())["rows"]


@pytest.fixture(scope="module")
def triangle(tmp_path_factory):
    """Folder and rows of two policies on two triangles of twin 0."""
    out = tmp_path_factory.mktemp("triangle")
    arguments = ["--tasks", "triangle", "--policies", "hybrid", "inverse_dynamics"]
    arguments += ["--option", "period=1,0.5", "--save-rollouts"]
    return out, evaluated(out, *arguments)


def test_every_value_of_an_option_is_run(triangle):
    _, rows = triangle
    assert [(row["period"], row["policy"]) for row in rows] == [
        (1.0, "hybrid"),
        (1.0, "inverse_dynamics"),
        (0.5, "hybrid"),
        (0.5, "inverse_dynamics"),
    ]
    assert {row["twin"] for row in rows} == {0}
    assert {row["robot"] for row in rows} == {"rig"}


def test_tracking_errors_are_those_after_the_approach(triangle):
    out, rows = triangle
    record = Rollout.load(out / "triangle_1_s_twin_0_hybrid.npz")
    error = np.linalg.norm((record.tip - record.reference)[:, :2], axis=1)
    assert rows[0]["e_mean"] == pytest.approx(error.mean())
    assert rows[0]["e_mean_tracking"] == pytest.approx(error[record.time > 10.0].mean())
    assert rows[0]["e_max_tracking"] == pytest.approx(error[record.time > 10.0].max())


def test_the_report_has_the_thesis_figures_below_ours(triangle):
    text = (triangle[0] / "report.md").read_text()
    one, half = text.split("## triangle 0.5 s")
    assert "| hybrid (thesis) | real |" in one and "8.60 | 18.40" in one  # Tab. 5.3
    assert "thesis) | real" not in half
    assert "after the approach" in text


def test_every_task_has_three_plots(triangle):
    written = {path.name for path in triangle[0].glob("*.png")}
    stems = ("triangle_1_s_twin_0", "triangle_0.5_s_twin_0")
    assert written == {f"{s}_{name}.png" for s in stems for name in ("tip", "lengths", "path")}


def test_rows_of_arm_and_rig_have_the_same_columns(tmp_path):
    arguments = ["--tasks", "lshape", "reach", "--policies", "hold", "rig_nn", "--no-plots"]
    arm, rig = evaluated(tmp_path, *arguments, "--control-period", "0.1")
    assert set(arm) == set(rig)
    assert arm["task"] == "lshape" and arm["policy"] == "hold"
    assert all(arm[name] is None for name in ("twin", "period", "radius", "e_mean_tracking"))
    assert rig["policy"] == "rig_nn"
    assert (rig["path_seed"], rig["radius"], rig["hold"]) == (0, 0.121, 3.0)
    assert rig["e_mean_tracking"] is None  # set points have no approach


def test_twins_are_compared_with_the_ideal_rig(tmp_path, capsys):
    arguments = ["--tasks", "triangle", "--policies", "inverse_dynamics", "--no-plots"]
    rows = evaluated(tmp_path, *arguments, "--option", "period=2", "--twin", "0", "none")
    assert [row["twin"] for row in rows] == [0, None]
    # The policy's model is that of the ideal rig.
    assert rows[0]["e_mean_tracking"] > 4 * rows[1]["e_mean_tracking"]
    out = capsys.readouterr().out
    assert "twin 0" in out and "ideal" in out
    assert "other rigs differ" not in out  # the policy has learnt of none


def test_all_policies_are_those_that_fit(tmp_path):
    rows = evaluated(tmp_path, "--tasks", "triangle", "--no-plots", *FAST)
    assert {"rig_nn", "hybrid_calibrated"} <= {row["policy"] for row in rows}
    assert not {"hold", "lqi"} & {row["policy"] for row in rows}


def test_options_apply_to_every_task_that_has_them(tmp_path):
    arguments = ["--tasks", "reach", "rig_circle", "--policies", "rig_nn", "--no-plots"]
    rows = evaluated(
        tmp_path, *arguments, "--option", "radius=0.05", "--path-seeds", "2", "--speeds", "0.2"
    )
    told = [(row["task"], row["radius"], row["path_seed"], row["speed"]) for row in rows]
    assert told == [("reach", 0.05, 2, None), ("rig_circle", 0.05, None, 0.2)]


@pytest.mark.parametrize(
    ("arguments", "reason"),
    [
        (["--tasks", "swing", "--policies", "hybrid"], "for the tasks triangle, rig_circle, reach"),
        (["--tasks", "triangle", "--policies", "lqi"], "for the tasks step, swing"),
        (["--tasks", "swing", "reach", "--policies", "hybrid"], "no policy for task 'swing'"),
        (["--tasks", "swing", "--twin", "1"], "--twin: only with tasks of the rig"),
        (["--tasks", "reach", "--option", "period=1"], "period is an option of triangle only"),
        (["--tasks", "reach", "--option", "seed=0.5"], "whole number"),
        (["--tasks", "triangle", "--option", "period=0"], "positive"),
        (["--tasks", "triangle", "--option", "period=5,0.08"], "below 2.02 m/s"),
        (["--tasks", "triangle", "--vary", "tension_gain=2"], "driven by length"),
        (["--tasks", "triangle", "--plant", "pcc"], "no tendon friction"),
        (["--tasks", "triangle", "--feedback", "output"], "--feedback output: only with"),
    ],
    ids=str,
)
def test_what_no_case_uses_is_refused_before_any_episode(arguments, reason, tmp_path, capsys):
    assert main(["evaluate", *arguments, "--out", str(tmp_path)]) == 2
    assert reason in capsys.readouterr().err
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("arguments", "allowed"),
    [
        (["--option", "period"], "NAME=V1,V2"),
        (["--option", "period=fast"], "not a number"),
        (["--option", "period=inf"], "not a number"),
        (["--twin", "-1"], "none"),
        (["--twin", "some"], "none"),
        (["--policies", "pid"], "hybrid_flexible"),
    ],
    ids=str,
)
def test_bad_arguments_are_told_what_is_allowed(arguments, allowed, capsys):
    with pytest.raises(SystemExit):
        main(["evaluate", "--tasks", "triangle", *arguments])
    assert allowed in capsys.readouterr().err


def test_inspect_shows_the_rig_as_built(capsys, monkeypatch):
    monkeypatch.setenv("COLUMNS", "80")
    assert main(["inspect", "--task", "triangle", "--twin", "3"]) == 0
    out = " ".join(capsys.readouterr().out.replace("│", " ").split())
    twin = rig3d_twin(3)
    assert f"backlash ({1e3 * twin.backlash[0]:.3g}, " in out
    assert f"{twin.robot.tendons[2].friction:.3g}" in out
    for text in ("twin 3", "16 hinges", "980 N/m", "0.5 to 40", "full scale 30 mm", "torsion"):
        assert text in out
    assert "precurvature" not in out and "…" not in out


def test_inspect_tells_which_errors_a_rig_has_not(capsys):
    assert main(["inspect", "--task", "reach", "--option", "hold=1", "--twin", "none"]) == 0
    out = " ".join(capsys.readouterr().out.replace("│", " ").split())
    assert "reach 0 121 mm 1 s" in out and "ideal" in out
    for error in ("backlash", "tendon friction", "camera noise", "camera delay"):
        assert error in out


@pytest.mark.slow  # compiling the model takes long
def test_a_rig_varies_and_can_be_a_beam_model(tmp_path, capsys):
    arguments = ["--tasks", "triangle", "--policies", "inverse_dynamics", "--no-plots", *FAST]
    arguments += ["--duration", "0.3"]
    vary = ["--twin", "0", "none", "--vary", "youngs_modulus=1,0.5"]
    rows = evaluated(tmp_path, *arguments, *vary)
    told = [(row["twin"], row["variation"].get("youngs_modulus")) for row in rows]
    assert told == [(0, None), (0, 0.5), (None, None), (None, 0.5)]
    assert "twin 0, E x 0.5" in capsys.readouterr().out
    assert len({row["e_final"] for row in rows}) == 4
    (row,) = evaluated(tmp_path, *arguments, "--plant", "pcc", "--twin", "none")
    assert row["plant"] == "pcc"
    assert row["e_final"] == pytest.approx(rows[2]["e_final"], abs=2e-3)  # ideal, as a chain


def test_render_takes_one_value_and_a_policy_of_the_rig(tmp_path, capsys):
    out = ["--out", str(tmp_path / "a.gif")]
    assert main(["render", "--task", "triangle", "--option", "period=5,1", *out]) == 2
    assert "one value" in capsys.readouterr().err
    assert main(["render", "--task", "triangle", "--policy", "lqi", *out]) == 2
    assert "hybrid" in capsys.readouterr().err
    assert main(["render", "--task", "swing", "--twin", "1", *out]) == 2
    assert "tasks of the rig" in capsys.readouterr().err


def test_render_draws_the_rig(tmp_path, monkeypatch):
    frame = np.zeros((60, 80, 3), np.uint8)
    drawn = []
    monkeypatch.setattr(RigEnv, "render", lambda env: drawn.append(env.twin.seed) or frame)
    size = ["--size", "80", "60", "--fps", "10", "--duration", "0.5"]
    arguments = ["--task", "triangle", "--twin", "2", "--option", "period=1", *size]
    assert main(["render", *arguments, "--out", str(tmp_path / "a.gif")]) == 0
    assert (tmp_path / "a.gif").exists()
    assert drawn == [2] * 6


def test_options_are_declared_once():
    """Labels, columns and files know every option that a task has, and its default."""
    for name, make in EVERY_TASK.items():
        assert set(defaults(make)) <= set(OPTIONS)
        assert dict(make_task(name).options) == defaults(make)
        assert make_task(name, **defaults(make)) == make_task(name)
