"""The generalization benchmark: its cases, rows, tables and figures; a small run."""

import json
from io import StringIO

import numpy as np
import pytest
from rich.console import Console

from softrobot_env.benchmarks.generalization import run as generalization
from softrobot_env.benchmarks.generalization import tables as generalization_tables
from softrobot_env.benchmarks.generalization.plots import plot
from softrobot_env.benchmarks.generalization.run import (
    DISTURBANCES,
    NOMINAL,
    PARAMETERS,
    PARTS,
    SEEDS,
    SPEEDS,
    TASKS,
    Row,
    cases,
    disturbed,
    policies,
    run_case,
    unseen,
    variation_name,
)
from softrobot_env.benchmarks.records import select
from softrobot_env.cli import main
from softrobot_env.control.registry import POLICIES, policy_environment
from softrobot_env.envs.tracking import TrackingEnv
from softrobot_env.evaluation.runner import Case
from softrobot_env.tasks import UNSEEN_TASKS, make_task

pytestmark = pytest.mark.slow  # its quick run is one of `make slow`

METRICS = (
    "e_max", "e_rms", "e_mean", "e_final", "rise_time", "settling_time", "overshoot",
    "steady_state_error", "tension_max",
)  # fmt: skip


def part_of(case):
    return "unseen" if case.task.option("speed") else "disturbed"


def make_row(case, failure=None):
    """A made-up episode, 10 mm off for the first seed, 11 mm for the second and so on."""
    task = case.task
    value = None if failure else 0.01 + 0.001 * (task.option("seed") or 0)
    return Row(
        part=part_of(case),
        task=task.name,
        policy=case.policy,
        robot="arm",
        plant="mujoco",
        source="sim",
        speed=task.option("speed"),
        path_seed=task.option("seed"),
        step_width=task.step_width,
        variation=case.variation,
        policy_time_median=1e-6,
        policy_time_p99=1e-6,
        realtime_factor=1.0,
        decision_period=0.01,
        remarks={},
        failure=failure,
        **dict.fromkeys(METRICS, value),
    )


def fake_run(wanted, progress=None):
    if progress is not None:
        progress("done", len(wanted), len(wanted))
    return [make_row(case) for case in wanted]


def shown(rows):
    page = Console(width=110, file=StringIO())
    page.print(generalization_tables.tables(rows))
    return page.file.getvalue()


def table(text, title):
    """Lines of the table of a title, with words parted by single spaces."""
    lines = [" ".join(line.split()) for line in text.splitlines()]
    start = next(i for i, line in enumerate(lines) if line.startswith(title))
    end = next((i for i in range(start + 5, len(lines)) if not lines[i]), len(lines))
    return lines[start:end]


def test_a_full_run_covers_every_case():
    every = list(cases())
    assert len(set(map(str, every))) == len(every)
    assert {part_of(case) for case in every} == set(PARTS)
    assert set(policies()) == set(POLICIES) - {"hold"}
    assert set(SPEEDS) == set(UNSEEN_TASKS)
    runs = sum(len(speeds) * (len(SEEDS) if t == "random" else 1) for t, speeds in SPEEDS.items())
    runs += len(TASKS) * len((NOMINAL, *PARAMETERS, *DISTURBANCES))
    for policy in policies():
        assert sum(case.policy == policy for case in every) == runs


def test_a_quick_run_is_a_part_of_the_full_one():
    quick = list(cases(quick=True))
    assert len(quick) < len(list(cases())) / 5
    assert set(map(str, quick)) <= set(map(str, cases()))
    assert {part_of(case) for case in quick} == set(PARTS)


@pytest.mark.parametrize("policy", ["lqi", "mpc_preview", "imitation"])  # 1, 5 and 10 ms
def test_environments_accept_every_variation(policy):
    env = TrackingEnv("step", **policy_environment(policy))
    for variation in (*PARAMETERS, *DISTURBANCES):
        env.reset(seed=0, options={"vary": variation})
        assert variation_name(variation) != "nominal"


def test_policies_left_out_are_those_not_installed(monkeypatch):
    path = "softrobot_env.benchmarks.generalization.run.installed_policies"
    monkeypatch.setattr(path, lambda: ["hold", "imitation", "lqi"])
    assert policies() == ["lqi", "imitation"]
    assert {case.policy for case in cases()} == {"lqi", "imitation"}


SMALL = [
    unseen("imitation", "circle", 0.4),
    unseen("feedforward", "random", 0.4, 3),
    disturbed("imitation", "step", 0.05, {"delay": 0.02}),
    disturbed("imitation", "step", 0.05, NOMINAL),
]


