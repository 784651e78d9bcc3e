"""The package works without its thesis: a copy without that folder, with metadata of its own."""

import os
import shutil
from pathlib import Path

import pytest
from support.processes import finished

ROOT = Path(__file__).resolve().parents[1]

pytestmark = pytest.mark.slow

#: What runs in the copy, with the text that it prints.
WORKS = {
    "environment": (
        "import gymnasium, softrobot_env\n"
        "env = gymnasium.make('SoftRobot/Track-v0', robot='planar_finger')\n"
        "env.reset(seed=0)\n"
        "ids = [i for i in gymnasium.registry if i.startswith('SoftRobot/')]\n"
        "print(len(ids), 'softrobot_env.thesis' in __import__('sys').modules)",
        "4 False",
    ),
    "names that it lacks": (
        "from softrobot_env import robots\nprint(hasattr(robots, 'ARM'), len(robots.ROBOTS))",
        "False 5",
    ),
    "identification": ("import softrobot_env.identification.fit.report\nprint('there')", "there"),
    "policies": (
        "from softrobot_env.control.registry import fitting_policies\n"
        "from softrobot_env.robots import find_robot\n"
        "fits = fitting_policies(find_robot('planar_finger'))\n"
        "print(sorted(name for name, lacks in fits.items() if lacks is None)[:2])",
        "['chain_dynamics', 'chain_dynamics_pi']",
    ),
}

#: Commands that end well.
COMMANDS = (
    "list",
    "inspect --robot planar_finger",
    "evaluate --robot planar_finger --tasks circle --policies static hold --duration 0.1 --out e",
    "train lq_preview --robot planar_finger --quick --out t",
)


@pytest.fixture(scope="module")
def copy(tmp_path_factory):
    """Folder of the copy, and the environment of its processes."""
    folder = tmp_path_factory.mktemp("without")
    for name in ("softrobot_env", "assets", "models"):
        shutil.copytree(ROOT / name, folder / name, ignore=shutil.ignore_patterns("__pycache__"))
    shutil.rmtree(folder / "softrobot_env" / "thesis")
    info = folder / "softrobot_env-0.2.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: softrobot_env\nVersion: 0.2.0\n")
    (info / "entry_points.txt").write_text("")
    return folder, os.environ | {"PYTHONPATH": str(folder)}


def ran(copy, *arguments):
    folder, variables = copy
    done = finished(*arguments, cwd=folder, env=variables)
    assert done.returncode == 0, done.stdout[-2000:] + done.stderr[-2000:]
    return done.stdout


@pytest.mark.parametrize("what", WORKS)
def test_it_works(copy, what):
    code, printed = WORKS[what]
    assert ran(copy, "-W", "error", "-c", code).strip() == printed


@pytest.mark.parametrize("command", COMMANDS, ids=lambda command: command.split()[0])
def test_commands_work(copy, command):
    assert "Traceback" not in ran(copy, "-m", "softrobot_env", *command.split())


def test_commands_ask_for_a_robot(copy):
    folder, variables = copy
    command = ("-m", "softrobot_env", "evaluate", "--out", "asked")
    done = finished(*command, cwd=folder, env=variables)
    assert done.returncode == 2 and "give a robot: --robot FILE" in done.stderr
