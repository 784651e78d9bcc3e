"""Linear algebra takes one thread on the command line and in worker processes."""

import os
import re
from pathlib import Path
from threading import Event, Thread

import numpy as np
import pytest
from support.processes import finished
from threadpoolctl import ThreadpoolController

from softrobot_env.beams.pcc import PCC
from softrobot_env.core import processes
from softrobot_env.core.processes import THREADS, one_blas_thread, worker_processes
from softrobot_env.robots import ARM
from softrobot_env.scene.build import build_scene
from softrobot_env.scene.config import SceneConfig
from softrobot_env.scene.statics import equilibrium

ROOT = Path(__file__).resolve().parents[2]

#: Writes at the end of a process, not of those it starts, how many threads it runs.
WITNESS = """
import atexit, os, sys
def tell():
    assert "numpy" in sys.modules
    open(os.environ["WITNESS"], "w").write(str(len(os.listdir("/proc/self/task"))))
if os.getppid() == int(os.environ["WITNESS_OF"]):
    atexit.register(tell)
"""

needs_proc = pytest.mark.skipif(
    not Path("/proc/self/task").exists() or (os.cpu_count() or 1) < 2,
    reason="needs Linux, where threads can be counted, and more than one core",
)


def threads(tmp_path, *command: str, **settings: str) -> int:
    """Threads of a process at its end: OpenBLAS starts its own when NumPy is loaded."""
    (tmp_path / "sitecustomize.py").write_text(WITNESS)
    reported = tmp_path / "threads"
    environment = {k: v for k, v in os.environ.items() if k not in THREADS} | settings
    environment |= {"WITNESS": str(reported), "WITNESS_OF": str(os.getpid())}
    environment |= {"PYTHONPATH": f"{tmp_path}{os.pathsep}{ROOT}"}
    finished(*command, env=environment, check=True)
    return int(reported.read_text())


@needs_proc
def test_the_command_line_takes_one_thread(tmp_path):
    script = tmp_path / "softrobot"
    script.write_text("import sys; from softrobot_env.cli import main; sys.exit(main())")
    assert threads(tmp_path, "-m", "softrobot_env", "--help") == 1
    assert threads(tmp_path, str(script), "--help") == 1


@needs_proc
def test_the_user_and_importing_programs_decide_for_themselves(tmp_path):
    two = {"OPENBLAS_NUM_THREADS": "2"}
    assert threads(tmp_path, "-m", "softrobot_env", "--help", **two) > 1
    assert threads(tmp_path, "-c", "import softrobot_env") > 1


def _settings(_: int) -> list[str | None]:
    return [os.environ.get(name) for name in THREADS]


def test_workers_take_one_thread_and_leave_the_environment_alone(monkeypatch):
    monkeypatch.setenv(THREADS[0], "3")
    monkeypatch.delenv(THREADS[1], raising=False)
    with worker_processes(1) as pool:
        assert list(pool.map(_settings, range(1))) == [["1"] * len(THREADS)]
    assert os.environ[THREADS[0]] == "3"
    assert THREADS[1] not in os.environ


def test_what_waits_is_not_begun_after_an_error():
    with pytest.raises(ZeroDivisionError), worker_processes(1) as pool:
        waiting = [pool.submit(_settings, k) for k in range(50)]
        raise ZeroDivisionError
    assert any(future.cancelled() for future in waiting)


def blas_threads():
    """Of NumPy's and SciPy's libraries: others in the process, as OpenCV's, are not asked."""
    libraries = ThreadpoolController().select(user_api="blas").info()
    own = [one for one in libraries if re.search("numpy|scipy", one["filepath"])]
    assert own
    return {library["num_threads"] for library in own}


def in_a_thread(work):
    """What `work` returns; the thread that sets numbers owns them as long as it lives."""
    found = []
    worker = Thread(target=lambda: found.append(work()))
    worker.start()
    worker.join()
    return found[0]


@pytest.fixture
def two_threads():
    limited = in_a_thread(lambda: ThreadpoolController().limit(limits=2, user_api="blas"))
    yield
    in_a_thread(limited.restore_original_limits)


def test_linear_algebra_takes_one_thread_for_a_while(two_threads):
    """And as many as before afterwards, however it ends."""
    with one_blas_thread():
        assert blas_threads() == {1}
        with one_blas_thread():
            assert blas_threads() == {1}
        assert blas_threads() == {1}
    assert blas_threads() == {2}
    with pytest.raises(ZeroDivisionError), one_blas_thread():
        raise ZeroDivisionError
    assert blas_threads() == {2}


def test_threads_that_overlap_leave_all_as_it_was(two_threads):
    inside, leave = Event(), Event()

    def first():
        with one_blas_thread():
            inside.set()
            leave.wait(10)

    other = Thread(target=first)
    other.start()
    inside.wait(10)
    with one_blas_thread():
        assert blas_threads() == {1}
        leave.set()
        other.join()
    assert blas_threads() == {2}


def test_scenes_and_beams_take_one_thread_for_their_matrices(monkeypatch):
    limited, libraries = [], processes._libraries

    def reported(with_scipy):
        limited.append(True)
        return libraries(with_scipy)

    monkeypatch.setattr(processes, "_libraries", reported)
    beam = PCC(ARM, 6)
    still = np.zeros(beam.n)
    scene = build_scene(SceneConfig(ARM))
    for work in (
        lambda: build_scene(SceneConfig(ARM)),
        lambda: equilibrium(scene.model, np.zeros(6)),
        lambda: beam.equilibrium(),
        lambda: beam.linearize((still, still)),
    ):
        limited.clear()
        work()
        assert limited
