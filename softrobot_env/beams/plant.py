"""A beam model as the plant of an environment: one control period at a time."""

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from softrobot_env.beams import mechanics
from softrobot_env.beams.model import BeamModel
from softrobot_env.beams.numerics.compilation import kernel, reference
from softrobot_env.beams.numerics.integration import DONE, FAILURES, Control, integrate, workspace
from softrobot_env.beams.numerics.methods import find_method
from softrobot_env.beams.signals import constant
from softrobot_env.equilibrium import EquilibriumError
from softrobot_env.interfaces import Measurement
from softrobot_env.robots import Base, RobotParams
from softrobot_env.robots.loads import Load

#: Builds the model of a robot under some loads.
Build = Callable[[RobotParams, Sequence[Load]], BeamModel]

_MAX_STEPS = 20_000  # in one control period
_SECTIONS = 4  # per piece: the angle between two sections is measured modulo 2 pi
_ITERATIONS = 8
_CURVATURE_ERROR = 1e-9  # of the curvature limit
_DIFFERENCE = 1e-3  # of the curvature limit


class SteppedModel:
    """A planar robot's beam model with light stepping and read-outs (`interfaces.PlantModel`).

    The curvature of a piece is the angle between the cross-sections at its ends over its length:
    its exact mean for every model, whatever the model's own pieces are.

    Attributes:
        robot: The robot.
        strain: See `interfaces.PlantModel`.
        model: The beam model, driven by tension.
    """

    def __init__(
        self,
        robot: RobotParams,
        build: Build,
        *,
        strain: float = 0.0,
        method: str = "sdirk4",
        step: float | None = None,
        tolerance: float = 1e-5,
    ) -> None:
        """Build the model of a robot.

        Args:
            robot: The robot.
            build: Function from a robot and loads to its model.
            strain: See `interfaces.PlantModel`.
            method: A key of `methods.METHODS`.
            step: [s], fixed step; without it a method that estimates its error adapts it.
            tolerance: Error of a step, relative to the size of a large motion.

        Raises:
            ValueError: Unknown method, or a method that needs a step.
        """
        self.robot, self.strain, self._build = robot, strain, build
        self._method, self._step, self._tolerance = method, step, tolerance
        self._prepare()

    def __getstate__(self) -> dict:
        # References to compiled data cannot be copied; the same model is built again instead.
        names = ("robot", "strain", "_build", "_method", "_step", "_tolerance")
        return {name: self.__dict__[name] for name in names}

    def __setstate__(self, state: dict) -> None:
        self.__dict__.update(state)
        self._prepare()

    def _prepare(self) -> None:
        """Build the model, and what a step would otherwise build anew."""
        self.model = self._build(self.robot, ())
        scheme = find_method(self._method, self._step)
        self._scheme = reference(scheme)
        signal = constant(np.zeros(self.model.n_inputs))
        self._tension = signal.coefficients[0, 0]  # a view: what is written here is applied
        self._signal = reference(signal)
        model = self.model
        width = mechanics.bandwidth(model.data)
        self._work = reference(workspace(model.n, width, len(scheme.b), model.n_inputs))
        self._samples = np.empty((2, 2, self.model.n))
        self._counters, self._steps = np.zeros(4, dtype=np.int64), np.zeros(2)
        self._prepare_readout()

    def _prepare_readout(self) -> None:
        """Place two points, on the outer fibres, in each section whose angle is measured."""
        robot = self.robot
        robot.require_plane("a planar model")
        edges = robot.backbone.cut(robot.pieces)
        parts = np.arange(_SECTIONS * robot.pieces + 1) / _SECTIONS
        stations = np.interp(parts, np.arange(robot.pieces + 1), edges)
        offset = np.array([robot.backbone.widest, 0.0])
        places = np.concatenate((stations, stations, [robot.length]))
        offsets = np.zeros((len(places), 2))
        offsets[: len(stations)], offsets[len(stations) : -1] = offset, -offset
        self._probe = self.model.probe(places, offsets)
        base = robot.base or Base()
        self._sizes = np.diff(edges)
        self._base = np.column_stack([base.axes, base.position])[[0, 2]]

    # ------------------------------------------------------------------ postures

    def rest(self) -> np.ndarray:
        """Coordinates (n,) of the straight pose."""
        return self.model.rest()

    def equilibrium(self, tension: np.ndarray) -> np.ndarray:
        """Coordinates (n,) at rest under tensions (n_tendons,) [N].

        Raises:
            EquilibriumError: There is none, or it is unstable.
        """
        return self.model.equilibrium(tension)

    def bent(self, curvature: np.ndarray) -> np.ndarray:
        """Coordinates (n,) whose measured curvature is `curvature` (pieces,) [1/m].

        The posture is that of the robot without tendons and weight under moments at the ends of
        its pieces, which bend without stretching; Newton's method on the moments.

        Raises:
            ValueError: No moments do that, because the model has too few pieces.
        """
        robot, pieces = self.robot, self.robot.pieces
        edges = robot.backbone.cut(pieces)
        stiffness = robot.backbone.in_series(robot.backbone.bending, edges)
        loads = [
            Load(f"bend{k + 1}", station=float(s), moment=(0.0, 1.0, 0.0))
            for k, s in enumerate(edges[1:])
        ]
        model = self._build(_bare(robot), loads)

        def posture(bending: np.ndarray, guess: np.ndarray | None = None) -> np.ndarray:
            moments = stiffness * bending
            moments = moments - np.append(moments[1:], 0.0)
            return model.equilibrium(moments, guess, check_stability=False)

        def read(q: np.ndarray) -> np.ndarray:
            return self.measure(q, np.zeros_like(q)).curvature

        wanted = np.asarray(curvature, dtype=float)
        limit, change = robot.curvature_limit, _DIFFERENCE * robot.curvature_limit
        applied = wanted.copy()
        try:
            q = posture(applied)
            for iteration in range(_ITERATIONS + 1):
                error = read(q) - wanted
                if np.max(np.abs(error)) <= _CURVATURE_ERROR * limit:
                    return q
                if iteration == _ITERATIONS:
                    break
                moved = [read(posture(applied + e, q)) for e in change * np.eye(pieces)]
                jacobian = (np.stack(moved, axis=1) - (error + wanted)[:, None]) / change
                applied = applied - np.linalg.solve(jacobian, error)
                q = posture(applied, q)
        except (EquilibriumError, np.linalg.LinAlgError) as reason:
            raise ValueError(self._cannot_bend(wanted)) from reason
        raise ValueError(self._cannot_bend(wanted))

    def _cannot_bend(self, curvature: np.ndarray) -> str:
        return (
            f"{type(self.model).__name__} with {self.model.n} coordinates cannot take the start "
            f"curvature {curvature.tolist()} 1/m; use more pieces or start from an equilibrium "
            "(start_input)"
        )

    # ------------------------------------------------------------------ motion

    def advance(
        self, q: np.ndarray, v: np.ndarray, tension: np.ndarray, duration: float
    ) -> str | None:
        """Move the state on in place; what went wrong, or None (`interfaces.PlantModel`)."""
        self._tension[:] = tension
        # The whole period is tried first: a motion that follows its reference needs few steps.
        first = duration if self._step is None else self._step
        control = reference(Control(self._step is None, first, self._tolerance, _MAX_STEPS))
        self._counters[:] = 0
        self._work.formed[0] = 0.0  # a copy of the environment goes on without the old matrix
        code, reached = integrate(
            self.model.data,
            self._scheme,
            control,
            self._signal,
            self._work,
            np.array([0.0, duration]),
            q,
            v,
            *self._samples,
            self._counters,
            self._steps,
        )
        if code == DONE:
            return None
        how = f"tolerance {self._tolerance:g}" if self._step is None else f"step {self._step:g} s"
        return f"{FAILURES[code]} after {reached:.4g} s of it ({self._method}, {how})"

    # ------------------------------------------------------------------ read-outs

    def measure(self, q: np.ndarray, v: np.ndarray) -> Measurement:
        """New arrays with everything that can be measured (`interfaces.PlantModel`)."""
        out = np.zeros((4, max(2, self.robot.pieces)))
        tip, speed, curvature, rate = out[0, :2], out[1, :2], *out[2:, : self.robot.pieces]
        _measure(self._probe, q, v, self._sizes, self._base, tip, speed, curvature, rate)
        return Measurement(tip, speed, curvature, rate, self.model.tendon_length(q))


