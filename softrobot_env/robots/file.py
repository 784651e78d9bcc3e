"""Robot descriptions as TOML files: SI units in their keys, `RobotParams` both ways.

Keys are those of the fields (`core.records`). A `[[tendon]]` with a list of names is as many
tendons at equal angles. A table `[hardware]` says what drives the real robot, and is kept as it is.
Places in messages count from 1: `section[1]` is the section at the base.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from math import ceil, radians
from pathlib import Path
from typing import Annotated, Any

from softrobot_env.core.files import file_name, read_table, text, write_text
from softrobot_env.core.records import (
    Name,
    Unit,
    check_argument,
    keys,
    placed,
    read,
    read_values,
    write,
)

from .parameters import Base, Disc, Drive, Finger, Gripper, Head, RobotParams
from .ranges import Degrees, Length, Radius, Station
from .sections import Section
from .sensors import Sensor
from .tendons import Tendon

#: Fewest pieces of a section whose table does not say it, and of one through which a tendon runs
#: that is not straight. Chains have as many times as many as their accuracy asks for, see
#: `scene.resolution`.
PIECES, WINDING_PIECES = 6, 12


@dataclass(frozen=True)
class _Place:
    """Where a tendon is, in other words than the fields of `Tendon`.

    Attributes:
        ends_at_section: Number of the section at whose end it is anchored, from 1, in place of
            `end_m`.
        radius: [m], distance from the fibre, in place of `offset_m`.
        angle: [deg] from +x towards +y by which the tendon is turned; the first one's of a list of
            names.
    """

    ends_at_section: int | None = None
    radius: Annotated[Station | None, Unit("m")] = None
    angle: Degrees = 0.0


@dataclass(frozen=True)
class _Cylinder:
    """A disc by its shape, a homogeneous cylinder, in place of `inertia_kg_m2`.

    Attributes:
        radius: [m].
        thickness: [m].
    """

    radius: Radius
    thickness: Length


@dataclass(frozen=True)
class _FingerTable:
    """A finger whose robot is another file.

    Attributes:
        name: Unique name.
        robot: Path of the robot's file, from the folder of this one.
        base: Where it is clamped; its own x axis points towards the object.
    """

    name: Name
    robot: str
    base: Base


#: Tables of a robot's file by name, "" the whole, each with the records that its keys are of.
TABLES: dict[str, tuple[type, ...]] = {
    "": (RobotParams,),
    "base": (Base,),
    "head": (Head,),
    "section": (Section,),
    "tendon": (Tendon, Drive, _Place),
    "disc": (Disc, _Cylinder),
    "sensor": (Sensor,),
}
#: The same of a gripper's.
GRIPPER_TABLES: dict[str, tuple[type, ...]] = {"": (Gripper,), "finger": (_FingerTable,)}


def read_robot(path: Path | str) -> RobotParams:
    """The robot that a file describes.

    Raises:
        ValueError: The file says what is not allowed; one line with file and key.
        OSError: The file cannot be read.
    """
    with placed(path):
        return replace(_robot(read_table(Path(path))), file=Path(path).resolve())


def write_robot(robot: RobotParams, path: Path | str, notes: Sequence[str] = ()) -> None:
    """Write a file that is read as the same robot, with lines of notes above as comments."""
    above = "".join(f"# {note}".rstrip() + "\n" for note in notes)
    write_text(path, above + text(_table(robot)))


def read_gripper(path: Path | str) -> Gripper:
    """The gripper that a file describes; the files of its fingers' robots are named beside it.

    Raises:
        ValueError: A file says what is not allowed; one line with file and key.
        OSError: A file cannot be read.
    """
    path = Path(path)

    def finger(table: Mapping[str, Any], where: str) -> Finger:
        (values,) = read_values(table, where, GRIPPER_TABLES["finger"])
        try:
            robot = read_robot(path.parent / values["robot"])
        except OSError as error:
            raise ValueError(f"{where}.robot: {error}") from None
        return Finger(**values | {"robot": robot})

    with placed(path):
        gripper = read(Gripper, read_table(path), readers={"finger": finger})
    return replace(gripper, file=path.resolve())


def write_gripper(gripper: Gripper, path: Path | str) -> None:
    """Write a file that is read as the same gripper, and beside it those of its robots."""
    fingers = []
    for finger in gripper.fingers:
        robot = file_name(f"{finger.robot.name}.toml")
        write_robot(finger.robot, Path(path).parent / robot)
        fingers.append({"name": finger.name, "robot": robot, "base": write(finger.base)})
    write_text(path, text(write(gripper) | {"finger": fingers}))


def _table(robot: RobotParams) -> dict[str, Any]:
    table, drive = write(robot), write(robot.drive)
    table["section"] = [write(section) for section in robot.backbone.sections]
    if robot.adaptive_pieces:
        for section in table["section"]:
            del section["pieces"]
    table["tendon"] = []
    for tendon in robot.tendons:
        one = write(tendon)
        if tendon.route:  # begins with the tendon's place at the base
            del one["offset_m"]
            one["route_m"] = ((0.0, *tendon.offset), *tendon.route)
        table["tendon"].append(one | drive)
    lists = ("section", "tendon", "disc", "sensor")
    alone = {key: value for key, value in table.items() if key not in lists}
    real = {} if robot.hardware is None else {"hardware": robot.hardware}
    return alone | {key: table[key] for key in lists if key in table} | real


def _robot(table: Mapping[str, Any]) -> RobotParams:
    hardware = table.get("hardware")
    table = {key: value for key, value in table.items() if key != "hardware"}
    later = dict.fromkeys(("section", "tendon", "disc"), lambda one, where: (where, one))
    (values,) = read_values(table, "", TABLES[""], later)
    said = values.pop("sections", ())
    if not said:
        raise ValueError("section must be one or more tables, each begun with [[section]]")
    sections = [read(Section, {"pieces": PIECES} | one, where) for where, one in said]
    ends = [float(sum(s.length for s in sections[: k + 1])) for k in range(len(sections))]
    found = [_tendons(*x, k, ends) for k, x in enumerate(values.pop("tendons", ()))]
    tendons = tuple(tendon for tendons, _ in found for tendon in tendons)
    for k, (_, one) in enumerate(said):
        if "pieces" not in one:
            pieces = default_pieces(ends[k] - sections[k].length, ends[k], tendons)
            sections[k] = replace(sections[k], pieces=pieces)
    for k, sensor in enumerate(values.get("sensors", ()), 1):
        _check_on_robot(f"sensor[{k}].end_m", sensor.end, ends[-1])
    values["discs"] = tuple(_disc(*x, ends[-1]) for x in values.get("discs", ()))
    return RobotParams(
        **values,
        sections=tuple(sections),
        tendons=tendons,
        drive=_one_drive([drive for _, drive in found]),
        adaptive_pieces=not any("pieces" in one for _, one in said),
        hardware=hardware,
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


def _disc(where: str, table: Mapping[str, Any], length: float) -> Disc:
    """A disc, by its inertia or as a homogeneous cylinder."""
    shape = tuple(keys(_Cylinder))
    cylinder = any(key in table for key in shape)
    _check_exclusive(table, where, "inertia_kg_m2", *shape)
    optional = ["inertia_kg_m2"] if cylinder else shape
    disc, size = read_values(table, where, TABLES["disc"], optional=optional)
    _check_on_robot(f"{where}.station_m", disc["station"], length)
    _check_on_robot(f"{where}.thickness_m", size.get("thickness", 0.0), length)
    numbers = {name: float(x) for name, x in (disc | size).items()} if cylinder else disc
    with placed(where, Disc):
        return Disc.uniform(**numbers) if cylinder else Disc(**numbers)


def _tendons(
    where: str, table: Mapping[str, Any], number: int, ends: Sequence[float]
) -> tuple[list[Tendon], tuple[str, dict[str, Any]]]:
    """Tendons of a table, at equal angles if it has several names, and how they are driven."""
    names = table.get("name")
    names = names if isinstance(names, list) and names else [names]
    single = {"group": number, **table} | ({"name": names[0]} if "name" in table else {})
    optional = ("offset_m", "end_m")
    values, drive, place = read_values(single, where, TABLES["tendon"], optional=optional)
    for k, name in enumerate(names, 1):
        check_argument(f"{where}.name[{k}]", name, Name)
    values |= _course(where, table, values, place, ends)
    _check_on_robot(f"{where}.end_m", values["end"], ends[-1])
    first = radians(place.get("angle", 0.0))
    with placed(where, Tendon):
        one = Tendon(**values)
        tendons = [
            one.turned(first + radians(360 * k / len(names)), name=name)
            for k, name in enumerate(names)
        ]
    return tendons, (where, {"kind": Drive.kind} | drive)


def _course(
    where: str,
    table: Mapping[str, Any],
    values: Mapping[str, Any],
    place: Mapping[str, Any],
    ends: Sequence[float],
) -> dict[str, Any]:
    """Offset at the base, route and end of a tendon."""
    _check_exclusive(table, where, "end_m", "ends_at_section")
    _check_exclusive(table, where, "route_m", "offset_m", "radius_m")
    _check_exclusive(table, where, "offset_m", "radius_m")
    course: dict[str, Any] = {}
    if "route" in values:
        (start, *offset), *route = values["route"] or [(None,)]
        if start != 0 or not route:
            raise ValueError(
                f"{where}.route_m must be points [s, x, y], the first at s = 0 and one more at "
                f"least, got {table['route_m']!r}"
            )
        course = {"offset": tuple(offset), "route": route, "end": route[-1][0]}
    elif "radius" in place:
        course["offset"] = (place["radius"], 0.0)
    elif "offset" not in values:
        raise ValueError(f"{where}: one of radius_m, offset_m, route_m missing")
    if "ends_at_section" in place:
        section = place["ends_at_section"]
        if not 1 <= section <= len(ends):
            raise ValueError(
                f"{where}.ends_at_section must be a whole number from 1 to {len(ends)}, got "
                f"{section}"
            )
        course["end"] = ends[section - 1]
    elif "end" in values:
        course["end"] = values["end"]
    elif "end" not in course:
        raise ValueError(f"{where}: one of end_m, ends_at_section missing")
    return course


def _one_drive(drives: Sequence[tuple[str, dict[str, Any]]]) -> Drive:
    """The drive that all tendons share."""
    if not drives:
        return Drive()
    first, drive = drives[0]
    for where, other in drives[1:]:
        for key, entry in keys(Drive).items():
            mine, its = drive.get(entry.name), other.get(entry.name)
            if its != mine:
                raise ValueError(
                    f"{where}.{key} must be {mine!r} as in {first}: the tendons of a robot are "
                    f"driven alike, got {its!r}"
                )
    with placed(first):
        return Drive(**drive)


def _check_exclusive(table: Mapping[str, Any], where: str, one: str, *others: str) -> None:
    both = [key for key in others if key in table]
    if one in table and both:
        raise ValueError(f"{where}: give {one} or {both[0]}, not both")


def _check_on_robot(what: str, station: float, length: float) -> None:
    if station > length * (1 + 1e-12):
        raise ValueError(f"{what} must be at most the robot's length, {length:g}, got {station!r}")
