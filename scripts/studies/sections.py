"""Robots of sections and routed tendons against exact rods: error and run time.

The chain and PCC are judged by rods without shear and extension, the Cosserat rod by one with both.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy import ndarray
from scipy.spatial.transform import Rotation

from softrobot_env.beams.cosserat import CosseratRod
from softrobot_env.beams.model import BeamModel
from softrobot_env.core.equilibrium import EquilibriumError
from softrobot_env.evaluation.models.runs import beam_of, best_of
from softrobot_env.rendering import figures
from softrobot_env.robots import Base, Disc, RobotParams, Section, Tendon
from softrobot_env.robots.file import PIECES as DEFAULT_PIECES
from softrobot_env.robots.file import default_pieces
from softrobot_env.scene.build import Scene, build_scene
from softrobot_env.scene.config import SceneConfig
from studies.lab import Column, Record, Study, lines, quantity, select, table, verdict
from studies.truths.spatial_rod import SpatialShape
from studies.truths.tendon_rod import guided_rod, hanging_rod, tendon_rod

#: Largest errors at the default resolution: tip over length, and strains over the largest of them.
GOAL = 0.005


@dataclass(frozen=True)
class Row(Record):
    """A robot's equilibrium under tensions with one model of some resolution.

    Attributes:
        case: Name of the robot, see `cases.CASES`.
        model: "chain", "pcc" or "cosserat".
        pieces: In total; sections have equally many.
        default: Whether that is the model's own choice for the robot.
        n: Number of its coordinates.
        error: [m], distance of the tip from the exact one.
        error_share: Over the length [1].
        curvature_error: Of the mean bending strains of thirds of sections, their largest error over
            the largest strain of the robot [1].
        twist_error: The same of torsion.
        equilibrium_time: [s] to find it, from the straight pose.
        failure: Why there is no result; None otherwise.
    """

    case: str
    model: str
    pieces: int = quantity("", "d")
    default: bool
    n: int | None = None
    error: float | None = None
    error_share: float | None = quantity("%", ".2g", "error", default=None)
    curvature_error: float | None = quantity("%", ".2g", "bending", default=None)
    twist_error: float | None = quantity("%", ".2g", "twist", default=None)
    equilibrium_time: float | None = quantity("ms", ".2g", "rest", default=None)
    failure: str | None = None

    @property
    def good(self) -> bool:
        """Whether all errors are within `GOAL`."""
        errors = (self.error_share, self.curvature_error, self.twist_error)
        return None not in errors and max(errors) <= GOAL


# -------------------- robots

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


def _section(length: float, radius: float | tuple[float, float], modulus: float) -> Section:
    return Section(length, radius, modulus, 1050.0, 0.02, DEFAULT_PIECES, poisson_ratio=0.4)


def _tendon(name: str, offset: tuple[float, float], end: float, **options: Any) -> Tendon:
    return Tendon(name, offset, end, 0, 60.0, **options)


def _robot(sections: Sequence[Section], *tendons: Tendon, **more: Any) -> RobotParams:
    """A robot with the pieces that robot files have which do not say any."""
    ends = np.cumsum([0.0, *(section.length for section in sections)])
    cut = (
        replace(section, pieces=default_pieces(*ends[k : k + 2], tendons))
        for k, section in enumerate(sections)
    )
    return RobotParams(tendons[0].name, sections=tuple(cut), tendons=tendons, **more)


def _guided(turns: float) -> RobotParams:
    """A slender rod of ten discs with a tendon through them."""
    ends = np.linspace(0, 0.3, 11).tolist()
    discs = tuple(Disc.uniform(s, 0.002, 0.012, 0.002) for s in ends[1:])
    tendon = _tendon("guided", (0.010, 0.0), 0.3, guides=tuple(ends[1:-1]), turns=turns)
    return _robot([_section(0.3, 0.003, 6e7)], tendon, discs=discs)


def _helical(turns: float) -> RobotParams:
    return _robot(_ONE, _tendon("helical", (0.005, -0.005), 0.3, turns=turns))


_ONE = [_section(0.3, 0.010, 8e5)]
_TAPERED, _SIDEWAYS = [_section(0.3, (0.011, 0.005), 8e5)], [_section(0.3, (0.014, 0.010), 8e5)]
_TWO = (_section(0.18, 0.013, 6e5), _section(0.14, 0.009, 9e5))
_THREE = (_section(0.12, 0.014, 7e5), _section(0.1, (0.012, 0.009), 7e5), _section(0.1, 0.008, 5e5))
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
_NEARER = _tendon("nearer", (0.004, 0.008), 0.3, route=((0.3, 0.001, -0.001),))
_ROUTE = ((0.08, 0.007, 0.002), (0.19, 0.0, -0.008), (0.3, -0.004, 0.0))
_VIA = _tendon("via", (0.0, 0.009), 0.3, route=_ROUTE)
_HANGING = {"gravity": _GRAVITY, "base": Base((0.0, 0.1, 0.5), (0.0, 0.0, -1.0), 0.4)}
_LYING = {
    "gravity": _GRAVITY,
    "base": Base((0.0, 0.0, 0.3), (1.0, 0.3, 0.0), 1.0),
    "discs": (Disc.uniform(0.2, 0.02, 0.015, 0.004),),
}
_UP = _tendon("up", (0.006, 0.004), 0.3, turns=0.3)
_NINE = (6.0, 0.5, 2.0, 0.5, 4.0, 0.5, 0.5, 1.5, 0.0)

CASES = (
    Case("helix of 1.5 turns", _helical(1.5), (5.0,), quick=True),
    Case("helix of 4 turns", _helical(-4.0), (6.0,)),
    Case("converging", _robot(_ONE, _NEARER), (3.0,)),
    Case("via-points", _robot(_ONE, _VIA), (4.0,), quick=True),
    Case("tapered", _robot(_TAPERED, _tendon("side", (0.003, 0.003), 0.3)), (0.4,)),
    Case("two sections", _robot(_TWO, *_OF_TWO), (6.0, 2.0, 3.0), quick=True),
    Case("three sections side by side", _robot(_THREE, *_SIDE_BY_SIDE), _NINE),
    Case("ten discs", _guided(0.0), (2.5,), guided_rod, quick=True),
    Case("ten discs, winding", _guided(0.5), (2.5,), guided_rod),
    Case("hanging", _robot(_TWO, *_OF_TWO, **_HANGING), (6.0, 2.0, 3.0), hanging_rod),
    Case("sideways", _robot(_SIDEWAYS, _UP, **_LYING), (4.0,), hanging_rod),
)


# -------------------- models against exact shapes

#: Pieces of a section.
PIECES, QUICK_PIECES = (3, 6, 12, 24, 48), (6, 12)

#: Most pieces in total whose equilibrium is sought.
_LARGEST = 100

_PARTS, _FINE = 3, 24  # of a section whose strain is compared, and of such a part
_SHEAR = 0.75  # as `CosseratRod` has


def measure(case: tuple[str, tuple[int, ...]]) -> list[Row]:
    """All models of a robot, with some numbers of pieces of a section."""
    name, resolutions = case
    (case,) = select(CASES, name=name)
    robot, rows = case.robot, []
    sections = len(robot.backbone.sections)
    stations = robot.backbone.cut([_PARTS * _FINE] * sections)
    for models, shear in ((("chain", "pcc"), None), (("cosserat",), _SHEAR)):
        truth = case.solve(robot, case.tension, stations, shear)
        for model in models:
            own = _default(model, robot)
            counts = {own, *(sections * n for n in resolutions)}
            for pieces in sorted(n for n in counts if n <= _LARGEST):
                rows.append(_row(case, model, pieces, pieces == own, truth))
    return rows


def _default(model: str, robot: RobotParams) -> int:
    """Number of pieces unless one is given."""
    if model == "cosserat":
        return max(2 * robot.pieces, CosseratRod.fewest(robot))
    return robot.pieces


def _row(case: Case, model: str, pieces: int, default: bool, truth: SpatialShape) -> Row:
    robot, tension = case.robot, np.array(case.tension)
    try:
        built, edges, n = _build(model, robot, pieces)
        built.equilibrium(tension)  # compiles
        time, q = best_of(lambda: built.equilibrium(tension), 3)
    except (EquilibriumError, ValueError) as error:
        return Row(case.name, model, pieces, default, failure=str(error))
    base, exact = robot.base or Base(), _true_strains(truth, robot)
    error = float(np.linalg.norm(built.tip(q) - base.axes @ truth.tip - base.position))
    off = np.abs(_mean(built.curvature(q), edges, _parts(robot)) - exact) / np.abs(exact).max()
    errors = error, error / robot.length, float(off[:, :2].max()), float(off[:, 2].max())
    return Row(case.name, model, pieces, default, n, *errors, time)


def _build(name: str, robot: RobotParams, pieces: int) -> tuple[Scene | BeamModel, ndarray, int]:
    """A chain or beam model, ends [m] of its pieces, and the number of its coordinates."""
    config = SceneConfig(robot, pieces=pieces, bending="spatial", torsion=True)
    if name == "chain":
        scene = build_scene(config)
        return scene, scene.config.edges, scene.model.nv
    model = beam_of(config, name, pieces)
    return model, model.edges, model.n


# ---------------------------------------------------------------- strains


def _parts(robot: RobotParams) -> ndarray:
    """Ends (k + 1,) [m] of the parts of sections whose strains are compared."""
    return robot.backbone.cut([_PARTS] * len(robot.backbone.sections))


def _true_strains(truth: SpatialShape, robot: RobotParams) -> ndarray:
    """Mean turn (k, 3) [1/m] of parts about the sections' own axes."""
    frames = Rotation.from_matrix(truth.frame)
    turns = (frames[:-1].inv() * frames[1:]).as_rotvec()
    return turns.reshape(-1, _FINE, 3).sum(axis=1) / np.diff(_parts(robot))[:, None]


