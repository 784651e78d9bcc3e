"""Derivatives of simulated motions, by the adjoint of the steps that were taken.

What the step size control chose is given: the lengths of the intervals, the rows of their tables
and the entries that were taken stay as they are, as do the laws of drives that were slack or at
their limits and friction that stuck or slid; so derivatives are those of the smooth piece that was
computed, of the side on which it was. `Derivatives.switches` says how often such a law changed.
"""

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, NamedTuple

import mujoco
import numpy as np
from numpy import ndarray

from softrobot_env.core.motion import IntegrationError, State
from softrobot_env.robots.actuation import Inputs, by_action
from softrobot_env.scene.build import Scene
from softrobot_env.scene.integration import layout
from softrobot_env.scene.servos import Servos
from softrobot_env.scene.simulation import Simulation
from softrobot_env.scene.statics import checked_controls, finite

from . import tape as tapes
from .chain import FIELDS, Posture, Room
from .holding import Step
from .model import Plan, Values, columns_of, flat, plan_of, refusals, shaped, values_of
from .parameters import Parameter, parameter, sensitivities
from .step import Back
from .winding import Turns

if TYPE_CHECKING:
    from softrobot_env.envs.tracking import TrackingEnv

#: From the number of a period and a state (2 nv,) to an input.
Law = Callable[[int, ndarray], ndarray]

_TINY = 1e-30  # imaginary part of what is varied


@dataclass(frozen=True)
class Derivatives:
    """Derivatives of a number, the weighted sum of what is observed of a motion.

    Attributes:
        position, velocity: (nv,), by the state at the start.
        inputs: (periods, n_inputs), by what was applied in each period, or by actions.
        parameters: By the parameters of the rollout, by their names.
        switches: Intervals in which a drive or friction had another law than in the one before:
            the derivative is that of the piece in between.
        strays: Intervals in which friction had several solutions, of which that of the simulation
            was not found again: the derivative is that of another one.
    """

    position: ndarray
    velocity: ndarray
    inputs: ndarray
    parameters: dict[str, float]
    switches: int
    strays: int = 0


class Observed(NamedTuple):
    """What is observed of a motion at the start and the ends of all periods, or tangents of it.

    Attributes:
        position, velocity: (k, nv) [rad, rad/s].
        tip, tip_velocity: (k, 3) [m, m/s].
        tendon_length: (k, ntendon) [m], as MuJoCo counts them.
        tension: (k, nu) [N], forces of the drives.
    """

    position: ndarray
    velocity: ndarray
    tip: ndarray
    tip_velocity: ndarray
    tendon_length: ndarray
    tension: ndarray


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

    def run(self, inputs: ndarray, start: State | None = None, law: Law | None = None) -> "Motion":
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
            simulation.record()
            if not simulation.advance():
                raise IntegrationError(simulation.failure() or "diverged", simulation.time)
            ends.append(len(simulation.tape))
            states.append(self._state())
            controls.append(simulation.ctrl.copy())
        seen = np.stack(states), np.stack(controls)
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
        return {k: v for k, v in self.__dict__.items() if k not in ("track", "complex_track")}

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

    def rest(self, controls: ndarray | None = None, guess: ndarray | None = None) -> "Rest":
        """The equilibrium under controls (nu,); an environment's start unless given.

        As `Scene.equilibrium`, which tells of the guess and of errors: without friction.
        """
        if controls is None and self._rest is not None:
            return Rest(self, *self._rest)
        controls = checked_controls(self.scene.model, controls)
        return Rest(self, self.scene.equilibrium(controls, guess), controls)


