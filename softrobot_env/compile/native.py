"""Functions that C code calls and that call C code, and arrays at addresses that C code has."""

import ctypes
from collections.abc import Callable
from typing import Any, NamedTuple

import llvmlite.binding
import numba
import numpy as np
from numba import types
from numba.core import cgutils
from numba.core.ccallback import CFunc
from numba.extending import intrinsic

from . import CALLED, LINKED, OFF
from .cache import SourceCache

#: Types of arguments of C functions.
ADDRESS, INT, FLOAT = types.uintp, types.int32, types.float64
_CTYPES = {ADDRESS: ctypes.c_size_t, INT: ctypes.c_int32, FLOAT: ctypes.c_double}

_OPTIONS = {
    "nogil": True,
    "error_model": "numpy",
    "fastmath": {"contract", "nsz", "reassoc"},
    **LINKED,
}

#: Compiles a function that returns no array. It counts no references to arrays: where functions
#: pass structures of arrays to each other, that would take almost half of the time.
jit = numba.njit(_nrt=False, **_OPTIONS)

#: As `jit`, for functions of structures that are called once or twice in others: passing them has
#: a price too.
inlined = numba.njit(_nrt=False, forceinline=True, **_OPTIONS)

#: Compiles a function that makes arrays or views.
making = numba.njit(_nrt=True, **_OPTIONS)

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


def entry(function: Callable) -> Entry:
    """Compile a function that C code calls, or let C code call Python's."""
    if OFF:
        return Entry(ctypes.CFUNCTYPE(*_CALL)(function), function)
    signature = (ADDRESS, ADDRESS, INT, ADDRESS), types.void
    made = CFunc(function, signature, locals={}, options={"nopython": True}, **CALLED)
    made._cache = SourceCache(function)
    made.compile()
    return Entry(made.ctypes, ctypes.PYFUNCTYPE(*_CALL)(made.address), made)
