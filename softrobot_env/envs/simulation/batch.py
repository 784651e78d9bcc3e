"""Many simulations of one scene, stepped on a thread pool, which report divergence.

The pool is MuJoCo's, through its C interface: `mujoco.batch` of the Python package offers `mj_step`
only; here any C function can be run on all simulations.
"""

import ctypes
import os
import warnings
from collections.abc import Iterator
from math import inf
from time import perf_counter
from typing import Any
from weakref import finalize

import mujoco
import numpy as np
from numpy import ndarray

from softrobot_env.core.arrays import HOST
from softrobot_env.core.processes import usable_cores
from softrobot_env.robots.variations import VARIATIONS
from softrobot_env.scene.build import CompiledModel, Scene, paces_of, vary_scene
from softrobot_env.scene.integration.layout import library_path
from softrobot_env.scene.servos import Servos
from softrobot_env.scene.simulation import WORRYING, Simulation, inaccuracy
from softrobot_env.scene.tendons import full_length
from softrobot_env.scene.timestep import Pace

#: Fields of a model that the package's variations scale or shift.
VARIED = tuple(
    dict.fromkeys(
        field for one in VARIATIONS.registered().values() for field in (*one.scales, *one.shifts)
    )
)

#: Work [s] in a control period that justifies a thread: waking one up takes 20 to 50 µs.
WORTH = 80e-6

#: Number of control periods timed for that.
_TIMED = 5


_STATE = {
    "qpos": mujoco.mjtState.mjSTATE_QPOS,
    "qvel": mujoco.mjtState.mjSTATE_QVEL,
    "ctrl": mujoco.mjtState.mjSTATE_CTRL,
    "xfrc_applied": mujoco.mjtState.mjSTATE_XFRC_APPLIED,
}
_ERROR_LENGTH = 500


class _Settings(ctypes.Structure):
    """mjBatchConfig."""

    _fields_ = (("threads", ctypes.c_int), ("persistent", ctypes.c_bool))


def _library() -> ctypes.CDLL:
    """MuJoCo's library with the types of the functions used here."""
    library = ctypes.CDLL(library_path())
    pointer, whole, text = ctypes.c_void_p, ctypes.c_int, ctypes.c_char_p
    sizes = ctypes.POINTER(whole)
    for name, result, arguments in (
        ("makeBatch", pointer, (pointer, whole, pointer, text, whole)),
        ("deleteBatch", None, (pointer,)),
        ("nstate", whole, (pointer,)),
        ("stateComponent", pointer, (pointer, whole, sizes)),
        ("warning", pointer, (pointer,)),
        ("expand", pointer, (pointer, text, sizes, sizes)),
        ("setConst", whole, (pointer, pointer, whole)),
        ("reset", whole, (pointer, pointer, whole, pointer, whole)),
        ("apply", whole, (pointer, pointer, whole, pointer, pointer, whole)),
        ("error", text, (pointer, whole)),
    ):
        function = getattr(library, f"mjb_{name}")
        function.restype, function.argtypes = result, arguments
    return library


