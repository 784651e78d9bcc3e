"""The accuracy benchmark's rows, table and figure; its physics is tested with the scene."""

import json
from io import StringIO

import numpy as np
import pytest
from rich.console import Console

from softrobot_env.benchmarks import accuracy, accuracy_tables
from softrobot_env.benchmarks.accuracy_plots import plot
from softrobot_env.benchmarks.static_cases import static_cases, tip_moment
from softrobot_env.benchmarks.tension_step import converged_reference
from softrobot_env.robots import ARM, CANTILEVER_WEAK
from softrobot_env.scene.quadrature import RULES

KEYS = [
    "case",
    "model",
    "n",
    "timestep",
    "integrator",
    "e_mean",
    "e_max",
    "wall_time",
    "step_time",
    "reference",
]
CASES = {case.name for case in static_cases()} | {"tension_step"}


@pytest.fixture(scope="module")
def calls():
    return []


@pytest.fixture(scope="module")
def rows(calls):
    return accuracy.run(quick=True, progress=lambda *call: calls.append(call))


def test_rows_are_flat_finite_and_complete(rows):
    json.dumps(rows, allow_nan=False)
    assert all(list(row) == KEYS for row in rows)
    for row in rows:
        assert 0 <= row["e_mean"] <= row["e_max"] < 0.01
        assert min(row["wall_time"], row["step_time"], row["timestep"]) > 0
    models = {f"mujoco_chain/{rule}" for rule in RULES}
    assert {(r["case"], r["model"]) for r in rows} == {(c, m) for c in CASES for m in models}


def test_dynamic_rows_cover_integrators_and_timesteps(rows):
    found = {(r["integrator"], round(1e3 * r["timestep"])) for r in rows if r["case"] not in STATIC}
    assert found == {(i, h) for i in ("implicitfast", "discrete") for h in (1, 2, 5, 10)}


STATIC = CASES - {"tension_step"}


def test_progress_counts_up_to_its_total(rows, calls):
    assert rows
    done, totals = [c[1] for c in calls], {c[2] for c in calls}
    assert done == list(range(len(calls)))
    assert totals == {done[-1]}


def test_more_hinges_are_more_accurate_in_every_static_case(rows):
    for case in STATIC:
        for rule in RULES:
            coarse, fine = (
                r["e_max"] for r in rows if (r["case"], r["model"].split("/")[1]) == (case, rule)
            )
            assert fine < coarse / 2, (case, rule)


def test_coarse_reference_is_within_its_own_uncertainty_of_a_finer_one():
    coarse = converged_reference(quick=True)
    fine = converged_reference(quick=False)
    distance = np.max(np.linalg.norm(coarse.tips - fine.tips, axis=1))
    assert distance < coarse.uncertainty < 1e-5
    assert fine.uncertainty < coarse.uncertainty


def test_chains_end_pieces_where_tendons_end():
    assert accuracy.hinge_numbers(CANTILEVER_WEAK, "gauss3") == (6, 12, 24, 48)
    assert accuracy.hinge_numbers(ARM, "gauss3", quick=True) == (9, 18)
    assert accuracy.hinge_numbers(ARM, "balanced2", quick=True) == (6, 12)


def test_table_and_figure_show_the_rows(rows, tmp_path):
    out = StringIO()
    Console(file=out, width=80).print(accuracy_tables.tables(rows))
    text = out.getvalue()
    for name in ("balanced2", "gauss3", "implicitfast", "h = 10 ms", "moment"):
        assert name in text
    (moment,) = (
        r["e_max"]
        for r in rows
        if (r["case"], r["model"], r["n"]) == ("tip_moment_1Nm", "mujoco_chain/midpoint", 12)
    )
    assert f"{1e3 * moment:.2g}" in text
    plot(rows, tmp_path / "accuracy.png")
    assert (tmp_path / "accuracy.png").read_bytes().startswith(b"\x89PNG")


def test_error_is_the_distance_to_the_truth():
    row = accuracy.static_row(tip_moment(1e-9), "midpoint", 6)
    # An unloaded rod is straight in every model: 1e-9 Nm deflects it by 5e-10 m.
    assert row["e_max"] < 1e-11
