"""Replays against formulas: arcs of constant curvature, and motions that are known."""

from dataclasses import replace
from math import pi

import numpy as np
import pytest
from numpy import ndarray
from scipy.spatial.transform import Rotation
from support.recorded_rods import AZIMUTHS, LENGTH, recorded, rod

from softrobot_env.identification.replay import control_period, error_rows, replay
from softrobot_env.recordings import Commands, Frame, Header, Marker, Time
from softrobot_env.recordings.files import recording_of
from softrobot_env.robots import Base
from softrobot_env.robots.twin import nominal_twin

RADIUS, TENDON, MODULUS = 0.005, 0.003, 1e6
BENDING = MODULUS * pi * RADIUS**4 / 4
ROD = rod(RADIUS, TENDON, MODULUS, 1000.0, stiffness=1e5)


def driven_by_length(robot, **drive):
    return replace(robot, drive=replace(robot.drive, kind="length", travel=0.01, **drive))


def on_the_arc(tension: float, azimuth: float, station: float, offset: ndarray) -> ndarray:
    """Where a tendon alone bends a point of the cross-section at a station to: an arc."""
    curvature = tension * TENDON / BENDING
    turn = curvature * station
    towards = np.array([np.cos(azimuth), np.sin(azimuth), 0.0])
    axis = np.array([-towards[1], towards[0], 0.0])
    along = np.array([0.0, 0.0, np.sin(turn)]) + (1 - np.cos(turn)) * towards
    return along / curvature + Rotation.from_rotvec(turn * axis).apply(offset)


@pytest.mark.slow
def test_a_level_robot_twists_under_its_weight_as_a_rod_does():
    """Bent to the side, its weight has an arm about its own axis."""
    level = replace(ROD, gravity=(0.0, 0.0, -9.81), base=Base(direction=(1.0, 0.0, 0.0)))
    level = replace(
        level.vary(youngs_modulus=3.0), tendons=tuple(t.turned(0.0, 3.0) for t in level.tendons)
    )
    recording = recorded([[0.0, 0.0, 0.0], [0.0, 0.3, 0.0], [0.0, 0.6, 0.0]])
    chain, beam = (
        replay(recording, level, plant).simulated[:, 0] for plant in ("mujoco", "cosserat")
    )
    assert np.abs(beam[-1] - beam[0]).max() > 0.2 * LENGTH
    assert np.linalg.norm(chain - beam, axis=1).max() < 0.005 * LENGTH


def test_arcs_in_a_turned_frame_with_commands_in_another_order_and_markers_beside_the_fibre():
    frame = Frame(("y", "z", "x"), (20.0, -30.0, 50.0), (0.1, -0.2, 0.3))
    stations, offsets = (LENGTH, 0.5 * LENGTH), np.array([[0.002, 0.003, 0.01], [0, -0.004, 0]])
    order, tensions = (2, 0, 1), np.linspace(0.1, 1.5, 5)
    columns = {f"T{k}": np.zeros(15) for k in order}
    places = np.empty((15, 2, 3))
    for row in range(15):
        tendon, tension = row // 5, tensions[row % 5]
        columns[f"T{tendon}"][row] = -1e3 * tension
        for m in range(2):
            world = on_the_arc(tension, AZIMUTHS[tendon], stations[m], offsets[m])
            places[row, m] = 1e3 * frame.to_recorded(world)
    columns |= {f"{axis}{m}": places[:, m, i] for m in range(2) for i, axis in enumerate("xyz")}
    markers = [
        Marker("x0", "y0", "z0", "mm", None, tuple(offsets[0])),
        Marker("x1", "y1", "z1", "mm", stations[1], tuple(offsets[1])),
    ]
    commands = Commands(
        "tension", tuple(f"T{k}" for k in order), "mN", tuple(f"t{k}" for k in order), (-1,) * 3
    )
    header = Header(commands, tuple(markers), rate_Hz=1, static=True, frame=frame)
    found = replay(recording_of(columns, header), ROD)
    # Hinges in the places of quadrature points lie off the arc by the square of a piece's turn.
    assert not found.failures and found.distance.max() < 2e-3 * LENGTH
    assert np.ptp(found.recorded[:, 0], axis=0).min() > 0.1 * LENGTH


def still(errors, labels=None):
    """A recording of a rod that stays straight, whose camera errs by (t, 3) [m]."""
    markers = np.array([0, 0, LENGTH]) - np.array(errors)[:, None]
    return recorded(np.zeros((len(errors), 1)), names=["t0"], markers=markers, labels=labels)


def test_errors_are_reported_as_they_are_and_with_one_offset_removed_by_pattern():
    errors = 1e-3 * np.array([[3, 0, 4], [3, 0, 4], [0, 0, 0], [6, 0, -8]])
    whole, first, second = error_rows(replay(still(errors, ["a", "a", "b", "b"]), ROD))
    assert (whole.pattern, whole.rows, whole.failed) == ("all", 4, 0)
    sizes = np.array([5, 5, 0, 10])
    assert 1e3 * whole.rms == pytest.approx(np.sqrt(np.mean(sizes**2)))
    assert (1e3 * whole.mean, 1e3 * whole.max) == pytest.approx((5, 10))
    assert [1e3 * x for x in (whole.offset_x, whole.offset_y, whole.offset_z)] == pytest.approx(
        [3, 0, 0], abs=1e-9
    )
    assert (1e3 * first.mean_centred, 1e3 * second.max_centred) == pytest.approx((4, 73**0.5))