class _Looked:
    """States (k, 2, nv) under controls (k, nu) that were looked at."""

    def __init__(self, rollout: Rollout, states: ndarray, controls: ndarray) -> None:
        self._rollout, self._states, self._controls = rollout, states, controls
        seen = np.zeros((len(states), self._seen))
        tapes.observe(rollout.plan, rollout.values, *rollout.track, states, controls, seen)
        self.observed = self._parted(states, seen)

    @property
    def _seen(self) -> int:
        plan = self._rollout.plan
        return tapes.LENGTHS + len(plan.begin) - 1 + len(plan.tendon)

    def _parted(self, states: ndarray, seen: ndarray) -> Observed:
        drives = seen.shape[1] - self._controls.shape[1]
        cuts = np.split(seen, [tapes.SPEED, tapes.LENGTHS, drives], axis=1)
        return Observed(states[:, 0], states[:, 1], *cuts)

    def _by_seen(self, weights: dict[str, ndarray], back: Back) -> tuple[ndarray, ndarray]:
        """Derivatives by states and controls of weights times what is observed; others in back."""
        unknown = [name for name in weights if name not in Observed._fields]
        if unknown:
            known = ", ".join(Observed._fields)
            raise ValueError(f"{unknown[0]!r} is not observed, choose from {known}")
        full = {
            name: finite(f"weights of {name}", weights[name], like.shape)
            if name in weights
            else np.zeros_like(like)
            for name, like in self.observed._asdict().items()
        }
        position, velocity, *seen = full.values()
        found = np.stack([position, velocity], axis=1), np.zeros_like(self._controls)
        own, seen = self._rollout, np.hstack(seen)
        chain = own.plan, own.values, *own.track, self._states, self._controls
        tapes.observe_back(*chain, seen, (back, *found))
        return found


class Rest(_Looked):
    """An equilibrium, to be looked at and derived.

    Attributes:
        controls: (nu,), that hold it.
        observed: What is observed of it, k = 1.
    """

    def __init__(self, rollout: Rollout, posture: ndarray, controls: ndarray) -> None:
        self.controls = controls
        state = np.stack([posture, np.zeros_like(posture)])
        super().__init__(rollout, state[None], controls[None])

    def vjp(self, **weights: ndarray) -> tuple[ndarray, dict[str, float]]:
        """Derivatives of weights times what is observed, see `Motion.vjp`.

        By the implicit function theorem: at rest the forces f(q, u, p) are 0, so that weights w on
        the posture are w dq = -(w / f_q) (f_u du + f_p dp).

        Returns:
            By controls (nu,), and by parameters by name.
        """
        own, back = self._rollout, self._rollout.zero()
        by_state, by_control = self._by_seen(weights, back)
        chain = own.plan, own.values, *own.track, self._states[0, 0], self.controls
        stiffness, forces = np.eye(by_state.shape[-1]), own.zero()
        tapes.rest_back(*chain, stiffness, own.zero())
        ways = -np.linalg.solve(stiffness.T, by_state[0, 0])[None]
        tapes.rest_back(*chain, ways, forces)
        by_parameters = own.by_parameters @ (flat(back.values) + flat(forces.values))
        named = dict(zip(own.parameters, by_parameters.tolist(), strict=True))
        return by_control[0] + forces.controls, named


