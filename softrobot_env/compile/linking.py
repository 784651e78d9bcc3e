"""Kernels as other kernels call them: LLVM's code, made machine code within their callers only.

Numba makes machine code of every function, and once more of it within each function that calls it,
and so on upwards; in a deep tree of calls this takes most of the time. A kernel that is linked
stops at LLVM's code. What Python calls is optimised, with all that it calls, and made machine code.
It runs as fast, and compiles in half the time or less.
"""

import gc
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import llvmlite.binding as llvm
from numba.core.caching import CompileResultCacheImpl
from numba.core.codegen import JITCodeLibrary
from numba.core.compiler import CompilerBase, CompileResult, DefaultPassBuilder, Flags
from numba.core.compiler_machinery import LoweringPass, register_pass
from numba.core.environment import lookup_environment
from numba.core.typed_passes import NoPythonBackend
from numba.core.typing.templates import _OverloadFunctionTemplate
from numba.extending import overload
from numba.np import arrayobj

#: Prefix of the global variables that hold the Python side of compiled functions.
_ENVIRONMENT = "_ZN08NumbaEnv"


class _Library(JITCodeLibrary):
    """Code that LLVM optimises with less effort than Numba asks for: it runs as fast.

    It is simplified before anything is linked to it; then it is optimised once, at level 2.
    """

    def _optimize_functions(self, module: Any) -> None:
        module.data_layout = self._codegen._data_layout
        manager, builder = self._codegen._function_pass_manager(opt=1)
        for function in module.functions:
            if not function.is_declaration:
                manager.run(function, builder)

    def _optimize_final_module(self) -> None:
        manager, builder = self._codegen._module_pass_manager(opt=2)
        manager.run(self._final_module, builder)


class _LinkedLibrary(_Library):
    """Code that is linked into that of its callers."""

    def _optimize_final_module(self) -> None:
        """Nothing: callers optimise it together with their own."""

    def _finalize_final_module(self) -> None:
        self._finalize_dynamic_globals()
        self._verify_declare_only_symbols()
        self._finalized = True


class CalledLibrary(_Library):
    """Code that Python or C code calls."""

    def _finalize_specific(self) -> None:
        super()._finalize_specific()
        for variable in self._final_module.global_variables:  # those of the linked functions too
            if variable.name.startswith(_ENVIRONMENT):
                environment = lookup_environment(variable.name)
                if environment is not None:
                    self._codegen.set_env(variable.name, environment)


def _entry() -> Callable:
    """Stands for a linked function where Numba asks for what Python would call.

    It has to be a built-in method, different for each function.
    """
    return object().__format__


@register_pass(mutates_CFG=False, analysis_only=False)
class _Announce(LoweringPass):
    """Let kernels that are compiled later call a linked one."""

    _name = "announce_linked"

    def __init__(self) -> None:  # abstract in the base class
        super().__init__()

    def run_pass(self, state: Any) -> bool:
        result = state.cr._replace(entry_point=_entry())
        state.targetctx.insert_user_function(result.entry_point, result.fndesc, [result.library])
        state.cr = result
        return True


def _misfit(given: tuple, place: tuple) -> None:
    """Raise ValueError: an array does not fit where it is to be copied to, as in `a[:2] = b`."""
    raise NotImplementedError


class _Flags(Flags):
    """Options of what is compiled here, so that Numba's own functions are compiled for it alone.

    Numba compares them a hundred thousand times, and would make dictionaries of all of them each.
    """

    __slots__ = ()

    def _changed(self) -> dict[str, Any]:
        options = self.options
        return {n: value for n, value in self._values.items() if value != options[n].default}

    def __eq__(self, other: object) -> bool:
        if type(other) is not _Flags:
            return False
        return self._values == other._values or self._changed() == other._changed()

    def __hash__(self) -> int:
        return hash((self.nrt, self.no_compile, self.forceinline, len(self.fastmath.flags)))


_decorator_of = _OverloadFunctionTemplate._get_jit_decorator


