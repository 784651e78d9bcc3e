"""What goes wrong on a bus of motors, on emulators of both kinds and a clock of their own.

In every case both promises are witnessed: outputs stay within range and speed, and nothing moves
when a dead host or line has been so for longer than the watchdog and the step under way.
"""

from dataclasses import replace

import numpy as np
import pytest
from support.motor_bench import MotorBench, motor_file

from softrobot_env.hardware.errors import LinkError, RefusedError, RobotError, RobotFaultError
from softrobot_env.hardware.motors import MotorFault, MotorRobot
from softrobot_env.hardware.protocol.messages import Fault

pytest.importorskip("dynamixel_sdk", reason="needs the robot extra")
pytest.importorskip("scservo_sdk", reason="needs the robot extra")

KINDS = ("dynamixel", "feetech")


@pytest.fixture(params=KINDS)
def kind(request):
    return request.param


@pytest.fixture
def bench(kind):
    """Three motors that have moved, and still shall."""
    bench = MotorBench(motor_file(kind)).start()
    bench.go(0.01, 0.4)
    yield bench
    assert bench.witness.unsafe == []


def moving(bench):
    """In motion: the next steps would lead on."""
    bench.go(-0.01, 0.1)
    assert bench.now - bench.witness.moved < 0.01


def fails(bench, code, text, within=0.5):
    """Drive on until a fault of a kind stops the robot; how it is then ramped down."""
    begin = bench.now
    with pytest.raises(RobotFaultError, match=text):
        while bench.now < begin + within:
            bench.go(-0.005, bench.file.control_period)
    assert bench.robot.fault.code == code
    frozen = bench.device.applied.copy()
    bench.run(0.05)
    np.testing.assert_allclose(bench.device.applied, frozen, atol=1e-3)
    with pytest.raises(RobotFaultError):
        bench.robot.exchange(np.zeros(3), bench.now)
    with pytest.raises(RobotError):
        bench.robot.arm()


def assert_still(bench, since):
    """Nothing moves from `since` [s] after now on; the motors hold where they are."""
    end = bench.now + since
    bench.run(since + 1.0)
    assert bench.witness.moved <= end
    assert np.abs(bench.device.applied).max() > 1e-4  # not at rest: held on the way


def test_set_points_are_followed_and_a_stop_ramps_to_rest_and_relaxes(bench):
    np.testing.assert_allclose(bench.robot.reading.length, 0.01, atol=1e-4)
    np.testing.assert_allclose(bench.device.applied, 0.01, atol=1e-4)
    assert bench.robot.reading.force == pytest.approx([10.0] * 3, abs=0.3)  # springs: 1000 N/m
    begin = bench.now
    bench.robot.stop()
    assert bench.now - begin >= 0.01 / bench.file.ramp - 0.05
    np.testing.assert_allclose(bench.device.applied, 0.0, atol=1e-4)
    assert not bench.device.powered
    bench.robot.arm()
    bench.go(0.002, 0.2)


def test_motors_hold_at_the_end_of_a_stop_where_the_file_says_so(kind):
    bench = MotorBench(motor_file(kind, at_stop="hold")).start()
    bench.go(0.005, 0.2)
    bench.robot.close()
    assert bench.device.powered and bench.closed == 1
    bench.run(2.0)
    np.testing.assert_allclose(bench.device.applied, 0.0, atol=1e-4)
    again = MotorRobot(bench.file, bench, type(bench.robot._bus), lambda: bench.now, bench.run)
    bench.closed = 0
    again.connect()
    again.arm()
    assert again.exchange(np.full(3, 1e-3), bench.now) is not None


@pytest.mark.parametrize("length", [0.021, -0.021, np.nan])
def test_what_lies_outside_the_range_is_refused_and_nothing_is_sent(bench, length):
    sent = bench.robot.link["sent"]
    with pytest.raises(ValueError, match=r"range|finite"):
        bench.robot.exchange(np.array([0.0, length, 0.0]), bench.now)
    assert bench.robot.link["sent"] == sent


