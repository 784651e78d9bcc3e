"""Many simulations of one scene by MuJoCo Warp, on a graphics card or on the processor.

MuJoCo Warp computes mass, forces and sensors of all robots in float32. The states are kept, and
the linear systems of the steps solved, in float64 tensors of PyTorch on the same device. It is
imported where it is used: MuJoCo Warp and PyTorch take seconds to load.
"""

from copy import copy
from typing import Any, NamedTuple

import mujoco
import mujoco_warp
import numpy as np
import torch
import warp
from numpy import ndarray

from softrobot_env.core.arrays import TorchArrays
from softrobot_env.scene.build import Scene
from softrobot_env.scene.integration.layout import COMMAND, HALF, HORN, HUGE, MOTOR, OFFSET, SPEED
from softrobot_env.scene.servos import Servos
from softrobot_env.scene.tendons import full_length
from softrobot_env.scene.timestep import EXTRAPOLATION

from .batch import VARIED, VariedFields, check_timesteps, nominal

#: Rows of the extrapolation: 4 evaluations of all forces for order 3.
ROWS = 3

#: Model fields that are separate for each robot once robots vary. The moment arms of channels are
#: shared: their factor goes to the gear of the drive.
_VARIED = (*(x for x in VARIED if x != "wrap_prm"), "body_subtreemass", "actuator_gear")

#: See `scene.integration.euler`.
_SWEEPS, _STILL = warp.constant(200), warp.constant(warp.float64(1e-12))


class _Acting(NamedTuple):
    """Matrices and forces of n chains in one posture.

    Attributes:
        mass, stiffness: (n, nv, nv), of joints and of taut drives.
        force: (n, nv), all generalised forces except friction of tendons.
        arms: (n, ntendon, nv), moment arms of tendons, if needed.
    """

    mass: torch.Tensor
    stiffness: torch.Tensor
    force: torch.Tensor
    arms: torch.Tensor | None


