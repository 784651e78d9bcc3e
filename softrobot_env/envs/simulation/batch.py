"""Many simulations of one scene, stepped on a thread pool, none hiding a diverged state."""

import warnings
from math import inf
from time import perf_counter

import mujoco
import numpy as np

from softrobot_env.core.arrays import HOST
from softrobot_env.core.processes import usable_cores
from softrobot_env.envs.simulation.pool import Pool
from softrobot_env.robots import NEUTRAL, VARIABLE
from softrobot_env.scene.build import CompiledModel, Scene, rates_of, vary_scene
from softrobot_env.scene.servos import Servos
from softrobot_env.scene.simulation import WORRYING, Simulation, inaccuracy
from softrobot_env.scene.tendons import FRICTION_IMPEDANCE, FRICTION_REFERENCE, full_length

#: Model fields that are proportional to parameters of the robot.
PROPORTIONAL = {
    "jnt_stiffness": ("youngs_modulus",),
    "jnt_stiffnesspoly": ("youngs_modulus",),
    "tendon_stiffness": ("youngs_modulus",),
    "tendon_stiffnesspoly": ("youngs_modulus",),
    "tendon_damping": ("youngs_modulus", "damping_time"),
    "dof_damping": ("youngs_modulus", "damping_time"),
    "body_mass": ("density",),
    "body_inertia": ("density",),
}

#: Those that tell where tendons run: lever arms in channels, guides, and ranges of lengths.
_ROUTES = ("wrap_prm", "site_pos", "actuator_ctrlrange", "actuator_biasprm")

#: Work [s] in a control period that pays for a thread: waking it up takes 20 to 50 µs.
WORTH = 80e-6

#: Control periods that are timed for that.
_TIMED = 5

_NO_CONSTRAINT = int(mujoco.mjtDisableBit.mjDSBL_CONSTRAINT)


def threads_for(scene: CompiledModel, count: int) -> int:
    """Threads for so many simulations of a scene: each has work worth `WORTH`, by a measured step.

    At most one a core that this process may run on, and one a simulation.
    """
    most = min(usable_cores(), count)
    if most == 1:
        return 1
    return max(1, min(most, int(count * step_cost(scene) / WORTH)))


def step_cost(scene: CompiledModel) -> float:
    """Time [s] of a control period of one simulation near rest, the least of some."""
    simulation = Simulation(scene)
    simulation.reset(scene.model.qpos0, np.zeros(scene.model.nu))
    times = []
    for _ in range(_TIMED):
        begin = perf_counter()
        simulation.advance()
        times.append(perf_counter() - begin)
    return min(times)


