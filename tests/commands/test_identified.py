"""`--learnt` on the command line: policies of the rig with what was learnt of any rig."""

import json
from types import SimpleNamespace

import numpy as np
import pytest
from support.rig_learnt_file import ALWAYS, constant_learnt, learnt_file

from softrobot_env.cli import main
from softrobot_env.core.files import models_dir
from softrobot_env.evaluation.rollout import Rollout
from softrobot_env.robots import RIG
from softrobot_env.thesis.envs import RigEnv
from softrobot_env.thesis.rig import parameters
from softrobot_env.thesis.rig.parameters import describe_rig

REACH = ["--tasks", "reach", "--option", "hold=0.2", "--option", "radius=0.03", "--no-plots"]


@pytest.fixture
def learnt(tmp_path):
    """A file of twin 3."""
    return str(learnt_file(tmp_path / "learnt.npz", twin=3))


def evaluated(out, *arguments):
    """Rows and text of a report."""
    assert main(["evaluate", *REACH, *arguments, "--out", str(out)]) == 0
    rows = json.loads((out / "report.json").read_text())["rows"]
    return rows, (out / "report.md").read_text()


def test_policies_act_as_the_file_says(learnt, tmp_path):
    policies = ["--policies", "rig_nn", "inverse_dynamics"]
    more = ["--twin", "3", "--learnt", learnt, "--save-rollouts"]
    rows, text = evaluated(tmp_path / "out", *policies, *more)
    assert [(row["twin"], row["learnt"]) for row in rows] == [(3, "twin 3"), (3, None)]
    record, other = (
        Rollout.load(next((tmp_path / "out").glob(f"*{row['policy']}.npz"))) for row in rows
    )
    np.testing.assert_allclose(record.action[1:], np.tile(ALWAYS, (len(record.action) - 1, 1)))
    assert not np.allclose(other.action[1:], ALWAYS, atol=0.01)
    assert "other rigs differ" not in text


def test_other_rigs_than_the_one_of_the_file_are_noted(learnt, tmp_path, capsys):
    more = ["--policies", "rig_nn", "--twin", "3", "0", "--learnt", learnt]
    rows, text = evaluated(tmp_path / "out", *more)
    assert [(row["twin"], row["learnt"]) for row in rows] == [(3, "twin 3"), (0, "twin 3")]
    note = "The identified parameters of the rig are of twin 3; other rigs differ from it."
    assert text.count(note) == 1
    assert " ".join(capsys.readouterr().out.split()).count(note) == 1


@pytest.mark.parametrize(
    ("command", "reason"),
    [
        ("evaluate --tasks swing", "--learnt: only with tasks of the rig, triangle"),
        (
            "evaluate --tasks reach --policies inverse_dynamics inverse_dynamics_ahead",
            "--learnt: only with the policies rig_nn, rig_nn_p, rig_nn_pi, hybrid, hybrid_ahead",
        ),
        ("render --task swing", "--learnt: only with tasks of the rig, triangle"),
        ("render --task reach --policy inverse_dynamics", "--learnt: only with the policies"),
    ],
)
def test_a_file_that_nothing_uses_is_refused(command, reason, learnt, tmp_path, capsys):
    out = tmp_path / "out"
    assert main([*command.split(), "--learnt", learnt, "--out", str(out)]) == 2
    assert reason in capsys.readouterr().err
    assert not out.is_file() and not list(out.glob("*"))


def _without_damping(path):
    constant_learnt().network.save(path, describe_rig(RIG) | {"stiffness": 1, "turn": 0, "play": 0})


@pytest.mark.parametrize(
    ("write", "reason"),
    [
        (lambda path: None, "make it with `softrobot train rig_nn --robot rig`"),
        (lambda path: path.write_text("stiffness = 1"), "is no npz file of arrays, or damaged"),
        (lambda path: np.savez(path, gains=1.0), "lacks the array 'weight_0'; it has gains; make"),
        (_without_damping, "lacks the array 'damping'"),
        (
            lambda path: path.write_bytes((models_dir() / "qs_nn.npz").read_bytes()),
            "is of 'arm' as it was then",
        ),
    ],
    ids=["missing", "text", "other arrays", "lacking", "other robot"],
)
def test_unfit_files_are_refused_before_any_episode(write, reason, tmp_path, capsys):
    out, path = tmp_path / "out", tmp_path / "unfit.npz"
    write(path)
    arguments = ["evaluate", "--tasks", "reach", "--learnt", str(path), "--out", str(out)]
    assert main(arguments) == 2
    said = capsys.readouterr().err
    assert str(path) in said and reason in said
    assert not list(out.iterdir())


def test_a_video_shows_what_the_file_says(learnt, tmp_path, monkeypatch):
    taken, step = [], RigEnv.step

    def told(env, action):
        taken.append(action)
        return step(env, action)

    monkeypatch.setattr(RigEnv, "step", told)
    monkeypatch.setattr(RigEnv, "render", lambda env: np.zeros((60, 80, 3), np.uint8))
    arguments = ["--task", "reach", "--policy", "rig_nn", "--duration", "0.2", "--fps", "10"]
    arguments += ["--size", "80", "60", "--learnt", learnt]
    assert main(["render", *arguments, "--out", str(tmp_path / "a.gif")]) == 0
    np.testing.assert_allclose(taken, np.tile(ALWAYS, (len(taken), 1)))
    assert len(taken) == 10


def test_the_trained_file_is_of_its_twin(tmp_path, monkeypatch, capsys):
    """What `train` writes is what `evaluate` takes."""
    errors = {"inverse": 1e-4, "forward": 2e-4}
    lesson = SimpleNamespace(networks=SimpleNamespace(errors=errors))
    monkeypatch.setattr(parameters, "record", lambda twin, seed, **_: None)
    monkeypatch.setattr(parameters, "identified", lambda recorded, seed, **_: lesson)
    monkeypatch.setattr(parameters, "parameters_of", lambda found, twin: constant_learnt(twin))
    assert main(["train", "rig_nn", "--twin", "3", "--out", str(tmp_path)]) == 0
    said = capsys.readouterr().out
    assert "bending damping over nominal" in said and "1.000" in said
    more = ["--policies", "rig_nn", "--twin", "3", "--learnt", str(tmp_path / "rig_nn_3.npz")]
    (row,), _ = evaluated(tmp_path / "out", *more)
    assert row["learnt"] == "twin 3"
