"""Robots of several and tapered sections with tendons on any route, and their exact shapes."""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from softrobot_env.robots import Base, Disc, RobotParams, Section, Tendon
from softrobot_env.robots.file import PIECES, default_pieces
from studies.truths.spatial_rod import SpatialShape
from studies.truths.tendon_rod import guided_rod, hanging_rod, tendon_rod

_GRAVITY = (0.0, 0.0, -9.81)


@dataclass(frozen=True)
class Case:
    """A robot, the tensions it is pulled by and how its exact shape is found.

    Attributes:
        name: What is special about it.
        robot: The robot.
        tension: (n_tendons,) [N].
        solve: Function of `studies.truths.tendon_rod`.
        quick: Whether it is part of a quick run.
    """

    name: str
    robot: RobotParams
    tension: tuple[float, ...]
    solve: Callable[..., SpatialShape] = tendon_rod
    quick: bool = False

    def shape(self, stations: np.ndarray, shear_coefficient: float | None) -> SpatialShape:
        """The exact shape at arc lengths (k,) [m], along the axes of the robot's base."""
        return self.solve(self.robot, self.tension, stations, shear_coefficient)


def _section(length: float, radius: float | tuple[float, float], modulus: float) -> Section:
    return Section(length, radius, modulus, 1050.0, 0.02, PIECES, poisson_ratio=0.4)


def _tendon(name: str, offset: tuple[float, float], end: float, **options: object) -> Tendon:
    return Tendon(name, offset, end, 0, 60.0, **options)


def _robot(
    name: str, *sections: Section, tendons: tuple[Tendon, ...], **more: object
) -> RobotParams:
    """A robot with the pieces that robot files have which do not say any."""
    ends = np.cumsum([0.0, *(section.length for section in sections)])
    cut = (
        replace(section, pieces=default_pieces(*ends[k : k + 2], tendons))
        for k, section in enumerate(sections)
    )
    return RobotParams(name, sections=tuple(cut), tendons=tendons, **more)


def _guided(turns: float) -> RobotParams:
    """A slender rod of ten discs with a tendon through them."""
    ends = np.linspace(0, 0.3, 11).tolist()
    discs = tuple(Disc.uniform(s, 0.002, 0.012, 0.002) for s in ends[1:])
    tendon = _tendon("guided", (0.010, 0.0), 0.3, guides=tuple(ends[1:-1]), turns=turns)
    return _robot("discs", _section(0.3, 0.003, 6e7), tendons=(tendon,), discs=discs)


_ONE = _section(0.3, 0.010, 8e5)
_TWO = (_section(0.18, 0.013, 6e5), _section(0.14, 0.009, 9e5))
_THREE = (_section(0.12, 0.014, 7e5), _section(0.1, (0.012, 0.009), 7e5), _section(0.1, 0.008, 5e5))


def _helical(turns: float) -> RobotParams:
    tendon = _tendon("helical", (0.005, -0.005), 0.3, turns=turns)
    return _robot("helical", _ONE, tendons=(tendon,))


_SIDE_BY_SIDE = tuple(
    _tendon(f"{end}_{k}", (r * np.cos(a + 2.1 * k), r * np.sin(a + 2.1 * k)), end)
    for end, r, a in ((0.12, 0.010, 0.3), (0.22, 0.007, 1.2), (0.32, 0.005, 2.5))
    for k in range(3)
)
_OF_TWO = (
    _tendon("inner", (0.0, 0.009), 0.18),
    _tendon("outer", (0.006, 0.003), 0.32),
    _tendon("winding", (-0.006, 0.0), 0.32, turns=0.6),
)

CASES = (
    Case("helix of 1.5 turns", _helical(1.5), (5.0,), quick=True),
    Case("helix of 4 turns", _helical(-4.0), (6.0,)),
    Case(
        "converging",
        _robot(
            "converging",
            _ONE,
            tendons=(_tendon("nearer", (0.004, 0.008), 0.3, route=((0.3, 0.001, -0.001),)),),
        ),
        (3.0,),
    ),
    Case(
        "via-points",
        _robot(
            "via",
            _ONE,
            tendons=(
                _tendon(
                    "via",
                    (0.0, 0.009),
                    0.3,
                    route=((0.08, 0.007, 0.002), (0.19, 0.0, -0.008), (0.3, -0.004, 0.0)),
                ),
            ),
        ),
        (4.0,),
        quick=True,
    ),
    Case(
        "tapered",
        _robot(
            "tapered",
            _section(0.3, (0.011, 0.005), 8e5),
            tendons=(_tendon("side", (0.003, 0.003), 0.3),),
        ),
        (0.4,),
    ),
    Case("two sections", _robot("two", *_TWO, tendons=_OF_TWO), (6.0, 2.0, 3.0), quick=True),
    Case(
        "three sections side by side",
        _robot("three", *_THREE, tendons=_SIDE_BY_SIDE),
        (6.0, 0.5, 2.0, 0.5, 4.0, 0.5, 0.5, 1.5, 0.0),
    ),
    Case("ten discs", _guided(0.0), (2.5,), guided_rod, quick=True),
    Case("ten discs, winding", _guided(0.5), (2.5,), guided_rod),
    Case(
        "hanging",
        _robot(
            "hanging",
            *_TWO,
            tendons=_OF_TWO,
            gravity=_GRAVITY,
            base=Base((0.0, 0.1, 0.5), (0.0, 0.0, -1.0), 0.4),
        ),
        (6.0, 2.0, 3.0),
        hanging_rod,
    ),
    Case(
        "sideways",
        _robot(
            "sideways",
            _section(0.3, (0.014, 0.010), 8e5),
            tendons=(_tendon("up", (0.006, 0.004), 0.3, turns=0.3),),
            gravity=_GRAVITY,
            base=Base((0.0, 0.0, 0.3), (1.0, 0.3, 0.0), 1.0),
            discs=(Disc.uniform(0.2, 0.02, 0.015, 0.004),),
        ),
        (4.0,),
        hanging_rod,
    ),
)
