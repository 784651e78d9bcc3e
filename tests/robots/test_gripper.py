"""Grippers as files and as objects."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from support.bad_files import assert_refused

from softrobot_env.robots import ARM, Base, Finger, find_gripper, read_gripper
from softrobot_env.robots.file import write_gripper

GRIPPER = find_gripper("gripper")


def test_the_gripper_is_that_of_the_audit():
    for finger in GRIPPER.fingers:
        robot = finger.robot
        assert (robot.length, robot.pieces, robot.outer_radius) == (0.09, 3, 0.003)
        width, height, modulus = 0.020, 0.006, 2.04e6
        assert robot.bending_stiffness == pytest.approx(modulus * width * height**3 / 12, rel=1e-3)
    left, middle, right = (finger.base.axes for finger in GRIPPER.fingers)
    assert np.degrees(np.arccos(left[:, 2] @ middle[:, 2])) == pytest.approx(90)
    np.testing.assert_allclose(left, right)
    for finger in GRIPPER.fingers:  # bent towards the middle
        assert finger.base.axes[:, 0] @ np.array(finger.base.position) < 0


def test_a_file_and_an_object_are_the_same(tmp_path):
    write_gripper(GRIPPER, tmp_path / "mine.toml")
    again = find_gripper(str(tmp_path / "mine.toml"))
    assert again == GRIPPER and again.file == tmp_path / "mine.toml"
    assert again.fingers[0].robot.file == tmp_path / "gripper_finger.toml"


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ('name = "gripper"', 'nome = "gripper"', "nome is no key; allowed are name"),
        ('robot = "gripper_finger.toml"', 'roboter = "x"', r"finger\[1\].roboter is no key"),
        ("direction = [", "directions = [", r"finger\[1\].base.directions is no key"),
        ('name = "left"', 'name = "middle"', "fingers need different names"),
        ("palm_m = [", "palm_m = [-", "palm_m must be"),
    ],
)
def test_what_is_wrong_in_a_file_is_named(tmp_path, old, new, message):
    write_gripper(GRIPPER, tmp_path / "mine.toml")
    assert_refused(read_gripper, tmp_path / "mine.toml", old, new, message)


def test_a_round_thing_is_seated_on_the_palm_or_between_the_fingers():
    assert GRIPPER.seat(0.03) == pytest.approx(np.sqrt(2) * 0.033 - 0.013, abs=1e-5)
    flat = replace(GRIPPER, fingers=(Finger("one", ARM, Base()),))
    assert flat.seat(0.03) == 0.03
    assert Path(GRIPPER.file).exists()
