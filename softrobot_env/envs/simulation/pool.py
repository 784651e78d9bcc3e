"""MuJoCo's batch of simulations on a thread pool, through its C interface.

`mujoco.batch` of the Python package offers `mj_step` only; here any C function is run on all.
"""

import ctypes
import os
from typing import Any

import mujoco
import numpy as np

from softrobot_env.scene.integration.layout import library_path

_STATE = {
    "qpos": mujoco.mjtState.mjSTATE_QPOS,
    "qvel": mujoco.mjtState.mjSTATE_QVEL,
    "ctrl": mujoco.mjtState.mjSTATE_CTRL,
    "xfrc_applied": mujoco.mjtState.mjSTATE_XFRC_APPLIED,
}
_ERROR = 500


class _Settings(ctypes.Structure):
    """mjBatchConfig."""

    _fields_ = (("threads", ctypes.c_int), ("persistent", ctypes.c_bool))


def _library() -> ctypes.CDLL:
    """MuJoCo's library with the types of the functions used here."""
    library, pointer, whole, text = (
        ctypes.CDLL(library_path()),
        ctypes.c_void_p,
        ctypes.c_int,
        ctypes.c_char_p,
    )
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
    """n simulations of one model, each with a state and values of the model of its own.

    Attributes:
        count: Number n of simulations.
        warnings: (n, mjNWARNING, 2) int32, last information and number of each.
    """

    def __init__(self, model: mujoco.MjModel, count: int, threads: int = 1) -> None:
        """Allocate.

        Args:
            model: The model; it is copied.
            count: Number n.
            threads: That share the work.

        Raises:
            RuntimeError: What MuJoCo says.
        """
        self._c, self.count, self._model = _library(), count, model
        self._process = os.getpid()
        settings, error = _Settings(threads, True), ctypes.create_string_buffer(_ERROR)
        self._batch = self._c.mjb_makeBatch(
            model._address, count, ctypes.byref(settings), error, _ERROR
        )
        if not self._batch:
            raise RuntimeError(f"cannot make a batch of {count}: {error.value.decode()}")
        self.warnings = _view(
            self._c.mjb_warning(self._batch), (count, int(mujoco.mjtWarning.mjNWARNING), 2), "i4"
        )
        self._everyone = np.arange(count, dtype=np.int32)

    def __del__(self) -> None:
        # The threads that deleting waits for are not there in a forked child.
        if getattr(self, "_batch", None) and os.getpid() == self._process:
            self._c.mjb_deleteBatch(self._batch)

    def bind(self, name: str) -> np.ndarray:
        """Array (n, k) of a part of the state, a key of `_STATE`, to be written to."""
        size, row = ctypes.c_int(), self._c.mjb_nstate(self._batch)
        start = self._c.mjb_stateComponent(self._batch, int(_STATE[name]), ctypes.byref(size))
        flat = _view(start, ((self.count - 1) * row + size.value,), float)
        return np.lib.stride_tricks.as_strided(flat, (self.count, size.value), (8 * row, 8))

    def expand(self, name: str) -> np.ndarray:
        """Array (n, ...) of a field of the model, from now on of every simulation's own.

        Raises:
            ValueError: There is none.
        """
        size, bytes_ = ctypes.c_int(), ctypes.c_int()
        like: Any = self._model
        for part in name.split("."):
            like = getattr(like, part)
        start = self._c.mjb_expand(
            self._batch, name.encode(), ctypes.byref(size), ctypes.byref(bytes_)
        )
        return self._field(start, name, np.asarray(like), bytes_.value)

    def _field(self, start: int | None, name: str, like: np.ndarray, size: int = 0) -> np.ndarray:
        if not start:
            raise ValueError(f"no field {name!r} of many simulations")
        kind = like.dtype if not size or like.dtype.itemsize == size else np.dtype(f"i{size}")
        return _view(start, (self.count, *like.shape), kind)

    def set_const(self, which: np.ndarray) -> None:
        """Derive constants of the models `which` (k,) anew."""
        self._call(self._c.mjb_setConst, which)

    def reset(self, which: np.ndarray) -> None:
        """Set simulations `which` (k,) to their start, without computing anything."""
        self._call(self._c.mjb_reset, which, None, int(mujoco.mjtStage.mjSTAGE_NONE))

    def apply(self, which: np.ndarray | None, function: Any, argument: int) -> None:
        """Run a C function (model, data, number, argument) on simulations `which` (k,)."""
        self._call(
            self._c.mjb_apply,
            self._everyone if which is None else which,
            ctypes.cast(function, ctypes.c_void_p),
            argument,
            1,
        )

    def check_process(self) -> None:
        """Raise RuntimeError in a forked child, which would wait for ever for its lost threads."""
        if os.getpid() != self._process:
            raise RuntimeError(
                f"these simulations belong to process {self._process}, and its threads are not in "
                f'this child of it, {os.getpid()}: make them here, or start children with "spawn"'
            )

    def _call(self, function: Any, which: np.ndarray, *arguments: Any) -> None:
        self.check_process()
        ids = np.ascontiguousarray(which, dtype=np.int32)
        if len(ids) and function(self._batch, ids.ctypes.data, len(ids), *arguments):
            texts = {self._c.mjb_error(self._batch, int(i)).decode() for i in ids}
            raise RuntimeError("; ".join(sorted(texts - {""})))


def _view(start: int, shape: tuple[int, ...], kind: Any) -> np.ndarray:
    """Array over memory that somebody else holds."""
    kind = np.dtype(kind)
    size = int(np.prod(shape)) * kind.itemsize
    raw = np.ctypeslib.as_array(ctypes.cast(start, ctypes.POINTER(ctypes.c_uint8)), (size,))
    return raw.view(kind).reshape(shape)
