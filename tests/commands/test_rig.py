"""The rig on the command line: what is identified of it with `--identified`, and its sensors."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from support.commands import called, evaluated
from support.rig_identified_file import ALWAYS, constant_identified, identified_file

from softrobot_env.cli import build_parser, main
from softrobot_env.commands.cases import make_cases, make_setup
from softrobot_env.evaluation.rollout import Rollout
from softrobot_env.robots import ROBOTS, Sensor, write_robot
from softrobot_env.robots.twin import rig3d_twin
from softrobot_env.tasks import EVERY_TASK, OPTIONS, defaults, make_task
from softrobot_env.thesis.envs import RigEnv
from softrobot_env.thesis.rig import parameters

FAST = "--option period=0.5 --control-period 0.05"


@pytest.fixture(scope="module")
def triangle(tmp_path_factory):
    """Folder and rows of two policies on two triangles of twin 0."""
    out = tmp_path_factory.mktemp("triangle")
    words = "--tasks triangle --policies hybrid inverse_dynamics --option period=1,0.5"
    return out, evaluated(out, words, "--save-rollouts --no-plots")


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


def test_the_report_has_the_thesis_figures_below_ours(triangle):
    text = (triangle[0] / "report.md").read_text()
    one, half = text.split("## triangle 0.5 s")
    assert "| hybrid (thesis) | real |" in one and "8.60 | 18.40" in one  # Tab. 5.3
    assert "thesis) | real" not in half
    assert "after the approach" in text


def test_rows_of_arm_and_rig_have_the_same_columns(tmp_path):
    words = "--tasks lshape reach --policies hold rig_nn --no-plots --control-period 0.1"
    arm, rig = evaluated(tmp_path, words)
    assert set(arm) == set(rig)
    assert arm["task"] == "lshape" and arm["policy"] == "hold"
    assert all(arm[name] is None for name in ("twin", "period", "radius", "e_mean_tracking"))
    assert rig["policy"] == "rig_nn"
    assert (rig["path_seed"], rig["radius"], rig["hold"]) == (0, 0.121, 3.0)
    assert rig["e_mean_tracking"] is None  # set points have no approach


def test_twins_are_compared_with_the_ideal_rig(tmp_path, capsys):
    words = "--tasks triangle --policies inverse_dynamics --no-plots --option period=2"
    rows = evaluated(tmp_path, words, "--twin 0 none")
    assert [row["twin"] for row in rows] == [0, None]
    # The policy's model is that of the ideal rig.
    assert rows[0]["e_mean_tracking"] > 4 * rows[1]["e_mean_tracking"]
    out = capsys.readouterr().out
    assert "twin 0" in out and "ideal" in out
    assert "other rigs differ" not in out  # the policy has parameters of none


def test_all_policies_are_those_that_fit():
    args = build_parser().parse_args(["evaluate", "--tasks", "triangle"])
    policies = {case.policy for case in make_cases(args, make_setup(args))}
    assert {"rig_nn", "hybrid_calibrated"} <= policies and not {"hold", "lqi"} & policies


def test_options_apply_to_every_task_that_has_them(tmp_path):
    words = "--tasks reach rig_circle --policies rig_nn --no-plots --option radius=0.05"
    rows = evaluated(tmp_path, words, "--path-seeds 2 --speeds 0.2")
    reported = [(row["task"], row["radius"], row["path_seed"], row["speed"]) for row in rows]
    assert reported == [("reach", 0.05, 2, None), ("rig_circle", 0.05, None, 0.2)]


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
    words = f"--tasks triangle --policies inverse_dynamics --no-plots {FAST} --duration 0.3"
    rows = evaluated(tmp_path, words, "--twin 0 none --vary youngs_modulus=1,0.5")
    reported = [(row["twin"], row["variation"].get("youngs_modulus")) for row in rows]
    assert reported == [(0, None), (0, 0.5), (None, None), (None, 0.5)]
    assert "twin 0, E x 0.5" in capsys.readouterr().out
    assert len({row["e_final"] for row in rows}) == 4
    (row,) = evaluated(tmp_path, words, "--plant pcc --twin none")
    assert row["plant"] == "pcc"
    assert row["e_final"] == pytest.approx(rows[2]["e_final"], abs=2e-3)  # ideal, as a chain


def test_options_are_declared_once():
    """Labels, columns and files know every option that a task has, and its default."""
    for name, make in EVERY_TASK.items():
        assert set(defaults(make)) <= set(OPTIONS)
        assert dict(make_task(name).options) == defaults(make)
        assert make_task(name, **defaults(make)) == make_task(name)


# ---------------------------------------------------------------- what is identified of a rig

REACH = "--tasks reach --option hold=0.2 --option radius=0.03 --no-plots"


@pytest.fixture
def identified(tmp_path):
    """A file of twin 3."""
    return str(identified_file(tmp_path / "identified.npz", twin=3))


@pytest.mark.parametrize(("twins", "notes"), [("3", 0), ("3 0", 1)])
def test_policies_act_as_the_file_says_and_other_rigs_are_noted(
    twins, notes, identified, tmp_path, capsys
):
    out, policies = tmp_path / "out", "--policies rig_nn inverse_dynamics --twin"
    given = ("--identified", identified, "--save-rollouts")
    for row in evaluated(out, REACH, policies, twins, *given):
        is_identified = row["policy"] == "rig_nn"
        assert row["identified"] == ("twin 3" if is_identified else None)
        (path,) = out.glob(f"*twin_{row['twin']}_{row['policy']}.npz")
        action = Rollout.load(path).action[1:]
        assert np.allclose(action, ALWAYS, atol=1e-6 if is_identified else 0.01) == is_identified
    note = "The identified parameters of the rig are of twin 3; other rigs differ from it."
    assert (out / "report.md").read_text().count(note) == notes
    assert " ".join(capsys.readouterr().out.split()).count(note) == notes


def test_a_video_shows_what_the_file_says(identified, tmp_path, monkeypatch):
    frame, drawn, taken, step = np.zeros((60, 80, 3), np.uint8), [], [], RigEnv.step

    def reported(env, action):
        taken.append(action)
        return step(env, action)

    monkeypatch.setattr(RigEnv, "step", reported)
    monkeypatch.setattr(RigEnv, "render", lambda env: drawn.append(env.twin.seed) or frame)
    words = "render --task reach --policy rig_nn --twin 3 --duration 0.2 --fps 10 --size 80 60"
    assert called(words, "--identified", identified, "--out", tmp_path / "a.gif") == 0
    assert (tmp_path / "a.gif").exists() and drawn == [3] * 3
    np.testing.assert_allclose(taken, np.tile(ALWAYS, (len(taken), 1)))
    assert len(taken) == 10


def test_the_trained_file_is_of_its_twin(tmp_path, monkeypatch, capsys):
    """What `train` writes is what `evaluate` takes."""
    errors = {"inverse": 1e-4, "forward": 2e-4}
    lesson = SimpleNamespace(networks=SimpleNamespace(errors=errors))
    monkeypatch.setattr(parameters, "record", lambda twin, seed, **_: None)
    monkeypatch.setattr(parameters, "identified", lambda recorded, seed, **_: lesson)
    monkeypatch.setattr(parameters, "parameters_of", lambda found, twin: constant_identified(twin))
    assert main(["train", "rig_nn", "--twin", "3", "--out", str(tmp_path)]) == 0
    said = capsys.readouterr().out
    assert "bending damping over nominal" in said and "1.000" in said
    more = ("--policies rig_nn --twin 3 --learnt", tmp_path / "rig_nn_3.npz")
    (row,) = evaluated(tmp_path / "out", REACH, *more)
    assert row["identified"] == "twin 3"
    assert "--learnt is --identified now" in capsys.readouterr().err


# ---------------------------------------------------------------- its sensors


FINGER = ROBOTS["planar_finger"]


def sensing(path, *sensors):
    """Write the file of a finger with sensors; returns its path."""
    write_robot(replace(FINGER, name="felt", sensors=sensors), path)
    return path


def test_the_rig_is_driven_by_its_sensor_alone(tmp_path):
    words = "--tasks triangle --policies rig_nn_pi --feedback sensors --duration 2 --no-plots"
    (row,) = evaluated(tmp_path, words)
    assert row["feedback"] == "sensors" and row["failure"] is None


@pytest.mark.slow
def test_any_robot_is_calibrated_and_driven_by_its_sensors(tmp_path, capsys):
    half = FINGER.length / 2
    tags = (Sensor("a", "tags", 0.0, half, 1), Sensor("b", "tags", half, FINGER.length, 1))
    finger = sensing(tmp_path / "felt.toml", *tags)
    words = f"--robot {finger} --tasks circle --policies chain_dynamics_pi --feedback sensors"
    assert called("evaluate", words, "--out", tmp_path / "out") == 2
    assert f"softrobot train sensors --robot {finger}" in capsys.readouterr().err
    assert called("train sensors --quick --robot", finger) == 0
    assert (finger.parent / "felt.sensors.npz").is_file()
    (row,) = evaluated(tmp_path / "out", words, "--no-plots")
    assert row["failure"] is None and row["e_mean"] < 1e-3


@pytest.mark.slow
def test_sensors_that_tell_no_side_are_refused(tmp_path, capsys):
    finger = sensing(tmp_path / "felt.toml", Sensor("a", "planar", 0.0, FINGER.length))
    assert called("train sensors --quick --robot", finger) == 2
    assert "do not tell where its tip is" in capsys.readouterr().err
