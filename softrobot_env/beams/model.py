"""What all beam models offer to Python: one class over the compiled kernels."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from numbers import Integral
from typing import Any, NamedTuple

import numpy as np
from numpy import ndarray

from softrobot_env.compile.kernels import kernel, reference
from softrobot_env.core import equilibrium as equilibria
from softrobot_env.core.continuation import Newton, find_equilibrium
from softrobot_env.core.motion import IntegrationError, Motion, State, sample_times
from softrobot_env.core.processes import one_blas_thread
from softrobot_env.robots import Base, RobotParams
from softrobot_env.robots.loads import Load

from . import mechanics, signals
from .actuation import Actuation, make_actuation, points_only, tendon_tensions
from .numerics import band, integration, linearization
from .signals import Signal

#: Share of a piece within which a place counts as the end of the piece.
_SNAP = 1e-9

#: Step of the difference by the loads' share, which most forces are linear in.
_SHARE = 1e-2


@dataclass(frozen=True)
class BeamMotion(Motion):
    """A simulated motion and what it took.

    Attributes:
        steps, rejected: Steps taken and repeated.
        residuals, matrices: Evaluations of the equations of motion and of Newton's matrix.
        smallest_step, largest_step: [s].
    """

    steps: int
    rejected: int
    residuals: int
    matrices: int
    smallest_step: float
    largest_step: float


class ControlAffine(NamedTuple):
    """M(q) a + k(q, v) = f(q, v) + B(q) u, thesis (2.96), or (2.98) for tendons driven by length.

    Attributes:
        mass: M (n, n).
        gyroscopic: k (n,), quadratic in the velocities.
        force: f (n,), elastic, damping and gravity forces.
        inputs: B (n, n_inputs).
    """

    mass: ndarray
    gyroscopic: ndarray
    force: ndarray
    inputs: ndarray


class BeamModel:
    """A discretised robot with tendons and loads; subclasses choose coordinates and kinematics.

    All coordinates are along the robot's own axes at its base; places, velocities and momenta that
    are read out are in the world, dead loads and gravity are given there.

    Inputs u are the tendons' tensions [N] (or lengths pulled in [m]), then the loads' amplitudes.
    Tensions are applied as given: limits, and that tendons cannot push, are up to the drive
    (`TendonMap`).

    Attributes:
        robot: The robot.
        pieces: Number of pieces, equal in each section; the robot's own unless given, or `fewest`.
        edges: (pieces + 1,) [m], their ends.
        loads: Its loads.
        drive: How tendons are driven, "tension" or "length".
        data: Reference to the structure for the kernels (`beams.mechanics`). Gravity enters it as
            a field `gravity` that all gravity forces are linear in.
        input_names: Names of the inputs.
        warns: Whether the model warns where it knows that it is inaccurate; a study of its errors
            need not be warned.
        inertia: How the mass is distributed: a name, or rigid bodies that are all of it.

    Raises:
        ValueError: No whole number of pieces, an unknown drive, or the robot has what no beam model
            has: a head (unless given rigid bodies stand for it), anisotropy or precurvature.
    """

    inertia: str | Sequence[Any] = "distributed"
    warns: bool = True

    def __init__(
        self, robot: RobotParams, pieces: int | None, loads: Sequence[Load], drive: str
    ) -> None:
        _check_robot(robot, has_head=not isinstance(self.inertia, str))
        pieces = max(robot.pieces, self.fewest(robot)) if pieces is None else pieces
        if not (isinstance(pieces, Integral) and pieces >= 1):
            raise ValueError(f"pieces must be a whole number, at least one, got {pieces!r}")
        self.robot, self.loads, self.drive = robot, tuple(loads), drive
        self.pieces, self._base = int(pieces), robot.base or Base()
        self.edges = self._cut()
        self.data: Any = reference(self._data(make_actuation(robot, loads, drive)))
        self.input_names = tuple(x.name for x in (*robot.tendons, *loads))
        if drive == "length":  # as the model sums it up: rounding must not make a tendon slack
            straight = self.tendon_length(self.rest())
            actuation = self.data.actuation._replace(straight=straight)
            self.data = self.data._replace(actuation=actuation)

    # ------------------------------------------------------------------ chosen by a subclass

    @classmethod
    def fewest(cls, robot: RobotParams) -> int:
        """Number of pieces with fewer of which the model cannot follow the robot's tendons."""
        return 1

    def _cut(self) -> ndarray:
        """Ends (pieces + 1,) [m] of the pieces."""
        return self.robot.backbone.cut(self.pieces)

    def _data(self, actuation: Actuation) -> Any:
        """Structure for the kernels with some actuation, an instance of a NamedTuple class."""
        raise NotImplementedError

    def rest(self) -> ndarray:
        """Coordinates (n,) of the straight pose."""
        raise NotImplementedError

    def curvature(self, q: ndarray) -> ndarray:
        """Mean curvature (pieces, 3) [1/m] about x, y and z of each piece at q (n,)."""
        raise NotImplementedError

    def tangent(self, q: ndarray) -> ndarray:
        """Directions (n, m) that q (n,) can change in; the identity without constraints."""
        return np.eye(len(q))

    def moved(self, q: ndarray, change: ndarray) -> ndarray:
        """Coordinates (n,) changed by (n,), exactly so to first order only."""
        return q + change

    def warn_of(self, q: ndarray) -> None:
        """Warn that the model is not to be trusted at q (n,), if it knows that."""

    def static_data(self, data: Any) -> Any:
        """Data whose static equations are regular; differs for redundant coordinates."""
        return data

    # ------------------------------------------------------------------ equations of motion

    @property
    def n(self) -> int:
        """Number of coordinates."""
        return self.data.n

    @property
    def n_inputs(self) -> int:
        """Number of inputs."""
        return len(self.input_names)

    def start(self) -> State:
        """The straight pose at rest."""
        q = self.rest()
        return State(q, np.zeros_like(q))

    def residual(self, q: ndarray, v: ndarray, a: ndarray, u: ndarray | None = None) -> ndarray:
        """Force (n,) missing from balance: M a + k - f - B u at q, v, a (n,)."""
        q, v, a = (self._vector(x) for x in (q, v, a))
        out = np.empty(self.n)
        mechanics.residual(self.data, q, v, a, self._inputs(u), out)
        return out

    def acceleration(self, q: ndarray, v: ndarray, u: ndarray | None = None) -> ndarray:
        """Acceleration (n,) in state q, v (n,) under inputs u (n_inputs,), zero if not given."""
        q, v = self._vector(q), self._vector(v)
        out = np.empty(self.n)
        mechanics.acceleration(self.data, q, v, self._inputs(u), out)
        return out

    def first_order(self, u: ndarray | Signal) -> Callable[[float, ndarray], ndarray]:
        """Right-hand side f(t, y) of y = (q, v) (2 n,) for the solvers of SciPy."""
        signal, n = reference(self._signal(u)), self.n
        inputs = np.empty(self.n_inputs)

        def derivative(t: float, y: ndarray) -> ndarray:
            signals.evaluate(signal, t, inputs)
            out = np.empty(2 * n)
            out[:n] = y[n:]
            mechanics.acceleration(self.data, y[:n], y[n:], inputs, out[n:])
            return out

        return derivative

    def control_affine(self, q: ndarray, v: ndarray) -> ControlAffine:
        """The equations of motion at q, v (n,), with all tendons taut if driven by length."""
        zero = np.zeros(self.n)
        static = self.residual(q, zero, zero)
        forward, backward = self.residual(q, v, zero), self.residual(q, -np.asarray(v), zero)
        mass = np.stack([self.residual(q, zero, e) - static for e in np.eye(self.n)], axis=1)
        force, inputs = -static - (forward - backward) / 2, self._unit_inputs(q)
        if self.drive == "length":
            k = len(self.robot.tendons)
            actuation = self.data.actuation
            slack = self.tendon_length(q) - actuation.straight
            # The residual without inputs already holds the tendons that u = 0 leaves taut.
            taut = self.tendon_tension(q, np.zeros(self.n_inputs))
            free = actuation.pretension + actuation.stiffness * slack - taut
            force = force + inputs[:, :k] @ free
            inputs[:, :k] *= actuation.stiffness
        return ControlAffine(mass, (forward + backward) / 2 - static, force, inputs)

    def _unit_inputs(self, q: ndarray) -> ndarray:
        """B (n, n_inputs) for tensions and load amplitudes."""
        data = self.data._replace(actuation=self.data.actuation._replace(by_length=False))
        out = np.empty((self.n, self.n_inputs))
        linearization.input_derivatives(data, self._vector(q), np.zeros(self.n_inputs), out)
        return out

    # ------------------------------------------------------------------ statics and dynamics

    @one_blas_thread()
    def equilibrium(
        self,
        u: ndarray | None = None,
        guess: ndarray | None = None,
        load_steps: int = 1,
        check_stability: bool | str = True,
    ) -> ndarray:
        """Coordinates (n,) in equilibrium under constant inputs u (n_inputs,).

        Args:
            u: Inputs, zero unless given.
            guess: (n,), where Newton's method starts. Without it, or if that fails, the path of
                equilibria from the straight pose is followed while the loads grow.
            load_steps: Least number of equal steps in which inputs, gravity and pretension grow
                along that path; as many as it needs are taken anyway.
            check_stability: True or "static" refuses an equilibrium that loads at rest cannot
                give; "dynamic" also one that flutters; False none (`equilibrium.require_stable`).

        Raises:
            EquilibriumError: None was found, or an unstable one.
            ValueError: `load_steps` or `check_stability` is not one of these.
        """
        kind, u = equilibria.stability_asked(check_stability), self._inputs(u)
        load_steps = equilibria.checked_load_steps(load_steps)
        guess = None if guess is None else self._finite(guess)
        loaded = LoadedModel(self, u)
        q = find_equilibrium(loaded, self.rest(), guess, load_steps)
        if kind == "dynamic" or (kind == "static" and not self._resists(loaded, q)):
            space = self.linearize(State(q, np.zeros_like(q)), u)
            equilibria.require_stable(kind, space.stiffness, space.mass, space.damping)
        if self.warns:
            self.warn_of(q)
        return q

    def _resists(self, loaded: "LoadedModel", q: ndarray) -> bool:
        """Whether every deviation from q (n,) is opposed, whatever the masses."""
        t = self.tangent(q)
        return equilibria.positive_definite(t.T @ loaded.stiffness(q) @ t)

    def simulate(
        self,
        duration: float,
        u: ndarray | Signal | None = None,
        start: State | None = None,
        *,
        method: str = "sdirk4",
        step: float | None = None,
        tolerance: float | None = None,
        samples: ndarray | float | None = None,
        max_steps: int = 10_000_000,
    ) -> BeamMotion:
        """Simulate a motion.

        Args:
            duration: [s].
            u: Constant inputs (n_inputs,) or a `Signal`; zero unless given.
            start: Initial state; the straight pose at rest unless given.
            method: A key of `integration.METHODS`.
            step: [s], fixed step; without it a method that estimates its error adapts it.
            tolerance: Largest error of a step, relative to the size of a large motion; 1e-6
                unless given. With a fixed step it bounds the error of Newton's iteration only,
                1e-10 unless given: accelerations follow from positions divided by step^2.
            samples: Instants (k,) [s] from 0 to the duration, or their distance [s], which
                divides it; start and end unless given.
            max_steps: Where to give up.

        Raises:
            ValueError: Unknown method, or a method that needs a step.
            IntegrationError: The integration failed; the message says how and when.
        """
        scheme = integration.find_method(method, step)
        start = self.start() if start is None else start
        times = sample_times(duration, samples)
        q, v = (self._finite(x).copy() for x in start)
        found = integration.samples(times, self.n)
        # An adaptive method finds its step within a few steps of any small one.
        if tolerance is None:
            tolerance = 1e-6 if step is None else 1e-10
        control = integration.Control(step is None, step or duration / 1000, tolerance, max_steps)
        width = mechanics.bandwidth(self.data)
        work = integration.workspace(self.n, width, len(scheme.b), self.n_inputs)
        given = (reference(x) for x in (scheme, control, self._signal(u), work))
        code, reached = integration.integrate(self.data, *given, (q, v), found)
        if code != integration.DONE:
            raise IntegrationError(
                f"{integration.FAILURES[code]} at t = {reached:.4g} s ({method}, "
                f"{'adaptive step' if step is None else f'step {step:g} s'})",
                reached,
            )
        if self.warns:
            self.warn_of(found.q[-1])
        return BeamMotion(*found, *work.counters.tolist(), *work.steps.tolist())

    @one_blas_thread()
    def linearize(self, state: State, u: ndarray | None = None) -> linearization.StateSpace:
        """Linear model about a state under inputs u (n_inputs,).

        Redundant coordinates are replaced by those of `tangent`; that is exact only at rest in
        equilibrium.

        Raises:
            ValueError: The coordinates are redundant and the state moves.
        """
        q, v = (self._finite(x).copy() for x in state)
        u, n = self._inputs(u), self.n
        rows = np.empty((3, n, 3 * mechanics.bandwidth(self.data) + 1))
        a = self.acceleration(q, v, u)
        linearization.residual_derivatives(self.data, q, v, a, u, rows)
        inputs = np.empty((n, self.n_inputs))
        linearization.input_derivatives(self.data, q, u, inputs)
        t = self.tangent(q)
        if t.shape[1] < n and np.any(v):
            raise ValueError("a model with redundant coordinates is linearised at rest only")
        stiffness, damping, mass = t.T @ band.dense(rows) @ t
        tip = self._point_jacobian(q, np.array([self.robot.length])) @ t
        m = t.shape[1]
        solved = np.linalg.solve(mass, np.hstack([stiffness, damping, t.T @ inputs]))
        upper = np.hstack([np.zeros((m, m)), np.eye(m)])
        return linearization.StateSpace(
            a=np.vstack([upper, -solved[:, : 2 * m]]),
            b=np.vstack([np.zeros((m, self.n_inputs)), solved[:, 2 * m :]]),
            c=np.hstack([tip, np.zeros((3, m))]),
            mass=mass,
            damping=damping,
            stiffness=stiffness,
        )

    # ------------------------------------------------------------------ read-outs

    def positions(self, q: ndarray, stations: ndarray, offsets: ndarray | None = None) -> ndarray:
        """Material points at arc lengths (k,) [m], offsets (k, 2) [m] in the section.

        Args:
            q: (n,) or (T, n).
            stations, offsets: Places; on the centreline unless offset.

        Returns:
            (k, 3) or (T, k, 3) [m].
        """
        probe = self.probe(stations, offsets)
        series = np.atleast_2d(np.ascontiguousarray(q, float))
        if series.shape[1] != self.n:
            raise ValueError(f"need coordinates of {self.n} numbers each, got {np.shape(q)}")
        out = np.empty((len(series), len(probe.actuation.point_station), 3))
        _locate_series(probe, series, out)
        out = out @ self._base.axes.T + np.array(self._base.position)
        return out if np.ndim(q) == 2 else out[0]

    def probe(self, stations: ndarray, offsets: ndarray | None = None) -> Any:
        """Data of the model whose points, for `mechanics.locate`, are these.

        Args:
            stations: (k,) [m] from 0 to the robot's length.
            offsets: (k, 2) [m] in the section; on the centreline unless given.

        Raises:
            ValueError: A point is off the robot, or the shapes do not fit.
        """
        stations = self.robot.stations(stations, offsets)
        return reference(self._data(points_only(stations, offsets)))

    def tip(self, q: ndarray) -> ndarray:
        """Tip (3,) or (T, 3) [m] of the centreline for q (n,) or (T, n)."""
        return self.positions(q, np.array([self.robot.length]))[..., 0, :]

    def velocities(self, q: ndarray, v: ndarray, stations: ndarray) -> ndarray:
        """Velocity (k, 3) [m/s] of the centreline at arc lengths (k,) [m] in state q, v (n,)."""
        return (self._point_jacobian(q, np.atleast_1d(stations)) @ v).reshape(-1, 3)

    def _point_jacobian(self, q: ndarray, stations: ndarray) -> ndarray:
        """(3 k, n) derivative of centreline points by the coordinates."""
        probe = self.probe(stations)
        out = np.empty((3 * len(stations), self.n))
        linearization.point_derivatives(probe, self._vector(q), out)
        return (self._base.axes @ out.reshape(-1, 3, self.n)).reshape(out.shape)

    def tendon_length(self, q: ndarray) -> ndarray:
        """(n_tendons,) [m] inside the robot at q (n,)."""
        q = self._vector(q)
        out = np.empty(len(self.robot.tendons))
        mechanics.tendon_lengths(self.data, q, out)
        return out

    def tendon_tension(self, q: ndarray, u: ndarray) -> ndarray:
        """(n_tendons,) [N] at q (n,) under inputs u (n_inputs,)."""
        out = np.empty(len(self.robot.tendons))
        tendon_tensions(self.data.actuation, self._inputs(u), self.tendon_length(q), out)
        return out

    def kinetic_energy(self, q: ndarray, v: ndarray) -> float:
        """[J] in state q, v (n,)."""
        q, v = self._vector(q), self._vector(v)
        return float(mechanics.kinetic_energy(self.data, q, v))

    def potential_energy(self, q: ndarray) -> float:
        """Elastic and gravitational energy [J] at q (n,), zero in the straight pose."""
        return float(mechanics.potential(self.data, self._vector(q)))

    def momentum(self, q: ndarray, v: ndarray) -> ndarray:
        """Linear [N s] and angular momentum [N m s] (6,) about the origin in state q, v (n,)."""
        q, v = self._vector(q), self._vector(v)
        out = np.empty(6)
        mechanics.momentum(self.data, q, v, out)
        out = (out.reshape(2, 3) @ self._base.axes.T).ravel()
        out[3:] += np.cross(self._base.position, out[:3])
        return out

    # ------------------------------------------------------------------ arguments

    def _vector(self, x: ndarray) -> ndarray:
        """Coordinates, velocities or accelerations, whose shape the kernels rely on."""
        x = np.ascontiguousarray(x, float)
        if x.shape != (self.n,):
            raise ValueError(f"states of this model have shape ({self.n},), got {x.shape}")
        return x

    def _finite(self, x: ndarray) -> ndarray:
        """The same, from which a computation starts; read-outs also take diverged states."""
        x = self._vector(x)
        if not np.all(np.isfinite(x)):
            where = np.flatnonzero(~np.isfinite(x)).tolist()
            raise ValueError(f"states must be finite, got {x[where[0]]} in coordinates {where}")
        return x

    def _inputs(self, u: ndarray | None) -> ndarray:
        if u is None:
            return np.zeros(self.n_inputs)
        u = np.ascontiguousarray(u, float)
        if u.shape != (self.n_inputs,):
            raise ValueError(
                f"inputs must have shape ({self.n_inputs},) for {', '.join(self.input_names)}; "
                f"got {u.shape}"
            )
        if not np.all(np.isfinite(u)):
            named = zip(self.input_names, u, strict=True)
            wrong = [f"{name!r} = {x}" for name, x in named if not np.isfinite(x)]
            raise ValueError(f"inputs must be finite, got {', '.join(wrong)}")
        return u

    def _signal(self, u: ndarray | Signal | None) -> Signal:
        if not isinstance(u, Signal):
            return signals.constant(self._inputs(u))
        if u.coefficients.shape[2] != self.n_inputs:
            raise ValueError(
                f"the signal has {u.coefficients.shape[2]} inputs, the model {self.n_inputs}: "
                f"{', '.join(self.input_names)}"
            )
        if not np.all(np.isfinite(u.coefficients)):
            raise ValueError("the signal's coefficients must be finite")
        return u


