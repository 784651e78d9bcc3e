"""Everything that can go wrong between host and motors, and what must happen then, of every kind.

| fault | what must happen | tests |
|---|---|---|
| byte corruption | dropped, counted; goes on | any_harm_*, bus_noise_* |
| frames dropped, shortly | motors hold; goes on | any_harm_*, a_short_silence_* |
| frames dropped, longer | host stops; motors hold | packets_that_are_lost_*, answers_that_* |
| duplicated | a goal again is the same goal | any_harm_*, copies_* |
| reordered, delayed | motors cannot tell: see there | late_packets_* |
| truncated | the next packet is intact | any_harm_* |
| split | put together | any_harm_* |
| garbage flood | bounded memory, no motion, recovery | garbage_alone_*, a_flood_* |
| disconnect in an episode | truncated; reset refuses; motors hold | a_line_unplugged_*, L |
| slow host | counted; stopped beyond the watchdog | a_host_that_slept_*, L |
| slow or stalled device | named; follows what waited, no farther | motors_that_slept_* |
| brown-out, reboot in motion | named, stopped, disarmed | a_motor_that_starts_*, a_voltage_dip |
| another maker's motor | refused by name; never armed | a_model_without_current_* |
| stuck motor | named; the others ramp | a_stuck_motor |
| encoder at fault | named, at once | an_encoder_that_fails |
| peer not reading | write gives up; motors hold | a_peer_that_takes_nothing |
| SIGKILL, SIGSTOP, SIGTERM | still in the watchdog's time | a_dead_host_*, V |
| exception, Ctrl-C | emergency stop: torque off | L |
| overload, heat, current | named, stopped, not cleared meanwhile | an_overload_*, a_cause_* |
| one motor silent | named; the others ramp down | one_silent_motor_* |
| wrong id, duplicate id | named; never armed | a_wrong_id_*, a_number_*, a_second_* |

Tests of this file have a virtual clock. L is `test_live_motors.py`, V `test_virtual_motors.py`,
both in real time. In every test of this file and of L a witness asserts, as the motors' programs
go on, that outputs stay within range and speed, and that nothing moves when the host has sent no
goals for the watchdog's time and a period; `test_witness.py` shows that it notices.
"""

import tracemalloc
from contextlib import suppress
from dataclasses import replace

import numpy as np
import pytest
from support.motor_bench import MotorBench, motor_file
from support.rough_lines import Harm

from softrobot_env.hardware.errors import LinkError, RefusedError, RobotError, RobotFaultError
from softrobot_env.hardware.motors import MotorFault
from softrobot_env.hardware.protocol.messages import Fault

pytest.importorskip("dynamixel_sdk", reason="needs the robot extra")
pytest.importorskip("scservo_sdk", reason="needs the robot extra")

KINDS = ("dynamixel", "feetech", "odrive")


@pytest.fixture(params=KINDS)
def kind(request):
    return request.param


@pytest.fixture
def made():
    """Makes benches, whose witnesses are asked at the end."""
    benches = []

    def make(file):
        benches.append(MotorBench(file))
        return benches[-1]

    yield make
    assert [bench.witness.unsafe for bench in benches] == [[]] * len(benches) != []


@pytest.fixture
def bench(kind, made):
    """Three motors that have moved, and still shall."""
    bench = made(motor_file(kind)).start()
    bench.go(0.01, 0.4)
    return bench


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
    bench.run_for(0.05)
    np.testing.assert_allclose(bench.device.applied, frozen, atol=1e-3)
    with pytest.raises(RobotFaultError):
        bench.robot.exchange(np.zeros(3), bench.now)
    with pytest.raises(RobotError):
        bench.robot.arm()


def bit(bench, word):
    """The bit of an error register that says so."""
    (found,) = (k for k, (_, text) in bench.device.kind.bits.items() if word in text)
    return 1 << found


def assert_still(bench, since):
    """Nothing moves from `since` [s] after now on; the motors hold where they are."""
    end = bench.now + since
    bench.run_for(since + 0.4)
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


