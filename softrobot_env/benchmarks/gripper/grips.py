"""Clamped objects under a tension that rises slowly: enclosing and fingertip grips."""

from math import degrees, pi

import numpy as np

from softrobot_env.benchmarks.gripper.rows import Grip
from softrobot_env.robots import GRIPPERS
from softrobot_env.scene.assembly import AssembledScene, build_assembly
from softrobot_env.scene.gripper import gripper_scene
from softrobot_env.scene.objects import Capsule, Ellipsoid, Object
from softrobot_env.scene.simulation import Simulation

GRIPPER = GRIPPERS["gripper"]

#: Cylinders by their diameters [m], and the oval by its semi-axes [m] in the plane of the fingers.
CYLINDERS, OVAL = (0.094, 0.060, 0.048), (0.020, 0.013)

#: [m], semi-axis of the oval along the bar: so long that it hardly tapers between the fingers.
_LONG = 0.15

_FINGER = "middle"
_FULL, _RISE = 38.0, 3.8

#: A link presses from this force [N] on.
_PRESSES = 1e-3


def things() -> dict[str, tuple[Object, float | None]]:
    """Name -> what is gripped, and the radius [m] of a finger that lies on it."""
    width = float(GRIPPER.fingers[0].robot.backbone.widest)
    out: dict[str, tuple[Object, float | None]] = {}
    for diameter in CYLINDERS:
        place = 0.0, 0.0, GRIPPER.seat(diameter / 2)
        thing = Capsule(
            name="bar", radius=diameter / 2, length=0.08, turn=(-pi / 2, 0, 0), position=place
        )
        out[f"{1e3 * diameter:g} mm"] = thing, diameter / 2 + width
    place = 0.0, 0.0, GRIPPER.seat(max(OVAL))
    out["oval"] = Ellipsoid(name="bar", semi_axes=(OVAL[0], _LONG, OVAL[1]), position=place), None
    return out


def grips(name: str, step: float = 2.0, pieces: int | None = None) -> list[Grip]:
    """Grips of a thing, one each `step` [N]."""
    thing, radius = things()[name]
    built = build_assembly(gripper_scene(GRIPPER, (thing,), pieces=pieces))
    simulation, rows = Simulation(built), []
    simulation.reset(built.model.qpos0, np.zeros(built.n_inputs))
    periods = round(_RISE / built.config.control_period)
    every = round(step / _FULL * periods)
    for k in range(1, periods + 1):
        simulation.ctrl[:] = _FULL * k / periods
        if not simulation.advance():
            raise RuntimeError(simulation.failure())
        if k % every == 0:
            rows.append(_grip(name, built, simulation, radius))
    return rows


def _grip(name: str, built: AssembledScene, simulation: Simulation, radius: float | None) -> Grip:
    part = built[_FINGER]
    robot = part.scene.config.robot
    bends = part.curvature(simulation.posture)[:, 1].reshape(robot.pieces, -1).mean(axis=1)
    angles = np.degrees(bends) * robot.length / robot.pieces
    links = len(part.scene.layout.stations)
    pressing = [t for t in simulation.contacts() if t.first.startswith(f"{_FINGER}/")]
    forces = np.array([np.linalg.norm(t.force) for t in pressing])
    stations = np.array([t.stations[0] for t in pressing], dtype=float)
    outer = stations > 0.4 * robot.length
    tip = stations > 0.9 * robot.length
    tip_share = float(forces[tip].sum() / max(forces[outer].sum(), _PRESSES))
    turn = None if radius is None else degrees(robot.length / robot.pieces / radius)
    return Grip(
        thing=name,
        tension=float(simulation.ctrl[0]),
        kind=_kind(bends, tip_share, bool(outer.any())),
        angles=tuple(angles.tolist()),
        touching=float((forces > _PRESSES).sum() / links),
        tip_share=tip_share,
        turn=turn,
    )


def _kind(bends: np.ndarray, tip_share: float, touches: bool) -> str:
    """Fingertip: of all that presses beyond the first sensor most is at the tip, which curls."""
    if not touches:
        return "open"
    return "fingertip" if tip_share > 0.5 and bends[-1] > bends[-2] else "enclosing"
