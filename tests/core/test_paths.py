"""Where what is compiled is kept, also where neither package nor home can be written to."""

import os
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

import pytest

from softrobot_env.core import files as paths

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


@pytest.fixture(autouse=True)
def fresh(monkeypatch, tmp_path):
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    paths.private_dir.cache_clear()
    yield
    paths.private_dir.cache_clear()


def test_the_users_cache_is_taken_where_it_can_be_written(monkeypatch, tmp_path):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "a" / "b"))
    assert paths.cache_dir() == tmp_path / "a" / "b" / "softrobot_env"


def test_else_a_folder_that_nobody_else_can_write_to(monkeypatch, tmp_path):
    (tmp_path / "file").touch()
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "file"))
    own = paths.cache_dir()
    assert own.parent == tmp_path and own.stat().st_mode & 0o777 == 0o700
    assert paths.cache_dir() == own


@pytest.mark.parametrize("trap", ["open to all", "link"])
def test_a_folder_that_others_prepared_is_not_taken(monkeypatch, tmp_path, trap):
    (tmp_path / "file").touch()
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "file"))
    prepared = tmp_path / f"softrobot_env-{os.getuid()}"
    if trap == "link":
        (tmp_path / "theirs").mkdir(mode=0o700)
        prepared.symlink_to(tmp_path / "theirs")
    else:
        prepared.mkdir()
        prepared.chmod(0o777)
    found = paths.cache_dir()
    assert found != prepared and found.stat().st_mode & 0o777 == 0o700


@pytest.mark.slow
def test_a_package_and_a_home_that_cannot_be_written_to_are_enough(tmp_path):
    package, home = tmp_path / "package", tmp_path / "home"
    home.mkdir()
    for part in ("softrobot_env", "assets", "models", "firmware"):
        source = Path(paths.__file__).parents[2] / part
        shutil.copytree(source, package / part, ignore=shutil.ignore_patterns("__pycache__"))
    names = {"package": package, "home": home, "python": sys.executable, "program": _PROGRAM}
    script = _READ_ONLY.format(**names)
    keep = {"PATH": os.environ["PATH"], "HOME": str(home), "PYTHONPATH": str(package)}
    keep["TMPDIR"] = str(tmp_path)
    done = subprocess.run(
        ["unshare", "-rm", "sh", "-c", script],
        env=keep,
        capture_output=True,
        text=True,
        cwd=tmp_path,
    )
    if "unshare" in done.stderr or "mount:" in done.stderr:
        pytest.skip(f"read-only folders cannot be made here: {done.stderr.splitlines()[-1]}")
    assert done.returncode == 0, done.stderr
    assert done.stdout.strip().startswith(str(package))
    assert list((tmp_path / "softrobot_env-0").rglob("*.nb?"))
