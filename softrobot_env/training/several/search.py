"""A search for settings of a training by Ray Tune: draws, and early ends of poor trials (ASHA).

Every trial is a training with a folder of its own and a checkpoint there at each check. One that is
begun anew, as its worker, its node or the whole search was stopped, tells Tune the checks that it
has, and goes on: Tune's own state, which is pickled and may be cut short, is not read.
"""

import os
import shutil
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import partial
from math import isfinite, prod
from pathlib import Path
from typing import Any

from softrobot_env.core.cluster import connected
from softrobot_env.core.extras import needed
from softrobot_env.core.files import read_table
from softrobot_env.core.interfaces import ProgressCallback, quiet
from softrobot_env.core.processes import THREADS, Workers
from softrobot_env.core.records import placed

from ..registry import TRAININGS
from ..request import TrainingRequest
from .runs import Run, described, goes_on, with_curve

#: Of ASHA: the best third of the trials goes on from each of the rungs, at these shares of the
#: steps. At every check a trial may end.
FACTOR, CHECKS = 3, 9

#: How often a trial goes on whose worker has ended.
_RETRIES = 5

#: Name of the folder of trials, and what is reported of a check, see `watch.Point`.
TRIALS, _POINT = "trials", ("steps", "reward", "max_mm", "failures")


#: What a file has, and how ranges that are equally likely in every decade are marked.
_TABLE, _LOG = "search", "log"


@dataclass(frozen=True)
class Range:
    """Numbers between two, both included.

    Attributes:
        low, high: The two.
        log: Whether the logarithm is sampled uniformly, not the number itself.
    """

    low: float
    high: float
    log: bool = False


#: Name of a setting -> the values or the range that it is searched in.
Space = dict[str, tuple[float, ...] | Range]


def parsed(text: str) -> tuple[str, tuple[float, ...] | Range]:
    """`name=0.1..0.3`, `name=1e-5..1e-3:log` or `name=1,2,3`.

    Raises:
        ValueError: It is none of them.
    """
    name, _, values = text.partition("=")
    ends, _, scale = values.partition(":")
    low, dots, high = ends.partition("..")
    try:
        if not dots and not scale:
            return name, tuple(dict.fromkeys(_number(part) for part in values.split(",")))
        found = Range(_number(low), _number(high), scale == _LOG)
    except ValueError:
        found = None
    if found is None or scale not in ("", _LOG) or not found.low < found.high:
        raise ValueError(f"{text!r} is not NAME=LOW..HIGH, NAME=LOW..HIGH:log or NAME=V1,V2")
    if found.log and found.low <= 0:
        raise ValueError(f"{text!r}: a range with log must be above zero")
    return name, found


def _number(text: str) -> float:
    value = float(text)
    if not isfinite(value):
        raise ValueError
    return value


def read_space(path: Path) -> Space:
    """The table `[search]` of a TOML file: texts as of `parsed`, or lists of values.

    Raises:
        FileNotFoundError: No such file.
        ValueError: It is no such file; says why.
    """
    found = {}
    with placed(path):
        held = read_table(path)
        table = held.get(_TABLE)
        if not isinstance(table, Mapping) or not table or len(held) > 1:
            raise ValueError(f"must have one table [{_TABLE}] with settings, and nothing else")
        for name, value in table.items():
            text = ",".join(map(str, value)) if isinstance(value, list) else value
            found |= [parsed(f"{name}={text}")]
    return found


def corners(space: Space) -> list[dict[str, float]]:
    """Settings in which each has each of its values or ends once, to check names and ranges."""
    ends = {
        name: (own.low, own.high) if isinstance(own, Range) else own for name, own in space.items()
    }
    first = {name: values[0] for name, values in ends.items()}
    return [first | {name: value} for name, values in ends.items() for value in values]


@dataclass(frozen=True)
class Search:
    """What is searched, and how much.

    Attributes:
        name: Of the training.
        request: What trials have in common.
        space: Of the settings.
        steps: Environment steps of a trial that is not ended early.
        trials: Number of draws; None for all combinations of values.
    """

    name: str
    request: TrainingRequest
    space: Space
    steps: int
    trials: int | None

    @property
    def count(self) -> int:
        """Number of trials."""
        if self.trials is not None:
            return self.trials
        return prod(len(own) for own in self.space.values() if not isinstance(own, Range))


@contextmanager
def tune_on(workers: Workers | None) -> Iterator[Any]:
    """The module `ray.tune` on a cluster; on one that is started here unless workers say more.

    Raises:
        ImportError: Ray or what its Tune needs is not installed.
        ConnectionError: There is no cluster at the address.
    """
    workers = workers or Workers()
    with connected(
        workers.ray or "local", dict.fromkeys(THREADS, "1"), None if workers.ray else workers.count
    ):
        with needed("Ray Tune is missing", "cluster"):
            from ray import tune
        yield tune


def searched(tune: Any, search: Search, study: str, show: ProgressCallback) -> list[Run]:
    """Trials of a search, in the order in which they were sampled.

    Args:
        tune: The module.
        search: What is searched; trials have folders beside its request's file, `trial_folder`.
        study: Name of the search; what is there of the same one is gone on with.
        show: Shows what is done.
    """
    where = trial_folder(search, 0).with_name("ray")
    shutil.rmtree(where, ignore_errors=True)
    with _telling(search, show):
        tuner = _new_tuner(
            tune, tune.with_resources(partial(_trial, search, study), {"cpu": 1}), search, where
        )
        results = {_trial_number(result.metrics["trial_id"]): result for result in tuner.fit()}
    return [_run(search, number, results[number]) for number in sorted(results)]