def _bare(robot: RobotParams) -> RobotParams:
    """The robot without tendons and weight."""
    return replace(robot, tendons=(), gravity=(0.0, 0.0, 0.0))


@kernel
def _measure(probe, q, v, sizes, base, tip, speed, curvature, rate):
    """Measure tip (2,) [m], curvature (pieces,) [1/m] and their rates in state q, v (n,).

    Args:
        probe: Data of a model whose points are those that `SteppedModel` places.
        q, v: State.
        sizes: (pieces,) [m].
        base: (2, 4), x and z in the world of the axes of the base, and of its position [m].
        tip, speed, curvature, rate: Set.
    """
    pieces = len(curvature)
    count = _SECTIONS * pieces + 1
    moving = np.empty(len(q), np.complex128)
    for i in range(len(q)):
        moving[i] = q[i] + 1e-30j * v[i]
    points = np.empty((2 * count + 1, 3), np.complex128)
    mechanics.locate(probe, moving, points)
    for i in range(2):
        tip[i], speed[i] = base[i, 3], 0.0
        for k in range(3):
            tip[i] += base[i, k] * points[2 * count, k].real
            speed[i] += base[i, k] * points[2 * count, k].imag / 1e-30
    for piece in range(pieces):
        curvature[piece], rate[piece] = 0.0, 0.0
        for k in range(_SECTIONS * piece, _SECTIONS * (piece + 1)):
            turn = _turn(points[k], points[count + k], points[k + 1], points[count + k + 1])
            curvature[piece] += turn.real / sizes[piece]
            rate[piece] += turn.imag / 1e-30 / sizes[piece]


@kernel
def _turn(above, below, next_above, next_below):
    """Angle [rad] from one section to the next, given two points (3,) [m] of each.

    The imaginary part is the derivative along the points' imaginary parts.
    """
    x0, z0 = above[0] - below[0], above[2] - below[2]
    x1, z1 = next_above[0] - next_below[0], next_above[2] - next_below[2]
    sine, cosine = x1 * z0 - z1 * x0, x0 * x1 + z0 * z1
    angle = np.arctan2(sine.real, cosine.real)
    size = sine.real**2 + cosine.real**2
    slope = (cosine.real * sine.imag - sine.real * cosine.imag) / size
    return complex(angle, slope)
