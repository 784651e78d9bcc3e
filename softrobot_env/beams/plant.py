"""A beam model as the plant of an environment: one control period at a time.

A robot's head is a rigid body beyond the tip. Beams have none, so it becomes a last section that is
a thousand times as stiff as the tip and weighs next to nothing, with a disc at its centre of mass.
"""

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import cached_property
from math import ceil
from typing import Any

import numpy as np
from numpy import ndarray

from softrobot_env.compile.kernels import kernel, reference
from softrobot_env.core.equilibrium import EquilibriumError
from softrobot_env.core.interfaces import Measurement
from softrobot_env.robots import Base, Disc, RobotParams, Section
from softrobot_env.robots.loads import Load

from . import mechanics
from .model import BeamModel
from .numerics import integration
from .numerics.quaternions import column3, dot3, scaled, weighting
from .signals import Signal

#: Builds the model of a robot under some loads.
Build = Callable[[RobotParams, Sequence[Load]], BeamModel]

_METHOD = "sdirk4"
_MAX_STEPS = 20_000  # in one control period
_SECTIONS = 4  # per piece, or more: the angle between two sections is measured modulo 2 pi
_CELLS = 24  # at least, of a shape for sensors
_LARGEST_TURN = 2.0  # rad, from one section to the next
_ITERATIONS = 30
_CURVATURE_ERROR = 1e-9  # of the curvature limit
_RIGID, _WEIGHTLESS = 1e3, 1e-3  # modulus and density of a head's section, of the tip's

_STEP = 1e-30  # imaginary: its square vanishes beside one

_PLANE = slice(0, 3, 2)