def test_rows_in_which_a_marker_was_lost_do_not_count():
    errors = 1e-3 * np.array([[3, 0, 4], [np.nan, np.nan, np.nan], [0, 0, 0]])
    seen = still(np.nan_to_num(errors))
    marker = replace(seen.header.marker[0], may_be_lost=True)
    lost = replace(
        seen,
        header=replace(seen.header, marker=(marker,)),
        markers=np.array([0, 0, LENGTH]) - errors[:, None],
    )
    (row,) = error_rows(replay(lost, ROD))
    assert (row.rows, row.failed) == (3, 0) and 1e3 * row.mean == pytest.approx(2.5)


def test_rows_without_an_equilibrium_are_reported_and_counted():
    column = replace(ROD, gravity=(0.0, 0.0, -9.81), density=3e5)  # its weight buckles it
    found = replay(still(np.zeros((2, 3))), column)
    assert len(found.failures) == 2 and "row 1: " in found.failures[0]
    (row,) = error_rows(found)
    assert (row.failed, row.rms, row.offset_x) == (2, None, None)


def test_a_servo_winds_at_its_speed_and_a_marker_is_seen_late():
    """Slow servos: the bend follows the lengths, r times the angle, whenever it is looked at."""
    light = replace(ROD, density=1.0, damping_time=0.001)  # so light that it does not lag
    robot = driven_by_length(light, speed=0.002)
    times = np.concatenate([[0.0], np.cumsum(np.tile([0.011, 0.02, 0.014], 40))])
    pull = np.array([0.001, -0.0005, -0.0005])
    commands = np.tile(pull, (len(times), 1))
    commands[0] = 0.0
    late = {"marker": Marker("x", "y", "z", delay_s=0.1), "time": Time("t")}
    recording = recorded(commands, "length", times=times, **late)
    # At unequal distances commands are held on a grid.
    assert control_period(recording) == 0.005
    x = replay(recording, robot).simulated[:, 0, 0]
    angle = np.clip(0.002 * (times - 0.1 - times[1]), 0.0, 0.001) / TENDON
    wanted = LENGTH * (1 - np.cos(angle)) / np.maximum(angle, 1e-12)
    assert x[-1] == pytest.approx(wanted[-1], rel=0.01)
    # The command comes up to half a grid period, 2.5 ms, off its time: 0.5 % of the way.
    assert np.abs(x - wanted).max() < 0.01 * wanted.max()


def test_what_cannot_be_replayed_is_refused():
    recording = still(np.zeros((1, 3)))
    head = recording.header
    none = replace(recording, header=replace(head, marker=()), markers=np.zeros((1, 0, 3)))
    far = replace(recording, header=replace(head, marker=(Marker("x", "y", "z", station_m=0.3),)))
    for given, twin, said in (
        (none, None, "no markers"),
        (recording, 3, "a twin has servos; robot 'rod' is driven by tension"),
        (far, None, r"station_m must be at most 0\.2, got 0\.3"),
    ):
        with pytest.raises(ValueError, match=said):
            replay(given, ROD, twin=twin)


@pytest.mark.parametrize("plant", ["mujoco", pytest.param("pcc", marks=pytest.mark.slow)])
def test_lengths_let_out_from_rest_are_found_by_small_steps(plant):
    """Of all tendons one pulls and the others give way, so that the rod is an arc."""
    angle = 0.8
    tip = LENGTH / angle * np.array([1 - np.cos(angle), 0.0, np.sin(angle)])
    wanted = recorded(angle * TENDON * np.cos(AZIMUTHS)[None], "length", markers=tip[None, None])
    robot = replace(ROD, tendons=tuple(replace(t, pretension=0.01) for t in ROD.tendons))
    found = replay(wanted, robot, plant)
    # Tendons that are not infinitely stiff give a little.
    assert not found.failures and found.distance.max() < 0.02 * tip[0]


def test_friction_leaves_static_rows_where_a_slow_motion_does():
    """The same commands as slow motion, by MuJoCo's dry friction, and as rows at rest."""
    rubbing = {"friction": 0.05, "pretension": 0.5, "stiffness": 500.0}
    tendons = tuple(replace(t, **rubbing) for t in ROD.tendons)
    robot = driven_by_length(replace(ROD, tendons=tendons, damping_time=0.02, density=100.0))
    ways = np.linspace(0, 1, 40), np.ones(20), np.linspace(1, 0.3, 30), np.full(20, 0.3)
    shares, ends = np.concatenate(ways), [59, -1]
    commands = shares[:, None] * np.array([0.002, -0.001, -0.001])
    times = 0.1 * np.arange(len(shares))
    moved = recorded(commands, "length", times=times, time=Time("t"))
    rested = recorded(commands, "length")
    free = replace(robot, tendons=tuple(replace(t, friction=0.0) for t in tendons))
    slow, still, smooth = (
        replay(*pair).simulated[:, 0, 0]
        for pair in ((moved, robot), (rested, robot), (rested, free))
    )
    behind = (still - smooth)[ends]
    assert behind[0] < -0.003 and behind[1] > 0.003
    # MuJoCo's friction is soft, and what is slow still moves.
    assert np.abs(still - slow)[ends].max() < 0.1 * np.abs(behind).min()


def test_servos_with_play_stop_short_by_half_of_it():
    robot = driven_by_length(ROD)
    twin = replace(nominal_twin(robot), backlash=(2e-4, 0.0, 2e-4))
    pull = np.array([0.002, -0.001, -0.001])
    commands = np.array([0.0, 1.0, 0.5, 0.49])[:, None] * pull
    rested = recorded(commands, "length")
    horns = np.array([[0, 0, 0], [0.0019, -0.001, -0.0009], [0.0011, -0.0005, -0.0006]])
    horns = np.append(horns, [[0.00108, -0.00049, -0.00059]], axis=0)
    with_play, there = replay(rested, robot, twin=twin), replay(recorded(horns, "length"), robot)
    assert with_play.simulated == pytest.approx(there.simulated, abs=1e-8)
