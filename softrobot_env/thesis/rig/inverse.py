"""Inverse dynamics of the rig step by step: one piece, as in the thesis, or several.

Lengths and their dynamic part s_dyn of (5.36) to (5.39), with a constant sum of tensions: then the
map from reduced inputs to tensions is linear, and s_dyn has no kinks where another tendon becomes
the loosest.
"""

from typing import Any, NamedTuple

import numpy as np
from numpy import ndarray

from softrobot_env.control.feedforward.motion import Motion
from softrobot_env.identification.visits import TOTAL
from softrobot_env.robots import RobotParams

from . import servo_flexible
from .servo_constraints import ServoConstraints
from .servo_dae import hold
from .three_tendons import mean_curvature

#: Pieces of the model in several pieces, and the modulus over that of the chain with which they
#: stand as that does (a test holds it).
PIECES, PIECES_SOFTER = 3, 0.98

#: [m], how far a reference may be from where its motion brings it: farther is a jump.
_JUMP = 3e-3


class Pull(NamedTuple):
    """What moves the output as wanted.

    Attributes:
        total: (3,) [m], lengths pulled in.
        dynamic: (3,) [m], the part of them that is dynamic.
        tension: (3,) [N], of the whole motion. A tendon cannot push: where one is negative, it
            would slacken, and the motion wanted cannot be had with this sum of tensions.
    """

    total: ndarray
    dynamic: ndarray
    tension: ndarray


class OnePiece:
    """Servo constraints on one piece, in closed form (thesis sec. 5.2.2).

    `SeveralPieces(robot, 1)` tracks as well (within 5 % on the rig's tasks), but a decision takes
    2.4 times as long.
    """

    def __init__(self, robot: RobotParams) -> None:
        self._servo = ServoConstraints(robot)

    def step(self, memory: Any, now: Motion, then: Motion, period: float) -> tuple[Pull, Any]:
        """Inputs of the motion `then`, half a period [s] or none after `now`.

        Args:
            memory: What the last step returned, a period ago, which is never changed in place;
                None in the first one. Here it is a guess.
            now, then: The reference.
            period: Control period.

        Raises:
            OutOfReachError: The model cannot follow.
        """
        tendons = self._servo.tendons
        y, _, _, reduced, static = self._servo.motion(*(x[None] for x in then), memory)[:, 0]
        tension = tendons.with_total(reduced, TOTAL)
        total = tendons.pulled(tension, self._servo.curvature(y))
        return Pull(total, tendons.spread @ (reduced - static) / tendons.stiffness, tension), y


class _Past(NamedTuple):
    """Memory of `SeveralPieces`.

    Attributes:
        progress: Of the inversion.
        rest: (n + 2,), curvatures and reduced input that hold the output where it is.
        now: Reference of the last step.
    """

    progress: servo_flexible.Progress
    rest: ndarray
    now: Motion


class SeveralPieces:
    """Servo constraints on several pieces, integrated by two steps in a control period.

    After a jump of the reference it begins anew, at rest.
    """

    def __init__(self, robot: RobotParams, pieces: int = PIECES) -> None:
        self._model = servo_flexible.FlexibleServoConstraints(robot, pieces)

    def step(
        self, memory: _Past | None, now: Motion, then: Motion, period: float
    ) -> tuple[Pull, Any]:
        """As `OnePiece.step`; raises InversionError where the model cannot follow."""
        start = memory is None or _jumped(memory.now, now, period)
        past = self._begin(now, then) if start else self._go_on(memory, now, then, period)
        tendons, rest = self._model.tendons, past.rest
        tension = tendons.with_total(past.progress.reduced, TOTAL)
        moving = tendons.pulled(tension, mean_curvature(past.progress.q[2]))
        held = tendons.pulled(tendons.with_total(rest[-2:], TOTAL), mean_curvature(rest[:-2]))
        return Pull(moving, moving - held, tension), past

    def _begin(self, now: Motion, then: Motion) -> _Past:
        if not np.hypot(*then.position) < self._model.robot.reach:
            raise _unheld(then)
        progress = self._model.start(then.position)
        rest = np.concatenate([progress.q[2], progress.reduced])
        return _Past(progress, rest, now)

    def _go_on(self, past: _Past, now: Motion, then: Motion, period: float) -> _Past:
        """Two steps of half a period; between them, the reference is halfway where they are."""
        half = period / 2
        middle = then.after(-half, np.zeros(2)) if now is then else now
        progress = past.progress
        for motion in (middle, then):
            progress = self._model.step(progress, half, motion.position, motion.velocity)
        q, reduced = past.rest[:-2].copy(), past.rest[-2:].copy()
        if not hold(self._model.data, np.ascontiguousarray(then.position), q, reduced):
            raise _unheld(then)
        return _Past(progress, np.concatenate([q, reduced]), now)


def _unheld(there: Motion) -> servo_flexible.InversionError:
    return servo_flexible.InversionError(f"the output cannot be held at {there.position} m", 0.0)


def _jumped(before: Motion, now: Motion, period: float) -> bool:
    """Whether a reference is not where its motion brought it since a period [s] ago.

    By the trapezoidal rule with its correction at the ends, of fifth order in the period.
    """
    way = now.position - before.position - period / 2 * (before.velocity + now.velocity)
    way += period**2 / 12 * (now.acceleration - before.acceleration)
    return float(np.hypot(*way)) > _JUMP
