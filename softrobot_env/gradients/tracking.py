"""Inputs that let a tip follow a path, by Gauss and Newton's method on the whole motion.

Each step takes the derivatives of all periods (`Motion.linearised`) and finds the change of the
inputs that is best for them, by dynamic programming from the end (Riccati's recursion), with the
last input as a part of the state so that changes of inputs cost something, and inputs within their
limits. The next motion is simulated with the laws of feedback that this gives, which keep it where
derivatives know it; Levenberg's damping does too. Rough inputs cost much at first: a smooth motion
near the path comes before an exact one.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy import ndarray
from numpy.linalg import norm, solve

from softrobot_env.core.motion import IntegrationError

from .motions import Motion
from .rollout import Rollout

#: Damping [1] at first, factors on it after steps that failed and that did not, and the largest.
_DAMPING, _HARDER, _EASIER, _STIFFEST = 1e-2, 8.0, 0.1, 1e4

#: Costs of rough inputs [1] before the one that is wanted.
_SMOOTH = (1e1, 1.0, 1e-1, 1e-2, 1e-3)

#: Cost of the square of an input over that of its change, so that inputs that do the same agree.
_EFFORT = 1e-2

#: Share of the cost by which a step has to be better, else it is the last of its cost.
_ENOUGH = 0.1


@dataclass(frozen=True)
class Followed:
    """What was found.

    Attributes:
        inputs: (periods, n_inputs), actions.
        motion: The motion by them.
        error: (periods + 1,) [m], distance of the tip from the path.
        steps: Number of steps taken.
    """

    inputs: ndarray
    motion: Motion
    error: ndarray
    steps: int


def follow(
    rollout: Rollout,
    path: ndarray | None = None,
    guess: ndarray | None = None,
    *,
    roughness: float = 1e-5,
    most_steps: int = 40,
    show: Callable[[int, float], None] | None = None,
) -> Followed:
    """Find actions of an environment by which the tip follows a path.

    Args:
        rollout: Of the environment, see `Rollout.of`, without servos.
        path: (periods + 1, 3) [m], NaN in coordinates that do not matter; the reference of the
            environment's task unless given.
        guess: (periods, n_inputs), where the search begins; zero unless given.
        roughness: [1], cost of the square of an action's change in a period, over that of an error
            of the robot's length.
        most_steps: At most so many steps.
        show: Called with each step and the largest error [m].

    Raises:
        ValueError: Arguments do not fit the robot, servos wind its tendons, or the rollout is of a
            scene.
        IntegrationError: The motion by the guess diverges.
    """
    if rollout.reference is None:
        raise ValueError("need a rollout of an environment, whose actions are within [-1, 1]")
    if rollout.has_servos:
        name = rollout.scene.config.robot.name
        raise ValueError(
            f"robot {name!r}: servos wind its tendons, with a speed or a dead time; paths are for "
            "robots whose actions take effect at once"
        )
    path = np.asarray(rollout.reference if path is None else path, float)
    guess = np.zeros((len(path) - 1, rollout.n_inputs)) if guess is None else guess
    here, step = rollout.run(guess), 0
    for cost in (*(x for x in _SMOOTH if x > roughness), roughness):
        problem = _Problem(rollout, path, cost)
        damping, gain = _DAMPING, 1.0
        while step < most_steps and gain > _ENOUGH:
            better, damping = problem.step(here, damping)
            if better is None:
                break
            step, gain, here = step + 1, 1 - problem.cost(better) / problem.cost(here), better
            if show is not None:
                show(step, float(problem.error(here).max()))
    return Followed(here.inputs, here, problem.error(here), step)


class _Problem:
    def __init__(self, rollout: Rollout, path: ndarray, roughness: float) -> None:
        self._rollout = rollout
        self._known = np.isfinite(path).any(axis=0)
        if path.ndim != 2 or path.shape[1] != 3 or not np.isfinite(path[:, self._known]).all():
            raise ValueError("need a path of points (periods + 1, 3), each coordinate known or NaN")
        self._path = path[:, self._known]
        self._rough = roughness * rollout.scene.config.robot.length**2
        self._effort = _EFFORT * self._rough

    def _gap(self, motion: Motion) -> ndarray:
        return motion.observed.tip[:, self._known] - self._path

    def error(self, motion: Motion) -> ndarray:
        """(periods + 1,) [m]."""
        return norm(self._gap(motion), axis=1)

    def cost(self, motion: Motion) -> float:
        """Squares of errors [m2], and of changes of inputs."""
        steps = np.diff(motion.inputs, axis=0)
        held = self._effort * (motion.inputs**2).sum()
        return float((self._gap(motion) ** 2).sum() + self._rough * (steps**2).sum() + held)

    def step(self, motion: Motion, damping: float) -> tuple[Motion | None, float]:
        """A better motion, or None, and how to damp the next step."""
        model, cost = self.model(motion), self.cost(motion)
        while damping < _STIFFEST:
            moved = self.moved(motion, self.laws(motion, model, damping))
            if moved is not None and self.cost(moved) < cost:
                return moved, _EASIER * damping
            damping *= _HARDER
        return None, damping

    def moved(self, motion: Motion, laws: tuple[ndarray, ndarray]) -> Motion | None:
        """The motion by laws beside another one, None if it diverges."""
        (first, gains), before = laws, motion.inputs
        past = motion.observed
        states = np.hstack([past.position, past.velocity])
        last = np.zeros(before.shape[1])

        def law(k: int, state: ndarray) -> ndarray:
            nonlocal last
            own = first[k] + gains[k] @ np.append(state - states[k], last)
            limited = np.clip(before[k] + own, -1.0, 1.0)
            last = limited - before[k]
            return limited

        try:
            return self._rollout.run(before, law=law)
        except IntegrationError:
            return None

    def model(self, motion: Motion) -> tuple[ndarray, ndarray, ndarray]:
        """Derivatives of periods, and of the tip (periods + 1, known, 2 nv) by states."""
        return *motion.linearised(), motion.tip_by_states()[:, self._known]

    def laws(self, motion: Motion, model: tuple, damping: float) -> tuple[ndarray, ndarray]:
        """Changes of inputs that are best as far as derivatives tell.

        Returns:
            (periods, n_inputs), and by changes of the state and of the input before
            (periods, n_inputs, 2 nv + n_inputs).
        """
        (by_state, by_input, tips), gap = model, self._gap(motion)
        inputs = motion.inputs
        periods, states, count = by_input.shape
        rough, eye = self._rough, np.eye(count)
        value, slope = np.zeros((states + count,) * 2), np.zeros(states + count)
        first, gains = np.zeros((periods, count)), np.zeros((periods, count, states + count))
        for k in reversed(range(periods)):
            value[:states, :states] += tips[k + 1].T @ tips[k + 1]
            slope[:states] += tips[k + 1].T @ gap[k + 1]
            step = inputs[k] - inputs[k - 1] if k else np.zeros(count)
            own = rough * (k > 0)
            begin = np.zeros((states + count,) * 2)  # (state, input before) to (state, this input)
            begin[:states, :states] = by_state[k]
            moved = np.vstack([by_input[k], eye])
            curved = moved.T @ value @ moved + (own + self._effort + damping * rough) * eye
            mixed = moved.T @ value @ begin
            mixed[:, states:] -= own * eye
            pushed = moved.T @ slope + own * step + self._effort * inputs[k]
            room = np.stack([-1 - inputs[k], 1 - inputs[k]])
            first[k], free = _within(curved, pushed, room)
            gains[k, free] = -solve(curved[np.ix_(free, free)], mixed[free])
            slope = begin.T @ slope + mixed.T @ first[k] + gains[k].T @ (pushed + curved @ first[k])
            slope[states:] -= own * step
            value = begin.T @ value @ begin + mixed.T @ gains[k]
            value[states:, states:] += own * eye
            value = (value + value.T) / 2  # rounding would grow
        return first, gains


def _within(curved: ndarray, pushed: ndarray, room: ndarray) -> tuple[ndarray, ndarray]:
    """The least of x . curved x / 2 + pushed . x within room (2, n), and where x is free."""
    free, x = np.ones(len(pushed), bool), np.zeros(len(pushed))
    for _ in range(len(pushed) + 1):
        x[free] = solve(curved[np.ix_(free, free)], -(pushed + curved[:, ~free] @ x[~free])[free])
        beyond = free & ((x < room[0]) | (x > room[1]))
        x = np.clip(x, *room)
        if not beyond.any():
            break
        free &= ~beyond
    return x, free
