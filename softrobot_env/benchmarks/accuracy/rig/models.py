"""The package's models as the rig at rest: each gives the output point for lengths pulled in.

The closed form and the chain have the head. The beam models have none beyond the backbone's end:
at rest its weight is a dead force on the end, and a moment that is found together with the posture.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import mujoco
import numpy as np
from scipy.optimize import root

from softrobot_env.beams.closed_forms.spatial_piece import (
    RigPiece,
    add_static,
    make_rig_piece,
    output,
)
from softrobot_env.beams.exact.rig_column import tensions
from softrobot_env.beams.model import BeamModel
from softrobot_env.benchmarks.accuracy.cases.beam_models import COSSERAT, DISTRIBUTED, Contestant
from softrobot_env.benchmarks.accuracy.rig.cases import PERIOD, ROBOT
from softrobot_env.benchmarks.accuracy.rows import BENDING, Physics
from softrobot_env.robots import RobotParams
from softrobot_env.robots.loads import Load
from softrobot_env.scene.build import Scene, build_scene
from softrobot_env.scene.config import SceneConfig, TipSensors
from softrobot_env.scene.quadrature import RULES
from softrobot_env.scene.statics import equilibrium

PIECE = "rig_piece"

#: Joints of the chain, coarse to fine; those of rules with three joints per piece.
JOINTS, JOINTS_OF_THREES = (2, 4, 8, 16, 32), (3, 6, 12, 24)

#: Pieces of the beam models at rest.
PIECES = {DISTRIBUTED.name: (1, 2, 4, 8, 16), COSSERAT.name: (6, 12, 24, 48)}

_LOAD_STEPS = 4
_TOLERANCE = 1e-12

#: Output point (3,) [m] for lengths (3,) [m].
Solve = Callable[[np.ndarray], np.ndarray]


@dataclass(frozen=True)
class Entry:
    """A model with its resolution.

    Attributes:
        name: Name in the report.
        n: Pieces, of the chain joints.
        physics: What it converges to.
        solve: Statics.
    """

    name: str
    n: int
    physics: Physics
    solve: Solve


def entries(quick: bool = False) -> list[Entry]:
    """All models at rest; a quick run has the coarsest ones."""
    found = [Entry(PIECE, 1, BENDING, piece_statics())]
    for contestant in (DISTRIBUTED, COSSERAT):
        for n in PIECES[contestant.name][: 2 if quick else None]:
            solve = beam_statics(contestant, n)
            found.append(Entry(contestant.name, n, contestant.physics, solve))
    for rule in RULES:
        for n in joint_numbers(rule)[: 3 if quick else None]:
            found.append(Entry(f"mujoco_chain/{rule}", n, BENDING, chain_statics(rule, n)))
    return found


def joint_numbers(rule: str) -> tuple[int, ...]:
    """Joints of the chain with a rule."""
    return JOINTS_OF_THREES if len(RULES[rule]) == 3 else JOINTS


def piece_statics(robot: RobotParams = ROBOT) -> Solve:
    """The closed form of one piece, with uniform backbone and head."""
    piece = make_rig_piece(robot, "distributed")
    offsets = np.array([t.offset for t in robot.tendons])

    def missing(y: np.ndarray, pulled: np.ndarray) -> np.ndarray:
        moment = tensions(robot, pulled, np.array([y[1], -y[0]])) @ offsets
        out = np.array([moment[1], -moment[0]])
        add_static(piece, y, out)
        return out

    def solve(pulled: np.ndarray) -> np.ndarray:
        y = np.zeros(2)
        for share in np.arange(1, _LOAD_STEPS + 1) / _LOAD_STEPS:
            y = root(missing, y, (share * pulled,), tol=_TOLERANCE).x
        return piece_output(piece, y)

    return solve


def piece_output(piece: RigPiece, y: np.ndarray) -> np.ndarray:
    """Output point (3,) [m] of the closed form at y (2,) [rad]."""
    point, jacobian = np.empty(3), np.empty((3, 2))
    output(piece, np.ascontiguousarray(y), point, jacobian)
    return point


def beam_statics(contestant: Contestant, n: int, robot: RobotParams = ROBOT) -> Solve:
    """A beam model that carries the head as a dead load."""
    weight = robot.head.mass * np.array(robot.gravity)
    end = robot.length
    loads = (
        Load("head", end, force=tuple(weight)),
        Load("lever_x", end, moment=(1.0, 0.0, 0.0)),
        Load("lever_y", end, moment=(0.0, 1.0, 0.0)),
    )
    model = contestant.build(replace(robot, head=None), n, loads, "spatial", drive="length")

    def solve(pulled: np.ndarray) -> np.ndarray:
        q, moment = model.rest(), np.zeros(2)
        for share in np.arange(1, _LOAD_STEPS + 1) / _LOAD_STEPS:

            def posture(
                moment: np.ndarray, share: float = share, near: np.ndarray = q
            ) -> np.ndarray:
                u = np.array([*(share * pulled), 1.0, *moment])
                return model.equilibrium(u, near, check_stability=False)

            def missing(moment: np.ndarray, posture: Callable = posture) -> np.ndarray:
                lever = robot.head.centre * end_axis(model, posture(moment))
                return np.cross(lever, weight)[:2] - moment

            moment = root(missing, moment, tol=_TOLERANCE).x
            q = posture(moment)
        return model.tip(q) + robot.head.output * end_axis(model, q)

    return solve


def end_axis(model: BeamModel, q: np.ndarray) -> np.ndarray:
    """Unit vectors (..., 3) along a head that is fixed to the end, at q (n,) or (T, n)."""
    radius = model.robot.outer_radius
    places = np.array([[0.0, 0.0], [radius, 0.0], [0.0, radius]])
    points = model.positions(q, np.full(3, model.robot.length), places)
    centre, x, y = np.moveaxis(points, -2, 0)
    axis = np.cross(x - centre, y - centre)
    return axis / np.linalg.norm(axis, axis=-1, keepdims=True)


def chain_scene(rule: str, n: int, robot: RobotParams = ROBOT, **options: object) -> Scene:
    """The chain on n joints, driven by length."""
    config = SceneConfig(
        robot,
        pieces=n // len(RULES[rule]),
        rule=rule,
        actuation="length",
        bending="spatial",
        control_period=PERIOD,
        sensors=(TipSensors(),),
        **options,
    )
    return build_scene(config)


def chain_statics(rule: str, n: int, robot: RobotParams = ROBOT) -> Solve:
    """The MuJoCo chain on n joints."""
    model = chain_scene(rule, n, robot).model

    def solve(pulled: np.ndarray) -> np.ndarray:
        data = mujoco.MjData(model)
        data.qpos[:] = equilibrium(model, pulled, load_steps=_LOAD_STEPS)
        mujoco.mj_kinematics(model, data)
        return data.site("tip").xpos.copy()

    return solve
