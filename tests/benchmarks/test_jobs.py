"""Jobs in processes: in order, begun anew where a process is killed, kept where a run stops."""

import os
import pickle
import signal
import subprocess
import sys
import time
from functools import partial
from pathlib import Path

import pytest

from softrobot_env.core import journal
from softrobot_env.core.jobs import run_in_processes
from softrobot_env.core.processes import Workers, parsed_workers, using


def mark_and_square(folder, number):
    (folder / f"{number}-{os.getpid()}").touch()
    return number**2


def dies_once(folder, number):
    died = folder / "died"
    if number == 1 and not died.exists():
        died.touch()
        os.kill(os.getpid(), signal.SIGKILL)
    return number


def always_dies(number):
    os.kill(os.getpid(), signal.SIGKILL)


def fails_at(folder, failing, number):
    if number == failing:
        raise ValueError("the third job fails")
    return mark_and_square(folder, number)


def jobs(work, count=4):
    return [(f"job {number}", partial(work, number)) for number in range(count)]


def test_results_are_in_the_order_of_the_jobs_and_so_is_progress(tmp_path):
    seen = []
    with using(Workers(2)):
        found = run_in_processes(
            jobs(partial(mark_and_square, tmp_path)), lambda *told: seen.append(told)
        )
    assert found == [0, 1, 4, 9]
    assert [done for _, done, _ in seen] == [0, 1, 2, 3, 4]
    assert len({path.name.split("-")[1] for path in tmp_path.iterdir()}) <= 2


def test_what_a_users_file_defines_can_be_a_job():
    offset = 3
    assert run_in_processes([("one", lambda: offset + 1)], processes=1) == [4]


def test_jobs_of_a_killed_process_are_begun_anew(tmp_path):
    assert run_in_processes(jobs(partial(dies_once, tmp_path)), processes=2) == [0, 1, 2, 3]


def test_processes_that_always_end_are_told_of():
    with pytest.raises(RuntimeError, match=r"ended 3 times.*job 0"):
        run_in_processes(jobs(always_dies, 1), processes=1)


ORPHANS = """
import os, sys, time
from pathlib import Path
from softrobot_env.core.processes import worker_processes

if __name__ == "__main__":
    with worker_processes(1) as pool:
        Path(sys.argv[1]).write_text(str(pool.submit(os.getpid).result()))
        time.sleep(60)
"""


def runs(process):
    try:
        return Path(f"/proc/{process}/stat").read_text().split()[2] != "Z"
    except FileNotFoundError:
        return False


@pytest.mark.skipif(not Path("/proc/self/stat").exists(), reason="needs /proc")
def test_workers_end_with_a_command_that_is_killed(tmp_path):
    script, told = tmp_path / "script.py", tmp_path / "pid"
    script.write_text(ORPHANS)
    with subprocess.Popen([sys.executable, script, told]) as command:
        while not told.is_file() or not told.read_text():
            time.sleep(0.05)
        command.kill()
    until = time.monotonic() + 20
    while runs(told.read_text()) and time.monotonic() < until:
        time.sleep(0.05)
    assert not runs(told.read_text())


def test_a_stopped_run_goes_on_where_it_was(tmp_path):
    first, second = tmp_path / "first", tmp_path / "second"
    first.mkdir()
    second.mkdir()
    with (
        pytest.raises(ValueError, match="third"),
        journal.kept_in(tmp_path, "a study"),
    ):
        run_in_processes(jobs(partial(fails_at, first, 2)), processes=1)
    with journal.kept_in(tmp_path, "a study") as kept:
        found = run_in_processes(jobs(partial(mark_and_square, second)), processes=1)
    assert found == [0, 1, 4, 9]
    assert kept.taken == len(list(first.iterdir())) >= 2
    assert kept.taken + len(list(second.iterdir())) == 4
    assert not (tmp_path / journal.FOLDER).exists()


def test_another_study_takes_up_nothing(tmp_path):
    journal.Journal(tmp_path, "one").write("job", b"kept")
    assert journal.Journal(tmp_path, "one").read("job") == b"kept"
    assert journal.Journal(tmp_path, "other").read("job") is None
    assert journal.Journal(tmp_path, "one").read("another job") is None


def test_a_result_that_somebody_else_wrote_is_not_read(tmp_path):
    kept = journal.Journal(tmp_path, "a study")
    kept.write("job", b"kept")
    (path,) = (tmp_path / journal.FOLDER).iterdir()
    path.write_bytes(path.read_bytes()[:32] + pickle.dumps("forged"))
    assert kept.read("job") is None
    path.write_bytes(b"short")
    assert kept.read("job") is None


def test_other_content_of_a_file_that_is_named_takes_up_nothing(tmp_path):
    robot = tmp_path / "my.toml"
    robot.write_text("length = 1")
    journal.Journal(tmp_path, "a study", [robot]).write("job", b"kept")
    assert journal.Journal(tmp_path, "a study", [robot]).read("job") == b"kept"
    robot.write_text("length = 2")
    assert journal.Journal(tmp_path, "a study", [robot]).read("job") is None


def test_results_are_kept_until_what_they_are_for_is_written(tmp_path):
    again = partial(run_in_processes, jobs(partial(mark_and_square, tmp_path)), processes=1)
    with pytest.raises(OSError, match="full"), journal.kept_in(tmp_path, "a study"):
        again()
        raise OSError("the disk is full")
    with journal.kept_in(tmp_path, "a study") as kept:
        assert again() == [0, 1, 4, 9]
    assert kept.taken == 4


def test_a_result_that_cannot_be_unpacked_is_found_anew(tmp_path):
    with journal.kept_in(tmp_path, "a study") as kept:
        kept.write("1 0 one", b"no pickle")
        assert run_in_processes([("one", lambda: 5)], processes=1) == [5]
    assert kept.taken == 0


@pytest.mark.parametrize("spoil", ["cut", "open to others"])
def test_a_key_that_is_no_secret_is_replaced(spoil, tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    journal.Journal(tmp_path, "a study").write("job", b"kept")
    (key,) = tmp_path.rglob("*.key")
    if spoil == "cut":
        key.write_bytes(b"")
    else:
        key.chmod(0o644)
    fresh = journal.Journal(tmp_path, "a study")
    assert fresh.read("job") is None
    assert len(key.read_bytes()) == 32 and key.stat().st_mode & 0o077 == 0


@pytest.mark.parametrize("text", ["0", "-1", "two", "ray:", "", "²"])
def test_workers_that_are_none_are_refused(text):
    with pytest.raises(ValueError, match="ray:ADDRESS"):
        parsed_workers(text)


def test_workers_are_numbers_or_addresses():
    assert parsed_workers("3") == Workers(3)
    assert parsed_workers("ray") == Workers(ray="local")
    assert parsed_workers("ray:127.0.0.1:6379") == Workers(ray="127.0.0.1:6379")
