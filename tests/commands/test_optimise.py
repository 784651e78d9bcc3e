"""`softrobot optimise`: its actions are those of the environment, and lead along the path."""

import json

import numpy as np
import pytest
from support.commands import called

from softrobot_env.core.artifacts import read_arrays
from softrobot_env.envs.tracking import TrackingEnv
from softrobot_env.robots import find_robot
from softrobot_env.tasks import make_task

TASK = "--robot planar_finger --task reach --option hold=0.2 --no-plots"


@pytest.mark.filterwarnings("ignore::softrobot_env.scene.timestep.TimestepWarning")
def test_actions_lead_along_the_path(tmp_path, capsys):
    assert called("optimise", TASK, "--steps 4 --out", tmp_path / "out") == 0
    assert "largest error" in capsys.readouterr().out
    (row,) = json.loads((tmp_path / "out" / "report.json").read_text())["rows"]
    actions = read_arrays(tmp_path / "out" / "actions.npz")["action"]
    env = TrackingEnv(make_task("reach", robot=find_robot("planar_finger"), hold=0.2))

    def errors(actions):
        found = [env.reset(seed=0)[1]["error"]]
        return np.array(found + [env.step(action)[4]["error"] for action in actions])

    found, still = errors(actions), errors(np.zeros_like(actions))
    assert found.mean() < 0.6 * still.mean() and row["steps"] <= 4
    assert row["e_max"] == pytest.approx(found.max()) and row["e_final"] == pytest.approx(found[-1])


def test_what_has_no_derivatives_is_refused(tmp_path, capsys):
    assert called("optimise --robot silicone_rod --option speed=0.1 --out", tmp_path / "out") == 2
    said = capsys.readouterr().err
    assert "servos wind its tendons" in said and said.count("\n") == 1
    assert not (tmp_path / "out" / "report.json").exists()
