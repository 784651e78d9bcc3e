"""Episodes of a real robot over motors in memory, in real time; see `test_motor_matrix`."""

from contextlib import closing
from copy import copy
from dataclasses import replace
from time import monotonic, sleep

import numpy as np
import pytest
from support.hardware_boards import LiveBoard
from support.motor_bench import Motors
from support.real_episodes import PATIENT, PERIOD, Still, fail, pull

from softrobot_env.commands.robot.virtual import motors_of
from softrobot_env.envs.real import RealRigEnv
from softrobot_env.hardware.errors import LinkError, RobotFaultError
from softrobot_env.hardware.motors import MotorBus
from softrobot_env.robots import RIG

pytest.importorskip("serial", reason="needs the robot extra")

pytestmark = [
    pytest.mark.timeout(60),
    pytest.mark.realtime(late=0.4),
    pytest.mark.usefixtures("patience"),
]


@pytest.fixture(params=["dynamixel", "feetech"])
def live(request, monkeypatch):
    """Motors of the rig behind a line in memory; other programs may load the machine."""
    pytest.importorskip("dynamixel_sdk")
    pytest.importorskip("scservo_sdk")
    patient = {"control_period": PERIOD, "watchdog": 0.9, "patience": 2.0, "latency": 0.03}
    file = replace(motors_of(request.param, RIG, "/dev/motors"), **patient, ramp=0.1)
    motors, send = Motors(file, look=0.01), MotorBus.write

    def write(bus, angles):
        motors.witness.spoke = monotonic()
        send(bus, angles)

    monkeypatch.setattr(MotorBus, "write", write)
    with LiveBoard(motors) as live:
        live.file = file
        yield live
    assert motors.witness.unsafe == []


@pytest.fixture
def make(live):
    """An environment away from rest, and whether its line can be opened."""
    made = []

    def line():
        if live.unplugged:
            raise LinkError("/dev/motors has gone")
        return copy(live.transport)

    def begin(**options):
        env = RealRigEnv(robot_file=live.file, line=line, tip=Still(), **PATIENT | options)
        made.append(env)
        live.unplugged = False
        env.reset()
        while live.board.device.applied[0] < 1e-3:
            assert pull(env)[4]["device_state"] == "running"
        return env

    yield begin
    for env in made:
        env.close()


def comes_to_rest(motors):
    end = monotonic() + 5
    while motors.device.powered:
        assert monotonic() < end
        sleep(PERIOD)
    np.testing.assert_allclose(motors.device.applied, 0.0, atol=2e-4)


def test_a_lost_line_ends_the_episode_and_can_be_plugged_again(live, make):
    env, motors = make(), live.board
    env._session.driver._transport.closed, live.unplugged = 1, True
    assert "closed" in fail(env)
    with pytest.raises(LinkError, match="gone"):
        env.reset(options={"clear_fault": True})
    sleep(0.9 + 2 * PERIOD)  # the watchdog
    held = motors.device.applied.copy()
    sleep(0.1)
    np.testing.assert_array_equal(motors.device.applied, held)
    assert motors.device.powered and held[0] > 5e-4
    live.unplugged = False
    env.reset(options={"clear_fault": True})
    assert not motors.device.powered or np.abs(motors.device.applied).max() < 2e-4
    assert pull(env)[4]["device_state"] == "running"


def test_a_slow_host_counts_what_it_misses_and_is_stopped(live, make):
    env = make(max_missed=40)
    *_, info = pull(env)
    missed = info["missed_steps"]
    sleep(10 * PERIOD)
    *_, info = pull(env)
    assert info["missed_steps"] >= missed + 9 and info["device_state"] == "running"
    sleep(60 * PERIOD)
    assert "missed" in fail(env)
    comes_to_rest(live.board)


@pytest.mark.parametrize("error", [ValueError, KeyboardInterrupt])
def test_an_exception_in_a_step_cuts_the_torque(live, make, monkeypatch, error):
    env = make()

    def broken(*_):
        raise error("mine")

    with monkeypatch.context() as patch:
        patch.setattr(env._session, "sight", broken)
        with pytest.raises(error, match="mine"):
            pull(env)
    assert not live.board.device.powered
    with pytest.raises(RobotFaultError, match="emergency stop"):
        env.reset()


def test_closing_ramps_to_rest(live, make):
    with closing(make()):
        pass
    comes_to_rest(live.board)
