"""Places in what is passed to the compiled integration, and in MuJoCo's structures.

`mjModel` and `mjData` hold a pointer to each of their arrays. Its place is found, not assumed: by
comparing the words of a small model's structures with the addresses that Python knows.
"""

import ctypes
from collections import namedtuple
from functools import cache
from pathlib import Path

import mujoco
import numpy as np
from numpy import ndarray

#: Places of a robot's sizes and shared arrays in `header` (int64).
NQ, NV, NU, NBODY, NTENDON, MEMORY, STRIDE, LENGTHS = range(8)
PATH, ROWS, SERVOS, REPORTED, REPORTS, SHADOW_STATES, LINEAR = range(8, 15)
RUBBING, USER, HELD = range(15, 18)  # elements of friction, and what they held, see `euler`
SERVO_SIZE, WIRES, MOTORS, TAPE, RUNS, OFFSETS = range(18, 24)

#: Value of `LINEAR` where not only lengths of tendons are linear in the positions, but those of
#: all drives.
DRIVES_TOO = 2

#: Arrays whose offsets in MuJoCo's structures follow in the header, from `OFFSETS` on.
MODEL_FIELDS = (
    "body_parentid", "body_dofadr", "body_dofnum", "jnt_stiffness", "dof_jntid", "dof_damping",
    "dof_armature", "actuator_ctrlrange",
    "actuator_biasprm", "actuator_forcerange", "ten_J_rownnz", "ten_J_rowadr", "ten_J_colind",
    "tendon_frictionloss", "actuator_gainprm", "dof_parentid", "dof_bodyid", "jnt_qposadr",
    "jnt_axis", "actuator_trntype", "actuator_trnid", "tendon_user", "tendon_adr", "tendon_num",
    "wrap_objid", "site_bodyid",
)  # fmt: skip
DATA_FIELDS = (
    "qpos", "qvel", "ctrl", "qfrc_applied", "xfrc_applied", "qacc", "cinert", "qfrc_passive",
    "qfrc_bias", "qfrc_actuator", "actuator_moment", "moment_rownnz", "moment_rowadr",
    "moment_colind", "actuator_force", "cdof", "qfrc_smooth", "ten_J",
    "actuator_length", "ten_length", "site_xpos", "site_xmat",
)  # fmt: skip
HEADER = OFFSETS + len(MODEL_FIELDS) + len(DATA_FIELDS) + 1  # and the time

#: Places in the header of the offsets, by the names of the fields.
AT = namedtuple("AT", (*MODEL_FIELDS, *DATA_FIELDS, "time"))(*range(OFFSETS, HEADER))

#: Places in a simulation's `memory` (float64): settings, then what it remembers and reports.
METHOD, SUBSTEPS, PERIOD, LONGEST, SHORTEST, ACCURACY, RATE, FEWEST, MOST, CALM = range(10)
REACH, NEXT, TAPED, WORST, MISSED, EVALUATIONS, STEPS, SUM, ESTIMATE = range(10, 19)
MEMORY_SIZE = 19  # of a simulation; its shadow's, alike, follows

#: Numbers of an interval on a tape, of which `TAPED` are kept: its length [s], rows of its table,
#: the entry that was taken, whether that was calmed, its start on the ramp [s] and that ramp's
#: duration [s]. Then positions, velocities and forces of the drives at its start, and the controls
#: of both ends of the ramp.
INTERVAL = 6

#: Rows (nu,) of what is known of a simulation's servos: settings, order, and where they are. Of
#: servos with dead time, which is `LATE` and some control periods, commands of before follow.
SPEED, OFFSET, HALF, COMMAND, MOTOR, HORN, TURNING, EFFORT, LATE = range(9)
SERVO_ROWS = 9

#: Places of a drive's parameters in its actuator's `gainprm`, of which MuJoCo reads the first:
#: stiffness [N/m]; seating, stretch beyond that of the pretension [m]; gain [N/m], limit [N], a of
#: the spool [1/m], damping [N s/m], inertia [kg], friction of the gear [N], count [m].
STIFFNESS, SEATING, TAKEN, GAIN, LIMIT, LAYERS, DAMPING, INERTIA, GEAR, COUNT = range(10)
DRIVE_SIZE = 10

#: Limit [N] of a motor without any: a finite number, which files can hold.
HUGE_FORCE = 1e15

