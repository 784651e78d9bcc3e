"""Robot files: read and written alike, and refused by place; the example robots."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from support.bad_files import assert_refused

from softrobot_env.cli import main
from softrobot_env.core.files import is_in_one_line
from softrobot_env.robots import (
    ARM,
    EXAMPLES,
    RIG,
    Base,
    Disc,
    Head,
    RobotParams,
    Section,
    Sensor,
    Tendon,
    find_robot,
    read_robot,
    write_robot,
)
from softrobot_env.robots.actuation import TendonMap, with_balance
from softrobot_env.robots.twin import nominal_twin

GOOD = """name = "mine"
[[section]]
length_m = 0.2
outer_radius_m = 0.02
youngs_modulus_Pa = 4e5
density_kg_m3 = 1070
damping_time_s = 0.03
[[tendon]]
name = ["a", "b"]
ends_at_section = 1
radius_m = 0.01
tension_limit_N = 40
"""

#: Another tendon, which is driven by length.
MIXED = """= 40
[[tendon]]
name = "c"
end_m = 0.1
radius_m = 0.01
tension_limit_N = 9
drive = "length"
stiffness_N_m = 9
"""

SENSED = """= 40
[[sensor]]
name = "lower"
kind = "planar"
begin_m = 0.0
end_m = 0.1
segments = 5
"""

some = st.floats(-1e3, 1e3)
size = st.floats(1e-3, 1.0)
_names = st.text(st.characters(codec="utf-8"), min_size=1, max_size=100).filter(is_in_one_line)


@st.composite
def _sections(draw):
    outer = draw(size | st.tuples(size, size))
    return Section(
        draw(size), outer, draw(st.floats(1e3, 1e11)), draw(st.floats(1, 1e4)), draw(size),
        draw(st.integers(1, 20)), draw(st.sampled_from([0.0, 1e-4])), draw(st.floats(-0.9, 0.5)),
    )  # fmt: skip


@st.composite
def _tendon(draw, name, length):
    end = length * draw(st.floats(0.1, 1.0))
    place = st.tuples(some, some)
    route = ((end / 2, *draw(place)), (end, *draw(place))) if draw(st.booleans()) else ()
    return Tendon(
        name, draw(place), end, draw(st.integers(0, 5)), draw(st.floats(10, 50)),
        guides=(end / 3,) * draw(st.booleans()),
        stiffness=draw(st.floats(1, 1e4) | st.just(np.inf)),
        pretension=draw(st.floats(0, 5)), friction=draw(size), route=route, turns=draw(some),
    )  # fmt: skip


@st.composite
def _sensors(draw, length):
    plain = Sensor(draw(st.sampled_from("abc")), "planar", 0.0, length / 2, segments=5)
    tags = replace(plain, kind="tags", segments=2, noise=draw(size), rate=30.0, delay=0.04)
    erring = plain.with_imperfections(draw(st.floats(0.1, 2.0)), draw(st.integers(0, 99)))
    return draw(st.sampled_from([plain, tags, erring]))


@st.composite
def _robots(draw):
    sections = tuple(draw(st.lists(_sections(), min_size=1, max_size=3)))
    length = float(sum(s.length for s in sections))
    inertia = draw(st.sampled_from([(1e-6, 1e-6, 2e-6), (3e-7, 4e-7, 5e-7)]))
    names = draw(st.lists(_names, max_size=3))
    vector = st.tuples(some, some, some)
    base = Base(draw(vector), (0.1, draw(some), 1.0), draw(some))
    return RobotParams(
        draw(_names),
        sections=sections,
        tendons=tuple(draw(_tendon(n, length)) for n in dict.fromkeys(names)),
        gravity=draw(vector),
        head=draw(st.sampled_from([None, Head(0.1, 0.0, inertia, 0.02)])),
        anisotropy=draw(st.floats(0, 1.9)),
        stiff_azimuth=draw(some),
        precurvature=(draw(st.floats(-0.5, 0.5)), 0.1),
        discs=(Disc(length / 3, draw(size), inertia),) * draw(st.integers(0, 2)),
        base=draw(st.sampled_from([None, Base(), base])),
        sensors=tuple(draw(st.lists(_sensors(length), max_size=2, unique_by=lambda x: x.name))),
    )


@settings(max_examples=20, deadline=None)
@given(robot=_robots())
def test_what_is_written_is_read_as_the_same_robot(robot, tmp_path_factory):
    path = tmp_path_factory.mktemp("robot") / "robot.toml"
    write_robot(robot, path)
    assert read_robot(path) == robot


ROD = find_robot("silicone_rod")
LOOSE = replace(ROD, name="loose", drive=replace(ROD.drive, backlash=5e-4))


@pytest.mark.parametrize(
    "robot", [ARM, RIG, *map(find_robot, EXAMPLES), LOOSE], ids=lambda r: r.name
)
def test_robots_with_their_drives_are_written_and_read(robot, tmp_path):
    write_robot(robot, tmp_path / "x.toml")
    assert read_robot(tmp_path / "x.toml") == robot
    assert robot is LOOSE or find_robot(robot.name) == robot
    if robot is LOOSE:
        assert nominal_twin(robot).backlash == (5e-4,) * 3


@pytest.mark.parametrize("name", ["rig", "silicone_rod", "hanging_trunk"])
def test_pretensions_of_moved_tendons_are_balanced(name):
    """As near as may be; what was balanced stays as it is."""
    robot, rng = find_robot(name), np.random.default_rng(0)
    same = [t.pretension for t in with_balance(robot).tendons]
    assert same == pytest.approx([t.pretension for t in robot.tendons])
    moved = tuple(
        replace(t.turned(0.1 * rng.uniform(), 1 + 0.1 * rng.uniform()), pretension=rng.uniform(1))
        for t in robot.tendons
    )
    unbalanced = replace(robot, tendons=moved)
    with pytest.raises(ValueError, match="must cancel each other"):
        TendonMap(unbalanced)
    found = with_balance(unbalanced)
    TendonMap(found)
    assert min(t.pretension for t in found.tendons) >= 0
    for g in {t.group for t in robot.tendons}:
        places = np.array([t.offset for t in found.tendons if t.group == g])
        pulls = np.array([t.pretension for t in found.tendons if t.group == g])
        assert np.abs(pulls @ places).max() < 1e-12


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("length_m = 0.2", "length_mm = 200", r"section\[1\]\.length_mm is no key; allowed are"),
        ("length_m = 0.2\n", "", r"section\[1\]: length_m missing"),
        ("outer_radius_m = 0.02", "outer_radius_m = -1", r"section\[1\]\.outer_radius_m must be"),
        ("= 1070", '= "much"', r"section\[1\]\.density_kg_m3 must be from 1e-09 to 1e.12 kg/m3"),
        ("ends_at_section = 1", "ends_at_section = 2", r"tendon\[1\]\.ends_at_section must be"),
        ("ends_at_section = 1", "end_m = 0.3", r"tendon\[1\]\.end_m must be at most"),
        ("radius_m = 0.01\n", "radius_m = 0.01\noffset_m = [0, 0]\n", "not both"),
        ("radius_m = 0.01\n", 'radius_m = 0.01\ndrive = "air"\n', r"tendon\[1\]\.drive must be"),
        ("radius_m = 0.01\n", 'radius_m = 0.01\ndrive = "length"\n', "finite stiffness"),
        ('name = "mine"', 'name = "mine"\nbase = 3', "base must be a table"),
        ('name = "mine"', "name = mine", "no TOML"),
        ('name = "mine"', f"name = {'[' * 3000}{']' * 3000}", "nested too deeply"),
        ('["a", "b"]', '["a", "a"]', "different names"),
        ('["a", "b"]', "[]", r"tendon\[1\]\.name must be 1 to 100 printable"),
        ("= 40\n", SENSED.replace("0.1", "0.75"), r"sensor\[1\].end_m must be at most the robot's"),
        ("= 40\n", SENSED.replace("planar", "round"), r"sensor\[1\].kind must be one of"),
        ("= 40\n", SENSED.replace("segm", "s"), r"sensor\[1\].sents is no key; allowed are name"),
        ("= 40\n", MIXED, r"tendon\[2\]\.drive must be 'tension' as in tendon\[1\]"),
    ],
)
def test_bad_files_are_refused_in_one_line_with_file_and_key(old, new, said, tmp_path, capsys):
    path = tmp_path / "my.toml"
    path.write_text(GOOD, "utf-8")
    assert_refused(read_robot, path, old, new, f"^{path}: .*{said}")
    assert main(["robot-file", "check", str(path)]) == 2
    assert capsys.readouterr().err.count("\n") == 1


def test_several_names_stand_at_equal_angles(tmp_path):
    (tmp_path / "my.toml").write_text(GOOD, "utf-8")
    assert [t.offset for t in read_robot(tmp_path / "my.toml").tendons] == [(0.01, 0), (-0.01, 0)]


def test_commands_take_a_robot_by_file_or_name(tmp_path, capsys):
    path = tmp_path / "my.toml"
    write_robot(replace(find_robot("ftdcr_v4"), name="mine"), path)
    assert main(["robot-file", "check", str(path)]) == 0
    assert capsys.readouterr().out.count("\n") == 1
    assert main(["export", "--robot", str(path), "--out", str(tmp_path)]) == 0
    assert (tmp_path / "mine.xml").exists() and (tmp_path / "mine_view.xml").exists()
    assert main(["inspect", "--robot", "planar_finger"]) == 0
    assert "upper_front" in capsys.readouterr().out
