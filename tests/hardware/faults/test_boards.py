"""The fault matrix on a virtual clock: floods, robots, hosts; see `test_matrix`."""

import tracemalloc
from dataclasses import replace

import pytest
from support.hardware_boards import PASS
from support.rough_bench import (
    HERE,
    PERIOD,
    ROBOT,
    STOPPED,
    THERE,
    Rough,
    assert_off,
    assert_stays_off,
    counts,
)

from softrobot_env.hardware.errors import UnansweredError
from softrobot_env.hardware.protocol import messages as m
from softrobot_env.hardware.protocol.messages import LONGEST, encode
from softrobot_env.hardware.protocol.session import Phase


@pytest.fixture
def rough():
    return Rough()


@pytest.mark.parametrize("seed", range(3))
def test_a_flood_moves_nothing_and_passes(seed):
    bench = Rough(seed=seed)
    bench.drive(THERE, 0.4)
    bench.harm(garbage=1000)
    bench.run(STOPPED)
    assert bench.out.applied == counts(HERE)
    assert_off(bench)
    bench.harm()
    bench.run(0.3)
    assert bench.session.fault.code == m.Fault.WATCHDOG
    assert bench.session.link.crc_errors + bench.session.link.frame_errors > 100
    bench.say(bench.session.clear(), 0.06)
    bench.arm(number=6)
    assert bench.session.phase == Phase.RUNNING and bench.out.powered


def test_a_flood_between_set_points_disturbs_nothing(rough):
    rough.harm(garbage=100)
    rough.drive(THERE, 0.4)
    assert rough.out.powered and rough.out.applied == counts(THERE)


def test_a_flood_needs_no_memory(rough):
    """Without a zero it looks like one frame that never ends."""
    tracemalloc.start()
    for _ in range(200):
        rough.session.receive(b"\x55" * 4096, rough.now)
    most = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert most < 20 * LONGEST + 3 * 4096


def test_a_device_that_slept_follows_no_old_set_points(rough):
    rough.drive(HERE, 0.2)
    followed = len(rough.core.witness.followed)
    rough.asleep = True
    for _ in range(3):
        rough.command(THERE, 5e-3)
    with pytest.raises(UnansweredError):
        rough.command(THERE)
    rough.run(0.05)
    rough.asleep = False
    rough.run(5e-3)
    assert rough.nacks() == {"late": 3}
    assert len(rough.core.witness.followed) == followed
    assert rough.out.powered and rough.out.applied == counts(HERE)
    rough.drive(THERE, 0.4)
    assert rough.out.applied == counts(THERE)


def test_a_device_that_slept_long_stops(rough):
    rough.drive(THERE, 0.4)
    rough.asleep = True
    rough.drive(THERE, 0.4)
    rough.asleep = False
    rough.run(STOPPED)
    assert rough.out.applied == counts(HERE)
    assert_stays_off(rough)


def test_a_low_supply_cuts(rough):
    rough.drive(THERE, 0.4)
    rough.board.supply = 4000
    rough.run(PASS)
    assert_stays_off(rough)
    assert rough.session.fault.code == m.Fault.BROWN_OUT


def test_a_stuck_servo_stays_and_the_others_go_to_rest(rough):
    rough.drive(THERE, 0.4)
    rough.board.stuck = counts(THERE)
    goal = (3e-3, 4e-3, 1e-3)
    rough.drive(goal, ROBOT.supervision.time)
    assert rough.out.powered and rough.out.applied == counts(goal)
    rough.drive(goal, 0.4)
    assert rough.out.applied == counts((0.0, 4e-3, 0.0))
    assert_stays_off(rough)
    fault = rough.session.fault
    assert (fault.code, fault.channel) == (m.Fault.STALL, 1) and "tendon 2" in fault.text


@pytest.mark.parametrize("rail", [4095, 0], ids=["saturated", "open"])
def test_a_rail_in_the_loop_is_told_at_once_and_then_stops(rail):
    watched = replace(ROBOT.supervision, adc_channels=(1,))
    bench = Rough(replace(ROBOT, supervision=watched))
    bench.drive(THERE, 0.4)
    bench.core.adc = (2000, rail, 2000, 2000)
    bench.drive(THERE, 0.06)
    assert m.Warning.ADC_RAIL in bench.session.reading.warnings
    assert bench.session.reading.adc.tolist() == [2000, rail, 2000, 2000]
    assert bench.out.powered and bench.out.applied == counts(THERE)
    bench.drive(THERE, watched.time + STOPPED)
    assert bench.out.applied == counts(HERE)
    assert_stays_off(bench)
    fault = bench.session.fault
    assert (fault.code, fault.channel, fault.value) == (m.Fault.ADC, 1, rail)


def test_a_rail_outside_the_loop_is_only_measured(rough):
    rough.core.adc = (2000, 4095, 2000, 0)
    rough.drive(THERE, 0.6)
    assert rough.session.reading.adc.tolist() == [2000, 4095, 2000, 0]
    assert not rough.session.reading.warnings & m.Warning.ADC_RAIL
    assert rough.out.powered and rough.out.applied == counts(THERE)


def test_a_host_of_another_table_arms_nothing(rough, monkeypatch):
    rough.say(rough.session.stop(), 0.1)
    config = rough.robot.to_message()
    setpoint = m.Setpoint(9, round(1e6 * rough.now), 50, 0, 3, (0, 0, 0))
    with monkeypatch.context() as other:
        other.setattr(m, "SCHEMA", m.SCHEMA ^ 1)
        frames = [encode(message, 1) for message in (config, m.Arm(9, 0), setpoint)]
    for frame in frames:
        rough.say(frame, 0.06)
    assert rough.session.link.device_crc_errors == 3
    assert_stays_off(rough)


def test_a_host_that_does_not_read_gets_whole_frames(rough):
    rough.reads = False
    for _ in range(50):
        rough.drive(THERE, PERIOD)
    rough.reads = True
    assert rough.out.powered and rough.out.applied == counts(THERE)
    rough.drive(THERE, 0.1)
    link = rough.session.link
    assert link.frame_errors == link.crc_errors == 0 and link.lost > 10