def _mean(strains: ndarray, edges: ndarray, parts: ndarray) -> ndarray:
    """Means (k, 3) of strains between edges over parts."""
    turned = np.append(np.zeros((1, 3)), np.cumsum(np.diff(edges)[:, None] * strains, axis=0), 0)
    at = np.stack([np.interp(parts, edges, column) for column in turned.T], axis=1)
    return np.diff(at, axis=0) / np.diff(parts)[:, None]


_STYLES = {"chain": "mujoco_chain", "pcc": "pcc", "cosserat": "cosserat"}


def _style(model: str) -> figures.Style:
    return figures.style_of(_STYLES[model])


def _message(rows: Sequence[Row]) -> str:
    own = select(rows, default=True)
    good = sum(row.error_share <= GOAL for row in own)
    return (
        f"With the models' own resolutions {good} of {len(own)} tips are within {100 * GOAL:g} % "
        "of the length"
    )


def _defaults(axis: figures.Axes, rows: Sequence[Row], _: str) -> None:
    """What is asked, and full dots where it is."""
    axis.axhline(100 * GOAL, **figures.REFERENCE | {"label": "goal at the full dots"})
    for row in select(rows, default=True):
        place = 1e3 * row.equilibrium_time, 100 * row.error_share
        axis.plot(*place, **_style(row.model).points)