class Motion(_Looked):
    """A simulated motion, to be looked at and derived.

    Attributes:
        inputs: (periods, n_inputs), that were given.
        observed: What is observed of it.
    """

    def __init__(
        self,
        rollout: Rollout,
        inputs: ndarray,
        tape: ndarray,
        ends: ndarray,
        seen: tuple[ndarray, ndarray],
        turns: list[Turns],
        resting: bool,
    ) -> None:
        states, controls = seen
        super().__init__(rollout, states, controls)
        self.inputs, self._resting, self._ends = inputs, resting, ends
        nv = states.shape[-1]
        width = layout.INTERVAL + 2 * nv + controls.shape[1]
        self._tape = np.ascontiguousarray(tape[:, :width])
        self._ramps = np.ascontiguousarray(tape[:, width:]).reshape(len(tape), 2, -1)
        choice = rollout.scene.timestep
        self._placed = rollout.is_placed  # else what is applied first has acted before
        self._rates = [one.rates(choice.timestep, choice.substeps) for one in turns]

    # ------------------------------------------------------------------ backwards

    def vjp(self, **weights: ndarray) -> Derivatives:
        """Derivatives of the sum of weights times what is observed.

        Args:
            **weights: By the names and of the shapes of `Observed`; zero unless given.

        Raises:
            ValueError: A name or a shape that nothing observed has.
        """
        own, back = self._rollout, self._rollout.zero()
        by_state, by_control = self._by_seen(weights, back)
        seeds = np.zeros((len(self._tape) + 1, *by_state.shape[1:]))
        seeds[self._ends] = by_state
        ramps = np.stack([self._ramps, np.zeros_like(self._ramps)])
        slides, strays = self._slides
        chain = own.plan, own.values, *own.track, self._tape
        switches = tapes.retrace(*chain, ramps, slides, (back, seeds))
        inputs = self._by_inputs(ramps[1], by_control)
        by_parameters = own.by_parameters @ flat(back.values)
        named = dict(zip(own.parameters, by_parameters.tolist(), strict=True))
        if self._resting and named:
            at_rest = own.rest().vjp(position=back.q[None])[1]
            named = {name: value + at_rest[name] for name, value in named.items()}
        return Derivatives(back.q, back.v, inputs, named, switches, strays)

    def linearised(self) -> tuple[ndarray, ndarray]:
        """Derivatives of the state (2 nv,), positions first, at the end of each period.

        Returns:
            (periods, 2 nv, 2 nv) by that at its start, and (periods, 2 nv, n_inputs) by its input.

        Raises:
            ValueError: Servos wind the tendons, whose state is no part of these.
        """
        if self._rates:
            raise ValueError("periods in which servos turn have no derivatives of their own")
        own, back, (n, nv) = self._rollout, self._rollout.zero(), (len(self._tape), self._nv)
        by_state = np.zeros((len(self.inputs), 2 * nv, 2 * nv))
        by_ramp = np.zeros((n, 2 * nv, *self._ramps.shape[1:]))
        chain = own.plan, own.values, *own.track, self._tape
        by = back, by_state, by_ramp
        tapes.linearise(*chain, self._ramps, self._slides[0], self._ends, by)
        applied = np.add.reduceat(by_ramp.sum(axis=2), self._ends[:-1])
        return by_state, self._by_given(applied)

    def tip_by_states(self, name: str = "tip") -> ndarray:
        """Derivatives (periods + 1, 3, 2 nv) of the tip by the states of `linearised`.

        Or of its velocity, `tip_velocity`.
        """
        rows = []
        for axis in range(3):
            weights = np.zeros_like(self.observed.tip)
            weights[:, axis] = 1.0
            by_state, _ = self._by_seen({name: weights}, self._rollout.zero())
            rows.append(by_state.reshape(len(by_state), -1))
        return np.stack(rows, axis=1)

    @cached_property
    def _slides(self) -> tuple[ndarray, int]:
        """What `tapes.find_slides` finds and returns."""
        own, columns, at = self._rollout, columns_of(self._rollout.plan), layout.INTERVAL
        found = np.zeros((len(self._tape), tapes.STEPS, columns), np.int8)
        if len(own.plan.rubs) + len(own.plan.zones) == 0:
            return found, 0
        states = self._tape[1:, at : at + 2 * self._nv].reshape(-1, 2, self._nv)
        after = np.concatenate([states, self._states[-1:]])
        chain = own.plan, own.values, *own.track, self._tape
        slides = found, np.zeros((tapes.TRIED, columns))
        return found, tapes.find_slides(*chain, self._ramps, after, slides)

    @property
    def _nv(self) -> int:
        return self._states.shape[-1]

    def _by_given(self, applied: ndarray) -> ndarray:
        """Derivatives (periods, ..., n_inputs) by what was given, of those by what was applied."""
        maps = [self._rollout.by_action(action) for action in self.inputs]
        return np.stack([x if m is None else x @ m for x, m in zip(applied, maps, strict=True)])

    def _by_inputs(self, ramps: ndarray, by_control: ndarray) -> ndarray:
        """Derivatives (periods, n_inputs) by inputs, of those by ramps (n, 2, nu) and controls."""
        periods, motor, horn = len(self.inputs), 0.0, 0.0
        applied = np.zeros((periods, self._controls.shape[1]))
        for p in reversed(range(periods)):
            own = ramps[self._ends[p] : self._ends[p + 1]]
            if not self._rates:
                applied[p] = own.sum(axis=(0, 1)) + by_control[p + 1]
                continue
            path, turned = self._rates[p]
            by_path = np.zeros((len(path), applied.shape[1]))
            for end, row in enumerate(self._rows_of(p, len(path))):
                np.add.at(by_path, row, own[:, end])
            by_path[-1] += by_control[p + 1] + horn
            motor, horn, applied[p] = np.einsum("kcd,kd->cd", path, by_path) + turned * motor
        if not self._placed:
            applied[0] += by_control[0]
        return self._by_given(applied)

    def _rows_of(self, period: int, rows: int) -> tuple[ndarray, ndarray]:
        """Rows (n,) of a servo's path at both ends of the ramps of a period's intervals."""
        own = self._tape[self._ends[period] : self._ends[period + 1]]
        ramp = np.cumsum(own[:, layout.INTERVAL - 2] == 0) - 1
        return np.minimum(ramp, rows - 1), np.minimum(ramp + 1, rows - 1)

    # ------------------------------------------------------------------ forwards

    def jvp(
        self,
        start: State | None = None,
        inputs: ndarray | None = None,
        parameters: dict[str, float] | None = None,
    ) -> Observed:
        """Derivatives of all that is observed along a change.

        Args:
            start: Change of the state at the start; of one at rest none that parameters make.
            inputs: (periods, n_inputs), change of the inputs.
            parameters: Changes by name.
        """
        own, (track, room) = self._rollout, self._rollout.complex_track
        states = np.zeros((len(self._tape) + 1, *self._states.shape[1:]), complex)
        states[0] = self._states[0] + (0 if start is None else 1j * _TINY * np.stack(start))
        change = np.zeros_like(self.inputs) if inputs is None else inputs
        ramps, controls = self._changed_controls(change)
        ramps, controls = self._ramps + 1j * _TINY * ramps, self._controls + 1j * _TINY * controls
        way = np.array([(parameters or {}).get(name, 0.0) for name in own.parameters])
        row = flat(own.values) + 1j * _TINY * (way @ own.by_parameters)
        values = shaped(row, own.values)
        chain = own.plan, values, track, room, self._tape
        tapes.follow(*chain, ramps, self._slides[0], states)
        seen = np.zeros((len(self._states), self._seen), complex)
        states = np.ascontiguousarray(states[self._ends])
        tapes.observe(own.plan, values, track, room, states, controls, seen)
        return self._parted(states.imag / _TINY, seen.imag / _TINY)

    def _changed_controls(self, change: ndarray) -> tuple[ndarray, ndarray]:
        """Changes of ramps (n, 2, nu) and controls (periods + 1, nu) by those of inputs."""
        ramps, controls = np.zeros_like(self._ramps), np.zeros_like(self._controls)
        motor = horn = np.zeros(controls.shape[1])
        for p, by in enumerate(change):
            by_action, own = self._rollout.by_action(self.inputs[p]), slice(*self._ends[p : p + 2])
            applied = by if by_action is None else by_action @ by
            if not self._rates:
                ramps[own], controls[p + 1] = applied, applied
                continue
            path, turned = self._rates[p]
            begin = np.stack([motor, horn, applied])
            moved = (path * begin).sum(axis=1)
            for end, row in enumerate(self._rows_of(p, len(path))):
                ramps[own, end] = moved[row]
            motor, horn = (turned * begin).sum(axis=0), moved[-1]
            controls[p + 1] = horn
        if not self._placed:
            controls[0] = controls[1]
        return ramps, controls


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
