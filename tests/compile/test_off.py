"""With Numba off everything runs as plain Python, and gives the same to rounding."""

import json
import os
import sys
from types import FunctionType

import gymnasium
import numpy as np
import pytest
from support.processes import finished

from softrobot_env.beams.registry import BeamPlant
from softrobot_env.compile import OFF
from softrobot_env.control.scheduled.aiming import remembered
from softrobot_env.evaluation.runner import Case, run
from softrobot_env.robots import find_robot
from softrobot_env.tasks import make_task


def figures():
    """Of a step of one and of two robots, of decisions, and of statics."""
    action, found = np.array([0.1, 0.2, -0.1], np.float32), {}
    for name in ("ArmSwing", "RigTriangle"):
        env = gymnasium.make(f"SoftRobot/{name}-v0")
        env.reset(seed=0)
        found[name] = env.step(action)[0]["tip_position"].tolist()
    env = gymnasium.make_vec("SoftRobot/ArmSwing-v0", num_envs=2, threads=2)
    env.reset(seed=0)
    found["vector"] = env.step(np.stack([action, -action]))[0]["tip_position"].tolist()
    env.close()
    for policy in ("lqi", "qs_nn"):
        rollout = run(Case(make_task("swing"), policy, duration=0.03)).rollout
        found[policy] = rollout.action.tolist()
    robot = find_robot("planar_finger")
    tension = np.linspace(1.0, 0.0, len(robot.tendons))
    for model in ("pcc", "cosserat"):
        beam = BeamPlant(model)(robot).model
        found[model] = beam.tip(beam.equilibrium(tension)).tolist()
    return found


@pytest.mark.skipif(OFF, reason="compares with compiled code")
def test_plain_python_gives_the_same():
    own = {"NUMBA_DISABLE_JIT": "1", "PYTHONPATH": os.pathsep.join(sys.path)}
    plain = json.loads(finished(__file__, env=os.environ | own, check=True).stdout)
    compiled = figures()
    assert plain.keys() == compiled.keys()
    for name, values in compiled.items():
        assert np.allclose(plain[name], values, rtol=1e-9, atol=1e-9), name


if __name__ == "__main__":
    assert OFF and isinstance(remembered, FunctionType)
    json.dump(figures(), sys.stdout)
