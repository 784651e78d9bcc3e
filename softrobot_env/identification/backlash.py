"""Backlash of a twin's servos, measured: the same lengths, approached from both sides.

Without dither a tendon lags behind its command by half of the servo's backlash and by friction over
the tendon's stiffness, unless the rig sways. So, slowly moved, the rig stands elsewhere after a
tendon was pulled there, and the others let out, than after the reverse; the network of its statics
tells how far apart that is in lengths.
"""

from collections.abc import Callable

import numpy as np

from softrobot_env.control.rig.inverse import TOTAL
from softrobot_env.identification.visits import Visit, disk_points, measure, nominal_lengths
from softrobot_env.robots import RIG
from softrobot_env.robots.twin import Twin

#: Places approached, of the disc of this radius [m]; five take four and a half minutes on a rig.
PLACES, _RADIUS = 5, 0.09

#: [m], by which the tendon pulled moves on the way to a place; the others' half is more than any
#: backlash.
_WAY = 1e-3

#: Slow enough not to sway: swaying works against friction as dither does against backlash.
_SLOWLY = Visit(move=4.0, rest=0.2, dither=0.0)

#: One tendon is pulled, the others are let out by half as much: (3, 3), a row each.
_PULLS = 1.5 * np.eye(3) - 0.5


def visit_sides(twin: Twin | int | None, seed: int = 0, count: int = PLACES) -> np.ndarray:
    """Outputs (3 count, 2, 2) [m]: of each place and `_PULLS`, after the pull and its reverse.

    Args:
        twin: See `RigEnv`.
        seed: Of the noise.
        count: Number of places.
    """
    places = nominal_lengths(RIG, disk_points(count, _RADIUS), TOTAL)
    way = _WAY * _PULLS
    stops = [x for here in places for w in way for x in (here - w, here, here + w, here)]
    found = measure(twin, np.array(stops), seed, visit=_SLOWLY)
    return found.reshape(-1, 4, 2)[:, 1::2]


def backlash_of(sides: np.ndarray, statics: Callable[[np.ndarray], np.ndarray]) -> float:
    """Backlash [m], see `IdentifiedParameters`, by least squares from what `visit_sides` found.

    Args:
        sides: (3 k, 2, 2) [m].
        statics: z (n, 2) [m] -> s (n, 3) [m] of the rig, with a constant sum of tensions.

    Raises:
        ValueError: Outputs of another shape.
    """
    if sides.ndim != 3 or sides.shape[1:] != (2, 2) or len(sides) % len(_PULLS):
        raise ValueError(f"need outputs (3 k, 2, 2), got {sides.shape}")
    apart = statics(sides[:, 1]) - statics(sides[:, 0])
    # The network sees what bends the rig, not the common part of the lags.
    lag = np.sign(_PULLS) - np.sign(_PULLS).mean(axis=1, keepdims=True)
    lags = np.tile(lag, (len(sides) // len(_PULLS), 1))
    return float(np.sum(apart * lags) / (2 * np.sum(lags**2)))