class WarpBatch:
    """`BatchSimulation` on a device, with arrays that are float64 tensors there by default.

    The integrator is that of `scene.integration` with constant steps and `ROWS` rows, without error
    control, or "implicitfast" or "discrete" of MuJoCo, without friction of tendons.

    Attributes:
        scene: The scene.
        arrays: The kind of all arrays.
        count: Number n of simulations.
        qpos, qvel: (n, nq) [rad, rad/s], hinge angles and rates.
        ctrl: (n, nu), current controls, writable.
        sensordata, actuator_force: (n, ...) float32, as in MjData, read-only.
        ten_length: (n, ntendon) [m], as in MjData, read-only.
        full_length: (n, n_tendons) [m], inside the straight robots, minus those of `ten_length`.
    """

    integration_error = None

    def __init__(self, scene: Scene, count: int, device: str) -> None:
        """Build the simulations.

        Args:
            scene: The scene, checked by `envs.simulation.warp_limits`.
            count: Number n of simulations.
            device: Of Warp and PyTorch, such as "cuda:0" or "cpu".
        """
        self.scene, self.count, self.arrays = scene, count, TorchArrays(device)
        self._host = model = _without_reset(scene.model)
        if warp.config.log_level == warp.LOG_INFO:  # which reports every kernel
            # Without a card Warp warns that there is none.
            warp.config.log_level = warp.LOG_ERROR if device == "cpu" else warp.LOG_WARNING
        warp.init()
        self._device = warp.device_from_torch(self.arrays.device)
        self._varied, self._rubs = None, scene.config.robot.has_friction
        with self._on_device():
            self._data = mujoco_warp.make_data(model, nworld=count, nconmax=0, njmax=0)
        self._take_model({})
        real, data = self.arrays.real, self._data
        self.qpos = real(np.tile(model.qpos0, (count, 1)))
        self.qvel = real(np.zeros((count, model.nv)))
        self.ctrl = real(np.zeros((count, model.nu)))
        shared = ("qpos", "qvel", "ctrl", "sensordata", "ten_length", "actuator_force", "ten_J")
        shared += ("M", "qfrc_passive", "qfrc_bias", "qfrc_actuator")
        self._seen = {name: warp.to_torch(getattr(data, name)) for name in shared}
        self.sensordata = self._seen["sensordata"]
        self.actuator_force = self._seen["actuator_force"]
        self._radius = real(np.ones((count, model.ntendon)))
        self.ten_length = torch.zeros_like(self._radius)
        self.full_length = real(np.tile(full_length(scene.config.robot, model), (count, 1)))
        self._servos: Servos | None = None
        index = self.arrays.index
        self._mass_at = tuple(map(index, _places(model.M_rownnz, model.M_rowadr, model.M_colind)))
        self._arm_at = tuple(
            map(index, _places(model.ten_J_rownnz, model.ten_J_rowadr, model.ten_J_colind))
        )
        self._drawn_by = index(model.actuator_trnid[:, 0].astype(np.int64))
        self._joint_of = index(model.dof_jntid.astype(np.int64))
        self._range = real(model.actuator_forcerange)
        self._step = self._extrapolate
        if scene.timestep.integrator != EXTRAPOLATION:
            self._step = self._step_by_mujoco
        self._finish()

    def _on_device(self) -> warp.ScopedDevice:
        """Context that runs Warp on PyTorch's stream, so that they wait for each other."""
        if self._device.is_cuda:
            stream = torch.cuda.current_stream(self.arrays.device)
            return warp.ScopedStream(warp.stream_from_torch(stream))
        return warp.ScopedDevice(self._device)

    def _take_model(self, sizes: dict[str, int]) -> None:
        """Put the model on the device, with separate fields for given numbers of robots."""
        with self._on_device():
            self._model = mujoco_warp.put_model(self._host, batch_sizes=sizes)
        self._fields = {name: warp.to_torch(getattr(self._model, name)) for name in _VARIED}

    def check_process(self) -> None:
        """Do nothing: a device itself refuses a forked child."""

    # ------------------------------------------------------------------ variations

    def vary(self, which: ndarray, values: dict[str, ndarray]) -> None:
        """Replace robots by variations, keeping posture and motion.

        Args:
            which: (k,) int, increasing, the simulations.
            values: (k,) of every variation of robots, as `RobotParams.vary` takes them.

        Raises:
            ValueError: A robot for which MuJoCo's integrator would need its own timestep.
        """
        if self._varied is None and nominal(values):
            return
        check_timesteps(self.scene, which, values)
        if self._varied is None:
            self._varied = VariedFields(self.scene)
            self._take_model(dict.fromkeys(_VARIED, self.count))
        robots = self.arrays.index(which)
        for field, rows in self._varied.of(values):
            if field in _VARIED:
                self._set(field, robots, rows)
            if field == "body_mass":
                self._set("body_subtreemass", robots, self._carried(rows))
            elif field == "wrap_prm":
                self._stretch(robots, rows, values["tendon_radius"])
        self._rubs = self._rubs or bool(values["tendon_friction"].any())

    def _set(self, field: str, robots: torch.Tensor, rows: ndarray) -> None:
        own = self._fields[field]
        own[robots] = torch.as_tensor(rows, dtype=own.dtype, device=own.device)

    def _carried(self, mass: ndarray) -> ndarray:
        """Masses (k, nbody) [kg] of the subtrees of bodies (k, nbody)."""
        total = mass.copy()
        for body in range(self._host.nbody - 1, 0, -1):
            total[:, self._host.body_parentid[body]] += total[:, body]
        return total

    def _stretch(self, robots: torch.Tensor, arms: ndarray, radius: ndarray) -> None:
        """Multiply moment arms (k, ...) of channels by factors (k,)."""
        changed = (arms != self._host.wrap_prm).astype(int)
        moved = np.add.reduceat(changed, self._host.tendon_adr, axis=1) > 0
        factors = np.where(moved, radius[:, None], 1.0)
        self._radius[robots] = self.arrays.real(factors)
        scales = factors[:, self._host.actuator_trnid[:, 0]]
        self._set("actuator_gear", robots, self._host.actuator_gear * scales[..., None])

    # ------------------------------------------------------------------ steps

    def drive_by(self, servos: Servos) -> None:
        """Drive n robots by servos from now on; the positions of the horns are the controls.

        Raises:
            ValueError: The number of robots or drives differs, or the drives are by tension.
        """
        servos.check_drives(self.scene.config.actuation, tuple(self.ctrl.shape))
        servos.live_as(self.arrays)
        self._servos = servos

    def reset(self, which: ndarray, qpos: ndarray, ctrl: ndarray) -> None:
        """Set postures at rest, under given controls.

        Args:
            which: (k,) int, increasing, the simulations to reset.
            qpos: (k, nq) [rad].
            ctrl: (k, nu).
        """
        robots, real = self.arrays.index(which), self.arrays.real
        self.qpos[robots], self.ctrl[robots], self.qvel[robots] = real(qpos), real(ctrl), 0.0
        self._finish()

    def advance(self, which: ndarray | None = None) -> ndarray:
        """Integrate over one control period with the controls in `ctrl`, or by the servos.

        Args:
            which: The simulations of interest; all are advanced.

        Returns:
            (n,) bool, whether each has diverged: not finite, or beyond MuJoCo's limit.
        """
        choice = self.scene.timestep
        for number in range(choice.substeps):
            begin, end = self.ctrl, self.ctrl
            if self._servos is not None:
                begin = self._servos.horn.clone()
                _wind(self._servos.block, choice.timestep)
                end = self._servos.horn
            self._put(self.qpos, self.qvel, begin)
            if number:
                self._evaluate()
            self._step(choice.timestep, begin, end)
            self.ctrl[:] = end
        self._finish()
        bounded = (self.qpos.abs() <= HUGE).all(axis=1) & (self.qvel.abs() <= HUGE).all(axis=1)
        return self.arrays.host(~bounded)

    def _finish(self) -> None:
        """Compute all outputs of the state, from which the next period starts."""
        model, data = self._model, self._data
        self._put(self.qpos, self.qvel, self.ctrl)
        with self._on_device():
            mujoco_warp.fwd_position(model, data, factorize=False)
            data.sensordata.zero_()
            mujoco_warp.sensor_pos(model, data)
            mujoco_warp.fwd_velocity(model, data)
            mujoco_warp.sensor_vel(model, data)
            mujoco_warp.fwd_actuation(model, data)
        torch.mul(self._radius, self._seen["ten_length"], out=self.ten_length)

    def _put(self, qpos: torch.Tensor, qvel: torch.Tensor, ctrl: torch.Tensor) -> None:
        for name, values in (("qpos", qpos), ("qvel", qvel), ("ctrl", ctrl)):
            self._seen[name].copy_(values)

    def _evaluate(self) -> None:
        """Mass matrix and all forces except the drives', for the state on the device."""
        with self._on_device():
            mujoco_warp.fwd_position(self._model, self._data, factorize=False)
            mujoco_warp.fwd_velocity(self._model, self._data)

    def _step_by_mujoco(self, h: float, begin: torch.Tensor, end: torch.Tensor) -> None:
        """Advance by a MuJoCo timestep, with the controls at its start."""
        model, data = self._model, self._data
        with self._on_device():
            mujoco_warp.fwd_actuation(model, data)
            mujoco_warp.fwd_acceleration(model, data, factorize=True)
            # The result of Warp's solver without constraints.
            warp.copy(data.qacc, data.qacc_smooth)
            if self.scene.timestep.integrator == "discrete":
                mujoco_warp.discrete(model, data)
            else:
                warp.copy(data.efc.Ma, data.qfrc_smooth)
                mujoco_warp.implicit(model, data)
        self.qpos.copy_(self._seen["qpos"])
        self.qvel.copy_(self._seen["qvel"])

    def _extrapolate(self, h: float, begin: torch.Tensor, end: torch.Tensor) -> None:
        """Advance by `h` [s]; see `scene.integration.extrapolation`, whose scheme this is.

        All forces except the drives' are current at the start.
        """
        first = self._measure()
        turns: list[torch.Tensor] = []
        velocities: list[torch.Tensor] = []
        for row in range(1, ROWS + 1):
            q, v, part = self.qpos, self.qvel, h / row
            for k in range(row):
                acting = first
                if k:
                    self._put(q, v, begin + (end - begin) * (k / row))
                    self._evaluate()
                    acting = self._measure()
                v = v + self._euler(acting, v, part)
                q = q + part * v
            _add_row(turns, q - self.qpos)
            _add_row(velocities, v)
        self.qpos += turns[-1]
        self.qvel.copy_(velocities[-1])

    def _measure(self) -> _Acting:
        """Matrices and forces for the controls on the device."""
        with self._on_device():
            mujoco_warp.fwd_actuation(self._model, self._data)
        seen, real = self._seen, self.arrays.real
        n, nv = self.qvel.shape
        mass = self.qvel.new_zeros((n, nv, nv))
        mass[:, self._mass_at[0], self._mass_at[1]] = real(seen["M"])
        stiffness = torch.diag_embed(real(self._fields["jnt_stiffness"])[:, self._joint_of])
        spring = -real(self._fields["actuator_biasprm"])[..., 1]
        arms = None
        if self._rubs or self.scene.config.actuation == "length":
            arms = self.qvel.new_zeros((n, self._host.ntendon, nv))
            arms[:, self._arm_at[0], self._arm_at[1]] = real(seen["ten_J"])
            arms *= self._radius[..., None]
        if self.scene.config.actuation == "length":
            force = real(seen["actuator_force"])
            taut = (force > self._range[:, 0]) & (force < self._range[:, 1])
            pulls = arms[:, self._drawn_by]
            stiffness = stiffness + pulls.mT @ ((spring * taut)[..., None] * pulls)
        force = seen["qfrc_passive"].double() - seen["qfrc_bias"] + seen["qfrc_actuator"]
        return _Acting(mass, stiffness, force, arms)

    def _euler(self, acting: _Acting, v: torch.Tensor, h: float) -> torch.Tensor:
        """The change (n, nv) of rates by one linearly implicit Euler step, with friction."""
        damping = self.arrays.real(self._fields["dof_damping"])
        rhs = h * (acting.force - h * (acting.stiffness @ v[..., None])[..., 0])
        system = acting.mass + torch.diag_embed(h * damping) + h * h * acting.stiffness
        factor, _ = torch.linalg.cholesky_ex(system)
        change = torch.cholesky_solve(rhs[..., None], factor)[..., 0]
        if not self._rubs:
            return change
        answers = torch.cholesky_solve(acting.arms.mT, factor)
        rates = (acting.arms @ (v + change)[..., None])[..., 0]
        bounds = (h * self.arrays.real(self._fields["tendon_frictionloss"])).expand_as(rates)
        impulses = torch.zeros_like(rates)
        passed = (acting.arms @ answers, bounds.contiguous(), rates.contiguous(), impulses)
        with self._on_device():
            arrays = [warp.from_torch(values) for values in passed]
            warp.launch(_find_impulses, self.count, arrays[:2], arrays[2:])
        return change - (answers @ impulses[..., None])[..., 0]