class Batch:
    """As `Simulation`, n times: after every call the read-outs of all are current.

    Attributes:
        scene: The scene, of one robot or of several.
        arrays: The kind of all arrays.
        threads: Of the pool.
        qpos, qvel: (n, nq) [rad, rad/s], hinge angles and rates.
        ctrl: (n, nu), controls in force, to be written to.
        sensordata, ten_length, actuator_force: (n, ...), as in MjData, read-only.
    """

    arrays = HOST

    def __init__(self, scene: CompiledModel, count: int, threads: int = 0) -> None:
        """Build the simulations.

        Args:
            scene: The scene.
            count: Number n of simulations.
            threads: Of the pool, 0 for as many as have enough to do.
        """
        self.scene, self.threads = scene, threads or threads_for(scene, count)
        self._batch = Pool(scene.model, count, self.threads)
        from softrobot_env.scene.integration.integrator import TOLD_FIELDS, Integration

        self._integration = Integration(scene.model, scene.timestep, count)
        for name in ("qpos", "qvel", "ctrl"):
            setattr(self, name, self._batch.bind(name))
        example = mujoco.MjData(scene.model)
        told = {name: np.zeros((count, *getattr(example, name).shape)) for name in TOLD_FIELDS}
        for name, array in told.items():
            setattr(self, name, array)
        self._integration.tell(**told)
        self.check_process = self._batch.check_process
        self._warnings = self._batch.warnings
        self._no_warnings = bytes(self._warnings.nbytes)
        self._nobody = np.zeros(count, dtype=bool)
        self._nobody.flags.writeable = False
        self._warned = False
        self._estimates = self._integration.estimates
        self._worrying = WORRYING * (scene.timestep.accuracy or inf)
        self._periods = 0

    def _warn(self) -> None:
        """Tell once that a robot does not keep the accuracy."""
        healthy = ~self._warnings[:, :, 1].any(axis=1)
        found = np.where(healthy, self._estimates, 0.0).max()
        if found > self._worrying:
            self._warned = True
            time = self._periods * self.scene.config.control_period
            warnings.warn(inaccuracy(self.scene, found, time), stacklevel=5)

    @property
    def integration_error(self) -> np.ndarray | None:
        """Estimated errors (n,) [m] in time since the resets; None with MuJoCo's integrators."""
        if self.scene.timestep.accuracy is None:
            return None
        return self._integration.estimates.copy()

    @property
    def count(self) -> int:
        """Number of simulations."""
        return self._batch.count

    def reset(self, which: np.ndarray, qpos: np.ndarray, ctrl: np.ndarray) -> None:
        """Set postures at rest, with controls in force.

        Args:
            which: (k,) int, increasing, the simulations to reset.
            qpos: (k, nq) [rad].
            ctrl: (k, nu).
        """
        self._batch.reset(which)
        self.qpos[which], self.ctrl[which] = qpos, ctrl
        self._batch.apply(which, self._integration.refresh, self._integration.header)
        self._integration.restart(which)

    def advance(self, which: np.ndarray | None = None) -> np.ndarray:
        """Integrate over one control period with the controls in `ctrl`, or by the servos.

        Args:
            which: (k,) int, increasing, the simulations to advance; all unless given.

        Returns:
            (n,) bool, whether each has diverged; read-only.
        """
        self._batch.apply(which, self._integration.advance, self._integration.header)
        self._periods += 1
        if not self._warned and self._estimates.max() > self._worrying:
            self._warn()
        if self._warnings.tobytes() == self._no_warnings:
            return self._nobody
        return self._warnings[:, :, 1].any(axis=1)


