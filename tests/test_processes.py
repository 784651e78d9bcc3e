"""Linear algebra takes one thread on the command line and in worker processes."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from softrobot_env.processes import THREADS, worker_processes

ROOT = Path(__file__).resolve().parents[1]

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
    told = tmp_path / "threads"
    environment = {k: v for k, v in os.environ.items() if k not in THREADS} | settings
    environment |= {"WITNESS": str(told), "WITNESS_OF": str(os.getpid())}
    environment |= {"PYTHONPATH": f"{tmp_path}{os.pathsep}{ROOT}"}
    subprocess.run([sys.executable, *command], env=environment, capture_output=True, check=True)
    return int(told.read_text())


@needs_proc
def test_the_command_line_takes_one_thread(tmp_path):
    script = tmp_path / "softrobot"
    script.write_text("import sys; from softrobot_env.cli import main; sys.exit(main())")
    assert threads(tmp_path, "-m", "softrobot_env", "--help") == 1
    assert threads(tmp_path, str(script), "--help") == 1


@needs_proc
def test_the_user_and_importing_programs_decide_for_themselves(tmp_path):
    two = {"OPENBLAS_NUM_THREADS": "2"}
    assert threads(tmp_path, "-m", "softrobot_env", "--help", **two) == 2
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