@warp.kernel
def _find_impulses(
    couplings: warp.array3d(dtype=warp.float64),
    bounds: warp.array2d(dtype=warp.float64),
    rates: warp.array2d(dtype=warp.float64),
    impulses: warp.array2d(dtype=warp.float64),
) -> None:
    """Impulses within their bounds that stop or slow rates, as in `scene.integration.euler`."""
    robot = warp.tid()
    count = rates.shape[1]
    for _sweep in range(_SWEEPS):
        moved = warp.float64(0.0)
        for k in range(count):
            most, own = bounds[robot, k], couplings[robot, k, k]
            if most > warp.float64(0.0) and own > warp.float64(0.0):
                wanted = warp.clamp(impulses[robot, k] + rates[robot, k] / own, -most, most)
                step = wanted - impulses[robot, k]
                impulses[robot, k] = wanted
                moved = warp.max(moved, warp.abs(step) / most)
                for j in range(count):
                    rates[robot, j] = rates[robot, j] - step * couplings[robot, j, k]
        if moved < _STILL:
            break


def _add_row(entries: list[torch.Tensor], entry: torch.Tensor) -> None:
    """Neville's scheme: replace the last row by the next, which starts with an entry."""
    row = len(entries)
    for j in range(row):
        before, entries[j] = entries[j], entry
        entry = entry + (entry - before) / ((row + 1) / (row - j) - 1)
    entries.append(entry)