def test_a_far_goal_is_approached_at_the_slew_rate(bench):
    begin = bench.now
    bench.go(-0.01, 0.2)
    assert bench.device.applied[0] == pytest.approx(0.01 - 0.05 * (bench.now - begin), abs=2e-3)


def test_a_dead_host_leaves_motors_that_hold(bench):
    """As after kill -9, with nothing more on the line."""
    moving(bench)
    assert_still(bench, bench.file.watchdog + bench.file.control_period)
    assert bench.device.powered


def test_a_host_that_slept_is_stopped_and_never_arms_by_itself(bench):
    moving(bench)
    held = bench.device.applied.copy()
    bench.run(0.3)
    fails(bench, Fault.WATCHDOG, r"no set-point for 0\.3")
    np.testing.assert_allclose(bench.device.applied, held, atol=1.5e-3)
    bench.robot.stop()
    assert bench.robot.reading is not None and not bench.device.powered
    bench.robot.clear()
    bench.robot.connect()
    bench.robot.arm()
    bench.go(0.0, 0.1)


def test_a_line_unplugged_in_motion(bench):
    moving(bench)
    bench.plugged = False
    with pytest.raises(LinkError, match="gone"):
        bench.go(-0.01, 0.1)
    bench.robot.close()  # which can do nothing, and ends
    assert_still(bench, bench.file.watchdog + bench.file.control_period)


def test_one_silent_motor_is_named_and_the_others_ramp_down(bench):
    bench.device.motors[1].silent = True
    fails(bench, MotorFault.SILENT, r"motor 2 \(tendon b\) does not answer")
    with pytest.raises(RobotError, match="motor 2 does not take torque = 0"):
        bench.robot.stop()
    assert not bench.device.powered  # it hears, although it does not say so
    np.testing.assert_allclose(bench.device.applied[[0, 2]], 0.0, atol=1e-4)


def test_a_short_silence_is_counted_and_the_robot_goes_on(bench):
    bench.device.motors[1].silent = True
    bench.go(0.01, 0.02)
    bench.device.motors[1].silent = False
    bench.go(0.0, 0.3)
    assert bench.robot.link["lost"] >= 1 and bench.robot.fault is None


def test_bus_noise_is_dropped_and_counted(kind):
    bench = MotorBench(motor_file(kind, patience=0.5)).start()
    bench.device.noise = 2e-4
    for target in (0.01, -0.01, 0.005):
        bench.go(target, 0.6)
    assert bench.robot.link["lost"] > 0 and bench.witness.unsafe == []


def test_garbage_alone_moves_nothing(kind):
    bench = MotorBench(motor_file(kind))
    noise = np.random.default_rng(0)
    for _ in range(200):
        bench.device.receive(noise.bytes(1000))
        bench.run(2e-3)
    assert len(bench.device._received) <= 4096 and not bench.device.powered
    bench.device._received.clear()
    bench.start()
    bench.go(0.005, 0.3)
    assert bench.witness.unsafe == []


def test_a_wrong_id_is_named_with_those_that_answer(kind):
    bench = MotorBench(motor_file(kind))
    bench.device.put(bench.device.motors[2], "id", 9)
    with pytest.raises(LinkError, match=r"motor 3 \(tendon c\).*those that answer: 1, 2, 9"):
        bench.robot.connect()
    assert not bench.device.powered


def test_a_number_that_two_motors_have(kind):
    bench = MotorBench(motor_file(kind))
    bench.device.put(bench.device.motors[2], "id", 2)
    with pytest.raises(RobotError, match="motor 3"):
        bench.robot.connect()


def test_a_second_motor_of_a_number_garbles_answers_in_motion(bench):
    bench.device.put(bench.device.motors[2], "id", 2)
    fails(bench, MotorFault.SILENT, "motor [23]")


def test_an_overload_and_its_clearing(bench):
    bench.device.motors[0].errors |= 1 << 5
    fails(bench, Fault.FORCE, r"motor 1 \(tendon a\) reports an overload")
    bench.robot.stop()
    if bench.file.kind == "feetech":
        bench.device.motors[0].errors = 0  # ends with its cause
    bench.robot.clear()
    bench.robot.connect()
    bench.robot.arm()
    bench.go(0.0, 0.2)


