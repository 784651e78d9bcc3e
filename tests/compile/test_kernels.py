"""Kernels are compiled once, and never run stale."""

import gc
import os
import shutil
import subprocess
import sys
import time
from pathlib import Path
from typing import NamedTuple

import numba
import numpy as np
import pytest

import softrobot_env
from softrobot_env.compile import OFF
from softrobot_env.compile.kernels import kernel, reference, structure
from softrobot_env.compile.native import called, jit, shared

pytestmark = pytest.mark.skipif(OFF, reason="nothing is compiled")


@structure
class Inner(NamedTuple):
    values: np.ndarray


@structure
class Outer(NamedTuple):
    factor: float
    inner: Inner


@kernel
def _sum(data):
    return data.factor * data.inner.values.sum()


def test_structures_are_passed_by_reference():
    data = reference(Outer(2.0, Inner(np.ones(3))))
    assert _sum(data) == 6.0
    data.inner.values[0] = 4.0  # the arrays are shared
    assert _sum(data) == 12.0
    assert _sum(data._replace(factor=1.0)) == 6.0
    assert data.factor == 2.0


class Pair(NamedTuple):
    first: np.ndarray
    inner: Inner


@jit
def _last(pair):
    pair.first[0] += 1.0
    return pair.inner.values[-1] + pair.first.size


@called
def _last_of(first, values):
    pair = shared(Pair(first, Inner(values)))
    return _last(pair) + _last(pair)


def test_tuples_are_passed_by_their_address():
    """Of any types: those of one class with other arrays are others."""
    first, values = np.zeros(3), np.arange(4.0)
    assert _last_of(first, values) == 12.0 and first[0] == 2.0
    assert _last_of(first[::2], np.arange(8)[::2]) == 16.0 and first[0] == 4.0


@kernel
def _double(x):
    if x < 0:
        raise ValueError("negative")
    return 2 * x


@kernel
def _double_twice(x):
    return _double(_double(x))


def test_only_what_python_calls_becomes_machine_code():
    assert _double_twice(3.0) == 12.0
    assert not _double.overloads  # linked into its caller, nothing of its own
    assert _double(3.0) == 6.0
    assert len(_double.overloads) == 1
    assert _double_twice(np.float32(0.5)) == 2.0
    for function in (_double, _double_twice):
        with pytest.raises(ValueError, match="negative"):
            function(-1.0)


def test_kernels_of_foreign_structures_are_not_stored():
    _sum(reference(Outer(2.0, Inner(np.ones(3)))))
    assert not list((Path(__file__).parent / "__pycache__").glob("test_compilation._sum*.nbc"))


@pytest.mark.parametrize(
    ("before", "files"),
    [
        pytest.param("", 2, id="linked", marks=pytest.mark.slow),
        pytest.param(
            "import numba; numba.version_info = (9, 9, 9); ",
            1,
            id="another numba",
            marks=pytest.mark.slow,
        ),
    ],
)
def test_an_edit_of_any_source_recompiles_what_uses_it(tmp_path, before, files):
    """`value` calls nothing; its user `twice` stands in another file."""
    package = tmp_path / "softrobot_env"
    ignored = shutil.ignore_patterns("__pycache__", "benchmarks", "envs")
    shutil.copytree(Path(softrobot_env.__file__).parent, package, ignore=ignored)
    beams = package / "beams"
    (beams / "first.py").write_text(
        "from softrobot_env.compile.kernels import kernel\n\n\n"
        "@kernel\ndef value(x):\n    return x + 1\n"
    )
    (beams / "second.py").write_text(
        "from softrobot_env.compile.kernels import kernel\n"
        "from softrobot_env.beams.first import value\n\n\n"
        "@kernel\ndef twice(x):\n    return 2 * value(x)\n"
    )

    def run():
        code = before + (
            "from softrobot_env.beams.second import twice; print(twice(1)); "
            "print(sum(twice.stats.cache_hits.values())); "
            "from softrobot_env.beams.first import value; value(1)"
        )
        environment = {k: v for k, v in os.environ.items() if k != "NUMBA_CACHE_DIR"}
        result = subprocess.run(
            [sys.executable, "-c", code],
            cwd=tmp_path,
            env=environment | {"PYTHONPATH": str(tmp_path)},
            capture_output=True,
            text=True,
            check=True,
        )
        return [int(x) for x in result.stdout.split()]

    assert run() == [4, 0]
    stored = sorted((beams / "__pycache__").glob("first.value*.nbc"))
    assert len(stored) == files  # for kernels and for Python; neither removes the other
    assert run() == [4, 1]
    first = beams / "first.py"
    first.write_text(first.read_text().replace("x + 1", "x + 2"))
    assert run() == [6, 0]
    renewed = sorted((beams / "__pycache__").glob("first.value*.nbc"))
    assert len(renewed) == files and not set(renewed) & set(stored)


def test_an_array_of_another_shape_is_refused_in_a_linked_kernel_too():
    @kernel
    def put(place, given):
        place[:2] = given

    @kernel
    def call(place, given):
        put(place, given)

    place = np.zeros(3)
    call(place, np.ones(2))
    assert place.tolist() == [1, 1, 0]
    with pytest.raises(ValueError, match="another shape"):
        call(place, np.ones(4))


@kernel
def _made(count):
    return np.empty(count)


def _made_by_numba(count):
    return len(np.empty(count)) + len(_made(count + 1)) + len(np.empty(count))


def test_functions_of_numba_stay_as_they_are_for_others():
    assert _made(3).shape == (3,)
    of_user = numba.njit(_made_by_numba)
    assert of_user(3) == 10
    for function in (_made, of_user):
        with pytest.raises(ValueError, match="negative dimensions"):
            function(-2)


@pytest.mark.parametrize("collects", [True, False])
def test_garbage_is_collected_after_a_compilation_if_it_was_before(collects):
    before = gc.isenabled()
    try:
        (gc.enable if collects else gc.disable)()
        assert kernel(lambda x: x + 1)(1) == 2
        assert gc.isenabled() == collects
        with pytest.raises(numba.TypingError):
            kernel(lambda x: x.no_such_thing)(1)
        assert gc.isenabled() == collects
    finally:
        (gc.enable if before else gc.disable)()


_COMPILES_LONG = """
import sys, time
from softrobot_env.compile.kernels import kernel

@kernel
def calls(x):
    total = 0.0
    for i in range(3):
        total += (x[i:] @ x[i:]) + x[::-1].sum() + (x.reshape(-1, 1) * x).sum()
    return total

import numpy as np
time.sleep(max(0.0, float(sys.argv[1]) - time.time()))
calls(np.ones(4))
print(sum(calls.stats.cache_hits.values()))
"""


@pytest.mark.skipif(sys.platform == "win32", reason="files are not locked there")
def test_of_processes_that_need_the_same_kernel_one_compiles_it(tmp_path):
    script = tmp_path / "script.py"
    script.write_text(_COMPILES_LONG)
    command = [sys.executable, str(script), str(time.time() + 3)]
    runs = [subprocess.Popen(command, stdout=subprocess.PIPE, text=True) for _ in range(2)]
    assert sorted(int(run.communicate()[0]) for run in runs) == [0, 1]
    assert not list(tmp_path.rglob("*.lock"))
