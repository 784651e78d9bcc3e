"""Everything that can go wrong between host and robot, and what must happen then.

| fault | what must happen | tests |
|---|---|---|
| byte corruption | dropped, counted; goes on | damage_is_dropped_and_counted, any_harm_*, L |
| frames dropped, shortly | the robot holds; goes on | a_short_gap_is_held, any_harm_*, L |
| frames dropped, longer | ramp to rest, off, latched | F: the_watchdog_*, S: silence_latches_* |
| duplicated | ignored; feed no watchdog | copies_keep_nothing_alive, any_harm_*, L |
| reordered | refused by number | F: sequence_numbers_wrap, any_harm_*, L |
| delayed | refused by age | what_came_too_late_moves_nothing |
| of another session | refused | F: a_wrong_setpoint_neither_moves_nor_feeds |
| truncated | the next frame is intact | P: a_cut_frame_does_not_take_the_next_*, any_harm_*, L |
| split | put together | L: all_harm_at_once_is_survived |
| garbage flood | bounded memory, no motion, recovery | a_flood_*, any_harm_*, L |
| disconnect in an episode | truncated in time; ramp; reset refuses | L: a_lost_line_* |
| slow host | missed steps are counted, no burst; then a fault | L: a_slow_host_* |
| slow device | three set-points under way; old ones die | a_device_that_slept_* |
| stalled device | truncated in time; old set-points die | L: a_stalled_device_* |
| brown-out reset | disarmed; truncated; cause and boot reported | L: a_restart* |
| supply too low | off at once | F: an_emergency_stop_and_a_low_supply_* |
| firmware of another protocol or table | both named; never arms | S: another_board_is_refused |
| host of another table | damage for the robot; never arms | a_host_of_another_table_* |
| stuck servo | tendon named; it stays, the others ramp, off | F: what_lasts_*, S: a_fault_tells_* |
| converter saturated or open | reported at once, raw value kept; ramp | a_rail_* |
| peer not reading | write gives up; truncated | L: a_peer_that_does_not_read_* |
| host not reading | the robot goes on, whole frames | a_host_that_does_not_read_* |
| SIGKILL, SIGTERM, Ctrl-C | at rest in the watchdog's time | R: killing_the_host_* |
| exception in a step | emergency stop | R: an_exception_in_a_step_* |

Tests of this file have a virtual clock. Those of L, in `test_live.py`, use a pseudo-terminal or the
environment with a board in memory, and R is `envs/real/test_env.py`, both in
real time; S is `hardware/test_session.py`, F `test_session.py` and `test_faults.py` in
`hardware/firmware`, P `test_framing.py` there.

In every test a `Witness` of `output_witness.py` asserts at each pass of the robot's
program that outputs are inside limits and slew rates, and that nothing but a fresh set-point of
the session moves them, except the ramp to rest.
"""

import tracemalloc
from dataclasses import replace

import pytest
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
from support.rough_lines import Harm

from softrobot_env.hardware.errors import UnansweredError
from softrobot_env.hardware.protocol import messages as m
from softrobot_env.hardware.protocol.messages import LONGEST, encode
from softrobot_env.hardware.protocol.session import Phase


@pytest.fixture
def rough():
    return Rough()


@pytest.mark.parametrize("seed", range(2))
@pytest.mark.parametrize(
    "harm",
    [
        {"corrupt": 0.2},
        {"drop": 0.2},
        {"truncate": 0.2},
        {"delay": 0.2},
        {"duplicate": 0.5, "copies": 3},
        {"garbage": 100},
        {"corrupt": 0.05, "drop": 0.05, "truncate": 0.05, "delay": 0.05, "duplicate": 0.2},
    ],
    ids=["corrupt", "drop", "truncate", "delay", "duplicate", "garbage", "all"],
)
def test_any_harm_is_survived(harm, seed):
    bench = Rough(replace(ROBOT, watchdog=0.3), seed)  # for more in a row than chance will harm
    bench.harm(**harm)
    for length in 3 * (THERE, HERE):
        bench.drive(length, 0.5)
        assert bench.out.powered and bench.out.applied == counts(length)
    for line in (bench.up, bench.down):
        assert all(line.done[kind] for kind in harm.keys() - {"copies", "garbage"})
    assert bench.session.phase == Phase.RUNNING