class Pool:
    """n simulations of one model, each with its own state and model values.

    Attributes:
        count: Number n of simulations.
        warnings: (n, mjNWARNING, 2) int32, last information and number of each.
    """

    def __init__(self, model: mujoco.MjModel, count: int, threads: int = 1) -> None:
        """Allocate.

        Args:
            model: The model; it is copied.
            count: Number n.
            threads: Number of threads that share the work.

        Raises:
            RuntimeError: MuJoCo's error.
        """
        self._c, self.count, self._model = _library(), count, model
        self._process = os.getpid()
        settings, error = _Settings(threads, True), ctypes.create_string_buffer(_ERROR_LENGTH)
        self._batch = self._c.mjb_makeBatch(
            model._address, count, ctypes.byref(settings), error, _ERROR_LENGTH
        )
        if not self._batch:
            raise RuntimeError(f"cannot make a batch of {count}: {error.value.decode()}")
        self._delete = finalize(self, _delete, self._c, self._batch, self._process)
        self.warnings = _view(
            self._c.mjb_warning(self._batch), (count, int(mujoco.mjtWarning.mjNWARNING), 2), "i4"
        )
        self._everyone = np.arange(count, dtype=np.int32)

    def bind(self, name: str) -> ndarray:
        """Writable array (n, k) of a part of the state, a key of `_STATE`."""
        size, row = ctypes.c_int(), self._c.mjb_nstate(self._batch)
        start = self._c.mjb_stateComponent(self._batch, int(_STATE[name]), ctypes.byref(size))
        flat = _view(start, ((self.count - 1) * row + size.value,), float)
        return np.lib.stride_tricks.as_strided(flat, (self.count, size.value), (8 * row, 8))

    def expand(self, name: str) -> ndarray:
        """Array (n, ...) of a field of the model, separate for every simulation from now on.

        Raises:
            ValueError: There is no such field.
        """
        size, bytes_ = ctypes.c_int(), ctypes.c_int()
        like = field_of(self._model, name)
        start = self._c.mjb_expand(
            self._batch, name.encode(), ctypes.byref(size), ctypes.byref(bytes_)
        )
        if not start:
            raise ValueError(f"no field {name!r} of many simulations")
        kind, itemsize = like.dtype, bytes_.value
        if itemsize not in (0, kind.itemsize):
            kind = np.dtype(f"i{itemsize}")
        return _view(start, (self.count, *like.shape), kind)

    def set_const(self, which: ndarray) -> None:
        """Recompute the derived constants of models `which` (k,)."""
        self._call(self._c.mjb_setConst, which)

    def reset(self, which: ndarray) -> None:
        """Set simulations `which` (k,) to their start, without computing anything."""
        self._call(self._c.mjb_reset, which, None, int(mujoco.mjtStage.mjSTAGE_NONE))

    def apply(self, which: ndarray | None, function: Any, argument: int) -> None:
        """Run a C function (model, data, number, argument) on simulations `which` (k,)."""
        self._call(
            self._c.mjb_apply,
            self._everyone if which is None else which,
            ctypes.cast(function, ctypes.c_void_p),
            argument,
            1,
        )

    def check_process(self) -> None:
        """Raise RuntimeError in a forked child, which would wait forever for its lost threads."""
        if os.getpid() != self._process:
            raise RuntimeError(
                f"these simulations belong to process {self._process}, and its threads are not in "
                f'this child of it, {os.getpid()}: make them here, or start children with "spawn"'
            )

    def _call(self, function: Any, which: ndarray, *arguments: Any) -> None:
        self.check_process()
        ids = np.ascontiguousarray(which, dtype=np.int32)
        if len(ids) and function(self._batch, ids.ctypes.data, len(ids), *arguments):
            texts = {self._c.mjb_error(self._batch, int(i)).decode() for i in ids}
            raise RuntimeError("; ".join(sorted(texts - {""})))


def _delete(library: ctypes.CDLL, batch: int, process: int) -> None:
    # The threads that this waits for do not exist in a forked child.
    if os.getpid() == process:
        library.mjb_deleteBatch(batch)


def _view(start: int, shape: tuple[int, ...], kind: Any) -> ndarray:
    """Array over memory owned by another object."""
    kind = np.dtype(kind)
    size = int(np.prod(shape)) * kind.itemsize
    raw = np.ctypeslib.as_array(ctypes.cast(start, ctypes.POINTER(ctypes.c_uint8)), (size,))
    return raw.view(kind).reshape(shape)


def threads_for(scene: CompiledModel, count: int) -> int:
    """Threads for so many simulations of a scene, each with work of `WORTH`, by a measured step.

    At most one per core available to this process, and one per simulation.
    """
    most = min(usable_cores(), count)
    if most == 1:
        return 1
    return max(1, min(most, int(count * step_cost(scene) / WORTH)))


def step_cost(scene: CompiledModel) -> float:
    """Time [s] of a control period of one simulation near rest, the shortest of several."""
    simulation = Simulation(scene)
    simulation.reset(scene.model.qpos0, np.zeros(scene.model.nu))
    times = []
    for _ in range(_TIMED):
        begin = perf_counter()
        simulation.advance()
        times.append(perf_counter() - begin)
    return min(times)