class SteppedModel:
    """A robot's beam model with light stepping and read-outs (`interfaces.PlantModel`).

    The curvature of a piece is the turn between the cross-sections at its ends over its length,
    summed up over some sections in between where it is in space: its mean, whatever the model's
    own pieces are. Turns are seen from the robot's own, turning sections, as hinge angles are.

    Attributes:
        robot: The robot.
        strain, cells: See `interfaces.PlantModel`.
        model: The beam model.
    """

    def __init__(
        self,
        robot: RobotParams,
        build: Build,
        *,
        strain: float = 0.0,
        axes: slice = _PLANE,
        bending: str = "planar",
        step: float | None = None,
        tolerance: float = 1e-5,
    ) -> None:
        """Build the model of a robot.

        Args:
            robot: The robot.
            build: Function from a robot and loads to its model.
            strain: See `interfaces.PlantModel`.
            axes: Coordinates of the tip that are measured.
            bending: "planar" for a model in the x-z plane, or "spatial".
            step: [s], fixed step; without it the error's estimate adapts it.
            tolerance: Error of a step, relative to the size of a large motion.

        Raises:
            ValueError: The step is not positive.
        """
        self.robot, self.strain, self._build = robot, strain, build
        self._axes, self._directions = axes, 1 if bending == "planar" else 2
        self._step, self._tolerance = step, tolerance
        self._whole = headless(robot)
        self.model = model = self._build(self._whole, ())
        scheme = integration.find_method(_METHOD, self._step)
        self._scheme = reference(scheme)
        self._signals: dict[tuple[int, float], tuple[ndarray, Any]] = {}
        width = mechanics.bandwidth(model.data)
        self._work = reference(integration.workspace(model.n, width, len(scheme.b), model.n_inputs))
        self._samples = integration.samples(np.zeros(2), model.n)
        self._prepare_readout()

    def _prepare_readout(self) -> None:
        """Place a point in each section whose turn is measured."""
        robot = self.robot
        if self._directions == 1:
            robot.require_plane("a planar model")
        sizes = np.diff(robot.backbone.cut(robot.pieces))
        least = max(_SECTIONS, ceil(robot.curvature_limit * sizes.max() / _LARGEST_TURN))
        self._pieces = self._place_probe(self._stations(least)), sizes
        self.cells = self._stations(max(least, ceil(_CELLS / robot.pieces)))
        base = robot.base or Base()
        self._base = np.column_stack([base.axes, base.position])[self._axes]

    def _stations(self, number: int) -> ndarray:
        """Ends [m] of so many parts of each of the robot's pieces."""
        robot = self.robot
        parts = np.arange(number * robot.pieces + 1) / number
        return np.interp(parts, np.arange(robot.pieces + 1), robot.backbone.cut(robot.pieces))

    def _place_probe(self, stations: ndarray) -> Any:
        """The centres of sections at stations [m], and the tip."""
        return self.model.probe(np.append(stations, self.robot.reach))

    # ------------------------------------------------------------------ postures

    def rest(self) -> ndarray:
        """Coordinates (n,) of the straight pose."""
        return self.model.rest()

    def equilibrium(self, control: ndarray) -> ndarray:
        """Coordinates (n,) at rest under controls (n_tendons,) [N or m].

        Raises:
            EquilibriumError: There is none, or it is unstable.
        """
        return self.model.equilibrium(control)

    def bent(self, curvature: ndarray) -> ndarray:
        """Coordinates (n,) whose measured curvature is `curvature` [1/m].

        The posture is that of the robot without tendons and weight under moments at the ends of
        its pieces, which bend without stretching, found by Broyden's method. In space they turn
        with their sections.

        Args:
            curvature: (pieces,) in the plane, (2 pieces,) in space, (beta, gamma) each.

        Raises:
            ValueError: No moments do that, because the model has too few pieces.
        """
        from scipy.optimize import NoConvergence, broyden1

        robot, directions = self.robot, self._directions
        edges = robot.backbone.cut(robot.pieces)
        stiffness = robot.backbone.in_series(robot.backbone.bending, edges)[:, None]
        axes = ((0.0, 1.0, 0.0), (-1.0, 0.0, 0.0))[:directions]
        loads = [
            Load(f"bend{k + 1}_{d}", station=float(s), moment=axis, follows=directions > 1)
            for k, s in enumerate(edges[1:])
            for d, axis in enumerate(axes)
        ]
        model = self.bare(loads)

        def posture(bending: ndarray, guess: ndarray | None = None) -> ndarray:
            moments = stiffness * bending.reshape(-1, directions)
            moments = moments - np.append(moments[1:], np.zeros((1, directions)), axis=0)
            return model.equilibrium(moments.ravel(), guess, check_stability=False)

        def off(bending: ndarray) -> ndarray:
            nonlocal q
            q = posture(bending, q)
            return self.measure(q, np.zeros_like(q)).curvature - wanted

        wanted = np.asarray(curvature, float)
        within = _CURVATURE_ERROR * robot.curvature_limit
        try:
            q = posture(wanted)
            # A moment bends as much as it is made for, but for what the model errs by.
            if np.max(np.abs(off(wanted))) > within:
                found = broyden1(off, wanted, alpha=-1.0, maxiter=_ITERATIONS, f_tol=within)
                q = posture(found, q)
            return q
        except (EquilibriumError, NoConvergence, ValueError) as reason:
            raise ValueError(
                f"{type(self.model).__name__} with {self.model.n} coordinates cannot take the "
                f"start curvature {wanted.tolist()} 1/m; use more pieces or start from an "
                "equilibrium (start_input)"
            ) from reason

    def bare(self, loads: Sequence[Load] = ()) -> BeamModel:
        """The model of the robot without tendons and weight: its springs, and loads."""
        return self._build(replace(self._whole, tendons=(), gravity=(0.0, 0.0, 0.0)), loads)

    # ------------------------------------------------------------------ motion

    def advance(self, q: ndarray, v: ndarray, control: ndarray, duration: float) -> str | None:
        """Move the state on in place; what went wrong, or None (`interfaces.PlantModel`)."""
        signal = self._follow(control, duration)
        # The whole period is tried first: a motion that follows its reference needs few steps.
        first = duration if self._step is None else self._step
        control = integration.Control(self._step is None, first, self._tolerance, _MAX_STEPS)
        given = (self.model.data, self._scheme, reference(control), signal, self._work)
        self._work.counters[:] = 0
        self._samples.times[1] = duration
        self._work.formed[0] = 0.0  # a copy of the environment goes on without the old matrix
        code, reached = integration.integrate(*given, (q, v), self._samples)
        if code == integration.DONE:
            return None
        how = f"tolerance {self._tolerance:g}" if self._step is None else f"step {self._step:g} s"
        return f"{integration.FAILURES[code]} after {reached:.4g} s of it ({_METHOD}, {how})"

    def _follow(self, control: ndarray, duration: float) -> Any:
        """The compiled signal of controls (n,), or of a path of them."""
        rows = control.reshape(-1, self.model.n_inputs)
        spans, kind = max(1, len(rows) - 1), (len(rows), duration)
        if kind not in self._signals:
            values = np.zeros((spans, min(2, len(rows)), self.model.n_inputs))
            self._signals[kind] = values, reference(Signal(0.0, duration / spans, values))
        values, signal = self._signals[kind]
        values[:, 0] = rows[:spans]
        if len(rows) > 1:
            values[:, 1] = np.diff(rows, axis=0) * (spans / duration)
        return signal

    # ------------------------------------------------------------------ read-outs

    def measure(self, q: ndarray, v: ndarray) -> Measurement:
        """New arrays with everything that can be measured (`interfaces.PlantModel`)."""
        tip, strain = self._seen(q, v)
        curvature, rate = strain[:, :, : self._directions].copy().reshape(2, -1)
        return Measurement(*tip.copy(), curvature, rate, self.model.tendon_length(q))

    def tension(self, q: ndarray, control: ndarray) -> ndarray:
        """Tensions (n_tendons,) [N] in a posture under controls (`interfaces.PlantModel`)."""
        return self.model.tendon_tension(q, control)

    def strains(self, q: ndarray) -> ndarray:
        """Beta, gamma and torsion (pieces, 3) [1/m] in a posture (`interfaces.PlantModel`)."""
        return self._seen(q, np.zeros_like(q))[1][0]

    def shape(self, q: ndarray) -> ndarray:
        """Beta, gamma and torsion (k, 3) [1/m] of all cells (`interfaces.PlantModel`)."""
        return self._seen(q, np.zeros_like(q), self._cells)[1][0]

    @cached_property
    def _cells(self) -> tuple[Any, ndarray]:
        """Probe and sizes [m] of the cells."""
        return self._place_probe(self.cells), np.diff(self.cells)

    def _seen(
        self, q: ndarray, v: ndarray, parts: tuple[Any, ndarray] | None = None
    ) -> tuple[ndarray, ndarray]:
        """Tip (2, axes) and strains (2, parts, 3), each with its rate.

        Of the robot's pieces unless given others, by their probe and sizes [m].
        """
        probe, sizes = parts or self._pieces
        tip, strain = np.zeros((2, len(self._base))), np.zeros((2, len(sizes), 3))
        _measure(probe, q, v, sizes, self._base, tip, strain)
        return tip, strain