def test_damage_is_dropped_and_counted(rough):
    rough.harm(corrupt=0.2)
    rough.drive(THERE, 2.0)
    rough.harm()
    rough.drive(THERE, 0.1)
    link = rough.session.link.as_dict()
    there = link["device_crc_errors"] + link["device_frame_errors"]
    here = link["crc_errors"] + link["frame_errors"]
    assert there >= rough.up.done["corrupt"] > 5 and here >= rough.down.done["corrupt"] > 5
    arming, sent = 1, (2.0 + 0.1) / PERIOD
    followed = len(rough.core.witness.followed)
    assert followed + rough.up.done["corrupt"] == arming + round(sent)
    assert rough.out.applied == counts(THERE)


def test_a_short_gap_is_held(rough):
    rough.drive(THERE, 0.4)
    rough.harm(drop=1.0)
    rough.drive(HERE, 0.06)
    assert rough.out.powered and rough.out.applied == counts(THERE)
    rough.harm()
    rough.drive(HERE, 0.4)
    assert rough.out.powered and rough.out.applied == counts(HERE)
    assert rough.session.link.lost > 0


def test_copies_keep_nothing_alive(rough):
    rough.drive(THERE, 0.4)
    rough.up.harm = Harm(duplicate=1.0, copies=40, held=PERIOD)
    rough.command(THERE)
    rough.run(STOPPED)
    assert rough.out.applied == counts(HERE)
    rough.run(0.3)
    assert_stays_off(rough)
    assert rough.nacks()["sequence"] >= 4


def test_what_came_too_late_moves_nothing(rough):
    """Its number is good, as newer ones were lost; its age is not."""
    rough.drive(HERE, 0.1)
    rough.up.harm = Harm(delay=1.0, held=ROBOT.ttl + 0.02)
    rough.command(THERE)
    rough.up.harm = Harm(drop=1.0)
    rough.drive(HERE, 0.06)
    assert rough.out.powered and rough.out.applied == counts(HERE)
    rough.drive(HERE, 0.06)
    rough.run(0.2)
    assert rough.nacks() == {"late": 1}
    assert rough.out.applied == counts(HERE)
    assert_stays_off(rough)


# ---------------------------------------------------------------- what is at either end
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
    with pytest.raises(UnansweredError, match="has not answered the last 3"):
        rough.command(THERE)
    rough.run(0.05)
    rough.asleep = False
    rough.run(5e-3)
    assert rough.nacks() == {"late": 3}
    assert len(rough.core.witness.followed) == followed
    assert rough.out.powered and rough.out.applied == counts(HERE)
    rough.drive(THERE, 0.4)
    assert rough.out.applied == counts(THERE)


@pytest.mark.parametrize("rail", [4095, 0], ids=["saturated", "open"])
def test_a_rail_in_the_loop_is_told_at_once_and_then_stops(rail):
    """One outside the loop is only measured."""
    watched = replace(ROBOT.supervision, adc_channels=(1,))
    bench = Rough(replace(ROBOT, supervision=watched))
    for adc, warned in (((4095, 2000, 2000, 0), False), ((2000, rail, 2000, 2000), True)):
        bench.core.adc = adc
        bench.drive(THERE, 0.06 if warned else 0.4)
        assert (m.Warning.ADC_RAIL in bench.session.reading.warnings) == warned
        assert bench.session.reading.adc.tolist() == list(adc)
        assert bench.out.powered and bench.out.applied == counts(THERE)
    bench.drive(THERE, watched.time + STOPPED)
    assert bench.out.applied == counts(HERE)
    assert_stays_off(bench)
    fault = bench.session.fault
    assert (fault.code, fault.channel, fault.value) == (m.Fault.ADC, 1, rail)


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
