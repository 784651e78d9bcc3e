"""The controller benchmark: its metrics, ratios, goals, tables and figures; a small run."""

import json
from dataclasses import replace
from io import StringIO

import numpy as np
import pytest
from rich.console import Console

from softrobot_env.benchmarks.controllers import goals as controllers_goals
from softrobot_env.benchmarks.controllers import run as controllers
from softrobot_env.benchmarks.controllers import tables as controllers_tables
from softrobot_env.benchmarks.controllers.cases import (
    TASKS,
    ControllerRow,
    E,
    make_case,
    motion_errors,
    with_ratios,
)
from softrobot_env.benchmarks.controllers.goals import GoalRow
from softrobot_env.benchmarks.controllers.plots import plot
from softrobot_env.benchmarks.episodes import EpisodeRecord, policies, record_of
from softrobot_env.benchmarks.records import of_kind, select
from softrobot_env.cli import main
from softrobot_env.control.registry import POLICIES
from softrobot_env.evaluation.rollout import Rollout
from softrobot_env.evaluation.runner import Outcome
from softrobot_env.thesis.figures import AUDIT, CONTROLLERS, FIGURES
from studies.quantities import number, span, with_unit

pytestmark = pytest.mark.slow  # a study; the quick suite has what it stands on

#: Figures of a made-up episode, all goals met.
GOOD = {
    "e_mean": 1e-4,
    "e_max": 1e-4,
    "e_rms": 5e-5,
    "e_final": 1e-6,
    "e_motion": 1e-4,
    "e_motion_least": 1e-5,
    "rise_time": 0.1,
    "settling_time": 0.2,
    "overshoot": 0.01,
    "steady_state_error": 1e-6,
    "tension_max": 20.0,
}


def make_row(setting="mujoco", policy="lqi", task="swing", width=None, variation=None, **changes):
    metrics = dict.fromkeys(GOOD) if changes.get("failure") else GOOD
    plant = "pcc" if setting == "thesis" else changes.pop("plant", "mujoco")
    fields = {
        "setting": setting,
        "plant": plant,
        "policy": policy,
        "task": task,
        "step_width": width,
        "variation": variation or {},
        "feedback": "output" if setting == "output" else "state",
        "robot": "arm",
        "source": "sim",
        "decision_period": 0.001,
        "policy_time_median": 1e-6,
        "policy_time_p99": 2e-6,
        "realtime_factor": 100.0,
        "remarks": {},
        "failure": None,
    }
    return ControllerRow(**{**fields, **metrics, **changes})


def make_trace(failure=None):
    time = np.linspace(0.0, 15.0, 31)
    point = np.stack([np.sin(time), 0 * time, np.cos(time)], axis=1)
    record = make_rollout(0.01 + 0 * time, time, failure)
    return replace(record, reference=point, tip=1.01 * point, curvature=np.ones((31, 6)))


def fake_run(setting, case):
    fields = {"plant": case.plant}
    if case.plant == "pcc":
        fields["trace"] = make_trace()
    if case.policy == "lq_adaptive":  # the best
        fields["e_rms"] = GOOD["e_rms"] / 2
    task = case.task
    return make_row(setting, case.policy, task.name, task.step_width, case.variation, **fields)


@pytest.fixture
def full(monkeypatch):
    """Rows of a full run whose episodes are made up."""
    monkeypatch.setattr(controllers, "run_case", fake_run)
    return controllers.run()


def episodes(rows):
    return of_kind(rows, ControllerRow)


def shown(rows):
    page = Console(width=110, file=StringIO())
    page.print(controllers_tables.tables(rows))
    return page.file.getvalue()


def make_rollout(error, time, failure=None):
    """Error (T,) [m] in x at times (T,) [s]."""
    count = len(time)
    tip = np.zeros((count, 3))
    tip[:, 0] = error
    tension = np.tile([3.0, 0.0, 5.0] * 2, (count, 1))
    return Rollout(
        time=time,
        reference=np.zeros((count, 3)),
        tip=tip,
        action=np.zeros((count, 3)),
        tendon_tension=tension,
        tendon_length=tension,
        curvature=np.zeros((count, 6)),
        reward=np.zeros(count),
        policy_time=np.ones(count - 1),
        policy_status=np.array([""] * (count - 1)),
        wall_time=1.0,
        failure=failure,
    )


def test_error_during_the_motion_leaves_the_kinks_out():
    time = np.arange(0.0, 15.01, 0.25)
    error = np.full(len(time), 2e-3)
    error[(time <= 0.5) | (time >= 10)] = 9e-3
    error[time == 3.0] = 1e-3
    assert motion_errors(make_rollout(error, time), "swing") == (1e-3, 2e-3)
    error[(time >= 5) & (time <= 6)] = 7e-3  # the corner of the L-shape
    error[(time > 0.5) & (time <= 1)] = 8e-3
    assert motion_errors(make_rollout(error, time), "lshape")[1] == 2e-3
    assert motion_errors(make_rollout(error, time), "step") == (None, None)