def test_a_small_run_in_processes_is_that_in_this_one():
    told = []
    rows = generalization.run_cases(SMALL, lambda *args: told.append(args), processes=2)
    assert [count for _, *count in told] == [[i, len(SMALL)] for i in range(len(SMALL) + 1)]
    assert sorted(label for label, *_ in told[1:]) == sorted(case.label for case in SMALL)
    for case, row in zip(SMALL, rows, strict=True):
        task = case.task
        told = (row.task, row.speed, row.path_seed, row.step_width)
        assert told == (task.name, task.option("speed"), task.option("seed"), task.step_width)
        assert (row.part, row.policy, row.variation) == (part_of(case), case.policy, case.variation)
        assert row.failure is None
        assert row.policy_time_median > 0
    here = run_case(SMALL[0])
    assert [getattr(here, name) for name in METRICS] == [getattr(rows[0], name) for name in METRICS]
    # A delay of a fifth of the rise time matters.
    assert rows[2].overshoot > 2 * rows[3].overshoot
    json.dumps([row.row() for row in rows], allow_nan=False)


def test_an_error_in_a_process_is_raised():
    with pytest.raises(ValueError, match="unknown policy"):
        generalization.run_cases([Case(make_task("swing"), "pid")], processes=1)


def test_tables_have_a_line_per_policy_and_fit_a_report():
    text = shown(fake_run(list(cases())))
    assert all(len(line) <= 110 for line in text.splitlines())
    assert "\u2026" not in text
    circle = table(text, "Unseen references: largest error")
    assert circle[-len(policies()) :] == [f"{p}{' 10.0' * 8}" for p in policies()]
    seeds = table(text, "Random paths: median / worst")
    assert seeds[-1] == f"{policies()[-1]}{' 12.0 / 14.0' * 6}"
    disturbed = table(text, "L-shape on disturbed drives and sensors: largest error")
    assert disturbed[-1] == f"{policies()[-1]}{' 10.0' * 9}"
    for name in ("overshoot in %", "settling time in s"):
        assert table(text, f"Step of 50 mm on a robot of other parameters: {name}")
    assert "\nFailed" not in text


def test_failed_runs_are_named():
    wanted = [case for case in cases() if case.policy in ("lqi", "mpc")]
    rows = fake_run(wanted)
    lost = [
        ("circle", 0.4, None, NOMINAL),
        ("random", 0.2, 1, NOMINAL),
        ("swing", None, None, {"delay": 0.02}),
    ]
    for i, case in enumerate(wanted):
        task = case.task
        told = (task.name, task.option("speed"), task.option("seed"), case.variation)
        if told in lost and case.policy == "mpc":
            rows[i] = make_row(case, failure="piece 3 folded")
    text = shown(rows)
    assert table(text, "Unseen references: largest error")[-1] == f"mpc{' 10.0' * 3} failed" + (
        " 10.0" * 4
    )
    assert "1 of 5 failed" in table(text, "Random paths")[-1]
    assert "failed" in table(text, "Swing on disturbed drives")[-1]
    failed = table(text, "Failed")
    assert [line for line in failed if line.startswith("mpc")] == [
        "mpc circle 0.4 m/s nominal piece 3 folded",
        "mpc random 1 0.2 m/s nominal piece 3 folded",
        "mpc swing delay 20 ms piece 3 folded",
    ]


@pytest.mark.parametrize("kind", ["full", "quick", "unseen", "disturbed", "failed"])
def test_figures_are_drawn_of_what_there_is(tmp_path, kind):
    rows = fake_run(list(cases(quick=kind == "quick")))
    if kind in PARTS:
        rows = select(rows, part=kind)
    if kind == "failed":
        rows = [make_row(case, failure="diverged") for case in cases()]
    plot(rows, tmp_path / "generalization.png")
    names = {"unseen": "generalization.png", "disturbed": "generalization_disturbed.png"}
    expected = {names[kind]} if kind in names else set(names.values())
    assert {path.name for path in tmp_path.iterdir()} == expected


def test_the_command_writes_report_and_figures(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(generalization, "run_cases", fake_run)
    assert main(["benchmark", "generalization", "--quick", "--out", str(tmp_path)]) == 0
    out = tmp_path / "generalization"
    rows = json.loads((out / "report.json").read_text())["rows"]
    assert len(rows) == len(list(cases(quick=True)))
    assert np.all([row["e_max"] is not None for row in rows])
    written = {path.name for path in out.iterdir()}
    expected = {
        ".written",
        "report.json",
        "report.md",
        "generalization.png",
        "generalization_disturbed.png",
    }
    assert written == expected
    assert "Unseen references" in capsys.readouterr().out
