"""Functions that C code calls, of LLVM's code that comes with the package.

Of the seconds until a first simulation, Numba takes most to make LLVM's code of the integrator, and
LLVM to optimise it. The result suits any processor of a kind, so it lies beside its source. A first
use only makes machine code of it for the processor at hand, the same as of the source. Where it is
of other sources, another Numba, LLVM or platform, or damaged, or where Numba is to check bounds or
add debug information, the function is compiled from its source.

    make prepared    # makes it anew, after an edit of these sources
"""

import zlib
from collections.abc import Callable, Iterable
from hashlib import sha256
from pathlib import Path
from typing import Any, NamedTuple

import llvmlite.binding as llvm
import numba
from numba.core.caching import CompileResultCacheImpl
from numba.core.ccallback import CFunc
from numba.core.compiler_lock import global_compiler_lock

from softrobot_env.core.sources import digest
from softrobot_env.core.under_way import tell, under_way

from .cache import SourceCache, sources_in
from .linking import CalledLibrary, KernelCompiler

#: What is said while machine code is made of it, and from which size [bytes] of its file at once:
#: that takes a second or more.
_TEXT, _LONG = "compiling the integrator to machine code, once", 50_000

#: How Numba begins the names of functions that C code calls.
_ENTRY = "cfunc."

#: Hexadecimal digits of the key that files begin with.
_KEY = 64


class _Library(CalledLibrary):
    """Keeps LLVM's code, optimised with all that is linked to it, before it is machine code.

    Its loops are short: unrolled, it runs no faster and takes longer to become machine code. With
    vectors that takes half as long again, and steps run up to a tenth faster where tendons rub.
    """

    bitcode = b""

    def take(self, module: Any) -> None:
        """Make machine code of such code."""
        self._final_module = module
        self._finalize_final_module()

    def _optimize_final_module(self) -> None:
        module = self._final_module
        for function in module.functions:
            if not (function.is_declaration or function.name.startswith(_ENTRY)):
                function.linkage = "internal"
        options = llvm.create_pipeline_tuning_options(speed_level=2)
        options.slp_vectorization = options.loop_unrolling = False
        options.loop_vectorization = True
        builder = llvm.create_pass_builder(self._codegen._tm, options)
        manager = builder.getModulePassManager()
        manager.add_refprune_pass()
        manager.run(module, builder)
        self.bitcode = module.as_bitcode()


class _Compiler(KernelCompiler):
    _library = _Library


class Code(NamedTuple):
    """Machine code of a function that C code calls.

    Attributes:
        library: Holds it.
        symbol: Its name there.
    """

    library: Any
    symbol: str

    @property
    def codegen(self) -> Any:
        """Tells the cache for which processor it is."""
        return self.library.codegen


class _CodeFiles(CompileResultCacheImpl):
    """How such functions are stored: by their machine code alone."""

    def reduce(self, code: Code) -> tuple:
        return code.library.serialize_using_object_code(), code.symbol

    def rebuild(self, target_context: Any, payload: tuple) -> Code:
        library, symbol = payload
        return Code(target_context.codegen().unserialize_library(library), symbol)

    def check_cachable(self, code: Code) -> bool:
        return not code.library.has_dynamic_globals


class _CodeCache(SourceCache):
    _impl_class = _CodeFiles


class PreparedFunction(CFunc):
    """A function that C code calls, ready once `compile` was called.

    Args:
        function: The function.
        signature: Types of its arguments, and of what it returns.
        sources: Files and folders whose edits change it.
    """

    def __init__(self, function: Callable, signature: tuple, sources: Iterable[Path]) -> None:
        super().__init__(function, signature, {}, {"nopython": True}, _Compiler)
        self.sources = tuple(sources)
        self._cache = _CodeCache(function, *self.sources)

    @global_compiler_lock
    def compile(self) -> None:
        """Take it from the cache, from its prepared code, or compile it."""
        context = self._targetdescr.target_context
        code = self._cache.load_overload(self._sig, context)
        if code is None:
            code = self._from_prepared(context.codegen()) or self.compiled()
            self._cache.save_overload(self._sig, code)
        self._library, self._wrapper_name = code
        self._wrapper_address = code.library.get_pointer_to_function(code.symbol)

    @global_compiler_lock
    def compiled(self) -> Code:
        """What Numba makes of its source."""
        result = self._compile_uncached()
        result.library.finalize()
        return Code(result.library, result.fndesc.llvm_cfunc_wrapper_name)

    @property
    def place(self) -> Path:
        """File of the prepared code."""
        source = Path(self._pyfunc.__code__.co_filename)
        return source.with_name(f"{source.stem}.{self.__name__}.llvm.z")

    def key(self) -> bytes:
        """What its LLVM code depends on, as hexadecimal digits."""
        config = numba.config
        made_by = numba.__version__, llvm.llvm_version_info, llvm.get_process_triple()
        files = sources_in((*self.sources, Path(__file__).parent))
        said = [(file.name, digest(file)) for file in files]
        told = repr((made_by, config.BOUNDSCHECK, config.DEBUGINFO_DEFAULT, said))
        return sha256(told.encode()).hexdigest().encode()

    def prepare(self) -> bytes:
        """Make what its file is to hold."""
        code = self.compiled()
        content = self.key() + code.symbol.encode() + b"\n" + code.library.bitcode
        return zlib.compress(content, 9)

    def prepared(self) -> tuple[str, Any] | None:
        """Symbol and module of its prepared code; None if there is none that fits."""
        try:
            content = zlib.decompress(self.place.read_bytes())
            if content[:_KEY] != self.key():
                return None
            symbol, _, bitcode = content[_KEY:].partition(b"\n")
            return symbol.decode(), llvm.parse_bitcode(bitcode)
        except (OSError, zlib.error, RuntimeError):
            return None

    def _from_prepared(self, codegen: Any) -> Code | None:
        found = self.prepared()
        if found is None:
            return None
        library = _Library(codegen, self.__name__)
        library.enable_object_caching()
        with under_way(lambda: _TEXT):
            if self.place.stat().st_size > _LONG:
                tell(_TEXT)
            library.take(found[1])
        return Code(library, found[0])