class LoadedModel:
    """A model under a share of its inputs, gravity and pretension."""

    def __init__(self, model: BeamModel, u: ndarray) -> None:
        data, actuation = model.data, model.data.actuation
        self._whole = (data.gravity, actuation.pretension, u)
        self._part = tuple(x.copy() for x in self._whole)
        gravity, pretension, _ = self._part
        actuation = actuation._replace(pretension=pretension)
        self._data = model.static_data(data._replace(gravity=gravity, actuation=actuation))
        self._zero, self.scale, self.moved = np.zeros(model.n), data.scale, model.moved
        width = mechanics.bandwidth(self._data)
        self._width, self._matrix = width, np.empty((model.n, 3 * width + 1))
        self._pivot = np.empty(model.n, np.int64)

    def _residual(self, q: ndarray, share: float) -> ndarray:
        for part, whole in zip(self._part, self._whole, strict=True):
            np.multiply(share, whole, out=part)
        out = np.empty_like(q)
        mechanics.residual(self._data, q, self._zero, self._zero, self._part[2], out)
        return out

    def stiffness(self, q: ndarray) -> ndarray:
        """Derivative (n, n) of the forces that rest takes by q (n,), under full loads."""
        self._residual(q, 1.0)
        linearization.stiffness_band(self._data, q, self._part[2], self._matrix)
        return band.dense(self._matrix)

    def newton(self, q: ndarray, share: float) -> Newton | None:
        """Newton's changes at q (n,), None where the stiffness is singular or not finite."""
        ahead = self._residual(q, share + _SHARE)
        missing = self._residual(q, share)
        linearization.stiffness_band(self._data, q, self._part[2], self._matrix)
        if not band.factor(self._matrix, self._width, self._pivot):
            return None
        found = Newton(-missing, (missing - ahead) / _SHARE)
        for x in found:
            band.solve(self._matrix, self._width, self._pivot, x)
        return found if all(np.all(np.isfinite(x)) for x in found) else None

    def again(self, q: ndarray, share: float) -> ndarray:
        """The change (n,) to balance the forces at q (n,), by the last factors."""
        change = -self._residual(q, share)
        band.solve(self._matrix, self._width, self._pivot, change)
        return change


