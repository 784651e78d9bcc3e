"""Motions of scenes and environments, whose derivatives `motions` finds."""

from collections.abc import Callable, Iterable
from functools import cached_property
from typing import TYPE_CHECKING

import mujoco
import numpy as np
from mujoco import MjModel
from numpy import ndarray

from softrobot_env.core.motion import IntegrationError, State
from softrobot_env.robots.actuation import Inputs, by_action
from softrobot_env.scene.build import Scene
from softrobot_env.scene.servos import Servos
from softrobot_env.scene.simulation import Simulation
from softrobot_env.scene.statics import checked_controls, finite

from . import tape as tapes
from .chain import FIELDS, Posture, Room
from .holding import Step
from .model import Plan, Values, columns_of, plan_of, refusals, values_of
from .motions import Motion, Rest
from .parameters import Parameter, parameter, sensitivities, varied_model
from .step import Back
from .stepping import SteppedMotion, Stepper, state_of
from .winding import Turns

if TYPE_CHECKING:
    from softrobot_env.envs.tracking import TrackingEnv

#: Steps of differences by parameters where there are no others, over their scales [1].
_SHARE = 1e-4

#: From the number of a period and a state (2 nv,) to an input.
Law = Callable[[int, ndarray], ndarray]


class Rollout:
    """Motions of a scene, one at a time, and their derivatives.

    Attributes:
        scene: The scene.
        parameters: Names of the numbers of its robot by which derivatives are found.
        reference: (periods + 1, 3) [m], of an environment's task, NaN in coordinates that have
            none; None of a scene.
    """

    reference: ndarray | None = None

    def __init__(self, scene: Scene, parameters: Iterable[str | Parameter] = ()) -> None:
        """Prepare motions of a scene.

        Args:
            scene: The scene.
            parameters: Numbers of its robot, see `parameters.parameter`. What a chain changes by
                them is found once, which takes as long as building eight scenes for each.

        Raises:
            ValueError: The scene has something of which no derivative is known, or a parameter is
                none.
        """
        self.scene = scene
        refused = list(refusals(scene))
        if refused:
            raise ValueError(f"no derivatives are known of {'; '.join(refused)}")
        robot, self.plan, self.values = (
            scene.config.robot,
            plan_of(scene.model),
            values_of(scene.model),
        )
        wanted = [parameter(robot, x) if isinstance(x, str) else x for x in parameters]
        self.parameters = tuple(one.name for one in wanted)
        self.by_parameters = sensitivities(scene, wanted)
        self._varied = [_around(scene, one) for one in wanted] if self._stepped else []
        self._simulation = Simulation(scene)
        self._inputs: Inputs | None = None
        self._servos: Servos | None = None
        self._rest: tuple[ndarray, ndarray] | None = None

    @classmethod
    def of(cls, env: "TrackingEnv", parameters: Iterable[str | Parameter] = ()) -> "Rollout":
        """Motions of an environment by its actions, from its start at rest.

        Its robot as it is: without randomization, delays, gains and noise.

        Raises:
            ValueError: As of a scene; it has a beam model, or actions that change inputs.
        """
        env = env.unwrapped
        if env.scene is None or env.act_as != "input":
            raise ValueError(
                "derivatives are known of environments with the MuJoCo chain (leave out `plant`) "
                "and actions that are inputs (act_as='input')"
            )
        parts = env._parts
        if parts.servos() is not None and parts.plant.nominal.timestep.accuracy is None:
            raise ValueError(
                "no derivatives are known of servos that wind tendons of a robot that MuJoCo's "
                "integrators move, such as one with contacts"
            )
        out = cls(parts.plant.nominal, parameters)
        out._inputs, out._servos = parts.inputs.per_action(), parts.servos()
        if out._servos is not None:
            out._simulation.drive_by(out._servos)
        beginning = parts.beginning(parts.parse_options(None))
        out._rest = beginning.start.posture, beginning.start.command
        points = np.array(beginning.reference.points)
        out.reference = np.full((len(points), 3), np.nan)
        out.reference[:, parts.axes] = points
        return out

    def run(
        self, inputs: ndarray, start: State | None = None, law: Law | None = None
    ) -> Motion | SteppedMotion:
        """Simulate a motion.

        Args:
            inputs: (periods, n_inputs), held for a control period each: tensions [N] or lengths [m]
                and amplitudes of loads; of an environment actions in [-1, 1].
            start: The straight pose at rest unless given; of an environment its start.
            law: Function of the number of a period and the state (2 nv,) at its start that returns
                an input (n_inputs,) in place of the given one. It is not derived.

        Raises:
            ValueError: Inputs are not finite, of another shape, or out of their range.
            IntegrationError: The motion diverged.
        """
        simulation, rows = self._simulation, np.array(inputs, float)
        if rows.ndim != 2 or not len(rows):
            raise ValueError(f"need a row of inputs for each period, got shape {rows.shape}")
        resting = start is None and self._rest is not None
        self._reset(start, self._applied(rows[0]))
        turns: list[Turns] = []
        starts: list[ndarray] = []
        ends, states, controls = [0], [self._state()], [simulation.ctrl.copy()]
        for number in range(len(rows)):
            if law is not None:
                rows[number] = law(number, states[-1].ravel())
            command = self._applied(rows[number])
            if self._servos is None:
                simulation.ctrl[:] = command
            else:
                self._servos.command[:] = command
                turns.append(Turns.of(self._servos))
            if self._stepped:
                starts.append(state_of(simulation.data))
            else:
                simulation.record()
            if not simulation.advance():
                raise IntegrationError(simulation.failure() or "diverged", simulation.time)
            ends.append(0 if self._stepped else len(simulation.tape))
            states.append(self._state())
            controls.append(simulation.ctrl.copy())
        seen = np.stack(states), np.stack(controls)
        if self._stepped:
            return SteppedMotion(self, rows, np.stack(starts), seen, resting)
        return Motion(self, rows, simulation.tape.copy(), np.array(ends), seen, turns, resting)

    def _applied(self, given: ndarray) -> ndarray:
        """What is applied (nu,) by an input."""
        command = given if self._inputs is None else self._inputs.command(given)
        return checked_controls(self.scene.model, command)

    def _reset(self, start: State | None, first: ndarray) -> None:
        simulation, model = self._simulation, self.scene.model
        posture, command = (model.qpos0, first) if self._rest is None else self._rest
        velocity = np.zeros(model.nv)
        if start is not None:
            posture = finite("start.q", start.q, (model.nq,))
            velocity = finite("start.v", start.v, (model.nv,))
        if self._servos is not None:
            self._servos.start(command)
            command = self._servos.horn
        simulation.reset(posture, command)
        if velocity.any():
            simulation.data.qvel[:] = velocity
            mujoco.mj_forward(model, simulation.data)

    def _state(self) -> ndarray:
        data = self._simulation.data
        return np.stack([data.qpos, data.qvel])

    def __getstate__(self) -> dict:
        # Some of their arrays are views of others, which copies would not be.
        return {
            k: v for k, v in self.__dict__.items() if k not in ("track", "complex_track", "stepper")
        }

    def zero(self) -> Back:
        """Derivatives that are zero."""
        nv, nu = len(self.plan.axis), len(self.plan.tendon)
        sizes = (nv,), (nv,), (nu,), (1, nv), (nv,), (columns_of(self.plan),)
        return Back(*map(np.zeros, sizes), Values(*map(np.zeros_like, self.values)))

    @cached_property
    def track(self) -> tuple:
        """Arrays for the steps of an interval."""
        return _track(self.plan, float)

    @cached_property
    def complex_track(self) -> tuple:
        """As `track`, of complex numbers."""
        return _track(self.plan, complex)

    @property
    def _stepped(self) -> bool:
        """Whether one of MuJoCo's integrators moves the robot."""
        return self.scene.timestep.accuracy is None

    @cached_property
    def stepper(self) -> Stepper:
        """What derives such motions."""
        return Stepper(self.scene.model, self.scene.timestep.substeps, self._varied)

    @property
    def n_inputs(self) -> int:
        """Number of inputs, of an environment of its actions."""
        return self.scene.n_inputs if self._inputs is None else self._inputs.n_inputs

    @property
    def has_servos(self) -> bool:
        """Whether servos wind the tendons."""
        return self._servos is not None

    @property
    def is_placed(self) -> bool:
        """Whether what is applied at the start is given, not that of the first period."""
        return self._rest is not None

    def by_action(self, action: ndarray) -> ndarray | None:
        """Derivative (nu, n_inputs) of what is applied by an action; None of what is applied."""
        return None if self._inputs is None else by_action(self._inputs, action)

    def rest(self, controls: ndarray | None = None, guess: ndarray | None = None) -> Rest:
        """The equilibrium under controls (nu,); an environment's start unless given.

        As `Scene.equilibrium`, which tells of the guess and of errors: without friction.
        """
        posture, own = self._rest if controls is None and self._rest is not None else (None, None)
        if own is None:
            own = checked_controls(self.scene.model, controls)
            posture = self.scene.equilibrium(own, guess)
        if self._stepped:
            self._simulation.reset(posture, own)
            if self._simulation.data.ncon:
                raise ValueError("no derivatives are known of an equilibrium in which it touches")
        return Rest(self, posture, own)


