"""Compiling the firmware: for this computer, for a microcontroller, and what is said without."""

import shutil
import subprocess
from types import SimpleNamespace

import pytest
from support.firmware_bench import running  # skips without a compiler
from support.processes import python

from firmware_schema import header
from softrobot_env.core.files import firmware_dir
from softrobot_env.hardware import virtual_robot as core
from softrobot_env.hardware.virtual_robot import CompilerMissingError, Core, Measured

QUIET = Measured((0,) * 3, (0,) * 3, (0,) * 4, 0, False)


def make(*arguments):
    command = ["make", "-C", str(firmware_dir()), *arguments]
    return subprocess.run(command, capture_output=True, text=True)


def test_the_tables_in_cpp_are_those_of_python():
    written = (firmware_dir() / "core" / "schema.h").read_text()
    assert written == header() + "\n", "run python scripts/firmware_schema.py"


def test_the_core_calls_no_platform_and_takes_no_memory():
    for path in (firmware_dir() / "core").iterdir():
        includes = [line for line in path.read_text().splitlines() if line.startswith("#include")]
        assert all(line == "#include <stdint.h>" or '"' in line for line in includes), path
        assert not {"new", "malloc", "float", "double"} & set(path.read_text().split()), path


def test_it_compiles_without_a_warning(tmp_path):
    done = make("host", f"BUILD={tmp_path}", f"CXX={core._compiler()[0]}")
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "core.so").exists()


@pytest.mark.parametrize("mcu", ["atmega328p", "atmega2560"])
def test_it_fits_into_a_microcontroller(mcu, tmp_path):
    if shutil.which("avr-g++") is None:
        pytest.skip("needs gcc-avr, avr-libc and binutils-avr")
    done = make("avr", f"BUILD={tmp_path}", f"MCU={mcu}")
    assert done.returncode == 0, done.stderr
    _, data, bss = map(int, done.stdout.split("filename")[1].split()[:3])
    assert data + bss < 1400  # of 2048 bytes; the rest is stack


def test_make_says_what_an_avr_build_needs(tmp_path):
    done = make("avr", f"BUILD={tmp_path}", "AVR=absent-")
    assert done.returncode != 0
    assert "install gcc-avr, avr-libc and binutils-avr" in done.stderr


@pytest.fixture
def cache(monkeypatch, tmp_path):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    return tmp_path


def test_two_processes_may_compile_at_once_and_nobody_again(cache, monkeypatch):
    code = "from softrobot_env.hardware.virtual_robot import Core; Core().transmit()"
    with python(code, stderr=subprocess.PIPE) as one, python(code, stderr=subprocess.PIPE) as other:
        assert [process.communicate()[1] for process in (one, other)] == [b"", b""]
    monkeypatch.setattr(core.subprocess, "run", None)
    assert list(cache.rglob("*.so")) == [core.compiled()]
    assert core.compiled().is_relative_to(cache / "softrobot_env")


def test_a_missing_compiler_is_named(cache, monkeypatch):
    monkeypatch.setenv("CXX", "absent-compiler -O2")
    with pytest.raises(CompilerMissingError, match=r"apt install g\+\+.*'absent-compiler'"):
        core.compiled()
    monkeypatch.delenv("CXX")
    monkeypatch.setenv("PATH", "")
    with pytest.raises(CompilerMissingError, match=r"apt install g\+\+"):
        core.compiled()


def test_a_compiler_that_fails_is_quoted(cache, monkeypatch):
    monkeypatch.setenv("CXX", f"{core._compiler()[0]} --no-such-option")
    with pytest.raises(CompilerMissingError, match="no-such-option"):
        core.compiled()
    assert list(cache.rglob("*.so")) == []


@pytest.mark.parametrize("options", [{"n": 0}, {"n": 7}, {"boot_id": -1}, {"boot_id": 2**32}])
def test_impossible_devices_are_refused(options):
    with pytest.raises(ValueError, match=r"from 0 to|1 to 6"):
        Core(**options)


def test_a_device_without_memory_is_refused(monkeypatch):
    full = SimpleNamespace(softrobot_create=lambda *_: None)
    monkeypatch.setattr(core, "library", lambda: full)
    with pytest.raises(MemoryError, match="no memory for a device"):
        Core()


@pytest.mark.parametrize(
    "wrong",
    [
        {"length": (0, 0)},
        {"force": (0,) * 6},
        {"adc": (0,) * 3},
        {"length": (2**15, 0, 0)},
        {"adc": (0, 0, 0, 2**16)},
        {"vbus": -1},
        {"vbus": 5.5},
    ],
)
def test_measurements_that_do_not_fit_are_refused(wrong):
    with pytest.raises(ValueError, match=r"needs 3 lengths|does not fit"):
        Core().run(0, QUIET._replace(**wrong))


def test_bytes_beyond_the_receive_buffer_are_lost():
    bench = running()
    bench.core.receive(b"\0" * 2**15)
    bench.core.receive(b"\2\0" * 10)
    (state,) = [m for m in bench.run(ms=50) if type(m).__name__ == "State"]
    assert state.frame_errors == 0
