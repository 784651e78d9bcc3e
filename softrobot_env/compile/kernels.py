"""Compilation of kernels to machine code, cached on disk, and their structures."""

import sys
from collections.abc import Callable
from functools import partial
from hashlib import sha256
from inspect import signature
from pathlib import Path
from typing import Any

import numba
from numba.core import types
from numba.experimental import structref
from numba.extending import overload

from . import CALLED, LINKED, OFF
from .cache import SourceCache

_PACKAGE = __name__.split(".")[0]

if LINKED:
    from .linking import LinkedFiles

_ROOT = Path(__file__).parents[1]


def _part(function: Callable) -> Path:
    """Folder whose sources a function may call: its part of the package, else its own folder."""
    own = Path(function.__code__.co_filename).parent
    if _ROOT not in own.parents:
        return own
    return _ROOT / own.relative_to(_ROOT).parts[0]


class _KernelCache(SourceCache):
    """Numba's cache, made safe for kernels that call each other and take foreign models.

    Numba watches the file of the function alone: here every kernel depends on all sources of the
    beams and of its own part of the package, so that an edit of any of them recompiles. And a
    kernel compiled for a model that is defined elsewhere, in a script for instance, is not
    stored: another script may mean something else by the same name.
    """

    def __init__(self, function: Callable, everywhere: bool, linked: bool = False) -> None:
        if linked:
            self._impl_class = LinkedFiles
        places = (_ROOT,) if everywhere else (_ROOT / "beams", _part(function))
        super().__init__(function, *places)
        if linked:
            self._cache_file._base += "-linked"

    def _save_overload(self, sig: Any, data: Any) -> None:
        """Store a compiled kernel if all types of its arguments belong to this package."""
        classes = [getattr(t, "instance_class", None) for t in sig]
        if all(c is None or c.__module__.split(".")[0] == _PACKAGE for c in classes):
            super()._save_overload(sig, data)


def kernel(function: Callable, everywhere: bool = False, nogil: bool = False) -> Any:
    """Compile a function on its first call for every new combination of argument types.

    Division by zero gives inf or nan, as in NumPy, so that a diverging state shows as one.

    Args:
        function: The function.
        everywhere: Whether structures from anywhere in the package may be passed to it, so that
            an edit of any of its sources recompiles it.
        nogil: Whether other threads run while Python calls it.
    """
    if OFF:
        function.py_func = function
        return function
    if LINKED:
        compiled = _dispatcher(function, nogil=nogil, **CALLED)
        called = _dispatcher(function, **LINKED)
        called._cache = _KernelCache(function, everywhere, linked=True)
    else:
        compiled = called = _dispatcher(function, nogil=nogil)
    compiled._cache = _KernelCache(function, everywhere)
    compiled.get_call_template = without_literals(called)
    compiled.get_overload = called.get_overload
    return compiled


def without_literals(compiled: Any) -> Callable[[tuple, dict], tuple]:
    """Its `get_call_template`, by which `f(1)` and `f(2)` are one kernel.

    Numba would compile each of them, with all it calls.
    """
    template = compiled.get_call_template

    def found(args: tuple, kws: dict) -> tuple:
        kws = {name: types.unliteral(t) for name, t in kws.items()}
        return template(tuple(types.unliteral(t) for t in args), kws)

    return found


def _dispatcher(function: Callable, **options: Any) -> Any:
    return numba.njit(error_model="numpy", fastmath={"contract", "nsz"}, **options)(function)


def implementation(function: Any, data_class: type) -> Callable[[Any], Any]:
    """Decorator: a kernel is what a function of `singledispatch` does for a structure's class.

    In other kernels, and in Python for references to the structure.
    """

    def register(made: Any) -> Any:
        def choose(*arguments: Any) -> Any:
            fits = getattr(arguments[0], "instance_class", None) is data_class
            return made.py_func if fits else None

        choose.__signature__ = signature(made.py_func)  # type: ignore[attr-defined]
        overload(function, jit_options=LINKED)(choose)
        function.register(_REFERENCES.get(data_class, data_class), made)
        return made

    return register


# ---------------------------------------------------------------- structures

#: Class of the references to instances of each structure.
_REFERENCES: dict[type, type] = {}


class _StructType(types.StructRef):
    """Numba's type of a structure; `instance_class` as in its type of named tuples."""

    data_class: type

    def __init__(self, fields: Any) -> None:
        super().__init__(fields)
        # Numba distinguishes types by name and puts the names of all arguments into every symbol:
        # kilobytes of fields would be most of the code that LLVM reads.
        digest = sha256(self.name.encode()).hexdigest()[:16]
        self.name = f"{type(self).__name__}_{digest}"

    def preprocess_fields(self, fields: Any) -> tuple:
        return tuple((name, types.unliteral(t)) for name, t in fields)

    @property
    def instance_class(self) -> type:
        return self.data_class


class Reference(structref.StructRefProxy):
    """A structure as kernels see it: passed as one pointer, its fields readable in Python.

    A named tuple would be passed by value, every field of every array on its own, which costs
    several times the run and compile time of the kernels here.
    """

    def __getattr__(self, name: str) -> Any:
        if name == "_source":  # not set yet
            raise AttributeError(name)
        return getattr(self._source, name)

    def __reduce__(self) -> tuple:
        return reference, (self._source,)

    def _replace(self, **changes: Any) -> "Reference":
        """A reference to a copy with other values."""
        return reference(self._source._replace(**changes))


def structure(data_class: type) -> type:
    """Class decorator: let instances of a NamedTuple class be passed to kernels by reference."""
    if OFF:
        return data_class
    module, name = data_class.__module__, data_class.__name__
    namespace = {"__module__": module, "data_class": data_class}
    struct_type = structref.register(type(f"{name}Type", (_StructType,), namespace))
    proxy = type(f"{name}Reference", (Reference,), {"__module__": module})
    for made in (struct_type, proxy):  # where pickle, hence the cache, looks for them
        setattr(sys.modules[module], made.__name__, made)
    structref.define_proxy(proxy, struct_type, list(data_class._fields))
    _REFERENCES[data_class] = proxy
    return data_class


def reference(data: Any) -> Any:
    """Reference to a structure, for kernels; structures inside it become references too."""
    if OFF:
        return data
    made = refer(data)
    made._source = data
    return made


def _referred(value):
    return value


@overload(_referred, jit_options=LINKED)
def _referred_implementation(value):
    data_class = getattr(value, "instance_class", None)
    if data_class not in _REFERENCES or not isinstance(value, types.BaseNamedTuple):
        return lambda value: value
    nested = [isinstance(field, types.BaseNamedTuple) for field in value.types]
    fields = ", ".join(
        f"referred(value.{name})" if within else f"value.{name}"
        for name, within in zip(data_class._fields, nested, strict=True)
    )
    namespace = {"make": _REFERENCES[data_class], "referred": _referred}
    exec(f"def convert(value): return make({fields})", namespace)
    return namespace["convert"]


@partial(kernel, everywhere=True)
def refer(data):
    """As `reference`, inside a kernel."""
    return _referred(data)
