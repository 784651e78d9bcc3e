"""Stepping a scene without ever hiding a diverged state."""

import warnings
from collections.abc import Callable
from dataclasses import dataclass, replace
from math import inf
from typing import TYPE_CHECKING

import mujoco
import numpy as np
from mujoco import MjData, MjModel, mjtWarning
from numpy import ndarray

from softrobot_env.core.motion import IntegrationError, Motion, State, sample_times

from .contacts import Touch, touches
from .servos import Servos
from .statics import checked_controls, finite, with_gravity
from .tendons import full_length
from .timestep import TimestepWarning

if TYPE_CHECKING:
    from .build import Scene

#: Inputs of a motion: constant (n_inputs,), one row (k, n_inputs) a control period, or of time [s].
Inputs = ndarray | Callable[[float], ndarray] | None

#: MuJoCo's warnings of a simulation that diverges -> what is not finite or huge.
DIVERGING = {
    int(mjtWarning.mjWARN_BADQPOS): "position",
    int(mjtWarning.mjWARN_BADQVEL): "velocity",
    int(mjtWarning.mjWARN_BADQACC): "acceleration",
}
_HEALTHY = bytes(4 * int(mjtWarning.mjNWARNING))


#: Lengths that the integrator sums in another order than MuJoCo (`integration.forces`).
_SUMMED = ("ten_length", "actuator_length")

#: Times the accuracy that is wanted, an estimate is worth a warning: it is mostly some times as
#: large as the error.
WORRYING = 2.0


def inaccuracy(scene: "Scene", estimate: float, time: float) -> TimestepWarning:
    """The warning that an estimate [m] at a time [s] is far beyond the accuracy."""
    return TimestepWarning(
        f"robot {scene.name!r}: by t = {time:.3f} s the motion may be "
        f"{1e3 * estimate:.3g} mm off, {1e3 * scene.timestep.accuracy:.3g} mm are wanted, or its "
        "speed by as much in a swing: small errors grow, or fast modes are damped (a smaller "
        "`accuracy` may help)"
    )


@dataclass(frozen=True)
class SceneMotion(Motion):
    """A simulated motion of a scene and how accurate it is.

    Attributes:
        integration_error: (k,) [m], estimated largest error of the backbone's position, and of its
            velocity over the first angular frequency, up to each instant; None with MuJoCo's
            integrators.
    """

    integration_error: ndarray | None