def headless(robot: RobotParams) -> RobotParams:
    """The robot with a stiff last section and a disc in place of its head, see the module."""
    head, sections = robot.head, robot.backbone.sections
    if head is None:
        return robot
    tip, size = sections[-1], max(head.centre, head.output)
    disc = Disc(robot.length + head.centre, head.mass, head.inertia)
    if not size:
        return replace(robot, head=None, discs=(*robot.discs, disc))
    stiff = Section(
        length=size,
        outer_radius=tip.outer_radii[1],
        youngs_modulus=_RIGID * tip.youngs_modulus,
        density=_WEIGHTLESS * tip.density,
        damping_time=tip.damping_time,
        pieces=1,
        poisson_ratio=tip.poisson_ratio,
    )
    longer = replace(robot, head=None).with_sections(*sections, stiff)
    return replace(longer, discs=(*robot.discs, disc))


@kernel
def _measure(probe, q, v, sizes, base, tip, strain):
    """Measure tip [m] and strain [1/m] and their rates in state q, v (n,).

    Args:
        probe: Data of a model whose points are those that `SteppedModel` places.
        q, v: State.
        sizes: (pieces,) [m].
        base: (axes, 4), those axes in the world of the axes of the base, and of its position [m].
        tip: (2, axes), set.
        strain: (2, pieces, 3), set to beta, gamma and torsion.
    """
    moving, count = np.empty(len(q), np.complex128), len(probe.actuation.point_station)
    for i in range(len(q)):
        moving[i] = q[i] + _STEP * 1j * v[i]
    points = np.empty((count, 3), np.complex128)
    axes = np.empty((count - 1, 3, 3), np.complex128)
    mechanics.locate(probe, moving, points, axes)
    for i in range(len(base)):
        tip[0, i], tip[1, i] = base[i, 3], 0.0
        for k in range(3):
            tip[0, i] += base[i, k] * points[-1, k].real
            tip[1, i] += base[i, k] * points[-1, k].imag / _STEP
    sections = (count - 2) // len(sizes)
    for piece in range(len(sizes)):
        for k in range(sections * piece, sections * (piece + 1)):
            x, y, z = _rotation(axes[k], axes[k + 1])
            for d, part in enumerate((y, -x, z)):
                strain[0, piece, d] += part.real / sizes[piece]
                strain[1, piece, d] += part.imag / _STEP / sizes[piece]


@kernel
def _rotation(first, second):
    """Rotation vector [rad] from axes to others, columns (3, 3), of less than half a turn."""
    a, b, c = column3(first, 0), column3(first, 1), column3(first, 2)
    d, e, f = column3(second, 0), column3(second, 1), column3(second, 2)
    real = np.sqrt(1 + dot3(a, d) + dot3(b, e) + dot3(c, f)) / 2
    quarter = 0.25 / real
    x = quarter * (dot3(c, e) - dot3(b, f))
    y = quarter * (dot3(a, f) - dot3(c, d))
    z = quarter * (dot3(b, d) - dot3(a, e))
    stretch, _ = weighting(5, (real, x, y, z))
    return scaled(2 * stretch, (x, y, z))
