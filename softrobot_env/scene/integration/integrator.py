"""How simulations are integrated: settings, memory, and the compiled function that advances them.

Loading compiled code takes time: the first simulation imports this module.
"""

from typing import Any

import numpy as np
from mujoco import MjModel, mjtTrn, mjtWrap
from numpy import ndarray

from ..chain import backbone_lengths
from ..tendons import is_ideal
from ..timestep import EXTRAPOLATION, RATE, Pace, TimestepChoice
from . import layout
from .articulated import runs
from .extrapolation import CALM
from .period import advance, refresh

_METHODS = {EXTRAPOLATION: layout.EXTRAPOLATED, "RK4": layout.WHOLE}

#: Rows of the extrapolation: the first that may do, and the last that is tried.
FEWEST_ROWS, MOST_ROWS = 3, 4

#: The shadow of a simulation is as many times less accurate.
SHADOW = 20.0

#: Least estimate [1], over the accuracy: smaller errors are not resolved by the shadow.
RESOLVED = 1 / 20

#: Intervals into which a control period is divided at most, or a swing that outlasts it.
MOST_INTERVALS = 256

#: Longest interval, over such a swing [1]: implicit steps damp what they do not follow, and the
#: shadow's do so as well, so that no estimate would tell.
_OF_SWING = 1 / 4

#: Fields of the data of which `Integration.report` keeps arrays.
REPORTED_FIELDS = ("sensordata", "ten_length", "actuator_force")


