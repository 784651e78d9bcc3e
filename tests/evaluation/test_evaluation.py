import json

import numpy as np
import pytest

from softrobot_env.control.registry import make_policy
from softrobot_env.envs.tracking import TrackingEnv
from softrobot_env.evaluation import report
from softrobot_env.evaluation.run import run_episode
from softrobot_env.evaluation.runner import Case, Outcome
from softrobot_env.robots import ARM
from softrobot_env.scene.timestep import TimestepWarning
from softrobot_env.tasks import make_task

COMMAND = "softrobot evaluate --tasks swing"


@pytest.fixture(scope="module")
def rollout():
    env = TrackingEnv("lshape", observe="all", control_period=0.05)
    return run_episode(env, make_policy("feedforward", ARM, 0.05), seed=3)


@pytest.fixture(scope="module")
def failed():
    """An undamped arm under Runge-Kutta with far too long steps."""
    with pytest.warns(TimestepWarning):
        env = TrackingEnv(
            "swing", observe="all", control_period=0.02, timestep=0.02, integrator="RK4"
        )
        policy = make_policy("feedforward", ARM, 0.02)
        return run_episode(env, policy, options={"vary": {"damping_time": 0}})


def row(rollout, task, **changes):
    values = Outcome(Case(make_task(task), "feedforward"), rollout, 0.05).row()
    return vars(values) | changes


def test_record_of_an_episode(rollout):
    task = make_task("lshape")
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
    env = TrackingEnv("step", observe="all", control_period=0.02)
    rollout = run_episode(env, make_policy("feedforward", ARM, 0.02), options={"duration": 25.0})
    values = row(rollout, "step")
    assert values["step_width"] == 0.05
    # Lightly damped second-order motion: audit's open-loop step, 55 to 65 % overshoot, 5.7 s.
    assert 0.5 < values["overshoot"] < 0.7
    assert 5 < values["settling_time"] < 6.5
    assert values["rise_time"] == pytest.approx(0.24, abs=0.02)


def test_a_failure_is_no_finite_result(failed):
    values = row(failed, "swing")
    assert "diverged" in values["failure"] or "left the workspace" in values["failure"]
    assert all(values[name] is None for name in ("e_mean", "e_max", "e_rms", "e_final"))


def test_reports_tell_the_failure(failed, tmp_path):
    rows = [row(failed, "swing")]
    report.write_json(tmp_path / "report.json", rows, COMMAND)
    stored = json.loads((tmp_path / "report.json").read_text())
    assert stored["rows"][0]["failure"] == failed.failure
    assert failed.failure in report.markdown(rows, COMMAND)
    assert "FAILED" in report.markdown(rows, COMMAND)
    assert failed.failure in str(report.tables(rows)[0].caption)


def test_reports_refuse_nan(rollout, tmp_path):
    with pytest.raises(ValueError):
        report.write_json(
            tmp_path / "report.json", [row(rollout, "lshape", e_max=float("nan"))], COMMAND
        )
    with pytest.raises(ValueError, match="not finite"):
        report.markdown([row(rollout, "lshape", e_max=float("inf"))], COMMAND)


def test_markdown_shows_the_thesis_beside_ours(rollout):
    text = report.markdown([row(rollout, "lshape")], COMMAND)
    assert "| LQI (thesis, PCC plant) |" in text and "1.71" in text


def test_meta_names_versions_and_command(rollout, tmp_path):
    report.write_json(tmp_path / "report.json", [], COMMAND)
    meta = json.loads((tmp_path / "report.json").read_text())["meta"]
    assert meta["command"] == COMMAND
    assert meta["versions"]["mujoco"].startswith("4.")
    assert meta["cpu"]