class Batch:
    """n times `Simulation`: after every call the outputs of all are current.

    Attributes:
        scene: The scene, of one robot or of several.
        arrays: The kind of all arrays.
        threads: Of the pool.
        qpos, qvel: (n, nq) [rad, rad/s], hinge angles and rates.
        ctrl: (n, nu), current controls, writable.
        sensordata, ten_length, actuator_force: (n, ...), as in MjData, read-only.
    """

    arrays = HOST

    def __init__(self, scene: CompiledModel, count: int, threads: int = 0) -> None:
        """Build the simulations.

        Args:
            scene: The scene.
            count: Number n of simulations.
            threads: Of the pool, 0 for as many as have enough work.
        """
        self.scene, self.threads = scene, threads or threads_for(scene, count)
        self._batch = Pool(scene.model, count, self.threads)
        from softrobot_env.scene.integration.integrator import REPORTED_FIELDS, Integration

        self._integration = Integration(scene.model, scene.timestep, count)
        for name in ("qpos", "qvel", "ctrl"):
            setattr(self, name, self._batch.bind(name))
        example = mujoco.MjData(scene.model)
        reported = {
            name: np.zeros((count, *getattr(example, name).shape)) for name in REPORTED_FIELDS
        }
        for name, array in reported.items():
            setattr(self, name, array)
        self._integration.report(**reported)
        self.check_process = self._batch.check_process
        self._warnings = self._batch.warnings
        self._no_warnings = bytes(self._warnings.nbytes)
        self._nobody = np.zeros(count, bool)
        self._nobody.flags.writeable = False
        self._warned = False
        self._estimates = self._integration.estimates
        self._worrying = WORRYING * (scene.timestep.accuracy or inf)
        self._periods = 0

    def _warn(self) -> None:
        """Warn once that a robot does not meet the accuracy."""
        found = np.where(~self._warnings[:, :, 1].any(axis=1), self._estimates, 0.0).max()
        if found > self._worrying:
            self._warned = True
            time = self._periods * self.scene.config.control_period
            warnings.warn(inaccuracy(self.scene, found, time), stacklevel=5)

    @property
    def tension_lost(self) -> ndarray:
        """(n, nu) [N], see `Simulation`."""
        return self._integration.lost

    @property
    def integration_error(self) -> ndarray | None:
        """Estimated errors (n,) [m] in time since the resets; None with MuJoCo's integrators."""
        if self.scene.timestep.accuracy is None:
            return None
        return self._integration.estimates.copy()

    @property
    def evaluations(self) -> ndarray:
        """Evaluations (n,) of all forces since the resets, also those for the estimated error."""
        return self._integration.evaluations

    @property
    def count(self) -> int:
        """Number of simulations."""
        return self._batch.count

    def reset(self, which: ndarray, qpos: ndarray, ctrl: ndarray) -> None:
        """Set postures at rest, under given controls.

        Args:
            which: (k,) int, increasing, the simulations to reset.
            qpos: (k, nq) [rad].
            ctrl: (k, nu).
        """
        self._batch.reset(which)
        self.qpos[which], self.ctrl[which] = qpos, ctrl
        self._batch.apply(which, self._integration.refresh.ctypes, self._integration.header)
        self._integration.restart(which)

    def advance(self, which: ndarray | None = None) -> ndarray:
        """Integrate over one control period with the controls in `ctrl`, or by the servos.

        Args:
            which: (k,) int, increasing, the simulations to advance; all unless given.

        Returns:
            (n,) bool, whether each has diverged; read-only.
        """
        self._batch.apply(which, self._integration.advance.ctypes, self._integration.header)
        self._periods += 1
        if not self._warned and self._estimates.max() > self._worrying:
            self._warn()
        if self._warnings.tobytes() == self._no_warnings:
            return self._nobody
        return self._warnings[:, :, 1].any(axis=1)


class BatchSimulation(Batch):
    """A batch of simulations of one robot and its variations.

    Attributes:
        full_length: (n, n_tendons) [m], inside the straight robots, minus those of `ten_length`.
    """

    def __init__(self, scene: Scene, count: int, threads: int = 0) -> None:
        """Build the simulations; arguments as `Batch`'s."""
        super().__init__(scene, count, threads)
        self._paces = paces_of(scene)
        self._full = full_length(scene.config.robot, scene.model)
        self.full_length = np.tile(self._full, (count, 1))
        self._fields: VariedFields | None = None
        self._rebuilt: set[str] = set()  # fields taken from scenes built for variations

    def vary(self, which: ndarray, values: dict[str, ndarray]) -> None:
        """Replace robots by variations, keeping posture and motion.

        Each is integrated like a single simulation of the same variation.

        Args:
            which: (k,) int, increasing, the simulations.
            values: (k,) of every variation of robots, as `RobotParams.vary` takes them.

        Raises:
            ValueError: A robot for which an integrator of MuJoCo would need its own timestep, or
                a variation that changes what all simulations share.
        """
        if self._fields is None and nominal(values):
            return
        check_timesteps(self.scene, which, values)
        if self._fields is None:
            self._fields = VariedFields(self.scene)
        model, expand = self.scene.model, self._batch.expand
        for field in self._rebuilt:
            expand(field)[which] = field_of(model, field)
        if self._rebuilt:
            self.full_length[which] = self._full
        for field, rows in self._fields.of(values):
            expand(field)[which] = rows
        paces = self._paces(values)
        for at in np.flatnonzero(self._fields.unknown(values)):
            pace = self._rebuild(which[at], {name: float(v[at]) for name, v in values.items()})
            if paces is not None:
                for many, one in zip(paces, pace, strict=True):
                    many[at] = one
        self._integration.set(which, self.scene.timestep, paces)
        self._batch.set_const(which)

    def _rebuild(self, robot: int, values: dict[str, float]) -> Pace:
        """Take over the differences of a scene built for one robot; its integration pace."""
        built = vary_scene(self.scene, values)
        for field in changed_fields(self.scene.model, built.model):
            try:
                self._batch.expand(field)[robot] = field_of(built.model, field)
            except ValueError:
                raise ValueError(
                    f"{', '.join(values)}: many simulations cannot differ in {field!r}, which one "
                    "of them changes; take single environments"
                ) from None
            self._rebuilt.add(field)
        self.full_length[robot] = full_length(built.config.robot, built.model)
        return built.timestep.pace

    def drive_by(self, servos: Servos) -> None:
        """Drive n robots by servos from now on; the positions of the horns are the controls.

        Raises:
            ValueError: The number of robots or drives differs, or the drives are by tension.
        """
        servos.check_drives(self.scene.config.actuation, self.ctrl.shape)
        self._integration.drive_by(servos.block)


