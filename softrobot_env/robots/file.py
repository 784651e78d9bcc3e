"""Robot descriptions as TOML files: SI units in their keys, `RobotParams` both ways.

`KEYS` has the key of each field. A `[[tendon]]` with a list of names is as many tendons at equal
angles. Places in messages count from 1: `section[1]` is the section at the base.
"""

import re
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import MISSING, asdict, fields, replace
from math import ceil, inf, radians
from pathlib import Path
from typing import Any, get_type_hints

from softrobot_env.core.records import NotNegative, Positive, check_argument
from softrobot_env.core.toml_text import lines, read_table
from softrobot_env.core.writing import write_text
from softrobot_env.robots.gripper import Finger, Gripper
from softrobot_env.robots.parameters import Base, Disc, Drive, DriveKind, Head, RobotParams
from softrobot_env.robots.sections import Section
from softrobot_env.robots.sensors import Sensor
from softrobot_env.robots.tendons import Tendon

#: Fewest pieces of a section whose table does not say it, and of one through which a tendon runs
#: that is not straight: shapes at rest are then within 0.5 % of the length of the exact ones
#: (`softrobot benchmark sections`).
PIECES, WINDING_PIECES = 6, 12

#: Keys of the fields of each data class.
KEYS: dict[type, dict[str, str]] = {
    RobotParams: {
        "name": "name",
        "gravity": "gravity_m_s2",
        "anisotropy": "anisotropy",
        "stiff_azimuth": "stiff_azimuth_rad",
        "precurvature": "precurvature_1_m",
    },
    Base: {"position": "position_m", "direction": "direction", "roll": "roll_rad"},
    Head: {
        "mass": "mass_kg",
        "centre": "centre_m",
        "inertia": "inertia_kg_m2",
        "output": "output_m",
    },
    Section: {
        "length": "length_m",
        "outer_radius": "outer_radius_m",
        "inner_radius": "inner_radius_m",
        "youngs_modulus": "youngs_modulus_Pa",
        "poisson_ratio": "poisson_ratio",
        "density": "density_kg_m3",
        "damping_time": "damping_time_s",
        "pieces": "pieces",
        "bending_friction": "bending_friction_N_m",
    },
    Tendon: {
        "name": "name",
        "offset": "offset_m",
        "end": "end_m",
        "group": "group",
        "route": "route_m",
        "turns": "helix_turns",
        "guides": "guides_m",
        "tension_limit": "tension_limit_N",
        "pretension": "pretension_N",
        "friction": "friction_N",
        "stiffness": "stiffness_N_m",
    },
    Disc: {"station": "station_m", "mass": "mass_kg", "inertia": "inertia_kg_m2"},
    Gripper: {"name": "name", "gravity": "gravity_m_s2", "palm": "palm_m"},
    Finger: {"name": "name"},
    Sensor: {
        "name": "name",
        "kind": "kind",
        "begin": "begin_m",
        "end": "end_m",
        "segments": "segments",
        "offset": "offset_m",
        "azimuth": "azimuth_rad",
        "acceptance": "acceptance_rad",
        "noise": "noise",
        "rate": "rate_Hz",
        "delay": "delay_s",
        "temperature": "temperature_K",
        "drift": "drift",
        "hysteresis": "hysteresis",
        "stretch": "stretch",
        "stray": "stray_1_N",
        "flicker": "flicker",
        "spread": "spread",
        "specimen": "specimen",
    },
}

#: Keys of a drive, which stand in the tables of the tendons.
_DRIVE_KEYS = {
    "kind": "drive",
    "speed": "speed_m_s",
    "travel": "travel_m",
    "backlash": "backlash_m",
}

#: Keys that are not fields, and what they may hold.
_SHORT: dict[type, dict[str, Any]] = {
    RobotParams: {
        "base": dict,
        "head": dict,
        "section": list,
        "tendon": list,
        "disc": list,
        "sensor": list,
    },
    Tendon: {
        "ends_at_section": int,
        "radius_m": Positive,
        "angle_deg": float,
        "drive": DriveKind,
        "speed_m_s": Positive,
        "travel_m": Positive,
        "backlash_m": NotNegative,
    },
    Disc: {"radius_m": Positive, "thickness_m": Positive},
    Gripper: {"finger": list},
    Finger: {"robot": str, "base": dict},
}


