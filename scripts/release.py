"""Build the distributions, and prove that they work where nothing else of this repository is.

    make release                                   # into dist/
    make release SOURCE_URL=https://HOST/OWNER/NAME    # with the pictures and links of README.md

What has to fit is checked first: the version, which stands in softrobot_env/core/__init__.py alone,
in CHANGELOG.md and CITATION.cff; the integrator's LLVM code; metadata, by twine; what the wheel
holds. Then the wheel, with the oldest Python that is found, and the source distribution, with the
newest, are installed in virtual environments of their own. The bare package is used in a folder of
its own; and of the wheel, with the extras that README.md asks for, the commands of its first steps,
with its robot file.
"""

import argparse
import os
import re
import shlex
import subprocess
import sys
import tempfile
import zipfile
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]

#: Most that the wheel may have [bytes], and one file of it: no table of one robot fills it.
WHEEL, FILE = 6_000_000, 300_000

#: Folders of the repository whose files no wheel holds.
NOT_FOR_USERS = ("tests", "scripts", "docs", "examples", "firmware/avr")

#: What the bare package has to do.
_USED = """
import gymnasium

env = gymnasium.make("softrobot_env:SoftRobot/ArmSwing-v0")
env.reset(seed=0)
env.step(env.action_space.sample())
import softrobot_env

assert "site-packages" in softrobot_env.__file__, softrobot_env.__file__
"""


def version() -> str:
    """The version of the sources.

    Raises:
        SystemExit: CHANGELOG.md has no section of it, or CITATION.cff another one.
    """
    stated = (ROOT / "softrobot_env/core/__init__.py").read_text(encoding="utf-8")
    found = re.search(r'^__version__ = "(.+)"$', stated, re.M)[1]
    for name, line in (("CHANGELOG.md", f"## {found}"), ("CITATION.cff", f"version: {found}")):
        if line not in (ROOT / name).read_text(encoding="utf-8").splitlines():
            raise SystemExit(f"{name} has no line {line!r}")
    return found


def check_wheel(path: Path) -> None:
    """Refuse a wheel that is too large, or holds what no user runs; SystemExit."""
    with zipfile.ZipFile(path) as wheel:
        files = [item for item in wheel.infolist() if not item.is_dir()]
    if path.stat().st_size > WHEEL:
        raise SystemExit(f"{path.name} has {path.stat().st_size} bytes, more than {WHEEL}")
    for item in files:
        if item.compress_size > FILE:
            raise SystemExit(f"{item.filename} has {item.compress_size} bytes, more than {FILE}")
        inside = item.filename.removeprefix("softrobot_env/_data/")
        if inside.startswith(tuple(f"{folder}/" for folder in NOT_FOR_USERS)):
            raise SystemExit(f"{item.filename} is nothing that users run")


def first_steps() -> list[list[str]]:
    """The commands of README.md's first steps."""
    text = (ROOT / "README.md").read_text(encoding="utf-8")
    block = re.search(r"## First steps.*?```bash\n(.*?)```", text, re.S)[1]
    return [shlex.split(line, comments=True) for line in block.splitlines()]


def robot_file() -> str:
    """README.md's robot, which its first steps use as `my.toml`."""
    return re.search(r"```toml\n(.*?)```", (ROOT / "README.md").read_text("utf-8"), re.S)[1]


def extras() -> str:
    """The extras that README.md asks for, in brackets."""
    return re.search(r'pip install -e "\.(\[.*?\])"', (ROOT / "README.md").read_text("utf-8"))[1]


def pythons() -> list[str]:
    """Interpreters that the package is for, the oldest first."""
    home = Path.home() / ".pyenv" / "versions"
    named = [sys.executable, *(f"python3.{minor}" for minor in range(11, 30))]
    named += [str(path) for path in home.glob("*/bin/python3")]
    asked = "import sys; print(*sys.version_info[:3], sys._base_executable)"
    found = set()
    for python in named:
        try:
            said = subprocess.run([python, "-c", asked], capture_output=True, text=True)
        except OSError:
            continue
        if said.returncode == 0:
            *numbers, path = said.stdout.split()
            found.add((tuple(map(int, numbers)), path))
    return [path for numbers, path in sorted(found) if numbers >= (3, 11)]


def run(*command: str | Path, **options: object) -> None:
    """A command, which is shown; SystemExit if it fails."""
    print("$", shlex.join(map(str, command)), flush=True)
    if status := subprocess.run(command, **options).returncode:
        raise SystemExit(f"{command[0]} ended with status {status}")


def use(python: str, package: Path, extras: str, commands: Iterator[list[str]]) -> None:
    """Install a package with a Python, and use it in its own folder; SystemExit if it fails."""
    with tempfile.TemporaryDirectory() as room:
        (Path(room) / "my.toml").write_text(robot_file(), encoding="utf-8")
        bin = Path(room) / "venv" / "bin"
        run(python, "-m", "venv", bin.parent)
        pip = (bin / "python", "-m", "pip", "install", "--quiet", "--disable-pip-version-check")
        run(*pip, "-c", ROOT / "constraints.txt", f"{package}{extras}")
        away = {key: value for key, value in os.environ.items() if key != "PYTHONPATH"}
        for command in commands:
            run(bin / command[0], *command[1:], cwd=room, env=away)
    print(f"{package.name} works outside the repository with {python}", flush=True)


def main() -> None:
    """Build, check and use."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, default=ROOT / "dist", help="default: dist/")
    out = parser.parse_args().out
    name = f"softrobot_env-{version()}"
    wheel, sources = out / f"{name}-py3-none-any.whl", out / f"{name}.tar.gz"
    run(sys.executable, ROOT / "scripts/prepared.py", "--check")
    run(sys.executable, "-m", "build", "--outdir", out, ROOT, stdout=subprocess.DEVNULL)
    run(sys.executable, "-m", "twine", "check", "--strict", wheel, sources)
    check_wheel(wheel)
    bare = [["python", "-c", _USED], ["softrobot", "list", "robots"]]
    bare.append(
        shlex.split("softrobot evaluate --tasks step --step-widths 0.05 --no-plots --out out")
    )
    oldest, *_, newest = pythons() * 2
    use(newest, sources, "", bare)
    use(oldest, wheel, extras(), first_steps())


if __name__ == "__main__":
    main()
