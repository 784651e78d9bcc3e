"""Files of trained, identified and recorded things: arrays in npz, facts in json.

Every loader reads through here, so that a file that is damaged, incomplete or not finite is refused
by name before anything is computed from it.
"""

import json
from collections.abc import Collection, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NoReturn

import numpy as np
from numpy import ndarray

from .files import atomic_write, readable
from .records import placed

#: What comes of values that do not go together.
_UNFIT = (ArithmeticError, AttributeError, LookupError, RecursionError, TypeError, ValueError)


class Arrays(dict[str, ndarray]):
    """Arrays by name, out of a file; one that is missing is refused with the file's name.

    Attributes:
        path: The file.
    """

    def __init__(self, path: str | Path, values: dict[str, ndarray]) -> None:
        super().__init__(values)
        self.path = path

    def __missing__(self, name: str) -> NoReturn:
        raise ValueError(f"{self.path} lacks the array {name!r}; it has {', '.join(self)}")

    def check_finite(
        self, infinite: Collection[str] = (), unmeasured: Collection[str] = ()
    ) -> None:
        """Refuse numbers that are not finite.

        Args:
            infinite: Arrays that may hold infinity, but not NaN.
            unmeasured: Arrays that may hold both, where nothing was measured.

        Raises:
            ValueError: There are others, or complex ones; the message names file and array.
        """
        for name, array in self.items():
            if array.dtype.kind == "c":
                raise ValueError(f"{self.path}: the array {name!r} holds complex numbers")
            if array.dtype.kind != "f" or name in unmeasured:
                continue
            bad = np.isnan(array) if name in infinite else ~np.isfinite(array)
            if bad.any():
                raise ValueError(
                    f"{self.path}: {bad.sum()} of {bad.size} numbers of the array {name!r} are "
                    "not finite"
                )

    def check_shapes(self, shapes: Mapping[str, tuple[int | None, ...]], prefix: str = "") -> None:
        """Raise ValueError unless arrays are numbers of these shapes, None standing for any size.

        Args:
            shapes: By the arrays' names.
            prefix: Before each name.
        """
        for name, shape in shapes.items():
            array = self[prefix + name]
            fits = array.ndim == len(shape) and array.dtype.kind in "fiu"
            if not fits or any(n not in (None, m) for n, m in zip(shape, array.shape, strict=True)):
                wanted = str(shape).replace("None", "n")
                raise ValueError(
                    f"{self.path}: the array {prefix + name!r} must hold numbers and have shape "
                    f"{wanted}, got {array.dtype} and {array.shape}"
                )

    @contextmanager
    def fitting(self) -> Iterator[None]:
        """Where something is made of the arrays: what does not go is refused in one line.

        Raises:
            ValueError: An array has another kind, shape or value than is needed; names the file.
        """
        try:
            yield
        except _UNFIT as error:
            reason = str(error).partition("\n")[0]
            if isinstance(error, ValueError) and str(self.path) in reason:
                raise
            raise ValueError(f"{self.path}: its arrays do not fit together: {reason}") from error


def read_arrays(path: str | Path) -> Arrays:
    """The arrays of an npz file, as they are.

    Raises:
        FileNotFoundError: No such file.
        ValueError: It is no npz file, damaged, or holds other things than arrays.
    """
    with readable(path).open("rb") as file:
        try:
            values = dict(np.load(file, allow_pickle=False))
            if not all(isinstance(value, ndarray) for value in values.values()):
                raise ValueError("NumPy gives other members of the zip file as bytes")
        except Exception as error:  # whatever zip, zlib and NumPy raise on damage
            raise ValueError(f"{path} is no npz file of arrays, or damaged") from error
        return Arrays(path, values)


def write_arrays(path: str | Path, values: Mapping[str, Any]) -> None:
    """Write a compressed npz file that `read_arrays` reads, under exactly this name."""
    arrays = {name: np.asarray(value) for name, value in values.items()}
    # Given a name, NumPy would append to it.
    with atomic_write(path) as aside, aside.open("wb") as file:
        np.savez_compressed(file, allow_pickle=False, **arrays)


def write_tree(path: str | Path, tree: Any) -> None:
    """Write nested dicts, lists and tuples of arrays, numbers and texts as an npz file.

    Floating-point arrays are kept to single precision, and equal arrays once.

    Raises:
        TypeError: Something else is in it.
    """
    arrays: dict[str, ndarray] = {}
    write_arrays(path, {_STRUCTURE: json.dumps(_taken_apart(tree, arrays)), **arrays})


def read_tree(path: str | Path) -> Any:
    """What `write_tree` wrote; errors as `read_arrays`."""
    arrays = read_arrays(path)
    with arrays.fitting():
        return _put_together(json.loads(str(arrays[_STRUCTURE])), arrays)


#: Array of a tree's structure as json; its arrays have numbers as names.
_STRUCTURE = "structure"


def _taken_apart(value: Any, arrays: dict[str, ndarray]) -> Any:
    """A value for json, its arrays put aside."""
    if isinstance(value, ndarray):
        array = value.astype(np.float32) if value.dtype == np.float64 else value
        for name, known in arrays.items():
            if known.dtype == array.dtype and np.array_equal(known, array, array.dtype.kind == "f"):
                return {"array": name}
        arrays[str(len(arrays))] = array
        return {"array": str(len(arrays) - 1)}
    if isinstance(value, np.generic):
        return value.item()
    if isinstance(value, dict):
        return {"dict": [[k, _taken_apart(v, arrays)] for k, v in value.items()]}
    if isinstance(value, list | tuple):
        kind = "list" if isinstance(value, list) else "tuple"
        return {kind: [_taken_apart(one, arrays) for one in value]}
    if value is None or isinstance(value, bool | int | float | str):
        return value
    raise TypeError(f"a tree holds no {type(value).__name__}")


def _put_together(value: Any, arrays: Arrays) -> Any:
    if not isinstance(value, dict):
        return value
    ((kind, content),) = value.items()
    if kind == "array":
        return arrays[content]
    if kind == "dict":
        return {k: _put_together(v, arrays) for k, v in content}
    parts = [_put_together(one, arrays) for one in content]
    return tuple(parts) if kind == "tuple" else parts


def read_facts(path: str | Path) -> Any:
    """What a json file tells.

    Raises:
        FileNotFoundError: No such file.
        ValueError: It is no json file, or holds a number that is not finite.
    """
    with placed(path):  # decoding errors are of this kind
        try:
            return json.loads(readable(path).read_text("utf-8"), parse_constant=_refuse)
        except RecursionError:
            raise ValueError("it is nested too deeply") from None


def _refuse(number: str) -> NoReturn:
    raise ValueError(f"{number} is no finite number")