def masses_at(robot: RobotParams, places: ndarray) -> ndarray:
    """Masses (k,) [kg] at places (k,) [m], which share backbone and discs between them."""
    backbone, number = robot.backbone, np.arange(len(places))

    def beyond(s: ndarray) -> ndarray:
        at = np.interp(s, places, number)
        return backbone.mass(s) * (at - np.floor(at))

    second = backbone.integrals(beyond, places)
    mass = np.append(backbone.integrals(backbone.mass, places) - second, 0.0)
    mass[1:] += second
    for disc in robot.discs:
        at = float(np.interp(disc.station, places, number))
        k = min(int(at), len(places) - 2)
        mass[k : k + 2] += disc.mass * np.array([k + 1 - at, at - k])
    return mass


def in_pieces(stations: ndarray, edges: ndarray) -> ndarray:
    """Places (k,) of stations (k,) [m] as numbers of pieces, whose edges [m] are whole numbers."""
    at = np.interp(stations, edges, np.arange(len(edges)))
    return np.where(np.abs(at - np.round(at)) < _SNAP, np.round(at), at)


def _check_robot(robot: RobotParams, has_head: bool) -> None:
    if robot.head is not None and not has_head:
        raise ValueError(
            f"robot {robot.name!r} has a head, which beam models know only as one of PCC's rigid "
            "bodies: give all its mass as `inertia`, or take the MuJoCo chain"
        )
    if not robot.is_symmetric:
        raise ValueError(
            f"robot {robot.name!r}: beam models have no anisotropy and no precurvature, only the "
            "MuJoCo chain has"
        )


@kernel
def _locate_series(model, q, out):
    """Set out (T, n_points, 3) [m] for coordinates (T, n)."""
    none = np.empty((0, 3, 3))
    for k in range(len(q)):
        mechanics.locate(model, q[k], out[k], none)
