"""Where MuJoCo keeps the arrays of its structures, for compiled code that gets their addresses.

`mjModel` and `mjData` hold a pointer to each of their arrays. Its place is found, not assumed: by
comparing the words of a small model's structures with the addresses that Python knows.
"""

import ctypes
from functools import cache
from pathlib import Path

import mujoco

#: A model in which no array that is looked for is empty.
_SMALL = """<mujoco><worldbody><body><joint type="ball" stiffness="1"/><geom size="1"/>
<body><joint name="k"/><geom size="1"/></body></body></worldbody>
<tendon><fixed name="t"><joint joint="k" coef="1"/></fixed></tendon>
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
