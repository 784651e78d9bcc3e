"""Numbers of robot files have ranges with units, and names can be shown and written."""

from dataclasses import fields, replace
from math import inf, nan
from typing import get_args, get_type_hints

import pytest
from robots.test_file import GOOD
from support.bad_files import assert_refused

from softrobot_env.cli import main
from softrobot_env.core.records import Range
from softrobot_env.robots import ARM, RobotParams, Section, find_gripper, find_robot, read_robot
from softrobot_env.robots.file import _Cylinder, _Place
from softrobot_env.robots.parameters import Base, Disc, Drive, Finger, Gripper, Head
from softrobot_env.robots.sensors import Sensor
from softrobot_env.robots.tendons import Tendon

KINDS = (RobotParams, Section, Tendon, Disc, Head, Base, Drive, Sensor, Finger, Gripper)
NUMBERS = [
    (kind, field.name)
    for kind in (*KINDS, _Place, _Cylinder)
    for field in fields(kind)
    # One of those that there are; a table that the kind of hardware it names looks at.
    if field.name not in ("ends_at_section", "hardware")
]


def allowed(hint, within=()):
    """Ranges of all numbers and texts that a hint takes; None of those without one."""
    if hint in (int, float, str):
        yield next((one for one in within if isinstance(one, Range)), None)
    for one in get_args(hint):
        if not isinstance(one, str | Range):
            yield from allowed(one, getattr(hint, "__metadata__", ()))


def test_no_number_is_without_a_finite_range():
    found = 0
    for kind, name in NUMBERS:
        for one in allowed(get_type_hints(kind, include_extras=True)[name]):
            if name in ("kind", "file"):
                continue
            assert one is not None, (kind, name)
            found += 1
            if "printable" not in one.text:
                beyond = [x for x in (-inf, -1e300, 1e300, nan) if one.holds(x)]
                assert not beyond, (kind, name, beyond)
    assert found > 60


DISC = """[[disc]]
station_m = 0.1
mass_kg = 0.1
radius_m = 0.1
thickness_m = 0.3
[[tendon]]"""


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("length_m = 0.2", "length_m = 6e4", r"length_m must be from 1e-06 to 1000 m, got 60000\."),
        (
            "= 4e5",
            "= 0.8",
            r"section\[1\]\.youngs_modulus_Pa must be from 10 to 1e.20 Pa, got 0\.8",
        ),
        (
            "= 1070",
            "= 1e13",
            r"density_kg_m3 must be from 1e-09 to 1e.12 kg/m3, got 10000000000000",
        ),
        ("= 40", "= 1e300", r"tendon\[1\]\.tension_limit_N must be from 1e-12 to 1e.12 N"),
        (
            "radius_m = 0.01\n",
            "offset_m = [1e5, 0]\n",
            r"offset_m\[0\] must be from -1000 to 1000 m",
        ),
        (
            "[[tendon]]",
            DISC,
            r"disc\[1\]\.thickness_m must be at most the robot's length, 0\.2, got 0\.3",
        ),
    ],
)
def test_what_is_out_of_range_is_said_with_its_key_value_and_range(old, new, said, tmp_path):
    path = tmp_path / "my.toml"
    path.write_text(GOOD, "utf-8")
    assert_refused(read_robot, path, old, new, said)


GRIPPER = find_gripper("gripper")
FINGER = GRIPPER.fingers[0]
BAD_NAMES = (
    "",
    "/etc/x",
    "../x",
    "a/b",
    "a\\b",
    "a\0b",
    "a\x1b[2Jb",
    "a\nb",
    "a\u202eb",
    "x" * 101,
)


@pytest.mark.parametrize("name", BAD_NAMES, ids=repr)
def test_a_name_that_is_no_file_name_or_moves_a_screen_is_refused(name):
    for record in (ARM, ARM.tendons[0], find_robot("gripper_finger").sensors[0], FINGER, GRIPPER):
        with pytest.raises(ValueError, match="name must be 1 to 100 printable"):
            replace(record, name=name)


def test_export_writes_in_its_folder_only(tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for text in (r"../../out\u0000", "../beside", "/tmp/elsewhere", r"\u001b[31mred"):
        (tmp_path / "my.toml").write_text(GOOD.replace('"mine"', f'"{text}"'), "utf-8")
        assert main(["export", "--robot", "my.toml", "--out", "inner/out"]) == 2
        (line,) = capsys.readouterr().err.splitlines()
        assert "name must be" in line and line.isprintable()
    assert [path.name for path in tmp_path.iterdir()] == ["my.toml"]
