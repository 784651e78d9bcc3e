"""The first minute of a new user: what the first commands take, and how long they are silent.

Each runs in a process of its own on one core, through a pipe: with an empty cache, as after the
installation, then once more with what that left there. Python has its own bytecode already.
"""

import os
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from time import perf_counter

from softrobot_env.beams.registry import MUJOCO, PLANTS
from softrobot_env.commands import evaluate, listing, render
from studies.lab import Record, Study, quantity, table

_STEP = """
import gymnasium
import softrobot_env
{}
env = gymnasium.make("SoftRobot/ArmSwing-v0"{})
env.reset(seed=0)
env.step(env.action_space.sample())
"""
_BEAM = "from softrobot_env.beams.registry import BeamPlant"

#: The policy of README.md's first steps.
_POLICY = "lq_adaptive"

#: Arguments of Python: commands by their words, and a first step of the arm as a MuJoCo chain or as
#: a beam model. They write to a folder of their own.
PROGRAMS = {
    "version": ("-m", "softrobot_env", "--version"),
    "help": ("-m", "softrobot_env", "--help"),
    "list": ("-m", "softrobot_env", "list"),
    "step": ("-c", _STEP.format("", "")),
    **{
        f"step {name}": ("-c", _STEP.format(_BEAM, f", plant=BeamPlant({name!r})"))
        for name in PLANTS
        if name != MUJOCO
    },
    "evaluate": (
        *("-m", "softrobot_env", "evaluate", "--tasks", "swing"),
        *("--policies", _POLICY, "--out", "out"),
    ),
    "render": (
        *("-m", "softrobot_env", "render", "--task", "swing"),
        *("--policy", _POLICY, "--out", "swing.gif"),
    ),
}

QUICK = ("version", "step")

#: What those programs load, so that a report tells when it is older than they are.
LOADED = (evaluate, listing, render)


@dataclass(frozen=True)
class Row(Record):
    """A program.

    Attributes:
        program: One of `PROGRAMS`.
        cache: "cold" where nothing was compiled before, "warm" where all was.
        wall: [s] from its start to its end.
        cpu: [s] of processors, its workers' too.
        first: [s] until it said something; None if it said nothing.
        silence: [s], the longest time without a word, from its start to its end.
    """

    program: str
    cache: str
    wall: float = quantity("s", ".2f", "wall")
    cpu: float = quantity("s", ".2f", "CPU")
    first: float | None = quantity("s", ".2f", "first word", default=None)
    silence: float = quantity("s", ".2f", "longest silence", default=0.0)


def measure(program: str) -> list[Row]:
    """Run a program twice.

    Raises:
        RuntimeError: It fails.
    """
    with tempfile.TemporaryDirectory() as folder:
        place = Path(folder)
        caches = dict.fromkeys(("NUMBA_CACHE_DIR", "XDG_CACHE_HOME"), str(place / "cache"))
        rows = []
        for cache in ("cold", "warm"):
            own = place / cache
            own.mkdir()
            rows.append(_run(program, cache, own, os.environ | caches))
    return rows


def _run(program: str, cache: str, place: Path, environment: dict[str, str]) -> Row:
    command = [sys.executable, *PROGRAMS[program]]
    before, began = os.times(), perf_counter()
    with _on_one_core():
        run = subprocess.Popen(
            command,
            cwd=place,
            env=environment,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
        )
    words, said = [], []
    with run:
        while part := os.read(run.stdout.fileno(), 2**16):
            said.append(part)
            words.append(perf_counter() - began)
    if run.returncode:
        raise RuntimeError(f"{program}: {b''.join(said).decode(errors='replace')}")
    wall, after = perf_counter() - began, os.times()
    cpu = after.children_user + after.children_system
    cpu -= before.children_user + before.children_system
    return Row(program, cache, wall, cpu, words[0] if words else None, _longest(words, wall))


def _longest(words: Sequence[float], end: float) -> float:
    """Longest time [s] between words, from 0 to the end."""
    return max(b - a for a, b in zip([0.0, *words], [*words, end], strict=True))


@contextmanager
def _on_one_core() -> Iterator[None]:
    """What is started within it runs on one core, where the system lets a process choose."""
    if not hasattr(os, "sched_setaffinity"):
        yield
        return
    cores = os.sched_getaffinity(0)
    os.sched_setaffinity(0, {max(cores)})
    try:
        yield
    finally:
        os.sched_setaffinity(0, cores)


STUDY = Study(
    kinds=(Row,),
    cases=tuple(PROGRAMS),
    quick=QUICK,
    measure=measure,
    label=str,
    tables=[
        table(
            "First use, on one core, through a pipe",
            "program",
            "cache",
            "wall",
            "cpu",
            "first",
            "silence",
        )
    ],
    note="step: gymnasium.make of the arm, reset, a step, also as a beam model; the rest: commands "
    f"of softrobot, evaluate and render with {_POLICY} on swing. cold: nothing was compiled "
    "before; warm: a second run. Where others share the core, wall is longer than CPU.",
    alone=True,
)
