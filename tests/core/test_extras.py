"""What to install: a command that works wherever the package came from, alike everywhere."""

import re
import tomllib
from importlib.metadata import PackageNotFoundError
from pathlib import Path

import pytest

from softrobot_env.core import extras
from softrobot_env.core.extras import install_command

ROOT = Path(__file__).resolve().parents[2]
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


def test_no_other_hint_is_written():
    wrong = [
        path.name
        for path in (ROOT / "softrobot_env").rglob("*.py")
        if "softrobot_env[" in path.read_text() and path.name != "extras.py"
    ]
    assert not wrong