def test_a_cause_that_lasts_cannot_be_cleared(bench):
    bench.device.motors[0].temperature = 90.0
    fails(bench, MotorFault.OVERHEATED, "motor 1.*too hot|motor 1.*90 °C")
    bench.robot.stop()
    with pytest.raises((RefusedError, LinkError)):
        bench.robot.clear()
        bench.run(0.2)
        bench.robot.clear()
    assert not bench.device.motors[0].was_on


def test_overheating_below_the_motors_own_limit(bench):
    for one in bench.device.motors:
        bench.device.put(one, "temperature_limit", 0)
    bench.device.motors[2].temperature = 75.0
    fails(bench, MotorFault.OVERHEATED, "motor 3.*75 °C hot")


def test_too_much_current_that_lasts(kind):
    file = motor_file(kind)
    weak = tuple(replace(m, max_current=0.08) for m in file.motors)
    bench = MotorBench(replace(file, motors=weak)).start()
    with pytest.raises(RobotFaultError, match=r"takes 0\.\d+ A"):
        bench.go(0.015, 1.0)
    assert bench.robot.fault.code == Fault.FORCE and bench.witness.unsafe == []


def test_a_voltage_dip(bench):
    for one in bench.device.motors:
        one.supply = 7.0
    fails(bench, Fault.BROWN_OUT, r"gets 7\.0 V")


def test_a_stuck_motor(bench):
    bench.device.motors[1].stuck = True
    fails(bench, Fault.STALL, "motor 2.*behind", within=1.0)


def test_a_motor_that_starts_anew_in_motion(bench):
    moving(bench)
    bench.device.reboot(bench.device.motors[1])
    begin = bench.now
    with pytest.raises(RobotFaultError, match="motor 2"):
        while bench.now < begin + 1.0:
            bench.go(-0.01, 0.02)
    assert bench.robot.fault.code in (MotorFault.SILENT, MotorFault.RESTARTED)
    bench.run(0.2)  # until it is back
    bench.robot.stop()
    bench.robot.clear()
    bench.robot.connect()
    bench.robot.arm()
    bench.go(0.0, 0.2)
    np.testing.assert_allclose(bench.device.applied, 0.0, atol=3e-3)


def test_an_emergency_stop_cuts_and_latches(bench):
    bench.robot.estop()
    assert not bench.device.powered or bench.run(0.01) or not bench.device.powered
    with pytest.raises(RobotFaultError, match="emergency stop"):
        bench.go(0.0, 0.02)
    bench.robot.clear()
    assert bench.robot.fault is None and not bench.device.powered


def test_far_outside_the_range_nothing_is_armed(kind):
    bench = MotorBench(motor_file(kind))
    for one in bench.device.motors:
        one.length = 0.025
    bench.witness.high[:] = 0.03
    bench.robot.connect()
    with pytest.raises(RefusedError, match="too far"):
        bench.robot.arm()
    assert not bench.device.powered


def test_dynamixels_watchdog_holds_them_and_refuses_goals_until_it_is_reset():
    bench = MotorBench(motor_file("dynamixel")).start()
    bench.go(0.01, 0.4)
    moving(bench)
    bench.run(0.3)
    held = bench.device.applied.copy()
    bench.robot._bus.write([5.0] * 3)  # another program's goal
    bench.run(0.3)
    np.testing.assert_array_equal(bench.device.applied, held)
    state = bench.robot._bus.read()[0]
    assert state.expired and state.powered


def test_two_motors_of_a_tendon_share_it(kind):
    file = motor_file(kind)
    twice = replace(file.motors[0], id=7, direction=-1)
    bench = MotorBench(replace(file, motors=(*file.motors, twice))).start()
    bench.go(0.01, 0.4)
    assert bench.robot.reading.length == pytest.approx([0.01] * 3, abs=1e-4)
    assert bench.robot.reading.force == pytest.approx([10.0] * 3, abs=0.5)
    assert bench.robot.reading.current[0] == pytest.approx(0.05, abs=0.01)
