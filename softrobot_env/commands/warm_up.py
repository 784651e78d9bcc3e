"""`softrobot warm-up`: precompile code that would otherwise be compiled at first use."""

from argparse import Namespace
from concurrent.futures import as_completed
from contextlib import closing
from itertools import islice
from time import perf_counter

from softrobot_env.beams.registry import MUJOCO, PLANTS, BeamPlant
from softrobot_env.control.registry import (
    POLICIES,
    home_robot,
    installed_policies,
    make_policy,
    policy_environment,
)
from softrobot_env.core.processes import usable_cores, worker_processes
from softrobot_env.evaluation.run import play
from softrobot_env.evaluation.runner import simulated
from softrobot_env.robots import ENTRIES, entry_of
from softrobot_env.tasks import make_task

from .output import progress_on, say

EXAMPLE = """softrobot warm-up
  softrobot warm-up lq_adaptive pcc"""

#: Number of steps after which nothing more is compiled.
_STEPS = 3


ARGUMENTS = f"""
    names NAME*  plants ({", ".join(PLANTS)}) and policies of the arm and the rig; default: all
"""


def run(args: Namespace) -> int:
    """Run the command; 1 if a plant or policy does not run.

    Raises:
        ValueError: There is no such plant or policy.
    """
    known = _known()
    unknown = [name for name in args.names if name not in known]
    if unknown:
        raise ValueError(f"unknown {', '.join(unknown)}: choose from {', '.join(known)}")
    names = list(dict.fromkeys([MUJOCO, *(args.names or known)]))
    began, failed = perf_counter(), 0
    with (
        progress_on("compiling", len(names)) as show,
        worker_processes(min(usable_cores(), len(names))) as pool,
    ):
        pool.submit(warm, names[0]).result()  # needed by all others
        waiting = {pool.submit(warm, name): name for name in names[1:]}
        for count, done in enumerate(as_completed(waiting), 2):
            show(f"compiling: {waiting[done]} is done", count, len(names))
            if (error := done.exception()) is not None:
                failed += 1
                say(f"{waiting[done]}: {error}", markup=False, soft_wrap=True)
    ready = len(names) - failed
    say(f"{ready} of {len(names)} are compiled, in {perf_counter() - began:.0f} s")
    return int(failed > 0)


def _known() -> list[str]:
    """Plants and installed policies."""
    made = (name for entry in ENTRIES.values() for name in entry.policies)
    ready = installed_policies()
    return list(dict.fromkeys([*PLANTS, *(n for n in made if n in ready or n not in POLICIES)]))


def warm(name: str) -> None:
    """Compile what a plant or a policy needs, by running a few steps."""
    policy = "hold" if name in PLANTS else name
    plant = {"plant": BeamPlant(name)} if name in PLANTS and name != MUJOCO else {}
    robot = home_robot(policy)
    options = policy_environment(policy, robot) | plant
    entry = entry_of(robot)
    task = make_task((entry.tasks or (entry.task,))[0], robot=robot)
    with closing(simulated(task, **options)) as env:
        for _ in islice(play(env, make_policy(policy, robot, env.control_period)), _STEPS):
            pass