def read_robot(path: Path | str) -> RobotParams:
    """The robot that a file describes.

    Raises:
        ValueError: The file says what is not allowed; one line with file and key.
        OSError: The file cannot be read.
    """
    with _told_of(f"{path}: "):
        return replace(_robot(read_table(Path(path))), file=Path(path).resolve())


def write_robot(robot: RobotParams, path: Path | str, notes: Sequence[str] = ()) -> None:
    """Write a file that is read as the same robot, with lines of notes above as comments."""
    write_text(path, "".join(f"# {note}".rstrip() + "\n" for note in notes) + _text(robot))


def read_gripper(path: Path | str) -> Gripper:
    """The gripper that a file describes; the files of its fingers' robots are told beside it.

    Raises:
        ValueError: A file says what is not allowed; one line with file and key.
        OSError: A file cannot be read.
    """
    path = Path(path)
    with _told_of(f"{path}: "):
        table = read_table(path)
        _check(Gripper, table, "", needed=("name", "finger"))
        fingers = tuple(_finger(*x, path.parent) for x in _tables(table, "finger"))
        return Gripper(**_fields(Gripper, table), fingers=fingers, file=path.resolve())


def write_gripper(gripper: Gripper, path: Path | str) -> None:
    """Write a file that is read as the same gripper, and beside it those of its robots."""
    blocks = [lines(_table_of(gripper))]
    for finger in gripper.fingers:
        robot = f"{finger.robot.name}.toml"
        write_robot(finger.robot, Path(path).parent / robot)
        said = lines({"name": finger.name, "robot": robot})
        blocks.append(f"[[finger]]\n{said}\n[finger.base]\n{lines(_table_of(finger.base))}")
    write_text(path, "\n".join(blocks))


def _finger(where: str, table: Mapping[str, Any], folder: Path) -> Finger:
    _check(Finger, table, f"{where}.", needed=("name", "robot", "base"))
    try:
        robot = read_robot(folder / str(table["robot"]))
    except OSError as error:
        raise ValueError(f"{where}.robot: {error}") from None
    base = _made(Base, table["base"], f"{where}.base")
    return Finger(**_fields(Finger, table), robot=robot, base=base)


def _text(robot: RobotParams) -> str:
    drive = {_DRIVE_KEYS[name]: value for name, value in asdict(robot.drive).items()}
    drive = {key: value for key, value in drive.items() if value not in (None, inf, 0.0)}
    blocks = [lines(_table_of(robot))]
    for name, part in (("base", robot.base), ("head", robot.head)):
        blocks += [f"[{name}]\n{lines(_table_of(part))}"] if part is not None else []
    listed = [("section", _table_of(x)) for x in robot.backbone.sections]
    listed += [("tendon", _tendon_table(x) | drive) for x in robot.tendons]
    listed += [("disc", _table_of(x)) for x in robot.discs]
    listed += [("sensor", _table_of(x)) for x in robot.sensors]
    return "\n".join([*blocks, *(f"[[{name}]]\n{lines(table)}" for name, table in listed)])


def _table_of(record: Any) -> dict[str, Any]:
    """What a data class says beyond its defaults, and what has none."""
    known = {field.name: field.default for field in fields(record)}
    said = {name: getattr(record, name) for name in KEYS[type(record)]}
    return {
        KEYS[type(record)][name]: value
        for name, value in said.items()
        if known[name] is MISSING or value != known[name]
    }


def _tendon_table(tendon: Tendon) -> dict[str, Any]:
    """A tendon; its route begins with its place at the base."""
    table = _table_of(tendon)
    if tendon.route:
        del table["offset_m"]
        table["route_m"] = ((0.0, *tendon.offset), *tendon.route)
    return table


