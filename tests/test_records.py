"""Records: what fields refuse, in one line, and how tables of files are read and written."""

import json
import tomllib
from dataclasses import dataclass, fields, replace
from math import inf, nan
from typing import Annotated

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from softrobot_env.core.files import is_in_one_line, text
from softrobot_env.core.records import (
    Key,
    Positive,
    Range,
    Unit,
    check_fields,
    keys,
    placed,
    read,
    unwritten,
    write,
)
from softrobot_env.envs.rewards import TrackingReward
from softrobot_env.hardware.robot_file import RobotFile, Servo, Supervision
from softrobot_env.recordings import Commands, Frame, Header, Time
from softrobot_env.recordings import Marker as Measured
from softrobot_env.robots import ARM, RIG, Load
from softrobot_env.robots.twin import rig3d_twin
from softrobot_env.scene.config import Appearance, Camera, Marker, PathMarker, SceneConfig
from softrobot_env.tasks import SetPoints, make_task
from softrobot_env.tasks.smooth_paths import SmoothRun, circle
from softrobot_env.tasks.trajectories import CurveSweep, EqualForceCurve, Polyline, Step
from softrobot_env.thesis.arm.mpc_settings import PREVIEW as MPC_PREVIEW
from softrobot_env.thesis.arm.mpc_settings import THESIS as MPC_THESIS
from softrobot_env.thesis.arm.quasi_static import Sampling
from softrobot_env.thesis.trajectories import LapCircle, RoundedTriangle

POINTS = ((0.1, 0.0, 0.4), (0.2, 0.0, 0.3))
CIRCLE = circle(*POINTS)

RECORDS = (
    ARM,
    RIG,
    ARM.tendons[0],
    RIG.head,
    Load("push", 0.1),
    rig3d_twin(0),
    SceneConfig(ARM),
    Camera("side", (0.0, 1.0), 1.0),
    Marker("target", POINTS[0]),
    PathMarker("path", POINTS),
    Appearance(),
    make_task("swing"),
    make_task("triangle"),
    Step(*POINTS),
    Polyline(POINTS, (0.0, 1.0)),
    EqualForceCurve(0.5),
    CurveSweep(EqualForceCurve(0.5), 0.5, 0.1),
    CIRCLE,
    SmoothRun(CIRCLE, 0.1),
    RoundedTriangle(),
    LapCircle(),
    SetPoints(POINTS, 1.0),
    TrackingReward(),
    Sampling(),
    MPC_THESIS,
    MPC_PREVIEW,
)

#: What no field may hold, but for the exceptions.
STRANGE = (nan, -inf, (nan,) * 2, (nan,) * 3, (1.0, inf), "", b"x", {}, object(), np.array(nan))

CASES = [(record, field.name) for record in RECORDS for field in fields(record)]


def refusal(record, name, value):
    """The message with which a value of a field is refused."""
    with pytest.raises(ValueError, match=name) as caught:
        replace(record, **{name: value})
    return str(caught.value)


@pytest.mark.parametrize(("record", "name"), CASES, ids=lambda x: getattr(x, "name", str(x))[:20])
def test_strange_values_are_refused_by_name(record, name):
    for value in STRANGE:
        message = refusal(record, name, value)
        assert "must be" in message and "\n" not in message and len(message) < 300


@pytest.mark.parametrize(("record", "name"), CASES, ids=lambda x: getattr(x, "name", str(x))[:20])
def test_numbers_are_no_texts_and_texts_no_numbers(record, name):
    """Nor are truth values numbers."""
    value = getattr(record, name)
    if name == "accuracy":
        replace(record, accuracy=1e-3)  # a length or a share as text
        refusal(record, name, True)
    elif isinstance(value, str):
        refusal(record, name, 1.0)
    elif isinstance(value, bool):
        refusal(record, name, 1)
    elif isinstance(value, int | float):
        refusal(record, name, str(value))
        refusal(record, name, True)
    elif isinstance(value, tuple) and value:
        refusal(record, name, value[0])
        refusal(record, name, (*value, "one more"))
        assert "[0]" in refusal(record, name, (None, *value[1:]))