def _around(scene: Scene, one: Parameter) -> tuple[MjModel, MjModel, float]:
    """Models with a larger and a smaller value of a parameter, and how far these are apart."""
    step = _SHARE * one.scale
    more, less = (varied_model(scene, one, one.value + s * step) for s in (1, -1))
    return more, less, 2 * step


def _track(plan: Plan, kind: type) -> tuple[tapes.Track, Room]:
    """Arrays for the steps of an interval."""
    bodies, nv, tendons, nu = (
        len(plan.parents),
        len(plan.axis),
        len(plan.begin) - 1,
        len(plan.tendon),
    )
    columns, parts, zones = columns_of(plan), len(plan.parts), len(plan.zones)
    p, s = tapes.POSTURES, tapes.STEPS

    def new(*shape: int) -> ndarray:
        return np.zeros(shape, kind)

    axis, inertia = new(p, nv, 6), new(p, bodies, 10)
    joints, places = (new(p, nv), new(p, nv)), (new(p, bodies, 3), new(p, bodies, 9))
    lines = new(p, tendons), new(p, tendons), new(p, parts, 4), new(p, tendons)
    flat_views = axis.reshape(p, -1), inertia.reshape(p, -1)
    forces = new(p, nu), new(p, nu), new(p, nv), new(p, columns, nv), new(p, zones)
    postures = Posture(*joints, *places, axis, inertia, *lines, *forces, *flat_views)
    trees = new(s, nv, 6), new(s, nv, 6), new(s, nv), new(plan.run[0], 21), new(plan.run[0], 6)
    each = [new(s, columns) for _ in range(5)]
    counts = [np.zeros((s, columns), np.int64) for _ in range(3)]
    steps = Step(
        (), new(s, nv), new(s, nv), new(s, 1 + columns, nv), new(s, columns, columns),
        new(s, columns, nv), new(s, columns, columns), *each, new(s, nv), *counts,
        new(s, columns), np.zeros((s, 1), np.int64),
    )  # fmt: skip
    weights, owner, laws = np.zeros((2, 4, 4)), np.zeros(s, np.int64), np.zeros((2, nu + columns))
    ends = new(2, nv), new(2, nv), new(2, nv)
    track = tapes.Track(
        postures, trees, steps, weights, new(p, nu), owner, *ends, laws, new(columns)
    )
    fields = new(FIELDS, bodies, 6), new(FIELDS, bodies, 6), new(bodies, 6)
    return track, Room(*fields, new(4, parts), new(zones), new(2, tendons), new(4, 6))