class BatchSimulation(Batch):
    """A batch of one robot's simulations, each of which may be of a variation of it.

    Attributes:
        full_length: (n, n_tendons) [m], inside the straight robots, less those of `ten_length`.
    """

    def __init__(self, scene: Scene, count: int, threads: int = 0) -> None:
        """Build the simulations; arguments as `Batch`'s."""
        super().__init__(scene, count, threads)
        self._varied = self._rubs = False
        self._rates = rates_of(scene)
        self.full_length = np.tile(full_length(scene.config.robot, scene.model), (count, 1))
        self._own = own_fields(scene)
        self._slopes: dict[str, np.ndarray] | None = None  # of routes, by the factor on radii

    def vary(self, which: np.ndarray, values: dict[str, np.ndarray]) -> None:
        """Let simulations be of varied robots, in posture and motion as they are.

        Each is integrated as a single simulation of the same variation.

        Args:
            which: (k,) int, increasing, the simulations.
            values: (k,) of each of `robots.VARIABLE`, as `RobotParams.vary` takes them.

        Raises:
            ValueError: A robot for which an integrator of MuJoCo would need its own timestep.
        """
        if not self._varied and all(np.all(values[name] == v) for name, v in NEUTRAL.items()):
            return
        check_timesteps(self.scene, which, values)
        self._varied = True
        model = self.scene.model
        for field, names in PROPORTIONAL.items():
            factor = np.prod([values[name] for name in names], axis=0)
            own = self._own.get(field, slice(None))
            nominal = getattr(model, field)[own]
            expanded = self._batch.expand(field)
            expanded[which, own] = nominal * factor.reshape(-1, *(1,) * nominal.ndim)
        self._route(which, values["tendon_radius"])
        self._rub(which, values["tendon_friction"])
        self._integration.set(which, self.scene.timestep, self._rates(values))
        self._batch.set_const(which)

    def _route(self, which: np.ndarray, radius: np.ndarray) -> None:
        """Lay the tendons at factors (k,) on their distances from the fibre.

        What places straight tendons is linear in them. Where tendons wind, a scene is built for
        each factor.
        """
        if self._slopes is None and np.all(radius == 1):
            return
        scene = self.scene
        if self._slopes is None:
            self._slopes = slopes_of(scene)
        winding = not all(tendon.is_straight for tendon in scene.config.robot.tendons)
        for name, slope in self._slopes.items():
            steps = (radius - 1).reshape(-1, *(1,) * slope.ndim)
            self._batch.expand(name)[which] = getattr(scene.model, name) + steps * slope
        for i, factor in zip(which.tolist() if winding else (), radius.tolist(), strict=False):
            laid = vary_scene(scene, {"tendon_radius": factor})
            for name in _ROUTES:
                self._batch.expand(name)[i] = getattr(laid.model, name)
            self.full_length[i] = full_length(laid.config.robot, laid.model)

    def _rub(self, which: np.ndarray, friction: np.ndarray) -> None:
        """Add friction (k,) [N] to the tendons, as `scene.build` and `scene.tendons` would."""
        if not self._rubs and not friction.any():
            return
        if not self._rubs:
            self._rubs = True
            self._batch.expand("tendon_solimp_fri")[:] = FRICTION_IMPEDANCE
            self._batch.expand("tendon_solref_fri")[:] = FRICTION_REFERENCE
        model = self.scene.model
        own = np.arange(model.ntendon) < len(self.scene.config.robot.tendons)
        loss = model.tendon_frictionloss + friction[:, None] * own
        self._batch.expand("tendon_frictionloss")[which] = loss
        flags = model.opt.disableflags | _NO_CONSTRAINT
        rubbing = loss.any(axis=1) | model.dof_frictionloss.any()
        self._batch.expand("opt.disableflags")[which] = flags & ~(_NO_CONSTRAINT * rubbing)

    def drive_by(self, servos: Servos) -> None:
        """Let servos of n robots turn in every period from now on; horns are the controls.

        Raises:
            ValueError: They are of another number of robots or drives, or these drive tensions.
        """
        servos.check_drives(self.scene.config.actuation, self.ctrl.shape)
        self._integration.drive_by(servos.block)


def own_fields(scene: Scene) -> dict[str, slice]:
    """What of fields follows the factors of a variation: links, not heads and discs."""
    first = scene.model.body("link0").id
    links = slice(first, first + len(scene.layout.stations))
    return {"body_mass": links, "body_inertia": links}


def slopes_of(scene: Scene) -> dict[str, np.ndarray]:
    """How fields that place straight tendons change with the factor on their distances."""
    half = vary_scene(scene, {"tendon_radius": 0.5}).model
    told = ((name, getattr(scene.model, name), getattr(half, name)) for name in _ROUTES)
    return {name: 2 * (whole - part) for name, whole, part in told}


def check_timesteps(scene: Scene, which: np.ndarray, values: dict[str, np.ndarray]) -> None:
    """Refuse robots that do not share MuJoCo's timestep; our own integrator needs none.

    Args:
        scene: Of the robots.
        which: (k,) int, their numbers.
        values: (k,) of each of `robots.VARIABLE`.
    """
    shared = scene.timestep
    if shared.accuracy is not None or scene.config.timestep is not None:
        return
    for at in range(len(which)):
        own = vary_scene(scene, {n: float(values[n][at]) for n in VARIABLE}).timestep
        if own.timestep < shared.timestep * (1 - 1e-9):
            raise ValueError(
                f"robot {which[at]} needs a timestep of {own.timestep:.3g} s with "
                f"{shared.integrator}, the others have {shared.timestep:.3g} s: give a "
                "`timestep` for all, or leave out `integrator`"
            )
