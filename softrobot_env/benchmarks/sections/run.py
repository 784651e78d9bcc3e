"""Chain, PCC and Cosserat rod of robots with sections and routes, against their exact shapes.

The chain and PCC are judged by rods without shear and extension, the Cosserat rod by one with both.
"""

from collections.abc import Callable
from time import perf_counter

import numpy as np
from scipy.spatial.transform import Rotation

from softrobot_env.beams.cosserat import CosseratRod
from softrobot_env.beams.registry import BeamPlant
from softrobot_env.benchmarks.sections.cases import CASES, Case
from softrobot_env.benchmarks.sections.rows import Row
from softrobot_env.benchmarks.timing import best_of
from softrobot_env.core.equilibrium import EquilibriumError
from softrobot_env.core.jobs import Progress
from softrobot_env.robots import Base, RobotParams
from softrobot_env.scene.build import build_scene
from softrobot_env.scene.config import SceneConfig
from softrobot_env.scene.simulation import Simulation
from studies.truths.spatial_rod import SpatialShape

#: Pieces of a section.
PIECES, QUICK_PIECES = (3, 6, 12, 24, 48), (6, 12)

#: Most pieces in total whose equilibrium is sought, and of those that are moved.
_LARGEST, _MOVED = 100, 50

_PERIOD, _PERIODS = 0.02, 5
_PARTS, _FINE = 3, 24  # of a section whose strain is compared, and of such a part
_SHEAR = 0.75  # as `CosseratRod` has

#: Finds tip (3,), strains (pieces, 3), their edges, number of coordinates, and moves a period.
Found = tuple[np.ndarray, np.ndarray, np.ndarray, int, Callable[[], object]]


def run(quick: bool = False, progress: Progress | None = None) -> list[Row]:
    """Judge all models of all robots.

    Args:
        quick: Fewer robots and resolutions.
        progress: Called with (description, done, total), or None.

    Returns:
        A row per robot, model and resolution.
    """
    cases = [case for case in CASES if case.quick or not quick]
    rows = []
    for number, case in enumerate(cases):
        if progress is not None:
            progress(case.name, number, len(cases))
        rows += _judge(case, QUICK_PIECES if quick else PIECES)
    return rows


def _judge(case: Case, resolutions: tuple[int, ...]) -> list[Row]:
    robot, rows = case.robot, []
    stations = _stations(robot)
    for models, shear in ((("chain", "pcc"), None), (("cosserat",), _SHEAR)):
        truth = case.shape(stations, shear)
        for model in models:
            own = _default(model, robot)
            counts = {own, *(len(robot.backbone.sections) * n for n in resolutions)}
            for pieces in sorted(n for n in counts if n <= _LARGEST):
                rows.append(_row(case, model, pieces, pieces == own, truth))
    return rows


def _default(model: str, robot: RobotParams) -> int:
    """Number of pieces unless one is given."""
    if model == "cosserat":
        return max(2 * robot.pieces, CosseratRod.fewest(robot))
    return robot.pieces


def _row(case: Case, model: str, pieces: int, default: bool, truth: SpatialShape) -> Row:
    find = _chain if model == "chain" else _beam
    robot, tension = case.robot, np.array(case.tension)
    try:
        solve = find(robot, pieces, model)
        solve(tension)  # compiles
        time, (tip, strains, edges, n, move) = best_of(lambda: solve(tension), 3)
    except (EquilibriumError, ValueError) as error:
        return Row(case.name, model, pieces, default, failure=str(error))
    base = robot.base or Base()
    exact = base.axes @ truth.tip + base.position
    off = _mean(strains, edges, _parts(robot)) - _true_strains(truth, robot)
    largest = np.abs(_true_strains(truth, robot)).max()
    error = float(np.linalg.norm(tip - exact))
    return Row(
        case.name,
        model,
        pieces,
        default,
        n=n,
        error=error,
        error_share=error / robot.length,
        curvature_error=float(np.abs(off[:, :2]).max() / largest),
        twist_error=float(np.abs(off[:, 2]).max() / largest),
        equilibrium_time=time,
        time_per_second=_moved(move) if pieces <= _MOVED else None,
    )


def _chain(robot: RobotParams, pieces: int, _: str) -> Callable[[np.ndarray], Found]:
    config = SceneConfig(
        robot, pieces=pieces, bending="spatial", torsion=True, control_period=_PERIOD
    )
    scene = build_scene(config)

    def solve(tension: np.ndarray) -> Found:
        q = scene.equilibrium(tension)

        def start() -> Callable[[], object]:
            simulation = Simulation(scene)
            simulation.reset(scene.start().q, tension)
            return simulation.advance

        return scene.tip(q), scene.curvature(q), config.edges, scene.model.nv, start

    return solve


def _beam(robot: RobotParams, pieces: int, name: str) -> Callable[[np.ndarray], Found]:
    way = {"axes": slice(0, 3), "bending": "spatial", "torsion": True, "actuation": "tension"}
    stepped = BeamPlant(name, pieces=pieces)(robot, **way)
    model = stepped.model

    def solve(tension: np.ndarray) -> Found:
        q = model.equilibrium(tension)

        def start() -> Callable[[], object]:
            state = stepped.rest(), np.zeros(model.n)
            return lambda: stepped.advance(*state, tension, _PERIOD) is None

        return model.tip(q), model.curvature(q), model.edges, model.n, start

    return solve


def _moved(start: Callable[[], Callable[[], object]]) -> float | None:
    """Run time over simulated time while the tensions act all at once; None if it fails."""
    start()()  # what is compiled or allocated first
    advance = start()
    begin = perf_counter()
    healthy = all(advance() for _ in range(_PERIODS))
    return (perf_counter() - begin) / (_PERIOD * _PERIODS) if healthy else None


# ---------------------------------------------------------------- strains


def _parts(robot: RobotParams) -> np.ndarray:
    """Ends (k + 1,) [m] of the parts of sections whose strains are compared."""
    return robot.backbone.cut([_PARTS] * len(robot.backbone.sections))


def _stations(robot: RobotParams) -> np.ndarray:
    return robot.backbone.cut([_PARTS * _FINE] * len(robot.backbone.sections))


def _true_strains(truth: SpatialShape, robot: RobotParams) -> np.ndarray:
    """Mean turn (k, 3) [1/m] of parts about the sections' own axes."""
    frames = Rotation.from_matrix(truth.frame)
    turns = (frames[:-1].inv() * frames[1:]).as_rotvec()
    return turns.reshape(-1, _FINE, 3).sum(axis=1) / np.diff(_parts(robot))[:, None]


def _mean(strains: np.ndarray, edges: np.ndarray, parts: np.ndarray) -> np.ndarray:
    """Means (k, 3) of strains between edges over parts."""
    turned = np.append(np.zeros((1, 3)), np.cumsum(np.diff(edges)[:, None] * strains, axis=0), 0)
    at = np.stack([np.interp(parts, edges, column) for column in turned.T], axis=1)
    return np.diff(at, axis=0) / np.diff(parts)[:, None]
