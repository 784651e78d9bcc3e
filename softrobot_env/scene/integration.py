"""How simulations are integrated: settings, memory, and the compiled function that advances them.

Loading compiled code takes time: the first simulation imports this module.
"""

from typing import Any

import mujoco
import numpy as np

from softrobot_env.scene.chain import TIP_SITE
from softrobot_env.scene.extrapolation import (
    ACCURACY,
    DATA_FIELDS,
    EVALUATIONS,
    EXTRAPOLATED,
    FEWEST,
    HEADER,
    LENGTHS,
    LONGEST,
    MEMORY,
    MEMORY_SIZE,
    METHOD,
    MISSED,
    MODEL_FIELDS,
    MOST,
    NBODY,
    NEXT,
    OFFSETS,
    PATH,
    PERIOD,
    RATE,
    ROWS,
    SHORTEST,
    SPLIT,
    STEPS,
    STRIDE,
    SUBSTEPS,
    TELL,
    TOLD,
    WHOLE,
    WORST,
    advance,
    refresh,
)
from softrobot_env.scene.structs import data_offsets, model_offsets, time_offset
from softrobot_env.scene.timestep import EXTRAPOLATION, TimestepChoice

_METHODS = {EXTRAPOLATION: EXTRAPOLATED, "RK4": WHOLE}

#: Rows of the extrapolation: the first that may do, and the last that is tried.
FEWEST_ROWS, MOST_ROWS = 3, 4

#: Intervals into which a control period is divided at most.
MOST_INTERVALS = 256

#: Fields of the data of which `Integration.tell` keeps arrays.
TOLD_FIELDS = ("sensordata", "ten_length", "actuator_force")


class Integration:
    """Settings and memory of n simulations, and the C function that advances one of them.

    Attributes:
        memory: (n, MEMORY_SIZE), see the module's places.
        header: Address of what is passed to `advance`.
    """

    def __init__(self, model: mujoco.MjModel, choice: TimestepChoice, count: int = 1) -> None:
        self._lengths = backbone_lengths(model)
        self.memory = np.zeros((count, MEMORY_SIZE))
        self._sizes = (model.nq, model.nv, model.nu, model.nbody)
        self._path = np.zeros((1, model.nu))
        self.set(slice(None), choice)
        self._connect()

    def set(self, which: Any, choice: TimestepChoice) -> None:
        """Let the simulations `which` be integrated as chosen, as if new."""
        chosen = self.memory[which]
        chosen[..., METHOD] = _METHODS.get(choice.integrator, SPLIT)
        chosen[..., SUBSTEPS] = choice.substeps
        chosen[..., PERIOD] = choice.timestep * choice.substeps
        chosen[..., LONGEST] = chosen[..., NEXT] = choice.timestep
        chosen[..., SHORTEST] = choice.timestep * choice.substeps / MOST_INTERVALS
        chosen[..., ACCURACY] = choice.accuracy or np.inf
        chosen[..., RATE] = choice.rate
        chosen[..., FEWEST], chosen[..., MOST] = FEWEST_ROWS, MOST_ROWS
        self.memory[which] = chosen

    def tell(self, **arrays: np.ndarray) -> None:
        """Keep arrays (n, ...) of fields of the data current, by name out of `TOLD_FIELDS`."""
        places = dict(zip(TOLD_FIELDS, data_offsets(*TOLD_FIELDS), strict=True))
        self._told = np.array(
            [(places[n], a[0].size, a.ctypes.data) for n, a in arrays.items()], dtype=np.int64
        )
        self._header[TOLD], self._header[TELL] = len(arrays), self._told.ctypes.data

    def restart(self, which: Any = slice(None)) -> None:
        """Forget the motion so far."""
        self.memory[which, NEXT] = self.memory[which, LONGEST]
        self.memory[which, WORST : STEPS + 1] = 0.0

    @property
    def advance(self) -> Any:
        """C function (model, data, number, header) that advances a simulation."""
        return advance.ctypes

    @property
    def refresh(self) -> Any:
        """C function that computes a simulation's read-outs; arguments as `advance`."""
        return refresh.ctypes

    @property
    def missed(self) -> np.ndarray:
        """View (n,): steps of the last control period that were beyond the accuracy."""
        return self.memory[:, MISSED]

    @property
    def evaluations(self) -> np.ndarray:
        """View (n,): evaluations of all forces since the last restart."""
        return self.memory[:, EVALUATIONS]

    def error(self, choice: TimestepChoice) -> np.ndarray | None:
        """Estimated errors (n,) [m] in time since the last restart; None if not estimated."""
        if choice.accuracy is None:
            return None
        return choice.accuracy * self.memory[:, WORST]

    @property
    def shortest(self) -> float:
        """[s], shortest step."""
        return float(self.memory[:, SHORTEST].min())

    def follow(self, path: np.ndarray | None) -> None:
        """Take controls from a path (k, nu), a row a timestep; None: as the data has them."""
        if path is None:
            self._header[ROWS] = 0
        else:
            self._path = np.ascontiguousarray(path)
            self._header[PATH], self._header[ROWS] = self._path.ctypes.data, len(path)

    def _connect(self) -> None:
        self._header = np.zeros(HEADER, dtype=np.int64)
        self._header[: NBODY + 1] = self._sizes
        self._header[OFFSETS:] = (
            *model_offsets(*MODEL_FIELDS),
            *data_offsets(*DATA_FIELDS),
            time_offset(),
        )
        self._header[MEMORY], self._header[STRIDE] = self.memory.ctypes.data, 8 * MEMORY_SIZE
        self._header[LENGTHS], self._header[PATH] = (
            self._lengths.ctypes.data,
            self._path.ctypes.data,
        )
        self.header = self._header.ctypes.data

    def __getstate__(self) -> dict:
        return {k: v for k, v in self.__dict__.items() if k not in ("header", "_header", "_told")}

    def __setstate__(self, state: dict) -> None:
        self.__dict__.update(state)
        self._connect()


def backbone_lengths(model: mujoco.MjModel) -> np.ndarray:
    """Length (nv,) [m] of the link that the last DOF of each body moves; the others have none."""
    lengths, beyond = np.zeros(model.nv), float(np.linalg.norm(model.site(TIP_SITE).pos))
    for body in range(model.nbody - 1, 0, -1):
        dofs, first = int(model.body_dofnum[body]), int(model.body_dofadr[body])
        if dofs:
            lengths[first + dofs - 1] = beyond
            beyond = 0.0
        beyond += float(np.linalg.norm(model.body_pos[body]))
    return lengths
