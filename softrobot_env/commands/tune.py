"""`softrobot tune`: search for settings of a training by Ray Tune."""

import shlex
from argparse import Namespace
from dataclasses import replace
from pathlib import Path
from typing import Any

from softrobot_env.core.runs import KEPT, kept_rows
from softrobot_env.robots import default_robot, find_robot
from softrobot_env.training.registry import TRAININGS
from softrobot_env.training.request import LEARNERS, TrainingRequest
from softrobot_env.training.several import report
from softrobot_env.training.several.runs import Run, check_unclaimed
from softrobot_env.training.several.search import (
    Range,
    Search,
    Space,
    corners,
    parsed,
    read_space,
    searched,
    trial_folder,
    tune_on,
)

from . import train
from .arguments import of_text, whole
from .output import check_free, filling, progress_on, say

EXAMPLE = """softrobot tune ppo --start none --search rate=1e-5..1e-3:log --search batch=256,512
  softrobot tune sac --space space.toml --trials 20 --steps 200000 --workers ray:auto"""

#: Default number of trials if there is a range to sample from.
_TRIALS = 16

#: Number of closed-loop checks of a trial; it may be stopped at each.
_CHECKS = 9


ARGUMENTS = f"""
    what NAME  training, out of %(choices)s
    <robot> a name or a file; default: arm
    --seed SEED (0)  of trainings and draws
    --search NAME=LOW..HIGH[:log]|V1,V2  a number of training.rl_config.RLConfig, and the range
        or the values to search in
    --space FILE  TOML file with the same in a table [search]
    --trials N  draws; default: {_TRIALS}, without ranges all combinations of values
    --quick  small trainings; no good settings
    <workers>; N are those of a Ray started here; default: as many as cores
    --out DIR  default: out/tune/NAME; the same command goes on with what is there
    <overwrite>
    {train.LEARNING}
"""

KINDS = {"what": LEARNERS, "search": of_text(parsed), "trials": whole, **train.LEARNING_KINDS}


def run(args: Namespace) -> int:
    """Run the command; 1 if all trials failed.

    Raises:
        ValueError: There is nothing to search, or a training would refuse a value.
        ImportError: Ray or another package is missing; the message says what to install.
        FileExistsError: There are results already, and no --overwrite.
    """
    name = args.what
    robot = default_robot() if args.robot is None else find_robot(args.robot)
    space = ({} if args.space is None else read_space(args.space)) | dict(args.search)
    settings = train.given(args)
    _check_space(args, space)
    TRAININGS[name].check(robot, settings)
    from softrobot_env.training.rl import check_request

    args.out = args.out or Path("out") / "tune" / name
    request = train.request_in(args.out, name, robot, settings, None)
    for values in corners(space):
        fixed = list((dict(settings.get("set", ())) | values).items())
        check_request(name, _with(request, {"set": fixed}))
    return _search(args, name, request, space)


def _check_space(args: Namespace, space: Space) -> None:
    """Refuse values that cannot be searched; names and ranges are checked by the training."""
    if not space:
        raise ValueError("nothing to search: give --search NAME=LOW..HIGH or --space FILE")
    fixed = dict(args.set)
    several = [name for name, values in fixed.items() if len(values) > 1]
    if several:
        raise ValueError(f"--set {several[0]}: one value; several are searched by --search")
    both = [name for name in space if name in fixed or name == "steps"]
    if both:
        raise ValueError(f"--search {both[0]}: it is the budget of a trial, or set by --set")


def _with(request: TrainingRequest, changes: dict[str, Any]) -> TrainingRequest:
    return replace(request, settings={**request.settings, **changes})


@filling
def _search(args: Namespace, name: str, request: TrainingRequest, space: Space) -> int:
    """Search, print and write."""
    request, steps = _sized(name, request)
    ranges = any(isinstance(own, Range) for own in space.values())
    search = Search(name, request, space, steps, args.trials or (_TRIALS if ranges else None))
    words, files = train.study_in(args)
    with kept_rows(args.out / KEPT, words, files - {request.path}) as kept:
        study = kept.name
        if not args.overwrite:
            check_free(request.path, overwrite=False)
            places = [trial_folder(search, number) for number in range(search.count)]
            check_unclaimed([place / request.path.name for place in places], study)
        bar = progress_on(name, prefix=f"{name}: ")
        with tune_on(args.workers) as tune, bar as show:
            found = searched(tune, search, study, show)
        table = report.runs_table(found, "trial")
        best = report.best_of(found)
        train.write(args, f"Search for settings of {name}", found, table)
        if best is not None:
            _keep(search, best, args)
    return int(best is None)


def _sized(name: str, request: TrainingRequest) -> tuple[TrainingRequest, int]:
    """The request with a check wherever a trial may be stopped, and the steps of a trial."""
    from softrobot_env.training.rl import config_of

    config = config_of(name, request.settings, request.robot)
    fixed = {"trial_every": float(max(1, config.steps // _CHECKS))}
    fixed |= dict(request.settings.get("set", ()))
    return _with(request, {"set": list(fixed.items())}), config.steps


def _keep(search: Search, best: Run, args: Namespace) -> None:
    """Write the best network, and print the command that trains it again."""
    from softrobot_env.training.rl import save_kept

    where = trial_folder(search, best.trial - 1)
    network = f"written to {search.request.path}"
    if where.is_dir():
        save_kept(search.request, where)
    else:
        network = "whose network is on the node that trained it"
    say(f"Best: trial {best.trial}, {network}", soft_wrap=True, highlight=False)
    words = ["softrobot", "train", search.name]
    words += [] if args.robot is None else ["--robot", str(args.robot)]
    words += [] if args.task == ["all"] else ["--task", *args.task]
    words += ["--start", args.start, "--seed", str(args.seed), "--steps", str(search.steps)]
    words += ["--randomize"] * args.randomize + ["--quick"] * args.quick
    for name, value in best.settings.items():
        words += ["--set", f"{name}={value:.17g}"]  # all digits are needed to reproduce the network
    say("Train with its settings:", shlex.join(words), soft_wrap=True, highlight=False)