_ERRORS = ("pieces", "error_share", "curvature_error", "twist_error", "equilibrium_time")

STUDY = Study(
    kinds=(Row,),
    cases=[(case.name, PIECES) for case in CASES],
    quick=[(case.name, QUICK_PIECES) for case in CASES if case.quick],
    measure=measure,
    label=lambda case: case[0],
    tables=[
        table(
            f"At the default resolution: are all errors within {100 * GOAL:g} %?",
            Column("robot", "case"),
            "model",
            Column("met", lambda row: verdict(row.good), ">"),
            *_ERRORS,
            where={"default": True},
            caption="error: of the tip over the length; bending, twist: of strains over the "
            "largest",
        ),
        table(
            "{case}",
            "model",
            Column("", lambda row: "default" if row.default else row.failure or ""),
            *_ERRORS,
            per=("case",),
        ),
    ],
    plots={
        "{}": lines(
            "equilibrium_time",
            "error_share",
            "model",
            title=_message,
            subject="Sections and routes: error of the tip against the time to find an equilibrium",
            panel="case",
            where={"failure": None},
            log="xy",
            style=_style,
            line={"linestyle": "none", "markerfacecolor": "white"},
            size=(3.3, 2.3),
            legend=True,
            decorate=_defaults,
        )
    },
    alone=True,
)