class Simulation:
    """A scene's model and data, advanced one control period at a time.

    MuJoCo evaluates kinematics and sensors at the start of a step, so after `mj_step` they lag
    the state by one timestep. Here they are evaluated at the end of a period, and the next one
    starts from them: the same work, and all read-outs are current.
    """

    def __init__(self, scene: "Scene") -> None:
        self.scene = scene
        self.model = scene.model
        self.data = MjData(scene.model)
        # Compiled code takes time to load.
        from .integration.integrator import Integration

        self._integration = Integration(scene.model, scene.timestep)
        self._warned = False
        self._connect()

    def _connect(self) -> None:
        """Take views and addresses, which a copy has of its own."""
        self._warnings = self.data.warning.number
        integration = self._integration
        self._estimate = integration.estimates
        self._worrying = WORRYING * (self.scene.timestep.accuracy or inf)
        self._compiled = integration.advance.locked
        self._arguments = self.model._address, self.data._address, 0, integration.header

    def __getstate__(self) -> dict:
        views = {"_warnings", "_estimate", "_worrying", "_compiled", "_arguments"}
        state = {k: v for k, v in self.__dict__.items() if k not in views}
        return state | {name: getattr(self.data, name).copy() for name in _SUMMED}

    def __setstate__(self, state: dict) -> None:
        lengths = {name: state.pop(name) for name in _SUMMED}
        self.__dict__.update(state)
        self.model = self.data.model
        self.scene = replace(self.scene, model=self.model)
        self._connect()
        # A pickle leaves out what the start of a period takes from the end of the one before.
        mujoco.mj_fwdPosition(self.model, self.data)
        for name, values in lengths.items():
            getattr(self.data, name)[:] = values
        mujoco.mj_fwdVelocity(self.model, self.data)

    @property
    def ctrl(self) -> ndarray:
        """(nu,) controls in force, to be written to."""
        return self.data.ctrl

    @property
    def full_length(self) -> ndarray:
        """(n_tendons,) [m] inside the straight robot, less those that `ten_length` tells."""
        return full_length(self.scene.config.robot, self.model)

    @property
    def time(self) -> float:
        """[s] since the start."""
        return self.data.time

    @property
    def posture(self) -> ndarray:
        """Hinge angles (nq,) [rad]."""
        return self.data.qpos.copy()

    def reset(self, qpos: ndarray, ctrl: ndarray) -> None:
        """Set a posture (nq,) [rad] at rest, with controls (nu,) in force."""
        mujoco.mj_resetData(self.model, self.data)
        self.data.qpos[:] = qpos
        self.data.ctrl[:] = ctrl
        mujoco.mj_forward(self.model, self.data)
        self._place_motors()
        self._integration.restart()

    def _place_motors(self) -> None:
        """Let servos with a gain hold the robot, and wires that seat have their tension."""
        integration = self._integration
        if not integration.is_ideal:
            arguments = self.model._address, self.data._address, 0, integration.header
            integration.refresh.locked(*arguments)

    def drive_by(self, servos: Servos) -> None:
        """Let servos turn in every period from now on; their horns are the controls.

        Raises:
            ValueError: They are of many robots or another number of drives, or these drive
                tensions.
        """
        servos.check_drives(self.scene.config.actuation, self.ctrl.shape)
        self._integration.drive_by(servos.block)
        if self._integration.motors and np.isnan(servos.turning).any():
            self._place_motors()

    def advance(self) -> bool:
        """Integrate over one control period with the controls in `data.ctrl`, or by the servos.

        Returns:
            Whether all went well; if not, `failure` says what happened.
        """
        self._compiled(*self._arguments)
        if self._estimate[0] > self._worrying:
            self._warn()
        return self._warnings.tobytes() == _HEALTHY

    def advance_through(self, path: ndarray) -> bool:
        """Integrate over one control period with controls (1 + k, nu): now and at `step_times`.

        At most as many as the period has timesteps, and the last row holds for the rest of it. In
        between the controls change steadily, or with MuJoCo's integrators keep the value at the
        start of each timestep, which comes half a step late and makes up for the half step by
        which they let forces act early.

        Returns:
            Whether all went well; if not, `failure` says what happened.
        """
        self._integration.follow(path)
        healthy = self.advance()
        self._integration.follow(None)
        return healthy

    def _warn(self) -> None:
        """Tell once that the accuracy is not kept."""
        if not self._warned and self._warnings.tobytes() == _HEALTHY:
            self._warned = True
            warnings.warn(inaccuracy(self.scene, self._estimate[0], self.time), stacklevel=4)

    def record(self) -> None:
        """Keep the intervals of the next period on the `tape`; before every one to be kept."""
        self._integration.record()

    @property
    def tape(self) -> ndarray:
        """The intervals (n, ...) kept since the reset, see `integration.layout.INTERVAL`."""
        return self._integration.tape

    @property
    def evaluations(self) -> int:
        """Evaluations of the forces since the reset, its shadow's too."""
        return int(self._integration.evaluations[0])

    @property
    def tension_lost(self) -> ndarray:
        """(nu,) [N], what friction along tendons has taken of their tensions at the far ends."""
        return self._integration.lost[0]

    @property
    def estimates(self) -> ndarray | None:
        """View (1,) of `integration_error`, None without."""
        return None if self.scene.timestep.accuracy is None else self._estimate

    @property
    def integration_error(self) -> float | None:
        """Estimated error [m] in time since the reset; None with MuJoCo's integrators."""
        return None if self.scene.timestep.accuracy is None else self._estimate[0]

    def contacts(self) -> tuple[Touch, ...]:
        """What touches now, and the forces under the controls in force."""
        data = MjData(self.model)  # reading must not move the simulation
        mujoco.mj_copyData(data, self.model, self.data)
        mujoco.mj_forward(self.model, data)
        return touches(self.model, data)

    @property
    def step_times(self) -> ndarray:
        """Times [s] of the ends of a control period's timesteps, since its start."""
        choice = self.scene.timestep
        return choice.timestep * np.arange(1, choice.substeps + 1)

    def failure(self) -> str | None:
        """What diverged and when, or None. MuJoCo's own reset is switched off in our scenes."""
        if self._warnings.tobytes() == _HEALTHY:
            return None
        raised = {name: self.data.warning[i] for i, name in DIVERGING.items()}
        raised = {name: warning for name, warning in raised.items() if warning.number}
        if not raised:
            return None
        kinds = ", ".join(f"{name} of DOF {w.lastinfo}" for name, w in raised.items())
        choice = self.scene.timestep
        return (
            f"simulation diverged in the control period ending at t = {self.data.time:.3f} s: not "
            f"finite or huge are {kinds} ({choice.integrator}, timestep {choice.timestep:g} s)"
        )


