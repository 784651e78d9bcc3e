"""Compiles `firmware/core` and `firmware/host` into a library of the user's cache, once."""

import ctypes
import hashlib
import os
import shlex
import shutil
import subprocess
import tempfile
from functools import cache
from pathlib import Path

from softrobot_env.paths import firmware_dir

_COMPILERS = ("c++", "g++", "clang++")
_FLAGS = ("-std=c++11", "-O2", "-fPIC", "-shared", "-fno-exceptions", "-fno-rtti")
_SUFFIXES = (".h", ".cpp")


class CompilerMissingError(RuntimeError):
    """No C++ compiler, or one that cannot compile the device's program."""


@cache
def library() -> ctypes.CDLL:
    """The compiled program with the functions of `firmware/host`.

    Raises:
        CompilerMissingError: There is no C++ compiler, or it fails.
    """
    found = ctypes.CDLL(str(compiled()))
    device, byte, half, word = ctypes.c_void_p, ctypes.c_uint8, ctypes.c_uint16, ctypes.c_uint32
    data = ctypes.c_char_p
    found.softrobot_create.argtypes = (byte, word, byte, half)
    found.softrobot_create.restype = device
    found.softrobot_destroy.argtypes = (device,)
    found.softrobot_run.argtypes = (device, word, data, data, half)
    found.softrobot_transmit.argtypes = (device, data, half)
    found.softrobot_transmit.restype = half
    found.softrobot_outputs.argtypes = (device, ctypes.c_void_p)
    return found


def compiled() -> Path:
    """Path of the library; compiles if these sources never were with this compiler.

    Raises:
        CompilerMissingError: There is no C++ compiler, or it fails.
    """
    sources, compiler = _sources(), _compiler()
    path = _folder(sources, compiler) / "core.so"
    if not path.exists():
        path.parent.mkdir(parents=True, exist_ok=True)
        _compile([*compiler, *_FLAGS], sources, path)
    return path


def _sources() -> list[Path]:
    folders = (firmware_dir() / "core", firmware_dir() / "host")
    return sorted(p for folder in folders for p in folder.iterdir() if p.suffix in _SUFFIXES)


def _compiler() -> list[str]:
    """Command of the C++ compiler: `$CXX`, or one that is on the path."""
    chosen = shlex.split(os.environ.get("CXX", ""))
    candidates = [chosen] if chosen else [[name] for name in _COMPILERS]
    for command in candidates:
        if shutil.which(command[0]):
            return command
    named = f"; $CXX names {chosen[0]!r}, which is not there" if chosen else ""
    raise CompilerMissingError(
        "the device's program needs a C++ compiler: install one (Debian, Ubuntu: apt install g++; "
        f"Fedora: dnf install gcc-c++; macOS: xcode-select --install) or name it in $CXX{named}"
    )


def _folder(sources: list[Path], compiler: list[str]) -> Path:
    """Folder in the user's cache for what this compiler makes of these sources."""
    digest = hashlib.sha256(repr((compiler, shutil.which(compiler[0]), _FLAGS)).encode())
    for path in sources:
        digest.update(path.name.encode() + b"\0" + path.read_bytes())
    root = os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache"
    return Path(root) / "softrobot_env" / f"core-{digest.hexdigest()[:16]}"


def _compile(command: list[str], sources: list[Path], path: Path) -> None:
    """Under another name first: two processes may do this at once."""
    with tempfile.TemporaryDirectory(dir=path.parent) as folder:
        new = Path(folder) / path.name
        units = [str(source) for source in sources if source.suffix == ".cpp"]
        done = subprocess.run([*command, *units, "-o", str(new)], capture_output=True, text=True)
        if done.returncode:
            raise CompilerMissingError(f"{shlex.join(command)} failed:\n{done.stderr}")
        new.replace(path)