@pytest.mark.parametrize(
    ("record", "changes", "reason"),
    [
        *((ARM, {"poisson_ratio": x}, "poisson_ratio") for x in (0.6, -1.0, -2.0, 0.5000001)),
        *((ARM, {x: 0.0}, x) for x in ("length", "outer_radius", "youngs_modulus", "density")),
        *((ARM, {x: -1.0}, x) for x in ("inner_radius", "damping_time", "anisotropy")),
        *((ARM, {"pieces": x}, "pieces") for x in (0, -1, 1.5, 6.0)),
        (ARM, {"gravity": (0.0, -9.81)}, "gravity"),
        (ARM, {"tendons": (ARM.tendons[0],) * 2}, "tendons need different names"),
        (ARM, {"outer_radius": 1e-100, "inner_radius": 0.0}, "outer_radius must be from 1e-07"),
        (ARM, {"inner_radius": np.nextafter(0.025, 0)}, "inner_radius < outer_radius"),
        (RIG, {"precurvature": (0.0, 0.0, 0.0)}, "precurvature"),
        (ARM.tendons[0], {"stiffness": 0.0}, "stiffness"),
        (ARM.tendons[0], {"tension_limit": inf}, "tension_limit"),
        (ARM.tendons[0], {"guides": (0.1, nan)}, "guides"),
        (RIG.head, {"inertia": (1e-6, 1e-6)}, "inertia"),
        (RIG.head, {"inertia": (1e-6, 1e-6, 3e-6)}, "sum of the other two"),
        (RIG.head, {"output": -0.01}, "output"),
        (SceneConfig(ARM), {"pieces": 0}, "pieces"),
        (SceneConfig(ARM), {"torsion": 1}, "torsion"),
        (SceneConfig(ARM), {"loads": (Load("a", 0.1), Load("a", 0.2))}, "different names, 'a'"),
        (Load("push", 0.1), {"station": -0.1}, "station"),
        (Appearance(), {"link_rgba": (0.0, 0.0, 0.0, 1.5)}, "link_rgba"),
        (make_task("triangle"), {"axes": "yz"}, "axes"),
        (make_task("triangle"), {"duration": 0.0}, "duration"),
        (TrackingReward(), {"fine_scale": 0.0}, "fine_scale"),
    ],
    ids=str,
)
def test_what_is_not_physical_or_does_not_go_together_is_refused(record, changes, reason):
    with pytest.raises(ValueError, match=reason):
        replace(record, **changes)


def test_lists_and_arrays_are_kept_as_tuples():
    """So that what is equal compares as equal."""
    for gravity in ([0, 0, -9.81], np.array([0, 0, -9.81])):
        assert replace(RIG, gravity=gravity) == RIG
    assert replace(ARM.tendons[0], guides=[0.05, 0.1]).guides == (0.05, 0.1)
    assert replace(ARM, length=np.float64(ARM.length), pieces=np.int64(6)) == ARM


@dataclass(frozen=True)
class Sample:
    choice: Annotated[float, Range("a share", lambda x: 0 <= x <= 1)] = 0.5
    either: tuple[int, str] | None = None
    many: tuple[tuple[float, ...], ...] = ()

    def __post_init__(self) -> None:
        check_fields(self, "sample")


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"choice": 2}, "sample: choice must be a share, got 2"),
        ({"either": (1.5, "a")}, "either must be None or a tuple of 2, each a whole number or a"),
        ({"many": ((1.0,), (2.0, nan))}, "many[1][1] must be a finite number, got nan"),
        ({"many": (1.0,)}, "many[0] must be a tuple, each entry a finite number, got 1.0"),
        ({"many": "long " * 99}, "..."),
    ],
    ids=str,
)
def test_messages_name_the_place(change, message):
    with pytest.raises(ValueError) as caught:
        Sample(**change)
    assert message in str(caught.value) and len(str(caught.value)) < 250
    assert Sample(0, (1, "a"), [[1, 2], []]).many == ((1, 2), ())


# ---------------------------------------------------------------- tables of files and rows


@dataclass(frozen=True)
class Part:
    size: Annotated[Positive, Unit("m")]
    time: Annotated[float, Unit("ms", 1e-3), Range("in [0, 9]", lambda x: 0 <= x <= 9)] = 2e-3

    def __post_init__(self) -> None:
        check_fields(self, "part")
        if self.size > 100:
            raise ValueError(f"part: size must be at most 100, got {self.size}")


@dataclass(frozen=True)
class Machine:
    name: str
    parts: Annotated[tuple[Part, ...], Key("part")] = ()
    spare: Part | None = None
    scale: Annotated[tuple[float, ...] | None, Unit("1/m")] = None
    hidden: int = unwritten(3)


def test_keys_and_defaults_follow_from_the_fields():
    assert list(keys(Machine)) == ["name", "part", "spare", "scale_1_m"]
    assert list(keys(Part)) == ["size_m", "time_ms"]
    assert write(Machine("a", hidden=4)) == {"name": "a"}
    assert write(Machine("a", spare=Part(2.0, 5e-3)), full=True) == {
        "name": "a",
        "part": [],
        "spare": {"size_m": 2.0, "time_ms": 5.0},
        "scale_1_m": None,
    }


