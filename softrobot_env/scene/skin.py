"""The visible body: one smooth surface that bends with the links (a MuJoCo skin)."""

import numpy as np

from softrobot_env.robots import RobotParams
from softrobot_env.scene.chain import Chain
from softrobot_env.scene.config import Rgba

BODY_SKIN = "soft_body"

_SIDES = 24
_RING_DISTANCE = 0.0125  # m
_ROUNDING = 0.15  # of the radius, at the rim of the tip


def add_skin(chain: Chain, robot: RobotParams, rgba: Rgba) -> None:
    """Add the surface of a straight cylinder and tie it to the links of the chain."""
    stations, radii = _profile(robot.length, robot.outer_radius)
    weights = _bone_weights(stations, chain.layout.stations, robot.length)
    ring_of_vertex = np.repeat(np.arange(len(stations)), _SIDES)
    bones = [np.flatnonzero(w > 1e-6) for w in weights[ring_of_vertex].T]
    origins = np.concatenate(([0.0], chain.layout.stations))
    chain.spec.add_skin(
        name=BODY_SKIN,
        rgba=rgba,
        vert=_vertices(stations, radii).ravel(),
        face=_faces(len(stations)).ravel(),
        bodyname=[body.name for body in chain.bodies],
        bindpos=np.stack([0 * origins, 0 * origins, origins], axis=1).ravel(),
        bindquat=np.tile([1.0, 0.0, 0.0, 0.0], len(origins)),
        vertid=[ids.tolist() for ids in bones],
        vertweight=[weights[ring_of_vertex[ids], i].tolist() for i, ids in enumerate(bones)],
    )


def _profile(length: float, radius: float) -> tuple[np.ndarray, np.ndarray]:
    """Arc length (n,) and radius (n,) [m] of the rings, with a rounded rim and a closed tip."""
    edge = _ROUNDING * radius
    rings = int(np.ceil((length - edge) / _RING_DISTANCE)) + 1
    body = np.linspace(0.0, length - edge, rings)
    angle = np.linspace(0, np.pi / 2, 4)[1:]
    stations = np.concatenate((body, length - edge * (1 - np.sin(angle)), [length]))
    rim = radius - edge * (1 - np.cos(angle))
    return stations, np.concatenate((np.full(rings, radius), rim, [0.0]))


def _bone_weights(stations: np.ndarray, hinges: np.ndarray, length: float) -> np.ndarray:
    """Share (n, 1 + n_hinges) of each link in the position of each ring.

    It passes from one link to the next between their middles. The smooth step makes the bent
    centre line tangent to every link in its middle.
    """
    edges = np.concatenate(([0.0], hinges, [length]))
    middles = (edges[:-1] + edges[1:]) / 2
    u = np.clip((stations[:, None] - middles[:-1]) / np.diff(middles), 0, 1)
    passed = np.hstack((np.ones((len(stations), 1)), u * u * (3 - 2 * u)))
    return passed - np.hstack((passed[:, 1:], np.zeros((len(stations), 1))))


def _vertices(stations: np.ndarray, radii: np.ndarray) -> np.ndarray:
    """(n * _SIDES, 3) [m], rounded to keep exported scenes short."""
    angle = 2 * np.pi * np.arange(_SIDES) / _SIDES
    x, y = np.multiply.outer(radii, np.cos(angle)), np.multiply.outer(radii, np.sin(angle))
    z = np.broadcast_to(stations[:, None], x.shape)
    return np.stack([x, y, z], axis=-1).reshape(-1, 3).round(5)


def _faces(rings: int) -> np.ndarray:
    """(n_faces, 3) vertex indices, counter-clockwise seen from outside."""
    ring, side = np.meshgrid(np.arange(rings - 1), np.arange(_SIDES), indexing="ij")
    a, b = ring * _SIDES + side, ring * _SIDES + (side + 1) % _SIDES
    c, d = a + _SIDES, b + _SIDES
    lower, upper = np.stack([a, b, d], axis=-1), np.stack([a, d, c], axis=-1)
    return np.concatenate((lower.reshape(-1, 3), upper.reshape(-1, 3)))
