"""Use our environments from other libraries, each installed in a virtual environment of its own.

`make test-clients` runs this. It prints a table, and fails if a use failed; a library that cannot
be installed is reported and fails nothing.
"""

import argparse
import json
import os
import subprocess
import sys
import venv
from pathlib import Path
from typing import Any, NamedTuple

HERE = Path(__file__).resolve().parent
ROOT = HERE.parents[1]

#: A use may be as slow as this [s], an installation too.
PATIENCE = 1800


class Client(NamedTuple):
    """A library: the packages it is installed with, beside ours, and whether it needs torch."""

    packages: tuple[str, ...]
    torch: bool = True


#: rl_zoo3 imports requests and Minari's recording Pillow without asking for them.
CLIENTS = {
    "torchrl": Client(("torchrl",)),
    "skrl": Client(("skrl",)),
    "tianshou": Client(("tianshou",)),
    "rl_zoo3": Client(("rl_zoo3", "requests")),
    "ray": Client(("ray[rllib]",)),
    "minari": Client(("minari[create,hdf5]", "pillow"), torch=False),
}


def pinned(package: str) -> str:
    """A package in the version of constraints.txt."""
    lines = (ROOT / "constraints.txt").read_text().splitlines()
    return next(line for line in lines if line.startswith(f"{package}=="))


def python(folder: Path, *words: str, **options: Any) -> subprocess.CompletedProcess:
    """Run the Python of a virtual environment."""
    command = [str(folder / "bin" / "python"), *words]
    return subprocess.run(
        command, capture_output=True, text=True, check=False, timeout=PATIENCE, **options
    )


def last_line(text: str, otherwise: str) -> str:
    """The last line of what was printed."""
    return (text.strip().splitlines() or [otherwise])[-1]


def install(client: Client, folder: Path) -> str:
    """Install a library and our package; returns why that is impossible, or nothing."""
    if not (folder / "bin" / "python").exists():
        venv.create(folder, with_pip=True)
    wanted = [[pinned("torch")]] if client.torch else []  # first, or the newest would be fetched
    for packages in [*wanted, [*client.packages, "-e", str(ROOT)]]:
        done = python(folder, "-m", "pip", "install", "--quiet", *packages)
        if done.returncode != 0:
            return last_line(done.stderr, "pip failed")
    return ""


def use(name: str, folder: Path) -> tuple[list[dict[str, Any]], dict[str, str]]:
    """What became of the uses of a library, and what they depend on, see `core.sources`."""
    variables = os.environ | {"PYTHONPATH": str(ROOT), "OPENBLAS_NUM_THREADS": "1"}
    done = python(folder, str(HERE / f"use_{name}.py"), env=variables)
    (folder / "use.log").write_text(done.stdout + done.stderr)
    lines = [line[4:] for line in done.stdout.splitlines() if line.startswith("USE ")]
    found = [json.loads(line) for line in lines]
    rows = [one["row"] for one in found]
    if done.returncode != 0:
        reason = last_line(done.stderr, "no reason given")
        rows.append({"use": "the whole script", "good": 0, "tried": 1, "reason": reason})
    return rows, {name: digest for one in found for name, digest in one["sources"].items()}


def version(name: str, folder: Path) -> str:
    """The installed version of a library."""
    code = f"from importlib.metadata import version; print(version({name!r}))"
    return python(folder, "-c", code).stdout.strip()


def table(rows: list[dict[str, Any]]) -> str:
    """The rows in Markdown."""
    lines = ["| library | version | use | ids that work | first failure |", "|---|---|---|---|---|"]
    for row in rows:
        share = f"{row['good']} of {row['tried']}" if row["tried"] else "not installed"
        reason = row["reason"].replace("|", "/")
        lines.append(f"| {row['name']} | {row['version']} | {row['use']} | {share} | {reason} |")
    return "\n".join(lines)


def main() -> int:
    """Run the clients; returns the exit status."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("clients", nargs="*", default=list(CLIENTS), metavar="CLIENT")
    parser.add_argument("--envs", type=Path, default=ROOT / ".venv" / "clients")
    parser.add_argument("--out", type=Path, help="folder of a report.json, as docs/results/clients")
    args = parser.parse_args()
    unknown = sorted(set(args.clients) - set(CLIENTS))
    if unknown:
        parser.error(f"no client {unknown[0]!r}; choose from {', '.join(CLIENTS)}")
    rows, sources = [], {}
    for name in args.clients:
        print(f"{name} ...", file=sys.stderr, flush=True)
        folder = args.envs.resolve() / name
        missing = install(CLIENTS[name], folder)
        if missing:
            nothing = {"version": "", "use": "", "good": 0, "tried": 0}
            rows.append({"name": name, **nothing, "reason": missing})
            continue
        own = {"name": name, "version": version(name, folder)}
        used, depends = use(name, folder)
        rows += [own | row for row in used]
        sources |= depends
    print(table(rows))
    if args.out:
        meta = {
            "command": "make test-clients",
            "python": sys.version.split()[0],
            "sources": sources,
        }
        args.out.mkdir(parents=True, exist_ok=True)
        text = json.dumps({"meta": meta, "rows": rows}, indent=1)
        (args.out / "report.json").write_text(text + "\n")
    return int(any(row["good"] < row["tried"] for row in rows))


if __name__ == "__main__":
    sys.exit(main())