def nominal(values: dict[str, ndarray]) -> bool:
    """Whether values (k,) by name change nothing."""
    return all(np.all(v == VARIATIONS[name].neutral) for name, v in values.items())


class VariedFields:
    """Model fields of varied robots, computed for all at once from the table of variations."""

    def __init__(self, scene: Scene) -> None:
        """Set up for variations of a scene's robot."""
        self._scene, self._probes = scene, {}
        first = scene.model.body("link0").id
        links = slice(first, first + len(scene.layout.stations))
        # Factors apply to links, not to heads and discs.
        self._own = {"body_mass": links, "body_inertia": links}

    def unknown(self, values: dict[str, ndarray]) -> ndarray:
        """(k,) bool, which robots need a separate scene."""
        odd = np.zeros(len(next(iter(values.values()))), bool)
        for name, value in values.items():
            if not VARIATIONS[name].is_of_fields(self._scene.config.robot):
                odd |= value != VARIATIONS[name].neutral
        return odd

    def of(self, values: dict[str, ndarray]) -> Iterator[tuple[str, ndarray]]:
        """Fields and their rows (k, ...) for values (k,) of variations."""
        scaled: dict[str, list[str]] = {}
        for name, value in values.items():
            for field in VARIATIONS[name].scales:
                scaled.setdefault(field, []).append(name)
            if name in self._probes or np.any(value != VARIATIONS[name].neutral):
                yield from self._shifted(name, value)
        for field, names in scaled.items():
            own, usual = self._own.get(field, slice(None)), field_of(self._scene.model, field)
            rows = np.repeat(usual[None], len(value), axis=0)
            factor = np.prod([values[name] for name in names], axis=0)
            rows[:, own] = usual[own] * _as_column(factor, usual)
            yield field, rows

    def _shifted(self, name: str, value: ndarray) -> Iterator[tuple[str, ndarray]]:
        """Fields that one variation shifts or switches, interpolated between two scenes."""
        one = VARIATIONS[name]
        if not (one.shifts or one.switches) or not one.is_of_fields(self._scene.config.robot):
            return
        other = 0.5 if one.is_factor else one.neutral + 1
        if name not in self._probes:
            self._probes[name] = vary_scene(self._scene, {name: other}).model
        for field in (*one.shifts, *one.switches):
            usual, there = (field_of(m, field) for m in (self._scene.model, self._probes[name]))
            off = _as_column(value - one.neutral, usual)
            if field in one.shifts:
                yield field, usual + off * ((there - usual) / (other - one.neutral))
            else:
                yield field, np.where(off != 0, there, usual)


def _as_column(values: ndarray, like: ndarray) -> ndarray:
    """Values (k,) that broadcast to fields (k, ...)."""
    return values.reshape(-1, *(1,) * like.ndim)


def changed_fields(nominal: mujoco.MjModel, varied: mujoco.MjModel) -> list[str]:
    """Names of the arrays in which a model of the same robot differs."""
    names = [n for n in dir(nominal) if isinstance(getattr(nominal, n), ndarray)]
    names += ["opt.gravity", "opt.disableflags"]
    return [n for n in names if not np.array_equal(field_of(nominal, n), field_of(varied, n))]


def field_of(model: mujoco.MjModel, name: str) -> ndarray:
    """A field such as "body_mass" or "opt.gravity"."""
    for part in name.split("."):
        model = getattr(model, part)
    return np.asarray(model)


def check_timesteps(scene: Scene, which: ndarray, values: dict[str, ndarray]) -> None:
    """Refuse robots that cannot share MuJoCo's timestep; our own integrator needs none.

    Args:
        scene: Of the robots.
        which: (k,) int, their indices.
        values: (k,) of every variation of robots.
    """
    shared = scene.timestep
    if shared.accuracy is not None or scene.config.timestep is not None:
        return
    for at in range(len(which)):
        own = vary_scene(scene, {n: float(v[at]) for n, v in values.items()}).timestep
        if own.timestep < shared.timestep * (1 - 1e-9):
            raise ValueError(
                f"robot {which[at]} needs a timestep of {own.timestep:.3g} s with "
                f"{shared.integrator}, the others have {shared.timestep:.3g} s: give a "
                "`timestep` for all, or leave out `integrator`"
            )