def _linking_decorator_of(template: Any) -> Callable:
    """What makes an implementation of a function of Numba, linked unless it says otherwise."""
    jit = _decorator_of(template)
    return lambda **options: jit(**{**LINKED, **options})


@contextmanager
def _less_work() -> Iterator[None]:
    """Within it Numba compiles with less effort.

    - Its own functions are linked, as the kernels are.
    - Its error of arrays that do not fit, which tells both shapes, is replaced by one that does
      not: it costs seconds to compile how numbers are written.
    - No garbage is looked for, which took a tenth of the time and found little.
    """
    usual, arrayobj.raise_with_shape_context = arrayobj.raise_with_shape_context, _misfit
    decorator = _OverloadFunctionTemplate._get_jit_decorator
    _OverloadFunctionTemplate._get_jit_decorator = _linking_decorator_of
    collects = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        arrayobj.raise_with_shape_context = usual
        _OverloadFunctionTemplate._get_jit_decorator = decorator
        if collects:
            gc.enable()


class KernelCompiler(CompilerBase):
    """Compiles what Python or C code calls."""

    _library = CalledLibrary

    def __init__(self, *arguments: Any) -> None:
        super().__init__(*arguments)
        state = self.state
        state.flags = _Flags(state.flags)
        state.library = self._library(state.targetctx.codegen(), "kernel")
        state.library.enable_object_caching()

    def _compile_core(self) -> Any:
        with _less_work():
            return super()._compile_core()

    def define_pipelines(self) -> list:
        """Numba's passes."""
        return [DefaultPassBuilder.define_nopython_pipeline(self.state)]


class LinkedCompiler(KernelCompiler):
    """Compiles what kernels call."""

    _library = _LinkedLibrary

    def define_pipelines(self) -> list:
        """Numba's passes up to LLVM's code."""
        self.state.flags.no_compile = True
        (passes,) = super().define_pipelines()
        passes.add_pass_after(_Announce, NoPythonBackend)
        passes.finalize()
        return [passes]


#: Options of a linked function, for `njit` and `overload`.
LINKED: dict[str, Any] = {
    "pipeline_class": LinkedCompiler,
    "no_cpython_wrapper": True,
    "no_cfunc_wrapper": True,
}


@overload(_misfit, jit_options=LINKED)
def _raise_misfit(given: Any, place: Any) -> Callable:
    def impl(given: Any, place: Any) -> None:
        raise ValueError("cannot copy an array to one of another shape")

    return impl


#: Options of a function that calls linked ones, for `njit` and `cfunc`.
CALLED: dict[str, Any] = {"pipeline_class": KernelCompiler}


class LinkedFiles(CompileResultCacheImpl):
    """How linked kernels are stored: LLVM's code, without machine code."""

    def reduce(self, cres: Any) -> tuple:
        """What is stored of a compiled kernel."""
        fndesc = cres.fndesc
        fndesc.typemap = fndesc.calltypes = None  # as Numba does: may fail to pickle
        code = cres.library._get_module_for_linking().as_bitcode()
        environments = tuple(cres._find_referenced_environments())
        return code, fndesc, cres.environment, cres.signature, cres.reload_init, environments

    def rebuild(self, target_context: Any, payload: tuple) -> Any:
        """The kernel that `reduce` made this of."""
        code, fndesc, environment, signature, reload_init, environments = payload
        for function in reload_init:
            function()
        library = _LinkedLibrary(target_context.codegen(), fndesc.mangled_name)
        library._final_module = library._shared_module = llvm.parse_bitcode(code)
        library._finalize_final_module()
        return CompileResult(
            target_context=target_context,
            typing_context=target_context.typing_context,
            library=library,
            environment=environment,
            entry_point=_entry(),
            fndesc=fndesc,
            type_annotation="",
            signature=signature,
            objectmode=False,
            lifted=(),
            typing_error=None,
            call_helper=None,
            metadata=None,
            reload_init=reload_init,
            referenced_envs=environments,
        )