def test_failed_episodes_have_no_metrics():
    rollout = make_rollout(np.zeros(3), np.arange(3.0), failure="left the workspace")
    assert motion_errors(rollout, "swing") == (None, None)
    outcome = Outcome(make_case("mujoco", "lqi", "swing"), rollout, 0.001)
    assert record_of(outcome, EpisodeRecord).tension_max is None


def test_the_largest_tension_is_that_of_any_tendon():
    rollout = make_rollout(np.zeros(3), np.arange(3.0))
    outcome = Outcome(make_case("mujoco", "lqi", "swing"), rollout, 0.001)
    assert record_of(outcome, EpisodeRecord).tension_max == 5.0


def test_ratios_are_to_the_same_case_with_the_nominal_robot():
    rows = [
        make_row(e_max=2e-3, e_rms=1e-3),
        make_row(policy="mpc", e_max=1.0),
        make_row("robustness", variation={E: 0.5}, e_max=3e-3, e_rms=4e-3),
        make_row("robustness", variation={E: 0.75}, failure="diverged"),
        make_row("robustness", "qs_nn", variation={E: 0.5}),
    ]
    nominal, _, varied, failed, alone = with_ratios(rows)
    assert "e_max_ratio" not in nominal.row()
    assert varied.e_max_ratio == pytest.approx(1.5)
    assert varied.e_rms_ratio == pytest.approx(4.0)
    assert failed.e_max_ratio is None
    assert alone.e_max_ratio is None


def test_a_full_run_covers_every_setting(full):
    found = episodes(full)
    assert {row.setting for row in found} == set(controllers.SETTINGS)
    assert list(dict.fromkeys(row.policy for row in found)) == policies()
    assert policies()[:3] == list(CONTROLLERS)
    assert set(policies()) == set(POLICIES) - {"hold"}
    for setting in ("thesis", "mujoco"):
        assert len(select(episodes(full), setting=setting)) == len(TASKS) * len(policies())
    output = {row.policy for row in select(episodes(full), setting="output")}
    assert {"lqi", "lq_adaptive"} <= output
    assert not output & {"qs_nn", "feedforward"}
    for task, width in TASKS:
        varied = select(found, setting="robustness", plant="mujoco", task=task, step_width=width)
        factors = [row.variation.get(E) for row in varied if row.policy == "lqi"]
        assert set(factors) - {None} == set(controllers.MODULI)
    others = [row.variation for row in found if E not in row.variation]
    assert {"damping_time": 2.0} in others
    assert {"density": 0.6} in others


@pytest.mark.slow
def test_a_quick_run_is_a_part_of_the_full_one(monkeypatch, full):
    quick = controllers.run(quick=True)
    assert len(episodes(quick)) < len(episodes(full)) / 4
    kept = ("setting", "plant", "policy", "task", "step_width", "variation")
    known = [[getattr(row, name) for name in kept] for row in episodes(full)]
    assert all([getattr(row, name) for name in kept] in known for row in episodes(quick))


def test_good_rows_meet_all_goals(full):
    goals = of_kind(full, GoalRow)
    assert goals
    assert all(row.met for row in goals)
    assert {row.setting for row in goals} == set(controllers.SETTINGS)


@pytest.mark.parametrize(
    ("fields", "goal"),
    [
        ({"task": "swing", "e_max": 2.1e-3}, "swing, largest error"),
        ({"task": "lshape", "e_max": 0.81e-3}, "L-shape, largest error"),
        ({"task": "step", "width": 0.05, "overshoot": 0.06}, "step of 50 mm, overshoot"),
        ({"task": "step", "width": 0.05, "settling_time": None}, "step of 50 mm, settling time"),
        ({"task": "step", "width": 0.2, "failure": "diverged"}, "step of 200 mm, overshoot"),
        ({"task": "step", "width": 0.1, "steady_state_error": 1e-4}, "all steps, steady-state"),
    ],
)
def test_bad_rows_miss_their_goal(fields, goal):
    rows = [make_row(), make_row(**fields)] if fields["task"] != "swing" else [make_row(**fields)]
    goals = controllers_goals.rows(rows)
    missed = [row.goal for row in goals if not row.met]
    assert any(name.startswith(goal) for name in missed)
    assert len({row.goal for row in goals}) > len(set(missed))


def test_the_best_policy_has_the_least_rms_error_on_mujoco():
    rows = [
        make_row(policy="lqi", e_rms=2e-3),
        make_row(policy="mpc", e_rms=1e-3),
        make_row(policy="qs_nn", failure="diverged"),
        make_row("thesis", policy="lq_adaptive", e_rms=1e-6),
    ]
    assert controllers_goals.best_policy(rows) == "mpc"
    assert controllers_goals.best_policy([]) is None
    assert controllers_goals.rows([]) == []