def _robot(table: Mapping[str, Any]) -> RobotParams:
    _check(RobotParams, table, "", needed=("name", "section"))
    sections = [_section(*x) for x in _tables(table, "section")]
    if not sections:
        raise ValueError("section must be one or more tables, each begun with [[section]]")
    ends = [float(sum(s.length for s in sections[: k + 1])) for k in range(len(sections))]
    read = [_tendons(*x, k, ends) for k, x in enumerate(_tables(table, "tendon"))]
    tendons = tuple(tendon for tendons, _ in read for tendon in tendons)
    for k, (_, said) in enumerate(_tables(table, "section")):
        if KEYS[Section]["pieces"] not in said:
            pieces = default_pieces(ends[k] - sections[k].length, ends[k], tendons)
            sections[k] = replace(sections[k], pieces=pieces)
    return RobotParams(
        **_fields(RobotParams, table),
        sections=tuple(sections),
        tendons=tendons,
        discs=tuple(_disc(*x, ends[-1]) for x in _tables(table, "disc")),
        sensors=tuple(_sensor(*x, ends[-1]) for x in _tables(table, "sensor")),
        base=_part(Base, table, "base"),
        head=_part(Head, table, "head"),
        drive=_one_drive([drive for _, drive in read]),
    )


def default_pieces(begin: float, end: float, tendons: Sequence[Tendon]) -> int:
    """Pieces of a section between two arc lengths [m], unless something else is said.

    As many to each span between the guides of its tendons, so that pieces end at equal spans' ends.
    """
    within = [tendon for tendon in tendons if tendon.end > begin * (1 + 1e-9)]
    winding = any(not tendon.is_straight for tendon in within)
    off = 1e-9 * end
    inside = [sum(begin + off < g < end - off for g in tendon.guides) for tendon in within]
    spans = max(inside, default=0) + 1
    return int(spans * ceil((WINDING_PIECES if winding else PIECES) / spans))


def _tables(table: Mapping[str, Any], name: str) -> list[tuple[str, Mapping[str, Any]]]:
    """Tables of a list and where they stand."""
    found = table.get(name, [])
    if not isinstance(found, list) or not all(isinstance(x, Mapping) for x in found):
        raise ValueError(f"{name} must be tables, each begun with [[{name}]]")
    return [(f"{name}[{k}]", x) for k, x in enumerate(found, 1)]


def _part(kind: type, table: Mapping[str, Any], name: str) -> Any:
    if name not in table:
        return None
    if not isinstance(table[name], Mapping):
        raise ValueError(f"{name} must be a table, got {table[name]!r}")
    return _made(kind, table[name], name)


def _made(kind: type, table: Mapping[str, Any], where: str) -> Any:
    """A data class from a table that says its fields."""
    needed = [KEYS[kind][f.name] for f in fields(kind) if f.default is MISSING]
    _check(kind, table, f"{where}.", needed)
    with _told_of(f"{where}: ", kind):
        return kind(**_fields(kind, table))


def _section(where: str, table: Mapping[str, Any]) -> Section:
    return _made(Section, {"pieces": PIECES} | dict(table), where)


def _sensor(where: str, table: Mapping[str, Any], length: float) -> Sensor:
    sensor = _made(Sensor, table, where)
    _within(f"{where}.end_m", sensor.end, length)
    return sensor


def _disc(where: str, table: Mapping[str, Any], length: float) -> Disc:
    """A disc, by its inertia or as a homogeneous cylinder."""
    shape = ("radius_m", "thickness_m")
    cylinder = any(key in table for key in shape)
    _exclusive(table, where, "inertia_kg_m2", *shape)
    _check(Disc, table, f"{where}.", needed=("station_m", "mass_kg", *(shape * cylinder)))
    _within(f"{where}.station_m", table["station_m"], length)
    if not cylinder:
        return _made(Disc, table, where)
    return Disc.uniform(*(float(table[key]) for key in ("station_m", "mass_kg", *shape)))


def _tendons(
    where: str, table: Mapping[str, Any], number: int, ends: Sequence[float]
) -> tuple[list[Tendon], tuple[str, dict[str, Any]]]:
    """Tendons of a table, at equal angles if it has several names, and how they are driven."""
    names = table.get("name")
    single = {"group": number, **table, "name": names[0] if _several(names) else names}
    _check(Tendon, {k: v for k, v in single.items() if v is not None}, f"{where}.", _NEEDED)
    names = names if _several(names) else [names]
    for k, name in enumerate(names, 1):
        check_argument(f"{where}.name[{k}]", name, str)
    said = _fields(Tendon, single) | _course(where, single, ends)
    _within(f"{where}.end_m", said["end"], ends[-1])
    first = radians(table.get("angle_deg", 0.0))
    with _told_of(f"{where}: ", Tendon):
        one = Tendon(**said)
        tendons = [
            one.turned(first + radians(360 * k / len(names)), name=name)
            for k, name in enumerate(names)
        ]
    said = {name: table[key] for name, key in _DRIVE_KEYS.items() if key in table}
    drive = {"kind": Drive.kind} | said
    return tendons, (where, drive)