def trial_folder(search: Search, number: int) -> Path:
    """Where a trial is, counted from 0."""
    return search.request.path.parent / TRIALS / f"trial_{number + 1}"


def _trial_number(trial_id: str) -> int:
    """Of a trial, by what Tune calls it: a random text and the number."""
    return int(trial_id.rpartition("_")[2])


def _new_tuner(tune: Any, trial: Callable[..., None], search: Search, where: Path) -> Any:
    from ray.tune.schedulers import ASHAScheduler
    from ray.tune.search.basic_variant import BasicVariantGenerator

    return tune.Tuner(
        trial,
        param_space=_sampled_from(tune, search),
        tune_config=tune.TuneConfig(
            metric="reward",
            mode="max",
            num_samples=search.trials or 1,
            search_alg=BasicVariantGenerator(random_state=search.request.seed),
            scheduler=ASHAScheduler(
                time_attr="steps",
                max_t=search.steps,
                grace_period=max(1, search.steps // CHECKS),
                reduction_factor=FACTOR,
            ),
        ),
        run_config=tune.RunConfig(
            name=where.name,
            storage_path=str(where.parent),
            failure_config=tune.FailureConfig(max_failures=_RETRIES),
            callbacks=[_callback()],
            verbose=0,
        ),
    )


def _sampled_from(tune: Any, search: Search) -> dict[str, Any]:
    """The space in Tune's words; whole numbers are sampled for settings that are whole."""
    from ..rl_config import NUMBERS

    found = {}
    for name, own in search.space.items():
        if not isinstance(own, Range):
            found[name] = tune.choice(own) if search.trials else tune.grid_search(list(own))
        elif NUMBERS[name] is int:
            draw = tune.lograndint if own.log else tune.randint
            found[name] = draw(int(own.low), int(own.high) + 1)
        else:
            draw = tune.loguniform if own.log else tune.uniform
            found[name] = draw(own.low, own.high)
    return found


def request_of(search: Search, sampled: Mapping[str, float], folder: Path) -> TrainingRequest:
    """The training of a trial."""
    fixed = dict(search.request.settings.get("set", ()))
    values = fixed | {name: float(value) for name, value in sampled.items()}
    settings = {**search.request.settings, "set": list(values.items()), "steps": search.steps}
    return replace(search.request, path=folder / search.request.path.name, settings=settings)


def _trial(search: Search, study: str, sampled: dict[str, float]) -> None:
    """Train with sampled settings, and report every check."""
    from ray import tune

    from ..checkpoint import read

    folder = trial_folder(search, _trial_number(tune.get_context().get_trial_id()))
    request, last = request_of(search, sampled, folder), {"steps": 0, "reward": -1.0}
    resume = goes_on(folder, study)
    settings = {**request.settings, "checkpoint": folder, "resume": resume}

    def report(curve: list[dict[str, float]]) -> None:
        last.update(curve[-1])
        tune.report(dict(last))

    try:
        for point in read(folder).curve if resume else ():
            report([point])
        TRAININGS[search.name].run(replace(request, settings=settings, report=report), quiet)
    except (ArithmeticError, ValueError) as error:  # of the training: anew it would fail again
        tune.report({**last, "failure": str(error).partition("\n")[0] or type(error).__name__})


def _run(search: Search, number: int, result: Any) -> Run:
    """What a trial found."""
    metrics, failure = result.metrics, result.metrics.get("failure")
    run = described(search.name, request_of(search, result.config, trial_folder(search, number)))
    run = replace(run, folder=f"{TRIALS}/{run.folder}", trial=number + 1)
    if result.error is not None:
        failure = str(result.error).strip().splitlines()[-1]
    if result.metrics_dataframe is not None and "max_mm" in result.metrics_dataframe:
        table = result.metrics_dataframe[list(_POINT)].dropna().to_dict("records")
        points = {int(point["steps"]): point for point in table}  # some come twice
        run = with_curve(run, [{**points[k], "steps": k} for k in sorted(points)])
    return replace(
        run,
        minutes=metrics.get("time_total_s", 0.0) / 60,
        pruned=failure is None and (run.steps or 0) < search.steps,
        failure=failure,
    )


#: Who receives results; what Tune calls is pickled with the search, and can hold nothing.
_LISTENERS: list[Callable[[list[Any]], None]] = []


@contextmanager
def _telling(search: Search, show: ProgressCallback) -> Iterator[None]:
    """Tell the progress, in steps of all trials; ended ones count as whole."""
    os.environ.setdefault("TUNE_DISABLE_SIGINT_HANDLER", "1")  # Ctrl-C ends the command
    os.environ.setdefault("RAY_AIR_NEW_OUTPUT", "0")  # the other one prints tables of its own

    def tell(trials: list[Any]) -> None:
        over = sum(trial.is_finished() for trial in trials)
        begun = [(t.last_result or {}).get("steps", 0) for t in trials if not t.is_finished()]
        done = over * search.steps + sum(begun)
        show(f"{over} of {search.count} trials over", int(done), search.count * search.steps)

    _LISTENERS.append(tell)
    try:
        yield
    finally:
        _LISTENERS.remove(tell)


def _callback() -> Any:
    from ray.tune import Callback

    class Telling(Callback):
        """Tells of every result."""

        def __reduce__(self) -> tuple[Any, ...]:
            return _callback, ()

        def on_trial_result(self, iteration: int, trials: list, *_: Any, **__: Any) -> None:
            for tell in _LISTENERS:
                tell(trials)

    return Telling()
