"""What large studies cost: arithmetic of the rows, and what is reckoned from what is measured."""

import pytest

from softrobot_env.core.processes import Workers
from studies import scale
from studies.scale import CORES, PRICE, Row, cost_of, job_rows


def test_costs_are_those_of_a_million_robot_seconds():
    row = Row("robots", "arm", "batch", **cost_of(100.0))
    assert row.core_hours == pytest.approx(1e6 / 100 / 3600)
    assert row.cost == pytest.approx(row.core_hours * PRICE)


def test_the_driver_bounds_the_shortest_job(monkeypatch):
    monkeypatch.setattr(scale, "_timed", lambda count: (1.0 + 0.002 * count, 500.0))
    monkeypatch.setattr(scale, "_memory", lambda count: 3000 * count)
    job, sweep = job_rows({"processes": Workers(2)}, quick=True)
    assert job.seconds == pytest.approx(0.002) and job.memory == 3000 and job.kept == 500
    assert sweep.shortest_job == pytest.approx(0.002 * CORES) and sweep.cost == CORES * PRICE
    assert len(scale.STUDY.show([job, sweep]).renderables) == 3
