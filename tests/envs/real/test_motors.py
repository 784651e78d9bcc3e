"""A real robot's environment over emulated motors, in real time."""

from contextlib import closing
from dataclasses import replace

import gymnasium
import numpy as np
import pytest
from support.patience import patient_drivers

from softrobot_env.commands.robot.virtual import virtual_process
from softrobot_env.control.registry import make_policy
from softrobot_env.envs.real import RealEnv
from softrobot_env.envs.tracking import TrackingEnv
from softrobot_env.evaluation.run import play
from softrobot_env.hardware.errors import RobotFaultError
from softrobot_env.robots import find_robot
from softrobot_env.tasks import make_task

pytest.importorskip("serial", reason="needs the robot extra")
pytest.importorskip("dynamixel_sdk", reason="needs the robot extra")
pytest.importorskip("scservo_sdk", reason="needs the robot extra")

pytestmark = pytest.mark.realtime(late=0.4)

TRUNK = find_robot("examples/motor_trunk.toml")
TASK = replace(make_task("reach", robot=TRUNK), duration=2.0)
PATIENT = {"max_missed": 10_000, "oldest": 2.0}


@pytest.fixture(params=["dynamixel", "feetech"])
def virtual(request):
    with virtual_process(None, kind=request.param, robot=TRUNK) as robot, patient_drivers():
        file = replace(robot.file, watchdog=1.0, patience=2.0, latency=0.03)
        yield robot._replace(file=file)


def test_a_policy_runs_over_motors_as_it_does_simulated(virtual):
    policy = make_policy("static", TRUNK, 0.02)
    with closing(TrackingEnv(TASK, control_period=0.02)) as env:
        simulated = np.mean([moment.info["error"] for moment in play(env, policy)])
    with closing(RealEnv(TASK, robot_file=virtual.file, tip=virtual.tip, **PATIENT)) as env:
        moments = list(play(env, policy))
        last = moments[-1].info
    assert "failure" not in last and last["device_state"] == "running"
    errors = [moment.info["error"] for moment in moments]
    missed = last["missed_steps"]
    if missed == 0:  # steps that a busy machine left out were not driven
        # A set point 68 mm away that motors hear of two periods later adds 1.4 mm in two seconds.
        assert abs(np.mean(errors) - simulated) < 2e-3


def test_an_observation_is_that_of_the_simulation_and_forces_are_estimated(virtual):
    options = {"observe": ("tip_position", "tendon_tension"), **PATIENT}
    make = "SoftRobot/Real-v0"
    given = {"task": TASK, "robot_file": virtual.file, "tip": virtual.tip}
    with closing(gymnasium.make(make, **given, **options)) as env:
        seen, info = env.reset()
        assert env.observation_space.contains(seen)
        seen, *_, info = env.step(np.zeros(6, np.float32))
        assert env.observation_space.contains(seen)
    np.testing.assert_allclose(info["tendon_tension"], 1.0, atol=0.3)  # pretension of the file


def test_a_fault_ends_the_episode_and_is_cleared_by_hand_only(virtual):
    with closing(RealEnv(TASK, robot_file=virtual.file, tip=virtual.tip, **PATIENT)) as env:
        env.reset()
        env.step(np.zeros(6, np.float32))
        env._session.driver.estop()
        *_, terminated, truncated, info = env.step(np.zeros(6, np.float32))
        assert truncated and not terminated and info["failure"] == "emergency stop"
        for again in (env.reset, lambda: env.step(np.zeros(6, np.float32))):
            with pytest.raises(RobotFaultError):
                again()
        env.reset(options={"clear_fault": True})
        *_, info = env.step(np.zeros(6, np.float32))
        assert info["device_state"] == "running"