class Integration:
    """Settings and memory of n simulations, and the C functions of one of them.

    Attributes:
        advance, refresh: Of a simulation, see `period`.
        memory: (n, 2, MEMORY_SIZE), of simulations and shadows, see `layout`.
        is_ideal: Whether all drives are as MuJoCo has them.
        motors: Number of a simulation's motors, which servos with a gain have.
        header: Address of what is passed to them.
    """

    advance, refresh = advance, refresh

    def __init__(self, model: MjModel, choice: TimestepChoice, count: int = 1) -> None:
        self._lengths, self._runs = backbone_lengths(model), runs(model.body_parentid)
        robots = np.flatnonzero(model.dof_parentid < 0)
        self._reach = np.add.reduceat(self._lengths, robots).max()
        self.memory = np.zeros((count, 2, layout.MEMORY_SIZE))
        self.is_ideal = is_ideal(model)
        self.motors = model.nu * (
            not self.is_ideal and bool(model.actuator_gainprm[:, layout.GAIN].any())
        )
        self._chained = model.nq + model.nv
        self._states = np.zeros((count, 2, self._chained + 4 * self.motors))
        self._zones = layout.zones(model)
        elements = model.ntendon + sum(number for _, number in self._zones)
        self._held = np.zeros((count, 2, 2, elements))
        self._sizes = (model.nq, model.nv, model.nu, model.nbody, model.ntendon)
        scalar = model.nq == model.nv
        linear = scalar and bool(np.all(model.wrap_type == mjtWrap.mjWRAP_JOINT))
        pulled = np.all(model.actuator_trntype == mjtTrn.mjTRN_TENDON)
        self._linear = layout.DRIVES_TOO if linear and pulled else int(linear)
        self._user = model.nuser_tendon
        self._path = np.zeros((1, model.nu))
        self._servos: ndarray | None = None
        self._tape = np.zeros((0, layout.INTERVAL + model.nq + model.nv + 3 * model.nu))
        self.set(slice(None), choice)
        self._connect()

    def set(self, which: Any, choice: TimestepChoice, paces: Pace | None = None) -> None:
        """Let the simulations `which` (k,) be integrated as chosen, as if new.

        With paces (k,) of their own if given.
        """
        chosen, period = self.memory[which], choice.timestep * choice.substeps
        pace = choice.pace if paces is None else Pace(*(x[:, None] for x in paces))
        frequency = pace.rate / RATE
        chosen[..., layout.METHOD] = _METHODS.get(choice.integrator, layout.SPLIT)
        chosen[..., layout.SUBSTEPS] = choice.substeps
        chosen[..., layout.PERIOD] = period
        chosen[..., layout.LONGEST] = np.minimum(choice.timestep, _OF_SWING * pace.swing)
        chosen[..., layout.NEXT] = chosen[..., layout.LONGEST]
        chosen[..., layout.SHORTEST] = np.minimum(period, pace.swing) / MOST_INTERVALS
        # Errors of swings that last for many periods within a control period add up in it.
        decay = pace.damping_ratio * frequency
        lasting = np.minimum(period, 1 / np.maximum(decay, 1e-300))
        care = np.minimum(1.0, pace.swing / lasting)
        chosen[..., layout.ACCURACY] = care * (choice.accuracy or np.inf)
        chosen[..., layout.RATE] = pace.rate
        chosen[..., layout.CALM] = CALM * pace.damping_time
        chosen[..., layout.REACH] = self._reach
        chosen[..., 1, layout.ACCURACY] *= SHADOW
        chosen[..., layout.FEWEST], chosen[..., layout.MOST] = FEWEST_ROWS, MOST_ROWS
        chosen[..., 1, layout.FEWEST] = FEWEST_ROWS - 1
        self._resolved = RESOLVED * (choice.accuracy or 0.0)
        chosen[..., 0, layout.ESTIMATE] = self._resolved
        self.memory[which] = chosen

    def report(self, **arrays: ndarray) -> None:
        """Keep arrays (n, ...) of fields of the data current, by name out of `REPORTED_FIELDS`."""
        places = dict(zip(REPORTED_FIELDS, layout.data_offsets(*REPORTED_FIELDS), strict=True))
        self._reported = np.array(
            [(places[n], a[0].size, a.ctypes.data) for n, a in arrays.items()], dtype=np.int64
        )
        self._header[layout.REPORTED], self._header[layout.REPORTS] = (
            len(arrays),
            self._reported.ctypes.data,
        )

    def record(self) -> None:
        """Keep the intervals of the first simulation, with room for those of a period."""
        memory, used = self.memory[0, 0], self._used
        room = int(memory[layout.PERIOD] / memory[layout.SHORTEST] + memory[layout.SUBSTEPS]) + 2
        if used + room > len(self._tape):
            tape = np.zeros((2 * (used + room), self._tape.shape[1]))
            tape[:used] = self._tape[:used]
            self._tape, self._header[layout.TAPE] = tape, tape.ctypes.data
            memory[layout.TAPED] = len(tape)

    @property
    def _used(self) -> int:
        """Intervals of the first simulation since the last restart, as far as they are kept."""
        return min(int(self.memory[0, 0, layout.STEPS]), len(self._tape))

    @property
    def tape(self) -> ndarray:
        """View of the intervals (n, ...) since the last restart, see `layout.INTERVAL`."""
        return self._tape[: self._used]

    def restart(self, which: Any = slice(None)) -> None:
        """Forget the motion so far."""
        self.memory[which, :, layout.NEXT] = self.memory[which, :, layout.LONGEST]
        self.memory[which, :, layout.WORST :] = 0.0
        self.memory[which, 0, layout.ESTIMATE] = self._resolved
        self._states[which, :, : self._chained] = np.nan
        self._held[which] = 0.0

    @property
    def estimates(self) -> ndarray:
        """View (n,): estimated errors [m] in time since the last restart; 0 of MuJoCo's."""
        return self.memory[:, 0, layout.ESTIMATE]

    @property
    def evaluations(self) -> ndarray:
        """Evaluations (n,) of all forces since the last restart, the shadows' too."""
        return self.memory[:, :, layout.EVALUATIONS].sum(axis=1)

    @property
    def lost(self) -> ndarray:
        """(n, nu) [N], what friction has taken of each tension by the tendon's last segment."""
        out, end = np.zeros((len(self._held), self._sizes[2])), self._sizes[4]
        for drive, number in self._zones:
            begin, end = end, end + number
            out[:, drive] = -self._held[:, 0, 1, begin:end].sum(axis=1)
        return out

    def follow(self, path: ndarray | None) -> None:
        """Take controls from a path (k, nu), a row a timestep; None: as the data has them."""
        if path is None:
            self._header[layout.ROWS] = 0
        else:
            self._path = np.ascontiguousarray(path)
            self._header[layout.PATH], self._header[layout.ROWS] = self._path.ctypes.data, len(path)

    def drive_by(self, servos: ndarray) -> None:
        """Take controls from servos (n, rows, nu), see `layout`, where no path is given."""
        self._servos = servos
        self._header[layout.SERVOS] = servos.ctypes.data
        self._header[layout.SERVO_SIZE] = servos.shape[1]

    def _connect(self) -> None:
        self._header = layout.header(self._sizes)
        self._header[layout.LINEAR] = self._linear
        self._header[layout.RUBBING] = self._held.shape[-1]
        self._header[layout.USER] = self._user
        self._header[layout.WIRES], self._header[layout.MOTORS] = not self.is_ideal, self.motors
        self._header[layout.STRIDE] = 16 * layout.MEMORY_SIZE
        for place, array in (
            (layout.MEMORY, self.memory),
            (layout.SHADOW_STATES, self._states),
            (layout.HELD, self._held),
            (layout.LENGTHS, self._lengths),
            (layout.RUNS, self._runs),
            (layout.PATH, self._path),
            (layout.TAPE, self._tape),
        ):
            self._header[place] = array.ctypes.data
        if self._servos is not None:
            self.drive_by(self._servos)
        self.header = self._header.ctypes.data

    def __getstate__(self) -> dict:
        return {
            k: v for k, v in self.__dict__.items() if k not in ("header", "_header", "_reported")
        }

    def __setstate__(self, state: dict) -> None:
        self.__dict__.update(state)
        self._connect()