@pytest.mark.parametrize(("e_max", "failure", "met"), [(2, None, 1), (2.1, None, 0), (1, "x", 0)])
def test_goals_on_another_modulus(e_max, failure, met):
    changes = {"failure": failure} if failure else {"e_max": e_max * GOOD["e_max"]}
    rows = [make_row(), make_row("robustness", variation={E: 1.5}, **changes)]
    rows.append(make_row("robustness", variation={"density": 1.5}, e_max=1.0))  # does not count
    goals = controllers_goals.rows(with_ratios(rows))
    growth = [row for row in goals if row.metric == "e_max_ratio"]
    assert [row.met for row in growth] == [bool(met)]
    failed = [row for row in goals if row.metric == "failures"]
    assert [row.value for row in failed] == [int(failure is not None)]


def test_policy_times_are_goals_of_the_thesis_controllers():
    step = {"task": "step", "width": 0.05}
    rows = [make_row(policy=name, policy_time_median=6e-6, **step) for name in CONTROLLERS]
    met = {row.policy: row.met for row in controllers_goals.rows(rows)}
    assert met == {"qs_nn": False, "lqi": True, "mpc": True}


def test_tables_show_the_thesis_and_every_policy(full):
    text = shown(full)
    assert "…" not in text
    for part in ("Tab. 6.2", "Tab. 6.4", "Tab. 6.5", "47.5", "27.3", "49700", "Goals", *policies()):
        assert part in text
    assert "NO" not in text


def test_tables_bear_failures_and_gaps(full):
    assert shown([]) == ""
    for rows in (
        full[:1],
        select(episodes(full), setting="output"),
        select(episodes(full), setting="robustness"),
    ):
        shown(rows)
    broken = [replace(row, **dict.fromkeys(GOOD), failure="diverged") for row in episodes(full)]
    broken = with_ratios(broken)
    text = shown(broken + controllers_goals.rows(broken))
    assert "failed" in text
    assert "diverged" in text
    never = [replace(row, settling_time=None, overshoot=None) for row in episodes(full)]
    text = shown(never + controllers_goals.rows(never))
    assert "never" in text
    assert "NO" in text


def test_numbers_have_the_digits_people_need():
    assert number(0.12345, "settling_time") == "0.12"
    assert number(0.47461, "overshoot") == "47.5"
    assert number(0.5, "e_max") == "500"
    assert number(3e-5, "steady_state_error") == "<0.01"
    assert number(None, "e_max") == "-"
    assert span((0.24, 0.24), "rise_time") == "240"
    assert with_unit(5e-3, "policy_time_median") == "5000 µs"


@pytest.mark.slow
def test_figures_are_drawn_of_what_there_is(full, tmp_path):
    plot(full, tmp_path / "controllers.png")
    names = {path.stem for path in tmp_path.iterdir()}
    assert {f"fig_6_{number}" for number in range(14, 23)} <= names
    assert {"error_against_time", "robustness_lq_adaptive"} <= names
    empty = tmp_path / "empty"
    empty.mkdir()
    plot([], empty / "controllers.png")
    assert list(empty.iterdir()) == []


def test_figures_bear_failures(tmp_path):
    rows = [
        make_row("thesis", "mpc", trace=make_trace()),
        make_row("thesis", "lqi", trace=make_trace("diverged"), failure="diverged"),
    ]
    plot(rows, tmp_path / "controllers.png")
    assert (tmp_path / "fig_6_15.png").exists()


def test_audit_and_thesis_name_the_same_quantities():
    known = {(f.task, f.step_width, f.controller) for f in FIGURES}
    assert set(AUDIT) <= known
    assert set(CONTROLLERS.values()) == {controller for *_, controller in known}
    assert all(low <= high for values in AUDIT.values() for low, high in values.values())


@pytest.mark.slow
@pytest.mark.timeout(600)  # kernels may have to be compiled first
def test_command_measures_and_writes(monkeypatch, tmp_path):
    monkeypatch.setattr(controllers, "policies", lambda: ["qs_nn"])
    assert main(["benchmark", "controllers", "--quick", "--out", str(tmp_path)]) == 0
    out = tmp_path / "controllers"
    rows = json.loads((out / "report.json").read_text())["rows"]
    assert all("trace" not in row for row in rows)
    settings = [row["setting"] for row in rows if "task" in row]
    assert settings == ["thesis"] * 2 + ["mujoco"] * 2 + ["robustness"]
    step, swing = rows[:2]
    assert step["rise_time"] == pytest.approx(0.24, abs=0.01)  # the audit's
    assert step["decision_period"] == pytest.approx(0.2)
    assert 0.014 <= swing["e_max"] <= 0.018  # the audit's
    assert swing["e_motion_least"] < swing["e_motion"] <= swing["e_max"]
    assert 14 < swing["tension_max"] < 20  # holding the end takes 14 N, the network knows 20 N
    assert "Tab. 6.2" in (out / "report.md").read_text()
    assert (out / "fig_6_14.png").exists()


def test_label_of_a_case():
    case = make_case("pcc", "lqi", "step", 0.05, {E: 0.5})
    assert controllers.job_label("robustness", case) == (
        "robustness, pcc, step 50 mm, lqi, E x 0.5"
    )
