"""The studies of the rig's quasi-static networks: cells, rows, tables and figures."""

import json
import os
from dataclasses import replace
from io import StringIO

import numpy as np
import pytest
from rich.console import Console

from softrobot_env.benchmarks.records import select
from softrobot_env.benchmarks.rig_networks import friction as rig_networks_friction
from softrobot_env.benchmarks.rig_networks import run as rig_networks
from softrobot_env.benchmarks.rig_networks.cases import (
    LAYERS,
    NEURONS,
    SAMPLES,
    TRAININGS,
    Case,
    CellRow,
    cases,
    run_case,
    train,
)
from softrobot_env.benchmarks.rig_networks.friction import FrictionRow
from softrobot_env.benchmarks.rig_networks.plots import plot
from softrobot_env.benchmarks.rig_networks.run import InferenceRow
from softrobot_env.benchmarks.rig_networks.tables import tables
from softrobot_env.identification.networks import direction_of
from softrobot_env.identification.slow_rig import RigStatics
from softrobot_env.identification.visits import collect, disk_points, split
from softrobot_env.robots import RIG

pytestmark = pytest.mark.slow  # its quick run is one of `make slow`


@pytest.fixture(scope="module")
def data():
    points = disk_points(100)
    return collect(RIG, RigStatics(), np.random.default_rng(0), points)


@pytest.fixture(scope="module")
def parts():
    return split(100, np.random.default_rng(0))


def make_row(case):
    """A made-up cell, whose error in mm is its number of layers (and samples)."""
    error = 1e-3 * (case.layers + (case.samples or 0))
    return CellRow(
        study=case.study,
        direction=case.direction,
        layers=case.layers,
        neurons=case.neurons,
        samples=case.samples or 648,
        trainings=case.trainings,
        e_rms=error,
        e_rms_least=error / 2,
        e_rms_largest=2 * error,
        e_max=5 * error,
        e_rms_validation=error,
        iterations=20,
        training_time=0.25,
    )


def made_up_friction():
    case = Case("friction", "forward", 2, 10, 150, 3)
    return [
        FrictionRow(**vars(make_row(replace(case, direction=d))), friction=f, total=total)
        for total in (26.0, None)
        for f in (0.0, 0.05)
        for d in ("forward", "inverse")
    ]


def made_up(quick):
    times = [
        InferenceRow(d, v, 1.5e-6)
        for d in ("forward", "inverse")
        for v in ("compiled", "plain", "batch")
    ]
    return [make_row(case) for case in cases(quick)] + made_up_friction() + times


def shown(rows):
    page = Console(width=110, file=StringIO())
    page.print(tables(rows))
    return [" ".join(line.split()) for line in page.file.getvalue().splitlines()]


def test_a_full_run_is_that_of_the_thesis():
    every = list(cases())
    assert len(set(every)) == len(every)
    assert NEURONS[0] == 1 and NEURONS[-1] == 50 and LAYERS == (1, 2, 3, 4, 5)
    assert SAMPLES[-1] == 646 and {80, 55, 150} < set(SAMPLES)
    for direction in ("forward", "inverse"):
        mine = [case for case in every if case.direction == direction]
        sizes = {(c.layers, c.neurons) for c in mine if c.study == "size"}
        assert sizes == {(a, b) for a in LAYERS for b in NEURONS}
        assert [c.samples for c in mine if c.study == "samples"] == list(SAMPLES)
        assert {c.trainings for c in mine} == {TRAININGS} == {10}
    quick = {(c.study, c.direction, c.layers, c.neurons, c.samples) for c in cases(quick=True)}
    assert quick < {(c.study, c.direction, c.layers, c.neurons, c.samples) for c in every}


def test_a_cell_is_the_median_of_its_trainings(data, parts):
    case = Case("samples", "forward", 1, 4, samples=30, trainings=3)
    row = run_case(case, data, parts)
    test = direction_of(data, "forward").take(parts.test)
    errors, worst = [], []
    for seed in range(3):
        network = train(case, data, parts, seed).network
        assert network.sizes == (3, 4, 2)
        off = np.linalg.norm(network(test.inputs) - test.outputs, axis=1)
        errors.append(np.sqrt(np.mean(off**2)))
        worst.append(off.max())
    assert len(set(errors)) == 3
    expected = [np.median(errors), min(errors), max(errors), np.median(worst)]
    told = [getattr(row, name) for name in ("e_rms", "e_rms_least", "e_rms_largest", "e_max")]
    np.testing.assert_allclose(told, expected)
    assert row.samples == 30 and row.training_time > 0