@pytest.mark.parametrize("kind", ["dynamixel", "feetech"])
def test_motors_hold_at_the_end_of_a_stop_where_the_file_says_so(kind, made):
    bench = made(motor_file(kind, at_stop="hold")).start()
    bench.go(0.005, 0.2)
    bench.robot.close()
    assert bench.device.powered and bench.closed == 1
    bench.run_for(2.0)
    np.testing.assert_allclose(bench.device.applied, 0.0, atol=1e-4)
    again = bench.host()
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
    assert bench.device.powered == (bench.file.kind != "odrive")  # whose watchdog lets go


def test_a_host_that_slept_is_stopped_and_never_arms_by_itself(bench):
    moving(bench)
    held = bench.device.applied.copy()
    bench.run_for(0.3)
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


def test_a_peer_that_takes_nothing(bench):
    moving(bench)
    bench.taken = False
    with pytest.raises(LinkError, match="nobody takes"):
        bench.go(-0.01, 0.1)
    assert_still(bench, 0.0)


HARM = {
    "corrupt": {"corrupt": 0.1},
    "drop": {"drop": 0.1},
    "truncate": {"truncate": 0.1},
    "duplicate": {"duplicate": 0.2},
    "split": {"piece": 64},
}


@pytest.mark.parametrize("name", HARM)
def test_any_harm_is_survived_and_counted(kind, name, made):
    bench = made(motor_file(kind, patience=0.5)).start()
    bench.harm(**HARM[name])
    for target in (0.01, -0.01, 0.005):
        bench.go(target, 0.3)
    done = bench.up.done[name], bench.down.done[name]
    assert min(done) > 0 or name == "split"
    bench.harm()
    bench.go(0.005, 0.4)
    np.testing.assert_allclose(bench.device.applied, 0.005, atol=1e-4)
    assert bench.robot.fault is None
    assert bench.robot.link["lost"] > 0 or name in ("duplicate", "split")


def test_packets_that_are_lost_for_longer_leave_motors_that_hold(bench):
    moving(bench)
    bench.up.harm = Harm(drop=1.0)
    with pytest.raises(RobotFaultError, match="does not answer"):
        bench.go(-0.01, 0.5)
    assert_still(bench, bench.file.watchdog + bench.file.control_period)


def test_answers_that_are_lost_for_longer_stop_the_robot(bench):
    moving(bench)
    bench.down.harm = Harm(drop=1.0)
    with pytest.raises(RobotFaultError, match="does not answer"):
        bench.go(-0.01, 0.5)
    with pytest.raises(RobotError, match="does not take torque = 0"):
        bench.robot.stop()
    np.testing.assert_allclose(bench.device.applied, 0.0, atol=1e-4)
    assert not bench.device.powered  # they hear


def test_copies_of_a_goal_move_nothing(bench):
    """Although they may keep a motor's own watchdog from biting."""
    bench.up.harm = Harm(duplicate=1.0, copies=40, held=bench.file.control_period)
    bench.go(0.0095, bench.file.control_period)
    bench.up.harm = Harm()
    assert_still(bench, bench.file.watchdog + bench.file.control_period)
    np.testing.assert_allclose(bench.device.applied, 0.0095, atol=6e-4)


def test_late_packets_lead_no_farther_than_they_are_late(kind, made):
    bench = made(motor_file(kind, patience=0.5)).start()
    bench.up.harm, bench.witness.late = Harm(delay=0.3, held=0.05), 0.05
    for target in (0.01, -0.01, 0.005):
        bench.go(target, 0.3)
    bench.up.harm = Harm()
    bench.go(0.005, 0.4)
    assert bench.up.done["delay"] > 5 and bench.robot.fault is None
    np.testing.assert_allclose(bench.device.applied, 0.005, atol=1e-4)