_NEEDED = ("name", "tension_limit_N")


def _several(names: Any) -> bool:
    return isinstance(names, list) and len(names) > 0


def _course(where: str, table: Mapping[str, Any], ends: Sequence[float]) -> dict[str, Any]:
    """Offset at the base, route and end of a tendon."""
    _exclusive(table, where, "end_m", "ends_at_section")
    for key in ("offset_m", "radius_m"):
        _exclusive(table, where, "route_m", key)
    _exclusive(table, where, "offset_m", "radius_m")
    course: dict[str, Any] = {}
    if "route_m" in table:
        (start, *offset), *route = table["route_m"] or [(None,)]
        if start != 0 or not route:
            raise ValueError(
                f"{where}.route_m must be points [s, x, y], the first at s = 0 and one more at "
                f"least, got {table['route_m']!r}"
            )
        course = {"offset": tuple(offset), "route": route, "end": route[-1][0]}
    elif "radius_m" in table:
        course["offset"] = (table["radius_m"], 0.0)
    elif "offset_m" not in table:
        raise ValueError(f"{where}: one of radius_m, offset_m, route_m missing")
    if "ends_at_section" in table:
        section = table["ends_at_section"]
        if not 1 <= section <= len(ends):
            raise ValueError(
                f"{where}.ends_at_section must be a whole number from 1 to {len(ends)}, got "
                f"{section}"
            )
        course["end"] = ends[section - 1]
    elif "end_m" in table:
        course["end"] = table["end_m"]
    elif "end" not in course:
        raise ValueError(f"{where}: one of end_m, ends_at_section missing")
    return course


def _one_drive(drives: Sequence[tuple[str, dict[str, Any]]]) -> Drive:
    """The drive that all tendons share."""
    if not drives:
        return Drive()
    first, drive = drives[0]
    for where, other in drives[1:]:
        for name, key in _DRIVE_KEYS.items():
            if other.get(name) != drive.get(name):
                raise ValueError(
                    f"{where}.{key} must be {drive.get(name)!r} as in {first}: the tendons of a "
                    f"robot are driven alike, got {other.get(name)!r}"
                )
    with _told_of(f"{first}: "):
        return Drive(**drive)


def _check(kind: type, table: Mapping[str, Any], where: str, needed: Sequence[str]) -> None:
    """Refuse unknown and missing keys, and values of another type or range."""
    hints = get_type_hints(kind, include_extras=True)
    allowed = {key: hints[name] for name, key in KEYS[kind].items()} | _SHORT.get(kind, {})
    for key in table:
        if key not in allowed:
            raise ValueError(f"{where}{key} is no key; allowed are {', '.join(allowed)}")
    for key in needed:
        if key not in table:
            raise ValueError(f"{where}{key} missing")
    for key, value in table.items():
        if allowed[key] not in (dict, list):
            check_argument(f"{where}{key}", value, allowed[key])


def _fields(kind: type, table: Mapping[str, Any]) -> dict[str, Any]:
    """Fields of a data class that a table says."""
    return {name: table[key] for name, key in KEYS[kind].items() if key in table}


def _exclusive(table: Mapping[str, Any], where: str, one: str, *others: str) -> None:
    both = [key for key in others if key in table]
    if one in table and both:
        raise ValueError(f"{where}: give {one} or {both[0]}, not both")


def _within(what: str, station: float, length: float) -> None:
    if station > length * (1 + 1e-12):
        raise ValueError(f"{what} must be at most the robot's length, {length:g}, got {station!r}")


@contextmanager
def _told_of(where: str, kind: type | None = None) -> Iterator[None]:
    """Begin a message with its place, and call fields by their keys."""
    try:
        yield
    except (ValueError, OverflowError) as error:
        text = str(error).replace("a tuple", "a list")
        for name, key in KEYS.get(kind, {}).items():
            if name not in ("name", "end"):
                text = re.sub(rf"\b{name}\b", key, text)
        raise ValueError(where + text) from None