def _wind(servos: torch.Tensor, time: float) -> None:
    """Turn servos (n, rows, nu) for a time [s], by the law of `scene.servos`."""
    way = servos[:, OFFSET] + servos[:, COMMAND] - servos[:, MOTOR]
    most, half = servos[:, SPEED] * time, servos[:, HALF]
    servos[:, MOTOR] += torch.minimum(torch.maximum(way, -most), most)
    motor = servos[:, MOTOR]
    servos[:, HORN] = torch.minimum(torch.maximum(servos[:, HORN], motor - half), motor + half)


def _places(nonzero: ndarray, start: ndarray, column: ndarray) -> tuple[ndarray, ...]:
    """Rows and columns (k,) of the elements of a sparse matrix, in their order."""
    rows = np.repeat(np.arange(len(nonzero)), nonzero)
    at = np.concatenate([np.arange(a, a + k) for a, k in zip(start, nonzero, strict=True)])
    if not np.array_equal(at, np.arange(len(at))):
        raise AssertionError("elements are not in order")
    return rows, column[at].astype(np.int64)


def _without_reset(model: mujoco.MjModel) -> Any:
    """A copy without our flag that Warp refuses; Warp never resets a diverged state.

    It also has no constraints, which includes MuJoCo's friction.
    """
    copied, flags = copy(model), mujoco.mjtDisableBit
    copied.opt.disableflags &= ~int(flags.mjDSBL_AUTORESET)
    copied.opt.disableflags |= int(flags.mjDSBL_CONSTRAINT)
    return copied
