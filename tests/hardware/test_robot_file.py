from dataclasses import replace

import numpy as np
import pytest
from support.bad_files import assert_refused
from support.hardware_boards import Bench

from softrobot_env.hardware.robot_file import (
    LONGEST_PULSE,
    SHORTEST_PULSE,
    Calibration,
    RobotFile,
    Servo,
    Supervision,
    Tip,
    read_robot_file,
    rig_file,
    write_robot_file,
)
from softrobot_env.robots import SERVO_SPEED


def test_a_file_is_read_as_it_was_written(tmp_path):
    tip = Tip("sensors", {"offset": [0.0, 0.001], "deep": {"a b": 'quote " ü'}})
    robot = replace(rig_file("/dev/robot"), tip=tip, supervision=Supervision(adc_channels=(0, 2)))
    write_robot_file(robot, tmp_path / "robot.toml")
    assert read_robot_file(tmp_path / "robot.toml") == robot


def test_parts_may_be_left_out(tmp_path):
    path = tmp_path / "short.toml"
    path.write_text(
        'name = "one"\nport = "/dev/x"\n[[tendons]]\nchannel = 0\ncenter_us = 1500\n'
        "gain_us_per_mm = -20\nminimum_mm = -1.5\nmaximum_mm = 2\n"
    )
    servo = Servo(0, 1500e-6, -0.02, -1.5e-3, 2e-3)
    assert read_robot_file(path) == RobotFile("one", "/dev/x", (servo,))


@pytest.mark.parametrize(
    ("old", "new", "complaint"),
    [
        ("ttl_ms = 50.0", "ttl_ms = 5000", r"ttl_ms must be in \[1, 1000\] in steps of 1"),
        ("ttl_ms = 50.0", "ttl_ms = 101", "ttl_ms must not be larger than watchdog_ms"),
        ("ttl_ms = 50.0", 'ttl_ms = "50"', "ttl_ms must be in .* got '50'"),
        ("ttl_ms = 50.0", "ttl_ms = nan", "ttl_ms must be in .* got nan"),
        ("watchdog_ms = 100.0", "watchdog_ms = 30", "twice control_period_ms"),
        ("state_delay_ms = 12.0", "state_delay_ms = 20", "smaller than control_period_ms"),
        ("ramp_mm_per_s = 30.0", "ramp_mm_per_s = 5.99", "within 10 s: at least 6 mm/s"),
        ("slew_mm_per_s = ", "slew_mm_per_s = 5 # ", "within 10 s: at least 6 mm/s"),
        ("baud = 500000", "baud = 9600", "baud must be one of 57600, 115200"),
        ("baud = 500000", "bauds = 500000", "bauds is no key; allowed are name, port"),
        ('name = "rig"', "", "name missing"),
        ('name = "rig"', 'name = ""', "name must be 1 to 100 printable"),
        ("rest_mm = 0.0", "rest_mm = 0.004", r"rest_mm must be in .* steps of 0.01, got 0.0"),
        ("rest_mm = 0.0", "rest_mm = 31", r"tendons\[1\]: minimum_mm <= rest_mm <= maximum_mm"),
        ("gain_us_per_mm = 31.83", "gain_us_per_mm = 0", "gain_us_per_mm must not be zero"),
        ("maximum_mm = 30.0", "maximum_mm = 35", "maximum_mm means a pulse of 2614 µs"),
        ("channel = 1", "channel = 2", r"channels 0 to 2, each once, got \[0, 2, 2\]"),
        ("adc_channels = []", "adc_channels = [4]", r"supervision.adc_channels\[0\] must be"),
        ("adc_low = 8", "adc_low = 4090", "supervision: adc_low must be smaller"),
        ('kind = "udp"', "", "tip: kind must be a text"),
        ('kind = "udp"', 'kind = "udp"\noffset = [0.0, {x = nan}]', "tip: offset must be finite"),
        ("[tip]", "[tips]", "tips is no key"),
        ("[[tendons]]", "[[tendons", "no TOML"),
    ],
)
def test_what_is_not_allowed_is_told_with_file_and_key(tmp_path, old, new, complaint):
    path = tmp_path / "rig.toml"
    write_robot_file(rig_file(), path)
    assert_refused(read_robot_file, path, old, new, f"{path}.*{complaint}")


