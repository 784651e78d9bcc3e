"""What large studies cost: arithmetic of the rows, and what is reckoned from what is measured."""

import pytest

from softrobot_env.benchmarks.scale import jobs
from softrobot_env.benchmarks.scale.rows import CORES, PRICE, Row, cost_of
from softrobot_env.benchmarks.scale.tables import tables
from softrobot_env.core.processes import Workers


def test_costs_are_those_of_a_million_robot_seconds():
    row = Row("robots", "arm", "batch", **cost_of(100.0))
    assert row.core_hours == pytest.approx(1e6 / 100 / 3600)
    assert row.cost == pytest.approx(row.core_hours * PRICE)


def test_the_driver_bounds_the_shortest_job(monkeypatch):
    monkeypatch.setattr(jobs, "_timed", lambda count: (1.0 + 0.002 * count, 500.0))
    monkeypatch.setattr(jobs, "_memory", lambda count: 3000 * count)
    job, sweep = jobs.run({"processes": Workers(2)}, quick=True)
    assert job.seconds == pytest.approx(0.002) and job.memory == 3000 and job.kept == 500
    assert sweep.shortest_job == pytest.approx(0.002 * CORES) and sweep.cost == CORES * PRICE
    assert len(tables([job, sweep]).renderables) == 3