def simulate(
    scene: "Scene",
    duration: float,
    u: Inputs = None,
    start: State | None = None,
    *,
    samples: ndarray | float | None = None,
    gravity: ndarray | None = None,
) -> SceneMotion:
    """Simulate a motion of a scene.

    Args:
        scene: The scene; it stays as it is.
        duration: [s], a multiple of the control period.
        u: Inputs; zero unless given. Constant (n_inputs,), rows (k, n_inputs) that hold for one
            control period each, or a steady function of the time [s] that returns (n_inputs,).
        start: Initial state; the straight pose at rest unless given.
        samples: Instants (k,) [s] from 0 to the duration, or their distance [s], multiples of the
            control period; start and end unless given.
        gravity: (3,) [m/s2] in place of the scene's.

    Warns:
        TimestepWarning: The motion may be far less accurate than the scene's `accuracy`.

    Raises:
        ValueError: A time is no multiple of the control period, an argument is not finite or not
            of its shape, or an input is out of its range.
        IntegrationError: The motion diverged; the message says what and when.
    """
    model, period = scene.model, scene.config.control_period
    times = sample_times(duration, samples)
    ends = np.round(times / period)
    off = np.abs(ends * period - times) > 1e-9 * period + 1e-12 * times
    if off.any():
        raise ValueError(
            f"duration and samples must be multiples of the control period of {period:g} s, got "
            f"{times[off][0]:g} s"
        )
    ends = ends.astype(int)
    controls = _controls(model, u, int(ends[-1]), period)
    q, v = scene.start() if start is None else start
    q, v = finite("start.q", q, (model.nq,)), finite("start.v", v, (model.nv,))
    model = with_gravity(model, gravity)
    simulation = Simulation(replace(scene, model=model))
    simulation.reset(q, controls(0, np.zeros(1))[0])
    simulation.data.qvel[:] = v
    mujoco.mj_forward(model, simulation.data)
    return SceneMotion(times, *_followed(simulation, controls, ends))


def _followed(
    simulation: Simulation, controls: Callable[..., ndarray], ends: ndarray
) -> tuple[ndarray, ndarray, ndarray | None]:
    """States (k, nq), (k, nv) and errors (k,) after the numbers of control periods `ends` (k,)."""
    instants = np.concatenate(([0.0], simulation.step_times))
    rows = {0: _sample(simulation)}
    for number in range(int(ends[-1])):
        path = controls(number, instants)
        if len(path) == 1:
            simulation.ctrl[:] = path[0]
        healthy = simulation.advance() if len(path) == 1 else simulation.advance_through(path)
        if not healthy:
            raise IntegrationError(simulation.failure() or "diverged", simulation.time)
        if number + 1 in ends:
            rows[number + 1] = _sample(simulation)
    q, v, errors = zip(*(rows[int(end)] for end in ends), strict=True)
    return np.stack(q), np.stack(v), None if errors[0] is None else np.array(errors)


def _sample(simulation: Simulation) -> tuple[ndarray, ndarray, float | None]:
    data = simulation.data
    return data.qpos.copy(), data.qvel.copy(), simulation.integration_error


def _controls(model: MjModel, u: Inputs, periods: int, period: float) -> Callable[..., ndarray]:
    """Function of the number of a period, and of instants (k,) [s] since its start.

    Returns rows of controls (k, nu) at those instants, or one if they hold for the period.
    """
    if callable(u):
        return lambda number, instants: np.stack(
            [checked_controls(model, u(number * period + t)) for t in instants]
        )
    values = np.zeros(model.nu) if u is None else np.asarray(u, float)
    if values.ndim < 2:
        held = checked_controls(model, values)[None]
        return lambda number, instants: held
    if len(values) != periods:
        raise ValueError(f"need a row of inputs for each of {periods} periods, got {len(values)}")
    rows = np.stack([checked_controls(model, row) for row in values])
    return lambda number, instants: rows[number : number + 1]
