"""Feedforward controllers of the rig (thesis ch. 5): statics from a network, dynamics from a model.

    rig_nn             s = network(z)                                   sec. 5.1
    inverse_dynamics   s = model(z, z', z'')                            sec. 5.2
    hybrid             s = network(z) + s_dyn of the model              sec. 5.3, (5.36) to (5.39)

and beyond the thesis: the reference half a control period ahead, as an input that is held for a
period lags by half of it; the model in several pieces; that model calibrated by the data that the
network was trained with; and what is known of the servos, their speed and backlash. All may be
corrected by feedback of the tip.
"""

from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from numpy import ndarray

from softrobot_env.control.base import NOT_FINITE, REASONS, UNREACHABLE, Controller
from softrobot_env.control.feedforward.feedback import Feedback, FeedbackState
from softrobot_env.control.feedforward.motion import Motion, ahead_of
from softrobot_env.control.feedforward.nearby import Neighbourhood
from softrobot_env.control.feedforward.statics import ChainStatics, Rest
from softrobot_env.core.interfaces import Observation
from softrobot_env.core.records import Positive, check_argument
from softrobot_env.robots import CAMERA_PERIOD, LENGTH_SCALE, SERVO_SPEED, WORKSPACE, RobotParams
from softrobot_env.scene.registry import RIG_PIECES

from .inverse import OnePiece, SeveralPieces
from .parameters import IdentifiedParameters
from .servo_constraints import OutOfReachError
from .servo_flexible import InversionError

_MARGIN = 3e-3  # m, by which a reference may lie beyond the points of the network
_BLIND = 0.1  # s without a finite reference, after which it is given up

_TIP = "tip_position"
_MOTION = ("reference", "reference_velocity", "reference_acceleration")
_LIMITED, _OUTSIDE = "length limit reached", "outside the trained workspace"
_UNREACHABLE, _NOT_FINITE = REASONS[UNREACHABLE], REASONS[NOT_FINITE]
_SLACK, _SLOW = "tendon would slacken", "servo too slow"


class Correction(NamedTuple):
    """Memory of the feedback: where the statics it goes by are at rest, and what it remembers."""

    rest: Rest
    feedback: FeedbackState


class RigState(NamedTuple):
    """What the next call needs.

    Attributes:
        memory: Of the inverse model; None to begin anew.
        now: The reference of the last call, None to begin anew.
        wanted: (3,) [m], lengths wanted of the horns; None to begin anew.
        blind: [s] since the last reference that was finite.
        action: (3,) [1], the last one; None at the start.
        status: Why action or motion is not the one wanted, or None; see `RigFeedforward`.
        correction: Of the feedback; None without, and before its first decision.
    """

    memory: Any = None
    now: Motion | None = None
    wanted: ndarray | None = None
    blind: float = 0.0
    action: ndarray | None = None
    status: str | None = None
    correction: Correction | None = None