#: Places of a tendon's row of `tendon_user`, all zero where nothing rubs along it: coefficient of
#: friction [1] in the robot, coefficient times angle [1] of the feed line, number of zones in the
#: robot, see `capstan`, and number of stations of a channel (0: guides). Then of each station
#: `STATION` numbers: place (x, y) [m], slope of the path [1] where it begins and where it ends, how
#: much of the backbone it stands for [m], and how much more the path turns there [rad].
COEFFICIENT, FEED, ZONES, STATIONS, COURSE = range(5)
STATION = 8

#: Values of METHOD: ours, MuJoCo's in two halves, MuJoCo's Runge-Kutta.
EXTRAPOLATED, SPLIT, WHOLE = range(3)

#: Largest magnitude of a position or velocity that has not diverged, as MuJoCo has it.
HUGE = 1e10


def zones(model: mujoco.MjModel) -> list[tuple[int, int]]:
    """Drives whose tendons rub along their way, and how many zones each has, see `capstan`.

    With one for the feed line, in the order of the names of the elements of friction.
    """
    out = []
    for drive, (tendon, _) in enumerate(model.actuator_trnid.tolist()):
        pulls = model.actuator_trntype[drive] == mujoco.mjtTrn.mjTRN_TENDON
        if pulls and model.nuser_tendon and model.tendon_user[tendon, ZONES]:
            out.append((drive, 1 + int(model.tendon_user[tendon, ZONES])))
    return out


#: A model in which no array that is looked for is empty.
_SMALL = """<mujoco><worldbody><site/>
<body><joint type="ball" stiffness="1"/><geom size="1"/>
<body><joint name="k"/><geom size="1"/></body></body></worldbody>
<tendon><fixed name="t" user="1"><joint joint="k" coef="1"/></fixed></tendon>
<actuator><motor tendon="t"/></actuator><sensor><jointpos joint="k"/></sensor></mujoco>"""

_WORD = 8
_SEARCHED = 20_000  # bytes after which a structure has ended
_GAP = 400  # bytes without a match that end the search


@cache
def library_path() -> str:
    """MuJoCo's shared library."""
    folder = Path(mujoco.__file__).parent
    return str(next(p for p in sorted(folder.iterdir()) if p.name.startswith("libmujoco.")))


@cache
def _example() -> tuple[mujoco.MjModel, mujoco.MjData]:
    model = mujoco.MjModel.from_xml_string(_SMALL)
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    return model, data


@cache
def model_offsets(*fields: str) -> tuple[int, ...]:
    """Offsets [words] of the pointers to arrays in `mjModel`.

    Raises:
        RuntimeError: One is not found: this is another MuJoCo than the package was made for.
    """
    model = _example()[0]
    return _offsets(model, 0, fields)


@cache
def data_offsets(*fields: str) -> tuple[int, ...]:
    """Offsets [words] of the pointers to arrays in `mjData`.

    Raises:
        RuntimeError: As `model_offsets`.
    """
    data = _example()[1]
    # The warnings come before the pointers, and long tables before them.
    start = data.warning.number.ctypes.data - data._address
    return _offsets(data, start - start % _WORD, fields)


def _offsets(structure: object, start: int, fields: tuple[str, ...]) -> tuple[int, ...]:
    wanted = {getattr(structure, name).ctypes.data: name for name in fields}
    found, last = {}, start
    for at in range(start, start + _SEARCHED, _WORD):
        name = wanted.get(ctypes.c_uint64.from_address(structure._address + at).value)
        if name is not None:
            # The last match counts: empty arrays share the address of the one after them.
            found[name], last = at // _WORD, at
        elif len(found) == len(wanted) and at - last > _GAP:
            break
    missing = [name for name in fields if name not in found]
    if missing:
        raise RuntimeError(f"MuJoCo {mujoco.__version__}: no place of {', '.join(missing)} found")
    return tuple(found[name] for name in fields)


@cache
def time_offset() -> int:
    """Offset [words] of the time in `mjData`.

    Raises:
        RuntimeError: As `model_offsets`.
    """
    data = mujoco.MjData(_example()[0])
    data.time = 0.1234567891011
    start = data.warning.number.ctypes.data - data._address
    for at in range(start - start % _WORD, start + _SEARCHED, _WORD):
        if ctypes.c_double.from_address(data._address + at).value == data.time:
            return at // _WORD
    raise RuntimeError(f"MuJoCo {mujoco.__version__}: no place of time found")


def header(sizes: tuple[int, ...]) -> ndarray:
    """A header (HEADER,) int64 with a robot's first sizes and the offsets in it, the rest zero."""
    out = np.zeros(HEADER, dtype=np.int64)
    out[: len(sizes)] = sizes
    out[OFFSETS:] = (*model_offsets(*MODEL_FIELDS), *data_offsets(*DATA_FIELDS), time_offset())
    return out