def test_motors_that_slept_are_named_and_follow_what_waited(bench):
    """Motors know no age: they go where the host froze them, and not beyond."""
    moving(bench)
    before, bench.asleep = bench.device.applied.copy(), True
    with pytest.raises(RobotFaultError, match="does not answer"):
        bench.go(-0.01, 0.5)
    bench.run_for(0.3)
    bench.asleep, bench.witness.late = False, 0.5
    bench.run_for(0.5)
    file = bench.file
    patience = file.patience + 3 * file.control_period
    assert np.abs(bench.device.applied - before).max() <= file.slew * patience
    assert bench.now - bench.witness.moved > 0.3


def test_a_flood_needs_no_memory_and_passes(bench):
    moving(bench)
    bench.harm(garbage=1000)
    tracemalloc.start()
    with suppress(RobotFaultError, LinkError):  # answers may be found between
        bench.go(0.0, 0.6)
    most = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert most < 2**21
    bench.harm()
    bench.robot.stop()
    bench.robot.clear()
    bench.robot.connect()
    bench.robot.arm()
    bench.go(0.005, 0.5)
    np.testing.assert_allclose(bench.device.applied, 0.005, atol=1e-4)


def test_a_model_without_current_is_refused(kind, made):
    bench = made(motor_file(kind))
    at = {"dynamixel": 0, "feetech": 3, "odrive": 1}[kind]
    bench.device.motors[1].table[at : at + 2] = b"\x42\x00"
    with pytest.raises(RobotError, match="motor 2, model 66, has no current"):
        bench.robot.connect()
    bench.run_for(0.1)
    assert not bench.device.powered


def test_an_encoder_that_fails(bench):
    bench.device.motors[2].errors |= bit(bench, "encoder")
    fails(bench, MotorFault.BROKEN, r"motor 3 \(tendon c\) reports that its encoder fails")


def test_one_silent_motor_is_named_and_the_others_ramp_down(bench):
    bench.device.motors[1].silent = True
    fails(bench, MotorFault.SILENT, r"motor 2 \(tendon b\) does not answer for [\d.]+ s")
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


def test_bus_noise_is_dropped_and_counted(kind, made):
    bench = made(motor_file(kind, patience=0.5)).start()
    bench.device.noise = 2e-4
    for target in (0.01, -0.01, 0.005):
        bench.go(target, 0.6)
    assert bench.robot.link["lost"] > 0


def test_garbage_alone_moves_nothing(kind, made):
    bench = made(motor_file(kind))
    noise = np.random.default_rng(0)
    for _ in range(200):
        bench.device.receive(noise.bytes(1000))
        bench.run_for(2e-3)
    assert len(bench.device._received) <= 4096 and not bench.device.powered
    bench.device._received.clear()
    bench.start()
    bench.go(0.005, 0.3)


def test_a_wrong_id_is_named_with_those_that_answer(kind, made):
    bench = made(motor_file(kind))
    bench.device.put(bench.device.motors[2], "id", 9)
    with pytest.raises(LinkError, match=r"motor 3 \(tendon c\).*those that answer: 1, 2, 9"):
        bench.robot.connect()
    assert not bench.device.powered


def test_a_number_that_two_motors_have(kind, made):
    bench = made(motor_file(kind))
    bench.device.put(bench.device.motors[2], "id", 2)
    with pytest.raises(RobotError, match="motor 3"):
        bench.robot.connect()


def test_a_second_motor_of_a_number_garbles_answers_in_motion(bench):
    bench.device.put(bench.device.motors[2], "id", 2)
    fails(bench, MotorFault.SILENT, "motor [23]")


def test_an_overload_and_its_clearing(bench):
    bench.device.motors[0].errors |= bit(bench, "overload")
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
        bench.run_for(0.2)
        bench.robot.clear()
    assert not bench.device.motors[0].was_on


def test_overheating_below_the_motors_own_limit(bench):
    for one in bench.device.motors:
        bench.device.put(one, "temperature_limit", 0)
    bench.device.motors[2].temperature = 75.0
    fails(bench, MotorFault.OVERHEATED, "motor 3.*75 °C hot")


