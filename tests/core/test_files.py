"""Files are written whole or not at all; where what is compiled is kept; what to install."""

import os
import re
import shutil
import subprocess
import sys
import tempfile
import tomllib
from importlib.metadata import PackageNotFoundError
from pathlib import Path

import pytest

from softrobot_env.core import extras, files
from softrobot_env.core.extras import install_command
from softrobot_env.core.files import atomic_write, write_text

ROOT = Path(__file__).resolve().parents[2]
PACKAGE = ROOT / "softrobot_env"


def test_a_file_appears_when_it_is_whole_and_folders_are_made(tmp_path):
    path = tmp_path / "new" / "a.txt"
    with atomic_write(path) as aside:
        aside.write_text("half")
        assert not path.exists() and aside.suffix == ".txt"
    assert [p.name for p in path.parent.iterdir()] == ["a.txt"] and path.read_text() == "half"


def test_what_is_written_reaches_the_disk_before_it_gets_its_name(tmp_path, monkeypatch):
    path, named, flush = tmp_path / "a.txt", [], os.fsync

    def noted(number):
        named.append(path.exists())
        flush(number)

    monkeypatch.setattr(os, "fsync", noted)
    write_text(path, "whole")
    assert named == [False] and path.read_text() == "whole"


def test_a_failure_leaves_what_was_there(tmp_path):
    path = tmp_path / "a.txt"
    write_text(path, "before")
    with pytest.raises(KeyboardInterrupt), atomic_write(path) as aside:
        aside.write_text("half")
        raise KeyboardInterrupt
    assert path.read_text() == "before" and len(list(tmp_path.iterdir())) == 1


def test_what_is_no_file_is_not_replaced_and_links_stay_links(tmp_path):
    pipe, link = tmp_path / "pipe", tmp_path / "link"
    os.mkfifo(pipe)
    with pytest.raises(FileExistsError, match=r"no file.*pipe"):
        write_text(pipe, "")
    link.symlink_to(tmp_path / "a.txt")
    write_text(link, "through")
    assert link.is_symlink() and (tmp_path / "a.txt").read_text() == "through"


def test_an_error_names_the_file_that_was_asked_for(tmp_path):
    (tmp_path / "file").touch()
    with pytest.raises(OSError, match=r"file/a\.txt'$"):
        write_text(tmp_path / "file" / "a.txt", "")


#: But logs of lines, which grow while robots run, locks, and what `atomic_write` is round.
WRITERS = {
    "core/artifacts.py",
    "core/files.py",
    "hardware/transport.py",
    "compile/cache.py",
    "recordings/columns.py",
    "training/several/runs.py",
}


@pytest.mark.parametrize(
    ("pattern", "places"),
    [
        (r'\.write_text\(|\.write_bytes\(|savez\w*\(|"wb"|"w"|"xb"', WRITERS),
        (r"softrobot_env\[", set()),
    ],
    ids=["files", "hints what to install"],
)
def test_nothing_else_writes(pattern, places):
    found = {
        path.relative_to(PACKAGE).as_posix()
        for path in PACKAGE.rglob("*.py")
        if re.search(pattern, path.read_text())
    }
    assert found == places


# ---------------------------------------------------------------- folders

_READ_ONLY = """
mount --bind {package} {package} && mount -o remount,ro,bind {package} &&
mount --bind {home} {home} && mount -o remount,ro,bind {home} && exec {python} -c '{program}'
"""

_PROGRAM = """
import gymnasium, softrobot_env
env = gymnasium.make("SoftRobot/ArmSwing-v0")
env.reset(seed=0)
env.step(env.action_space.sample())
from softrobot_env.beams.pcc import PCC
print(softrobot_env.__file__)
"""


@pytest.fixture
def fresh(monkeypatch, tmp_path):
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    files.private_dir.cache_clear()
    yield
    files.private_dir.cache_clear()


@pytest.mark.usefixtures("fresh")
def test_the_users_cache_is_taken_where_it_can_be_written(monkeypatch, tmp_path):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "a" / "b"))
    assert files.cache_dir() == tmp_path / "a" / "b" / "softrobot_env"


@pytest.mark.parametrize("trap", [None, "open to all", "link"])
@pytest.mark.usefixtures("fresh")
def test_else_a_folder_that_nobody_else_can_write_to_or_has_prepared(monkeypatch, tmp_path, trap):
    (tmp_path / "file").touch()
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "file"))
    prepared = tmp_path / f"softrobot_env-{os.getuid()}"
    if trap == "link":
        (tmp_path / "theirs").mkdir(mode=0o700)
        prepared.symlink_to(tmp_path / "theirs")
    elif trap:
        prepared.mkdir()
        prepared.chmod(0o777)
    found = files.cache_dir()
    assert (found == prepared) == (trap is None)
    assert found.parent == tmp_path and found.stat().st_mode & 0o777 == 0o700
    assert files.cache_dir() == found


@pytest.mark.slow
def test_a_package_and_a_home_that_cannot_be_written_to_are_enough(tmp_path):
    package, home = tmp_path / "package", tmp_path / "home"
    home.mkdir()
    for part in ("softrobot_env", "assets", "models", "firmware"):
        source = Path(files.__file__).parents[2] / part
        shutil.copytree(source, package / part, ignore=shutil.ignore_patterns("__pycache__"))
    names = {"package": package, "home": home, "python": sys.executable, "program": _PROGRAM}
    script = _READ_ONLY.format(**names)
    keep = {"PATH": os.environ["PATH"], "HOME": str(home), "PYTHONPATH": str(package)}
    keep["TMPDIR"] = str(tmp_path)
    command = ["unshare", "-rm", "sh", "-c", script]
    done = subprocess.run(command, env=keep, capture_output=True, text=True, cwd=tmp_path)
    if "unshare" in done.stderr or "mount:" in done.stderr:
        pytest.skip(f"read-only folders cannot be made here: {done.stderr.splitlines()[-1]}")
    assert done.returncode == 0, done.stderr
    assert done.stdout.strip().startswith(str(package))
    assert list((tmp_path / "softrobot_env-0").rglob("*.nb?"))


# ---------------------------------------------------------------- what to install

PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]


@pytest.mark.parametrize("extra", sorted(PROJECT["optional-dependencies"].keys() - {"all"}))
def test_the_command_names_what_the_project_does(extra):
    wanted = PROJECT["optional-dependencies"][extra]
    command = install_command(extra)
    assert sorted(re.findall(r'"([^"]+)"', command)) == sorted(wanted)
    assert ("download.pytorch.org/whl/cpu" in command) == (extra == "rl")


def test_from_sources_it_installs_those(monkeypatch):
    def unknown(_):
        raise PackageNotFoundError

    monkeypatch.setattr(extras, "requires", unknown)
    assert install_command("rl", "mpc") == 'pip install -e ".[rl,mpc]"'
