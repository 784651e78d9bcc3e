"""Long episodes tell how far they are."""

import pytest

from softrobot_env.evaluation import run
from softrobot_env.evaluation.runner import Case
from softrobot_env.evaluation.runner import run as run_case
from softrobot_env.tasks import make_task


def test_an_episode_tells_its_time(monkeypatch):
    monkeypatch.setattr(run, "_TOLD_EVERY", 0.0)
    told = []
    case = Case(make_task("lshape"), "hold", duration=0.4, scene={"control_period": 0.1})
    run_case(case, progress=told.append)
    assert told == pytest.approx([0.0, 0.1, 0.2, 0.3, 0.4])