def test_too_much_current_that_lasts(kind, made):
    file = motor_file(kind)
    weak = tuple(replace(m, max_current=0.08) for m in file.motors)
    bench = made(replace(file, motors=weak)).start()
    with pytest.raises(RobotFaultError, match=r"takes 0\.\d+ A"):
        bench.go(0.015, 1.0)
    assert bench.robot.fault.code == Fault.FORCE


def test_a_voltage_dip(bench):
    for one in bench.device.motors:
        one.supply = 7.0
    fails(bench, Fault.BROWN_OUT, r"gets 7\.0 V")
    bench.robot.stop()
    with pytest.raises(RefusedError, match="may still be there"):
        bench.robot.clear()
    for one in bench.device.motors:
        one.supply = 12.0
    bench.run_for(0.01)
    bench.robot.clear()


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
    bench.run_for(0.2)  # until it is back
    bench.robot.stop()
    bench.robot.clear()
    bench.robot.connect()
    bench.robot.arm()
    bench.go(0.0, 0.2)
    np.testing.assert_allclose(bench.device.applied, 0.0, atol=3e-3)


def test_an_emergency_stop_cuts_and_latches(bench):
    bench.robot.estop()
    assert not bench.device.powered or bench.run_for(0.01) or not bench.device.powered
    with pytest.raises(RobotFaultError, match="emergency stop"):
        bench.go(0.0, 0.02)
    bench.robot.clear()
    assert bench.robot.fault is None and not bench.device.powered


def test_far_outside_the_range_nothing_is_armed(kind, made):
    bench = made(motor_file(kind))
    for one in bench.device.motors:
        one.length = 0.025
    bench.witness.high[:] = 0.03
    bench.robot.connect()
    with pytest.raises(RefusedError, match="too far"):
        bench.robot.arm()
    assert not bench.device.powered


def test_dynamixels_watchdog_holds_them_and_refuses_goals_until_it_is_reset(made):
    bench = made(motor_file("dynamixel")).start()
    bench.go(0.01, 0.4)
    moving(bench)
    bench.run_for(0.3)
    held = bench.device.applied.copy()
    bench.robot._bus.write([5.0] * 3)  # another program's goal
    bench.run_for(0.3)
    np.testing.assert_array_equal(bench.device.applied, held)
    state = bench.robot._bus.read()[0]
    assert state.expired and state.powered


def test_an_odrive_lets_go_and_can_be_armed_again(made):
    """Its watchdog bites at rest too, which is no fault; in motion it is."""
    bench = made(motor_file("odrive")).start()
    moving(bench)
    bench.run_for(0.3)
    assert not bench.device.powered
    bench.robot._sent = bench.now  # a host that was only slow to speak
    with pytest.raises(RobotFaultError, match=r"motor 1 .* has let go"):
        bench.go(-0.01, 0.2)
    bench.robot.stop()
    bench.robot.clear()
    bench.run_for(0.5)
    bench.robot.connect()
    bench.robot.arm()
    bench.go(0.0, 0.3)
    assert bench.device.powered and bench.robot.fault is None


@pytest.mark.parametrize(
    ("changes", "allowed"),
    [({"at_stop": "hold"}, "at_stop 'relax'"), ({"mode": "position"}, "mode 'extended_position'")],
)
def test_what_an_odrive_cannot_do_is_refused(changes, allowed):
    bench = MotorBench(motor_file("odrive", **changes))
    with pytest.raises(RobotError, match=allowed):
        bench.robot.connect()


def test_two_motors_of_a_tendon_share_it(kind, made):
    file = motor_file(kind)
    twice = replace(file.motors[0], id=7, direction=-1)
    bench = made(replace(file, motors=(*file.motors, twice))).start()
    bench.go(0.01, 0.4)
    assert bench.robot.reading.length == pytest.approx([0.01] * 3, abs=1e-4)
    assert bench.robot.reading.force == pytest.approx([10.0] * 3, abs=0.5)
    assert bench.robot.reading.current[0] == pytest.approx(0.05, abs=0.01)
