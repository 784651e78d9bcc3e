from dataclasses import replace

import numpy as np
import pytest

from softrobot_env.hardware.calibration import Calibration, jog_file
from softrobot_env.hardware.robot_file import LONGEST_PULSE, SHORTEST_PULSE, rig_file

STEP = 1e-5


def obey(lines, robot=None):
    found = Calibration.begin(robot or rig_file(), np.zeros(3))
    for line in lines:
        found = found.obey(line)
    return found


def test_jogging_may_use_all_pulses_and_no_more():
    servos = jog_file(rig_file()).tendons
    pulses = [servo.pulse(x) for servo in servos for x in (servo.minimum, servo.maximum)]
    assert min(pulses) >= SHORTEST_PULSE and max(pulses) <= LONGEST_PULSE
    np.testing.assert_allclose(pulses, [SHORTEST_PULSE, LONGEST_PULSE] * 3, atol=0.5e-6)


def test_jogging_goes_no_farther_than_the_longest_ramp():
    """A winch of 600 mm for all pulses, where the file allows 40 mm to one side."""
    servos = tuple(replace(s, gain=3e-3, minimum=0.0, maximum=0.04) for s in rig_file().tendons)
    robot = replace(rig_file(), tendons=servos, ramp=0.01)
    for servo in jog_file(robot).tendons:
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


def test_marks_that_contradict_are_refused():
    with pytest.raises(ValueError, match="minimum_mm <= rest_mm <= maximum_mm"):
        obey(["+5", "min"]).result()


@pytest.mark.parametrize(
    ("line", "complaint"),
    [
        ("t 4", "the tendons are 1 to 3, got '4'"),
        ("up", "unknown command 'up'"),
        ("+x", "'.x' is no way in mm"),
        ("+nan", "is no way in mm"),
        ("+40", r"the servo reaches -34\.55 to 34\.55 mm"),
    ],
)
def test_a_wrong_line_is_told(line, complaint):
    with pytest.raises(ValueError, match=complaint):
        obey([line])