def test_numbers_reach_the_wire_in_the_order_of_channels():
    first, second, third = rig_file().tendons
    first, second = replace(first, channel=2, maximum=0.025), replace(second, channel=0)
    third = replace(third, channel=1, gain=-31.83e-3)
    config = replace(rig_file(), tendons=(first, second, third)).to_message()
    assert config.maximum == (3000, 3000, 2500)
    assert config.gain == (3183, -3183, 3183)
    assert config.watchdog_ms == 100 and config.state_delay_us == 12000
    assert config.ramp == 3000 and config.vbus_min == 4800


def test_the_rig_is_no_faster_than_its_servos():
    slew = rig_file().to_message().slew[0] * 1e-5
    assert SERVO_SPEED - 1e-5 < slew <= SERVO_SPEED


def test_pulses_of_the_board_are_those_of_the_file():
    bench = Bench().start()
    for _ in range(20):
        bench.command([0.01, 0.0, -0.02])
    wanted = [1e6 * s.pulse(x) for s, x in zip(bench.robot.tendons, (0.01, 0, -0.02), strict=True)]
    np.testing.assert_allclose(bench.board.core.outputs.pulse_us, wanted, atol=1)


# ---------------------------------------------------------------- calibration
STEP = 1e-5


def obey(lines, robot=None):
    found = Calibration.begin(robot or rig_file(), np.zeros(3))
    for line in lines:
        found = found.obey(line)
    return found


def test_jogging_may_use_all_pulses_and_no_more():
    servos = rig_file().jogged().tendons
    pulses = [servo.pulse(x) for servo in servos for x in (servo.minimum, servo.maximum)]
    assert min(pulses) >= SHORTEST_PULSE and max(pulses) <= LONGEST_PULSE
    np.testing.assert_allclose(pulses, [SHORTEST_PULSE, LONGEST_PULSE] * 3, atol=0.5e-6)


def test_jogging_goes_no_farther_than_the_longest_ramp():
    """A winch of 600 mm for all pulses, where the file allows 40 mm to one side."""
    servos = tuple(replace(s, gain=3e-3, minimum=0.0, maximum=0.04) for s in rig_file().tendons)
    robot = replace(rig_file(), tendons=servos, ramp=0.01)
    for servo in robot.jogged().tendons:
        assert (servo.minimum, servo.maximum) == pytest.approx((-0.03, 0.07))


def test_a_board_with_a_zero_of_its_own_keeps_it():
    begun = Calibration.begin(rig_file(), np.zeros(3), keeps_zero=True).obey("+1")
    with pytest.raises(ValueError, match="lengths from its own zero"):
        begun.obey("zero")
    assert begun.obey("max").result().tendons[0].maximum == pytest.approx(1e-3)


def test_jogs_add_up_for_the_chosen_tendon():
    np.testing.assert_allclose(obey(["+1.5", "t 3", "-2", "+0.25"]).target, [1.5e-3, 0, -1.75e-3])


@pytest.mark.parametrize("gain", [31.83e-3, -20e-3])
def test_marks_keep_their_place_when_zero_moves(gain):
    """The pulse at each mark is the one that the servo had when it was marked."""
    servos = tuple(replace(s, gain=gain, minimum=-5e-3, maximum=5e-3) for s in rig_file().tendons)
    robot = replace(rig_file(), tendons=servos)
    lines = ["t 2", "-3", "min", "+4", "rest", "+1", "zero", "+6", "max"]
    before, after = servos[1], obey(lines, robot).result().tendons[1]
    for name, marked in (("minimum", -3e-3), ("rest", 1e-3), ("maximum", 8e-3)):
        moved = after.pulse(getattr(after, name)) - before.pulse(marked)
        assert abs(moved) <= abs(gain) * STEP
    assert abs(after.pulse(0.0) - before.pulse(2e-3)) <= 0.5e-6


@pytest.mark.parametrize(
    ("lines", "complaint"),
    [
        (["t 4"], "the tendons are 1 to 3, got '4'"),
        (["up"], "unknown command 'up'"),
        (["+x"], "'.x' is no way in mm"),
        (["+nan"], "is no way in mm"),
        (["+40"], r"the servo reaches -34\.55 to 34\.55 mm"),
        (["+5", "min"], "minimum_mm <= rest_mm <= maximum_mm"),
    ],
)
def test_wrong_lines_and_marks_that_contradict_are_refused(lines, complaint):
    with pytest.raises(ValueError, match=complaint):
        obey(lines).result()
