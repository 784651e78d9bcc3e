"""Feedforward for any robot: the static inputs that hold the tip at the present reference."""

from typing import NamedTuple

import numpy as np

from softrobot_env.control.base import Controller, usable
from softrobot_env.control.status import NOT_FINITE, REASONS, UNREACHABLE
from softrobot_env.equilibrium import EquilibriumError
from softrobot_env.interfaces import Observation
from softrobot_env.robots import RobotParams
from softrobot_env.scene.build import build_scene
from softrobot_env.scene.inverse import Held, InverseStatics
from softrobot_env.scene.registry import scene_of

#: Distance of the tip at rest from the reference, as a share of the reach, that counts as out of
#: reach. Paths of tasks are series through solved points, good to a hundredth of it.
_OFF = 1e-4


class StaticState(NamedTuple):
    """What the next call needs.

    Attributes:
        target: (k,) [m], reference that `held` belongs to.
        held: Inputs of the last target that was reached, or those at the start.
        action: (n_inputs,) [1].
        status: Why the tip will not rest on the reference, or None.
    """

    target: np.ndarray
    held: Held | None
    action: np.ndarray
    status: str | None


class StaticFeedforward(Controller):
    """The inputs of least norm in whose equilibrium the tip is at the present reference.

    The quasi-static law of any robot: inverse statics on its MuJoCo chain, each decision from the
    one before. References may have two coordinates, x and z of a planar robot and x and y of a
    spatial one, or three; a third that does not follow from the other two is met as well where the
    robot has inputs left. Out of reach, the inputs that come nearest are held and the state's
    `status` says so.
    """

    requires = ("reference", "previous_action")

    def __init__(self, robot: RobotParams, control_period: float) -> None:
        """Of any robot with tendons, at any control period [s]."""
        self._scene = build_scene(scene_of(robot))
        self._inverse = InverseStatics(self._scene)
        self._space: InverseStatics | None = None
        self._off = _OFF * robot.reach
        self.sizes = {"previous_action": self._inverse.inputs.n_inputs}

    def start(self, observation: Observation) -> StaticState:
        """Begin from the inputs in force."""
        if len(observation["reference"]) not in (2, 3):
            raise ValueError(
                "StaticFeedforward needs 2 or 3 entries of reference, not "
                f"{len(observation['reference'])}"
            )
        inputs = self._inverse.inputs
        action = np.clip(usable(observation["previous_action"]), -1.0, 1.0)
        value = inputs.input_centre + action * inputs.input_scale
        try:
            posture = self._inverse.posture(value)
        except EquilibriumError:  # a motion may begin anywhere
            return StaticState(np.full(1, np.nan), None, action, None)
        held = Held(value[None], posture[None], np.zeros(1))
        return StaticState(np.full(1, np.nan), held, action, None)

    def act(self, observation: Observation, state: StaticState) -> tuple[np.ndarray, StaticState]:
        """Statics of the present reference."""
        if not all(np.isfinite(observation[name]).all() for name in self.requires):
            kept = np.clip(usable(observation["previous_action"]), -1.0, 1.0)
            return kept, state._replace(status=REASONS[NOT_FINITE])
        target = observation["reference"].copy()
        if not np.array_equal(target, state.target):  # it rests most of the time
            state = self._follow(target, state)
        return state.action.copy(), state

    def _follow(self, target: np.ndarray, state: StaticState) -> StaticState:
        first = len(state.target) != len(target)
        found, error = self._held(target, state.held, anywhere=first)
        reached = error <= self._off
        inputs = self._inverse.inputs
        action = (found.inputs[-1] - inputs.input_centre) / inputs.input_scale
        held = found if reached else state.held
        status = None if reached else REASONS[UNREACHABLE]
        return StaticState(target, held, np.clip(action, -1.0, 1.0), status)

    def _held(self, target: np.ndarray, before: Held | None, anywhere: bool) -> tuple[Held, float]:
        """Inputs, and the distance [m] of the tip from all coordinates of the target."""
        point, axes = np.zeros((1, 3)), self._axes(len(target))
        point[0, axes] = target
        found = self._inverse.solve(point, before, anywhere)
        error = self._error(found, target, axes)
        if error > self._off and len(target) == 3 and self._inverse.freedom > 2:
            if self._space is None:
                self._space = InverseStatics(self._scene, np.eye(3))
            spatial = self._space.solve(point, found, anywhere)
            closer = self._error(spatial, target, axes)
            if closer < error:
                return spatial, closer
        return found, error

    def _axes(self, size: int) -> list[int]:
        """Which coordinates of the world a reference of two or three is about."""
        if size == 3:
            return [0, 1, 2]
        return [0, 2] if self._scene.config.bending == "planar" else [0, 1]

    def _error(self, found: Held, target: np.ndarray, axes: list[int]) -> float:
        if not np.isfinite(found.errors[-1]):
            return np.inf
        return float(np.linalg.norm(self._scene.tip(found.postures[-1])[axes] - target))