def test_more_samples_than_there_are_is_an_error(data, parts):
    case = Case("samples", "inverse", 1, 2, samples=71, trainings=1)
    with pytest.raises(ValueError, match="71 samples are wanted of a set of 70"):
        run_case(case, data, parts)


def test_processes_find_what_one_finds(data, parts):
    wanted = [
        Case("size", "inverse", 1, 2, None, 2),
        Case("samples", "forward", 2, 3, 20, 2),
    ]
    told, threads = [], os.environ.get("OPENBLAS_NUM_THREADS")
    rows = rig_networks.run_cases(wanted, data, parts, lambda *args: told.append(args), 1)
    assert [count for _, *count in told] == [[0, 2], [1, 2], [2, 2]]
    assert {label for label, *_ in told[1:]} == {case.label for case in wanted}
    assert os.environ.get("OPENBLAS_NUM_THREADS") == threads
    for case, row in zip(wanted, rows, strict=True):
        row, here = row.row(), run_case(case, data, parts).row()
        same = [name for name in here if name != "training_time"]
        assert [row[name] for name in same if name[:2] != "e_"] == [
            here[name] for name in same if name[:2] != "e_"
        ]
        errors = [name for name in same if name[:2] == "e_"]
        np.testing.assert_allclose([row[n] for n in errors], [here[n] for n in errors], rtol=1e-6)


def test_errors_in_processes_are_raised(data, parts):
    with pytest.raises(ValueError, match="unknown direction"):
        rig_networks.run_cases([Case("size", "up", 1, 1, None, 1)], data, parts, print, 1)


def test_a_run_trains_and_times(monkeypatch):
    rig = RigStatics(friction=0, noise=0)
    visited = collect(RIG, rig, np.random.default_rng(0), disk_points(215), 26.0)
    small = [Case("size", "forward", 1, 3, None, 1), Case("samples", "inverse", 1, 3, 20, 1)]
    monkeypatch.setattr(rig_networks, "cases", lambda quick: small)
    rows = rig_networks.run(visited, quick=True, processes=1)
    assert [row.study for row in rows] == ["size", "samples"] + 6 * ["inference"]
    assert rows[0].samples == 151
    times = {(row.direction, row.variant): row.time for row in rows[2:]}
    assert len(times) == 6 and all(0 < time < 1e-3 for time in times.values())
    json.dumps([row.row() for row in rows], allow_nan=False)


def test_friction_sets_the_errors(monkeypatch):
    """0.3 N err by several times what 0.05 N do, and without any there is the camera's noise."""
    monkeypatch.setattr(rig_networks_friction, "FRICTIONS", (0.0, 0.3))
    rows = rig_networks_friction.friction_rows(disk_points(215), 1, lambda *args: None, 1)
    assert [row.friction for row in rows] == 2 * [0.0, 0.0, 0.3, 0.3]
    assert [row.total for row in rows] == 4 * [26] + 4 * [None]
    assert {(row.study, row.samples) for row in rows} == {("friction", 150)}
    for direction in ("forward", "inverse"):
        free, rubbing = (row.e_rms for row in select(rows, direction=direction, total=26))
        assert rubbing > 2.5 * free
    json.dumps([row.row() for row in rows], allow_nan=False)


@pytest.mark.parametrize("quick", [True, False])
def test_tables_show_every_cell(quick):
    lines = shown(made_up(quick))
    layers = (1, 2) if quick else LAYERS
    assert sum(line == " ".join(["10", *(f"{n}.000" for n in layers)]) for line in lines) == 2
    assert "150 152.000 (76.000 to 304.000) 152.000 (76.000 to 304.000)" in lines
    assert "forward, s -> z 152.000 0.77 760.00 20 0.25" in lines
    assert "inverse, z -> s 152.000 0.11 760.00 20 0.25" in lines
    assert "0.05 26 N 152.000 (76.000 to 304.000) 152.000 (76.000 to 304.000)" in lines
    assert any(line.startswith("0 least 152.000") for line in lines)
    assert "thesis 0.77 0.11" in lines
    assert "forward compiled 1.50 2.0" in lines and "inverse batch 1.50 -" in lines
    assert all("\u2026" not in line for line in lines)


@pytest.mark.parametrize("quick", [True, False])
def test_figures_are_drawn(tmp_path, quick):
    plot(made_up(quick), tmp_path / "rig_networks.png")
    assert (tmp_path / "rig_networks.png").stat().st_size > 20_000


def test_a_figure_of_one_direction(tmp_path):
    plot(select(made_up(True), direction="inverse"), tmp_path / "one.png")
    assert (tmp_path / "one.png").exists()