@pytest.mark.parametrize(
    ("said", "message"),
    [
        ({"part": 1}, "my.toml: name missing"),
        ({"name": "a", "hidden": 1}, "hidden is no key; allowed are name, part, spare, scale_1_m"),
        ({"name": ""}, "my.toml: name must be a text that is not empty, got ''"),
        ({"name": "a", "part": [{}]}, "my.toml: part[1]: size_m missing"),
        ({"name": "a", "part": {"size_m": 1}}, "part must be tables, each begun with [[part]]"),
        ({"name": "a", "part": [{"size_m": 1}, {"size_m": -1}]}, "part[2].size_m must be finite"),
        ({"name": "a", "spare": 3}, "spare must be a table, got 3"),
        ({"name": "a", "spare": {"size_m": 1, "x": 1}}, "spare.x is no key; allowed are size_m"),
        ({"name": "a", "spare": {"size_m": 1, "time_ms": 10}}, "spare.time_ms must be in [0, 9]"),
        ({"name": "a", "spare": {"size_m": 200}}, "spare: part: size_m must be at most 100"),
        ({"name": "a", "scale_1_m": 3}, "scale_1_m must be None or a list, each entry a finite"),
        ({"name": "a", "scale_1_m": [1, inf]}, "scale_1_m"),
    ],
    ids=str,
)
def test_tables_are_refused_in_a_line_with_their_place(said, message):
    with pytest.raises(ValueError) as caught, placed("my.toml"):
        read(Machine, said)
    assert message in str(caught.value) and "\n" not in str(caught.value)
    assert str(caught.value).startswith("my.toml: ")


def test_ranges_are_those_of_the_unit_in_files():
    with pytest.raises(ValueError, match=r"part: time_ms must be in \[0, 9\], got 20\.0"):
        Part(1.0, 0.02)


def test_numbers_of_files_are_decimal_after_a_change_of_units():
    unit = Unit("ms", 1e-3)
    assert unit.read(12.3456789) == 0.0123456789 and unit.written(0.0123456789) == 12.3456789
    assert unit.read(7) == 0.007 and unit.written(0.007) == 7


words = st.text(st.characters(codec="utf-8"), min_size=1)
names = st.text(st.characters(codec="utf-8"), min_size=1, max_size=100).filter(is_in_one_line)
numbers = st.floats(-1e9, 1e9)
sizes = st.floats(1e-9, 100)
steps = st.integers(100, 900).map(lambda count: round(1e-5 * count, 12))
parts = st.builds(Part, sizes, st.integers(0, 9).map(lambda count: round(1e-3 * count, 12)))
machines = st.builds(
    Machine,
    words,
    st.lists(parts, max_size=3).map(tuple),
    st.none() | parts,
    st.none() | st.lists(numbers, max_size=3).map(tuple),
)


@st.composite
def headers(draw):
    columns = tuple(draw(st.lists(words, min_size=1, max_size=3, unique=True)))
    each = st.tuples(*[numbers] * len(columns))
    vector = st.tuples(numbers, numbers, numbers)
    marker = st.builds(
        Measured, words, unit=st.sampled_from(["m", "cm", "mm"]), station_m=st.none() | sizes,
        offset_m=vector, delay_s=sizes, may_be_lost=st.booleans(),
    )  # fmt: skip
    commands = Commands(
        "length", columns, draw(st.sampled_from(["m", "mm"])),
        draw(st.sampled_from([None, columns])), draw(st.none() | each),
        draw(st.none() | each), draw(st.sampled_from(["from", "until"])),
    )  # fmt: skip
    timing = {"time": Time(draw(words), "ms")} if draw(st.booleans()) else {"rate_Hz": draw(sizes)}
    return Header(
        commands, tuple(draw(st.lists(marker, max_size=2))), **timing, runs=draw(st.none() | words),
        static=draw(st.booleans()), label=draw(st.none() | words),
        label_ends=tuple(draw(st.lists(words, max_size=2))),
        frame=Frame(draw(st.sampled_from([("x", "y", "z"), ("-y", "x", "z")])), draw(vector)),
        robot=draw(st.none() | words),
    )  # fmt: skip


@st.composite
def hardware(draw):
    servos = tuple(
        Servo(k, 1500e-6, draw(st.sampled_from([0.03183, -0.02])), -draw(steps), draw(steps))
        for k in range(draw(st.integers(1, 6)))
    )
    watched = Supervision(draw(steps), adc_channels=tuple(draw(st.lists(st.integers(0, 3)))))
    return RobotFile(
        draw(names), draw(words), servos, ramp=round(0.1 + draw(steps), 12), supervision=watched
    )


@settings(max_examples=60, deadline=None)
@given(record=machines | headers() | hardware())
def test_records_of_all_kinds_are_written_and_read_to_the_last_bit(record):
    tables = {"tip": lambda table, where: record.tip}  # whose options are no fields
    assert read(type(record), tomllib.loads(text(write(record))), readers=tables) == record
    row = json.loads(json.dumps(write(record, full=True)))
    assert read(type(record), {k: v for k, v in row.items() if v is not None}, "", tables) == record
