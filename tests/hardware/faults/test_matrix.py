"""Everything that can go wrong between host and robot, and what must happen then.

| fault | what must happen | tests |
|---|---|---|
| byte corruption | dropped, counted; goes on | damage_is_dropped_and_counted, any_harm_*, L |
| frames dropped, shortly | the robot holds; goes on | a_short_gap_is_held, any_harm_*, L |
| frames dropped, for longer | ramp to rest, off, latched | a_long_gap_ends_at_rest_and_latches |
| duplicated | ignored; feed no watchdog | copies_keep_nothing_alive, any_harm_*, L |
| reordered | refused by number | what_was_overtaken_is_refused, any_harm_*, L |
| delayed | refused by age | what_came_too_late_moves_nothing |
| of another session | refused | what_is_of_another_session_moves_nothing |
| truncated | the next frame is intact | a_cut_frame_takes_nothing_with_it, any_harm_*, L |
| split | put together | single_bytes_are_put_together, L |
| garbage flood | bounded memory, no motion, recovery | B: a_flood_*, L |
| disconnect in an episode | truncated in time; ramp; reset refuses | L: a_lost_line_* |
| slow host | missed steps are counted, no burst; then a fault | E: a_slow_host_* |
| slow device | three set-points under way; old ones die | B: a_device_that_slept_* |
| stalled device | truncated in time; old set-points die | L: a_stalled_device_* |
| brown-out reset | disarmed; truncated; cause and boot told | E: a_restart* |
| supply too low | off at once | B: a_low_supply_cuts |
| firmware of another protocol or table | both named; never arms | E: another_firmware_* |
| host of another table | damage for the robot; never arms | B: a_host_of_another_table_* |
| stuck servo | tendon named; it stays, the others ramp, off | B: a_stuck_servo_* |
| converter saturated or open | told at once, raw value kept; ramp | B: a_rail_* |
| peer not reading | write gives up; truncated | L: a_peer_that_does_not_read_* |
| host not reading | the robot goes on, whole frames | B: a_host_that_does_not_read_* |
| SIGKILL, SIGTERM, Ctrl-C | at rest in the watchdog's time | R: killing_the_host_* |
| exception in a step | emergency stop | R: an_exception_in_a_step_* |

Tests of this file, about frames, and of B, `test_boards.py`, about what is at either
end, have a virtual clock. Those of L, `test_live.py`, use pseudo-terminals, those of
E, `test_env.py`, the environment with a board in memory, and R is `envs/real/test_env.py`, all in
real time.

In every test a `Witness` of `output_witness.py` asserts at each pass of the robot's
program that outputs are inside limits and slew rates, and that nothing but a fresh set-point of
the session moves them, except the ramp to rest.
"""

from dataclasses import replace

import numpy as np
import pytest
from support.hardware_boards import PASS
from support.rough_bench import (
    FAR,
    HERE,
    PERIOD,
    ROBOT,
    STOPPED,
    THERE,
    Rough,
    assert_stays_off,
    counts,
)
from support.serial_proxy import Harm

from softrobot_env.hardware.protocol import messages as m
from softrobot_env.hardware.protocol.messages import encode
from softrobot_env.hardware.protocol.session import Phase


@pytest.fixture
def rough():
    return Rough()


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize(
    "harm",
    [
        {"corrupt": 0.2},
        {"drop": 0.2},
        {"truncate": 0.2},
        {"delay": 0.2},
        {"duplicate": 0.5, "copies": 3},
        {"corrupt": 0.05, "drop": 0.05, "truncate": 0.05, "delay": 0.05, "duplicate": 0.2},
    ],
    ids=["corrupt", "drop", "truncate", "delay", "duplicate", "all"],
)
def test_any_harm_is_survived(harm, seed):
    bench = Rough(replace(ROBOT, watchdog=0.3), seed)  # for more in a row than chance will harm
    bench.harm(**harm)
    for length in 4 * (THERE, HERE):
        bench.drive(length, 0.5)
        assert bench.out.powered and bench.out.applied == counts(length)
    for line in (bench.up, bench.down):
        assert all(line.done[kind] for kind in harm.keys() - {"copies"})
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


def test_a_long_gap_ends_at_rest_and_latches(rough):
    """Also in the middle of a motion."""
    rough.drive(FAR, 2 * PERIOD)
    rough.harm(drop=1.0)
    rough.drive(FAR, ROBOT.watchdog)
    assert rough.out.powered and rough.out.applied[0] > counts(FAR)[0] / 2
    rough.drive(FAR, max(FAR) / ROBOT.ramp)
    assert rough.out.applied == counts(HERE)
    rough.harm()
    rough.run(0.3)
    assert_stays_off(rough)
    assert rough.session.fault.code == m.Fault.WATCHDOG


def test_copies_keep_nothing_alive(rough):
    rough.drive(THERE, 0.4)
    rough.up.harm = Harm(duplicate=1.0, copies=40, held=PERIOD)
    rough.command(THERE)
    rough.run(STOPPED)
    assert rough.out.applied == counts(HERE)
    rough.run(0.3)
    assert_stays_off(rough)
    assert rough.nacks()["sequence"] >= 4


def test_what_was_overtaken_is_refused(rough):
    rough.drive(HERE, 0.1)
    rough.up.harm = Harm(delay=1.0, held=0.03)
    overtaken = rough.command(THERE, 0.01)
    rough.up.harm = Harm()
    rough.drive(HERE, 0.1)
    assert rough.nacks() == {"sequence": 1} and rough.session.echo(overtaken).seq > overtaken
    assert rough.out.powered and rough.out.applied == counts(HERE)


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


def test_what_is_of_another_session_moves_nothing(rough):
    rough.drive(HERE, 0.1)
    setpoint = m.Setpoint(6, 0, 50, m.MODE_LENGTH, 3, counts(THERE))
    for number in range(20):
        now = round(rough.now / m.CLOCK_UNIT)
        rough.say(encode(replace(setpoint, t_host=now), 1000 + number), PERIOD)
    assert rough.nacks()["session"] == 4
    assert rough.out.applied == counts(HERE)
    assert_stays_off(rough)


def test_a_cut_frame_takes_nothing_with_it(rough):
    frame = rough.session.setpoint(np.array(THERE), rough.now)[1]
    for size in range(1, len(frame)):
        rough.say(frame[:size], PASS)
        seq = rough.command(HERE)
        assert rough.session.echo(seq).seq == seq
    assert rough.out.applied == counts(HERE)


def test_single_bytes_are_put_together(rough):
    rough.up.harm = Harm(piece=1)
    for _ in range(10):
        seq = rough.command(THERE, 0.05)
    assert rough.session.echo(seq).seq == seq
    assert rough.out.powered and rough.out.applied == counts(THERE)
