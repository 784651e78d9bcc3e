"""Simulated motions and equilibria, to be looked at and derived: by the adjoint of their steps.

What the step size control chose is given: the lengths of the intervals, the rows of their tables
and the entries that were taken stay as they are, as do the laws of drives that were slack or at
their limits and friction that stuck or slid; so derivatives are those of the smooth piece that was
computed, of the side on which it was. `Derivatives.switches` says how often such a law changed.
"""

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy import ndarray

from softrobot_env.core.motion import State
from softrobot_env.scene.integration import layout
from softrobot_env.scene.statics import finite

from . import tape as tapes
from .model import Values, columns_of, flat, shaped
from .step import Back
from .winding import Turns

if TYPE_CHECKING:
    from .rollout import Rollout

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


class Looked:
    """States (k, 2, nv) under controls (k, nu) that were looked at."""

    def __init__(self, rollout: "Rollout", states: ndarray, controls: ndarray) -> None:
        self._rollout, self._states, self._controls = rollout, states, controls
        seen = np.zeros((len(states), self._width))
        tapes.observe(rollout.plan, rollout.values, *rollout.track, states, controls, seen)
        self.observed = self._parted(states, seen)

    @property
    def _width(self) -> int:
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

    def _along(self, states: ndarray, controls: ndarray, way: ndarray) -> Observed:
        """Changes of what is observed by those of states and controls, and along parameters."""
        own, (track, room) = self._rollout, self._rollout.complex_track
        there = np.ascontiguousarray(self._states + 1j * _TINY * states)
        seen = np.zeros((len(states), self._width), complex)
        controls = self._controls + 1j * _TINY * controls
        tapes.observe(own.plan, self._varied(way), track, room, there, controls, seen)
        return self._parted(states, seen.imag / _TINY)

    def _varied(self, way: ndarray) -> Values:
        """The chain's numbers, with their changes along parameters in their imaginary part."""
        own = self._rollout
        return shaped(flat(own.values) + 1j * _TINY * (way @ own.by_parameters), own.values)

    @property
    def _nv(self) -> int:
        return self._states.shape[-1]


class Rest(Looked):
    """An equilibrium, to be looked at and derived.

    Attributes:
        controls: (nu,), that hold it.
        observed: What is observed of it, k = 1.
    """

    def __init__(self, rollout: "Rollout", posture: ndarray, controls: ndarray) -> None:
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


class Moved(Looked):
    """A simulated motion, to be looked at and derived.

    Attributes:
        inputs: (periods, n_inputs), that were given.
        observed: What is observed of it.
    """

    def __init__(
        self, rollout: "Rollout", inputs: ndarray, seen: tuple[ndarray, ndarray], resting: bool
    ) -> None:
        super().__init__(rollout, *seen)
        self.inputs, self._resting = inputs, resting

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

    def _named(self, by_parameters: ndarray, start: ndarray) -> dict[str, float]:
        """Derivatives by name; by a start at rest, too, of those (nv,) by where that is."""
        own = self._rollout
        named = dict(zip(own.parameters, by_parameters.tolist(), strict=True))
        if self._resting and named:
            at_rest = own.rest().vjp(position=start[None])[1]
            named = {name: value + at_rest[name] for name, value in named.items()}
        return named

    def _by_given(self, applied: ndarray) -> ndarray:
        """Derivatives (periods, ..., n_inputs) by what was given, of those by what was applied."""
        maps = [self._rollout.by_action(action) for action in self.inputs]
        return np.stack([x if m is None else x @ m for x, m in zip(applied, maps, strict=True)])


class Motion(Moved):
    """A motion by the integrator of this package."""

    def __init__(
        self,
        rollout: "Rollout",
        inputs: ndarray,
        tape: ndarray,
        ends: ndarray,
        seen: tuple[ndarray, ndarray],
        turns: list[Turns],
        resting: bool,
    ) -> None:
        super().__init__(rollout, inputs, seen, resting)
        self._ends = ends
        width = layout.INTERVAL + 2 * self._nv + self._controls.shape[1]
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
        named = self._named(by_parameters, back.q)
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
        if start is not None:
            states[0] = 1j * _TINY * np.stack(start)
        change = np.zeros_like(self.inputs) if inputs is None else inputs
        ramps, controls = self._changed_controls(change)
        way = np.array([(parameters or {}).get(name, 0.0) for name in own.parameters])
        chain = own.plan, self._varied(way), track, room, self._tape
        tapes.follow(*chain, self._ramps + 1j * _TINY * ramps, self._slides[0], states)
        return self._along(states[self._ends].imag / _TINY, controls, way)

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
