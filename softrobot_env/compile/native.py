"""Functions that C code calls and that call C code; arrays at addresses, and tuples by theirs."""

import ctypes
from collections.abc import Callable
from functools import partial
from hashlib import sha256
from pathlib import Path
from typing import Any, NamedTuple

import llvmlite.binding
import numba
import numpy as np
from numba import types
from numba.core import cgutils
from numba.core.ccallback import CFunc
from numba.core.imputils import impl_ret_borrowed
from numba.core.typing.templates import AttributeTemplate
from numba.extending import (
    infer_getattr,
    intrinsic,
    lower_getattr_generic,
    models,
    register_model,
)

from . import CALLED, LINKED, OFF
from .cache import SourceCache
from .kernels import without_literals

if LINKED:
    from .prepared import PreparedFunction

#: Types of arguments of C functions.
ADDRESS, INT, FLOAT = types.uintp, types.int32, types.float64
_CTYPES = {ADDRESS: ctypes.c_size_t, INT: ctypes.c_int32, FLOAT: ctypes.c_double}

_OPTIONS = {
    "nogil": True,
    "error_model": "numpy",
    "fastmath": {"contract", "nsz", "reassoc"},
    **LINKED,
}


def _compiled(function: Callable, **options: Any) -> Any:
    compiled = numba.njit(**options, **_OPTIONS)(function)
    if not OFF:
        compiled.get_call_template = without_literals(compiled)
    return compiled


#: Compiles a function that returns no array. It counts no references to arrays: where functions
#: pass structures of arrays to each other, that would take almost half of the time.
jit = partial(_compiled, _nrt=False)

#: Compiles a function that makes arrays or views.
making = partial(_compiled, _nrt=True)

#: Compiles a function that Python calls.
called = numba.njit(**CALLED)


def functions_of(library: str, *first: types.Type) -> Callable[..., Any]:
    """From a name, and arguments after the first ones, to a function of a shared library."""
    llvmlite.binding.load_library_permanently(library)
    loaded = ctypes.CDLL(library)

    def function(name: str, *others: types.Type) -> Any:
        if not OFF:
            return types.ExternalFunction(name, types.void(*first, *others))
        found = loaded[name]
        found.argtypes, found.restype = [_CTYPES[each] for each in (*first, *others)], None
        return found

    return function


# ---------------------------------------------------------------- tuples by their address


class _Shared(types.Type):
    """Type of the address of a named tuple of the type `dtype`."""

    def __init__(self, dtype: Any) -> None:
        self.dtype, self.fields = dtype, dict(zip(dtype.fields, dtype.types, strict=True))
        super().__init__(f"shared_{sha256(dtype.name.encode()).hexdigest()}")


register_model(_Shared)(models.PointerModel)


@infer_getattr
class _SharedFields(AttributeTemplate):
    """Fields of a tuple by its address: of those that are tuples, their addresses."""

    key = _Shared

    def generic_resolve(self, shared: _Shared, name: str) -> types.Type | None:
        field = shared.fields.get(name)
        return _Shared(field) if isinstance(field, types.BaseNamedTuple) else field


@lower_getattr_generic(_Shared)
def _field(context: Any, builder: Any, shared: _Shared, address: Any, name: str) -> Any:
    place = cgutils.gep_inbounds(builder, address, 0, [*shared.fields].index(name))
    kind = shared.fields[name]
    if isinstance(kind, types.BaseNamedTuple):
        return place
    return impl_ret_borrowed(context, builder, kind, builder.load(place))


@intrinsic
def _address(typing: Any, held: Any) -> tuple[Any, Callable]:
    kind = _Shared(held)
    return kind(held), lambda context, builder, _, args: cgutils.alloca_once_value(builder, args[0])


#: A named tuple by its address, for functions that would be passed all that it holds otherwise. It
#: lives as long as the function that asks for it, and its arrays are not counted.
shared = (lambda held: held) if OFF else _address


@intrinsic
def _pointer(typing: Any, address: Any) -> tuple[Any, Callable]:
    signature = types.voidptr(types.uintp)
    return signature, lambda context, builder, _, args: builder.inttoptr(args[0], cgutils.voidptr_t)


@making
def array_at(address: int, shape: tuple[int, ...], kind: type) -> np.ndarray:
    """The array of a shape and a kind of numbers at an address."""
    if OFF:
        size = int(np.prod(shape)) * np.dtype(kind).itemsize
        return np.ndarray(shape, kind, (ctypes.c_char * size).from_address(int(address)))
    return numba.carray(_pointer(np.uint64(address)), shape, kind)


# ---------------------------------------------------------------- what C code calls

_CALL = None, ctypes.c_size_t, ctypes.c_size_t, ctypes.c_int32, ctypes.c_size_t


class Entry(NamedTuple):
    """A C function (address, address, number, address).

    Attributes:
        ctypes: For C code.
        locked: For Python, whose lock it keeps: a thread that simulates while Python exits must not
            run compiled code that is being unloaded.
        owner: What must live as long.
    """

    ctypes: Any
    locked: Callable
    owner: Any = None


def entry(function: Callable, outside: tuple[Path, ...] = ()) -> Entry:
    """Compile a function that C code calls, or let C code call Python's.

    Args:
        function: The function.
        outside: Sources out of its folder of which it has constants.
    """
    if OFF:
        return Entry(ctypes.CFUNCTYPE(*_CALL)(function), function)
    signature = (ADDRESS, ADDRESS, INT, ADDRESS), types.void
    sources = Path(function.__code__.co_filename).parent, *outside
    if LINKED:
        made = PreparedFunction(function, signature, sources)
    else:
        made = CFunc(function, signature, locals={}, options={"nopython": True})
        made._cache = SourceCache(function, *sources)
    made.compile()
    return Entry(made.ctypes, ctypes.PYFUNCTYPE(*_CALL)(made.address), made)
