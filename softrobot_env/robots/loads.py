"""Loads on a robot, the same for the MuJoCo scene and the beam models."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

from softrobot_env.core.records import Name, NotNegative, Record, Vector3

from .parameters import RobotParams
from .tendons import Tendon


@dataclass(frozen=True)
class Load(Record):
    """Force and moment at arc length `station` [m].

    Becomes an input of the same name whose value scales the load (1: as given).

    Raises:
        ValueError: A number is not finite.

    Attributes:
        name: Unique name.
        station: [m] from the base.
        force: (3,) [N].
        moment: (3,) [N m].
        follows: Whether the vectors turn with the cross-section; else they keep the world's
            directions (a dead load).
    """

    name: Name
    station: NotNegative
    force: Vector3 = (0.0, 0.0, 0.0)
    moment: Vector3 = (0.0, 0.0, 0.0)
    follows: bool = False


def seen_from_base(robot: RobotParams, loads: Sequence[Load]) -> tuple[Load, ...]:
    """The loads along the axes of a robot's base, where dead ones keep the world's directions."""
    if robot.base is None:
        return tuple(loads)
    return tuple(
        x if x.follows else replace(x, force=robot.seen(x.force), moment=robot.seen(x.moment))
        for x in loads
    )


def refuse_out_of_plane(
    model: str,
    other: str,
    loads: Sequence[Load] = (),
    gravity: Sequence[float] = (0.0, 0.0, 0.0),
    tendons: Sequence[Tendon] = (),
) -> None:
    """Refuse what would drive a planar model out of the x-z plane.

    Args:
        model: What the planar model is called.
        other: What to choose instead.
        loads: On the robot, along the axes of its base.
        gravity: (3,) [m/s2] along them.
        tendons: Of the robot.

    Raises:
        ValueError: Something acts across the plane; the message names it.
    """
    crossing = [f"tendon {t.name!r} (offset y)" for t in tendons if t.leaves_plane]
    crossing += [f"load {x.name!r} (force y)" for x in loads if x.force[1]]
    crossing += [f"load {x.name!r} (moment x or z)" for x in loads if x.moment[0] or x.moment[2]]
    crossing += ["gravity (y)"] if gravity[1] else []
    if crossing:
        raise ValueError(
            f"{model} moves in the x-z plane; remove {', '.join(crossing)} or choose {other}"
        )


def refuse_torsion(
    model: str, other: str, loads: Sequence[Load], tendons: Sequence[Tendon] = ()
) -> None:
    """Refuse moments about z that a model without torsion cannot answer; arguments as above.

    Raises:
        ValueError: A load or the route of a tendon has one; the message names it.
    """
    twisting = [f"load {x.name!r} (moment z)" for x in loads if x.moment[2]]
    twisting += [f"tendon {t.name!r} (winds round the fibre)" for t in tendons if t.twists]
    if twisting:
        raise ValueError(f"{model} cannot twist; remove {', '.join(twisting)} or choose {other}")