class RigFeedforward(Controller):
    """s = network(z_ref) + dynamic part of a model, or all of it by the model.

    Decides from the reference, its velocity and acceleration alone, and from the tip where it is
    fed back: one that is not finite then counts as where it should be. When the reference is not
    finite, it goes on with the acceleration it had, for a tenth of a second; after that, and when
    it is out of the model's reach, the action in force is kept. Beyond the points that the network
    was trained with, it is asked for the farthest place in that direction.

    The state's `status` is the first of these that holds. What changes the action, or may have,
    comes first; with the last two the action is the one wanted, but the rig cannot do it.

        observation not finite          or the action in force is unknown
        reference out of reach          the action in force is kept
        length limit reached            the action is clipped
        outside the trained workspace   the network is asked for a nearer place
        tendon would slacken            the model wants a negative tension; never without a model
        servo too slow                  the action differs from the one in force by more than
                                        `SERVO_SPEED` allows in a control period
    """

    requires = (*_MOTION, "previous_action")

    def __init__(
        self,
        robot: RobotParams,
        control_period: float,
        identified: IdentifiedParameters | None = None,
        model: OnePiece | SeveralPieces | None = None,
        ahead: bool = False,
        backlash: float | None = None,
        believed: RobotParams | None = None,
        tip_delay: float = CAMERA_PERIOD,
        margin: float = _MARGIN,
    ) -> None:
        """Put the parts together.

        Args:
            robot: Nominal rig.
            control_period: [s] between calls.
            identified: Identified parameters, whose statics count; those of the model unless given.
            model: Dynamics; the controller is quasi-static unless given.
            ahead: Take the reference half a control period ahead.
            backlash: [m], see `IdentifiedParameters`; unless given, the servos are taken as ideal.
            believed: The rig by whose chain the tip is fed back, see `Feedback`; unless given, it
                is not.
            tip_delay: [s], how late the tip is seen.
            margin: [m], by which a reference may lie beyond the points that the network was
                trained with.

        Raises:
            ValueError: Neither statics nor a model are given, or the period is not positive and
                finite.
        """
        check_argument("control_period", control_period, Positive)
        check_argument("backlash", backlash, float | None)
        if identified is None and model is None:
            raise ValueError("a feedforward controller needs identified statics, a model or both")
        self._network = None if identified is None else identified.statics
        self._model, self._period, self._backlash = model, control_period, backlash
        self._farthest = WORKSPACE + margin
        self._lead = control_period / 2 if ahead else 0.0
        self._reach = SERVO_SPEED * control_period / LENGTH_SCALE  # of an action, in a period
        self.sizes = dict.fromkeys(_MOTION, 2) | {"previous_action": len(robot.tendons)}
        self._chain = self._feedback = None
        if believed is not None:
            self._chain = ChainStatics(replace(believed, pieces=RIG_PIECES))
            near = Neighbourhood(self._chain, control_period)
            self._feedback = Feedback(
                self._chain,
                control_period,
                tip_delay=tip_delay,
                learning=near,
                drive_delay=believed.drive.late,
            )
            self.requires, self.sizes = (*self.requires, _TIP), self.sizes | {_TIP: 2}

    def start(self, observation: Observation) -> RigState:
        """Begin at rest."""
        return RigState()

    def act(self, observation: Observation, state: RigState) -> tuple[ndarray, RigState]:
        """Lengths for the motion wanted."""
        now = Motion(*(np.array(observation[name]) for name in _MOTION))
        blind = 0.0 if np.isfinite(now).all() else state.blind + self._period
        unseen = self._feedback is not None and not np.isfinite(observation[_TIP]).all()
        if blind > _BLIND or ((blind or unseen) and state.now is None):
            return _keep(observation, state, _NOT_FINITE)
        if blind:
            now = state.now.after(self._period, np.zeros(2))
        try:
            wanted, tension, memory = self._lengths(now, state)
        except (OutOfReachError, InversionError):
            return _keep(observation, state, _UNREACHABLE)
        more, correction = self._correction(observation, now, state)
        wanted = wanted + more
        action = self._driven(wanted, state.wanted) / LENGTH_SCALE
        limited, before = np.clip(action, -1.0, 1.0), observation["previous_action"]
        if blind or unseen or not np.isfinite(before).all():
            status = _NOT_FINITE
        elif (limited != action).any():
            status = _LIMITED
        else:
            status = self._status(now, tension, action - before)
        if correction is not None and status is not None and state.correction is not None:
            # What is missed for that reason is not for feedback to make up.
            feedback = correction.feedback.unlearned(state.correction.feedback)
            correction = correction._replace(feedback=feedback)
        return limited, RigState(memory, now, wanted, blind, limited.copy(), status, correction)

    def _correction(
        self, observation: Observation, now: Motion, state: RigState
    ) -> tuple[ndarray | float, Correction | None]:
        """Lengths (3,) [m] that feedback adds, and its memory."""
        if self._feedback is None:
            return 0.0, None
        tip, motion, before = observation[_TIP], self._then(now, state), state.correction
        if before is None:
            begun = self._chain.begin(np.zeros(len(observation["previous_action"])))
            before = Correction(begun, self._feedback.start(now.position))
        first = state.correction is None
        rest = self._chain.hold(motion.position, before.rest, first)
        more, feedback, _ = self._feedback.added(rest, motion, now.position, tip, before.feedback)
        return more, Correction(rest, feedback)

    def _decide_stacked(
        self, observation: Observation, states: list[Any]
    ) -> tuple[ndarray, list[Any]]:
        """As of any controller; the statics of all that is finite in one call."""
        sound = np.all([np.isfinite(observation[n]).all(axis=1) for n in self.requires], axis=0)
        alone = (self._model, self._backlash, self._feedback) == (None, None, None)
        if not alone or self._lead or not sound.any():
            return super()._decide_stacked(observation, states)
        actions, then = self._statics_stacked({n: observation[n][sound] for n in self.requires})
        if sound.all():
            return actions, then
        out, rest = np.empty((len(sound), self.sizes["previous_action"]), np.float32), ~sound
        left = {name: observation[name][rest] for name in self.requires}
        out[sound] = actions
        out[rest], others = super()._decide_stacked(
            left, [state for state, bad in zip(states, rest, strict=True) if bad]
        )
        fine, bad = iter(then), iter(others)
        return out, [next(fine) if one else next(bad) for one in sound]

    def _statics_stacked(self, observation: Observation) -> tuple[ndarray, list[RigState]]:
        """Actions float32 (k, 3) of the network alone, and states, for finite observations."""
        motion = [np.array(observation[name], float) for name in _MOTION]
        distance = np.hypot(*motion[0].T)
        share = np.minimum(1.0, self._farthest / np.maximum(distance, WORKSPACE))
        wanted = self._network.batch(motion[0] * share[:, None])
        action = wanted / LENGTH_SCALE
        limited = np.clip(action, -1.0, 1.0)
        change = np.abs(action - observation["previous_action"]).max(axis=1)
        status = np.select(
            [(limited != action).any(axis=1), distance > self._farthest, change > self._reach],
            [_LIMITED, _OUTSIDE, _SLOW],
            "",
        )
        rows = zip(*motion, wanted, limited, status.tolist(), strict=True)
        states = [RigState(None, Motion(*m), w, 0.0, a, said or None) for *m, w, a, said in rows]
        return limited.astype(np.float32), states

    def _lengths(self, now: Motion, state: RigState) -> tuple[ndarray, ndarray | None, Any]:
        """Lengths (3,) [m] wanted of the servos' horns, tensions (3,) [N], the model's memory."""
        then = self._then(now, state)
        if self._model is None:
            return self._statics(then.position), None, None
        pull, memory = self._model.step(state.memory, now, then, self._period)
        if self._network is None:
            return _finite(pull.total), pull.tension, memory
        return self._statics(then.position) + _finite(pull.dynamic), pull.tension, memory

    def _then(self, now: Motion, state: RigState) -> Motion:
        """The reference as far ahead as it is looked for."""
        if not self._lead:
            return now
        before = None if state.now is None else state.now.acceleration
        return now.ahead(self._lead, before, self._period)

    def _statics(self, place: ndarray) -> ndarray:
        """Lengths (3,) [m] that hold the output at (2,) [m], or as far that way as was trained."""
        distance = np.hypot(*place)
        return self._network(place * min(1.0, self._farthest / max(distance, WORKSPACE)))

    def _driven(self, wanted: ndarray, before: ndarray | None) -> ndarray:
        """Commands (3,) [m] with which the horns are on average where they should be."""
        if self._backlash is None or before is None:
            return wanted
        rate = (wanted - before) / self._period
        return wanted + ahead_of(rate, self._period, SERVO_SPEED, self._backlash)

    def _status(self, now: Motion, tension: ndarray | None, change: ndarray) -> str | None:
        """Why the rig will not do as wanted although the action (3,) is within its limits, or None.

        Args:
            now: The reference.
            tension: (3,) [N] wanted, or None.
            change: (3,) [1], of the action.
        """
        if self._network is not None and np.hypot(*now.position) > self._farthest:
            return _OUTSIDE
        # Lists of three are several times quicker than arrays.
        if tension is not None and min(tension.tolist()) < 0:
            return _SLACK
        return _SLOW if max(map(abs, change.tolist())) > self._reach else None


def _finite(lengths: ndarray) -> ndarray:
    """The lengths (3,) [m]; InversionError if the model's equations had no solution."""
    if not np.isfinite(lengths).all():
        raise InversionError("the model has no finite lengths for the reference", 0.0)
    return lengths


def _keep(observation: Observation, state: RigState, status: str) -> tuple[ndarray, RigState]:
    """The action in force, and a state that begins anew but for the feedback."""
    before = observation["previous_action"]
    if not np.isfinite(before).all():
        before = np.zeros_like(before) if state.action is None else state.action
    kept = np.clip(before, -1.0, 1.0)
    return kept, RigState(action=kept.copy(), status=status, correction=state.correction)
