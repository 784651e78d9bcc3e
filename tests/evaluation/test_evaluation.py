import json

import numpy as np
import pytest

from softrobot_env.control.registry import make_policy
from softrobot_env.envs.tracking import TrackingEnv
from softrobot_env.evaluation import report
from softrobot_env.evaluation.run import run_episode
from softrobot_env.evaluation.runner import Case, run
from softrobot_env.rendering import episodes
from softrobot_env.robots import ARM
from softrobot_env.scene.timestep import TimestepWarning
from softrobot_env.tasks import make_task

COMMAND = "softrobot evaluate --tasks swing"


@pytest.fixture(scope="module")
def outcome():
    return run(Case(make_task("lshape"), "feedforward", scene={"control_period": 0.05}))


@pytest.fixture(scope="module")
def failed():
    """An undamped arm under Runge-Kutta with far too long steps."""
    long = {"control_period": 0.02, "timestep": 0.02, "integrator": "RK4"}
    with pytest.warns(TimestepWarning):
        return run(Case(make_task("swing"), "feedforward", {"damping_time": 0}, scene=long))


def row(outcome, **changes):
    return vars(outcome.row()) | changes


def test_record_of_an_episode(outcome):
    task, rollout = outcome.case.task, outcome.rollout
    assert rollout.failure is None
    np.testing.assert_allclose(rollout.time, np.arange(301) * 0.05)
    np.testing.assert_allclose(rollout.reference, task.trajectory.position(rollout.time))
    assert rollout.tip.shape == (301, 3) and rollout.curvature.shape == (301, 6)
    assert rollout.tendon_tension.shape == rollout.tendon_length.shape == (301, 6)
    assert rollout.policy_time.shape == (300,) and np.all(rollout.policy_time > 0)
    assert rollout.wall_time > rollout.policy_time.sum()
    # The action in force before an instant is the one whose tensions are applied.
    pulls = np.maximum(80 * rollout.action[1:, 0], 0)
    np.testing.assert_allclose(rollout.tendon_tension[1:, 0], pulls, atol=1e-9)


def test_recording_needs_its_observables():
    env = TrackingEnv("swing", observe=("tip_position",))
    with pytest.raises(ValueError, match='observe="all"'):
        run_episode(env, make_policy("hold", ARM, 0.01))


def test_step_rows_have_step_metrics():
    scene = {"control_period": 0.02}
    values = row(run(Case(make_task("step"), "feedforward", duration=25.0, scene=scene)))
    assert values["step_width"] == 0.05
    # Lightly damped second-order motion: audit's open-loop step, 55 to 65 % overshoot, 5.7 s.
    assert 0.5 < values["overshoot"] < 0.7
    assert 5 < values["settling_time"] < 6.5
    assert values["rise_time"] == pytest.approx(0.24, abs=0.02)


def test_a_failure_is_no_finite_result(failed):
    values = row(failed)
    assert "diverged" in values["failure"] or "left the workspace" in values["failure"]
    assert all(values[name] is None for name in ("e_mean", "e_max", "e_rms", "e_final"))


def test_reports_tell_the_failure(failed, tmp_path):
    rows = [row(failed)]
    report.write_json(tmp_path / "report.json", rows, COMMAND)
    stored = json.loads((tmp_path / "report.json").read_text())
    assert stored["rows"][0]["failure"] == failed.rollout.failure
    assert failed.rollout.failure in episodes.markdown(rows, COMMAND)
    assert "FAILED" in episodes.markdown(rows, COMMAND)
    assert failed.rollout.failure in str(episodes.tables(rows)[0].caption)


def test_reports_refuse_nan(outcome, tmp_path):
    with pytest.raises(ValueError):
        report.write_json(tmp_path / "report.json", [row(outcome, e_max=float("nan"))], COMMAND)
    with pytest.raises(ValueError, match="not finite"):
        episodes.markdown([row(outcome, e_max=float("inf"))], COMMAND)


def test_markdown_shows_the_thesis_beside_ours(outcome):
    text = episodes.markdown([row(outcome)], COMMAND)
    assert "| LQI (thesis, PCC plant) |" in text and "1.71" in text


def test_meta_names_versions_and_command(tmp_path):
    report.write_json(tmp_path / "report.json", [], COMMAND)
    meta = json.loads((tmp_path / "report.json").read_text())["meta"]
    assert meta["command"] == COMMAND
    assert meta["versions"]["mujoco"].startswith("4.")
    assert meta["cpu"]
