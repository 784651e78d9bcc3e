"""Runs of a training over seeds and settings, each a job with a folder of its own."""

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field, replace
from itertools import product
from math import inf
from pathlib import Path
from threading import Event, Thread
from time import perf_counter

from softrobot_env.core.artifacts import read_facts
from softrobot_env.core.files import atomic_write, write_text
from softrobot_env.core.interfaces import ProgressCallback, quiet
from softrobot_env.core.processes import Workers, using
from softrobot_env.core.runs import Kept, Row, for_pictures, run_cases

from ..registry import TRAININGS
from ..request import Metrics, Quantity, TrainingRequest, curve_file

#: In a run's folder: the study that it is of, and the share of it that is done.
_STUDY, _SHARE = "study.txt", "share.txt"

#: [s] between looks at the shares, and between writing them.
_EVERY = 2.0


@dataclass(frozen=True)
class Run(Row):
    """A training with one seed and some settings; what is not known of it is None.

    Attributes:
        training, robot: What was trained.
        seed: Of everything random.
        settings: Numbers that were set.
        folder: Of its files, in that of all.
        steps: Environment steps of its last check.
        reward, max_error, failures, best_steps: Of its best check, by which its network was
            chosen: mean reward, largest error [m], failed episodes, and environment steps.
        figures: What the training reported at its end, in SI units.
        curve: Its checks, see `watch.Point`.
        minutes: That it took since it was last begun.
        trial: Its number in a search, None outside of one.
        pruned: Whether a search ended it early.
        failure: What it ended with, None if it went well.
        reported: As `figures`, with formats and units.
    """

    training: str
    robot: str
    seed: int
    settings: dict[str, float]
    folder: str
    steps: int | None = None
    reward: float | None = None
    max_error: float | None = None
    failures: int | None = None
    best_steps: int | None = None
    figures: dict[str, float | None] = field(default_factory=dict)
    curve: list[dict[str, float]] = field(default_factory=list)
    minutes: float | None = None
    trial: int | None = None
    pruned: bool = False
    failure: str | None = None
    reported: list[tuple[str, Quantity]] = for_pictures(())  # noqa: RUF009


def requests_of(
    request: TrainingRequest, seeds: Sequence[int], values: Mapping[str, Sequence[float]]
) -> dict[str, TrainingRequest]:
    """Requests of all pairs of settings and seeds, by the names of their folders.

    Args:
        request: What they have in common; its file is within `near` and there in theirs.
        seeds: Of the runs.
        values: Values of settings of `--set`; those with several tell the runs apart.
    """
    several = [name for name, own in values.items() if len(own) > 1]
    found = {}
    for chosen in product(*values.values()):
        settings = dict(zip(values, chosen, strict=True))
        parts = [f"{name}_{settings[name]:.12g}" for name in several]
        for seed in seeds:
            label = "_".join([*parts, f"seed_{seed}"])
            own = {**request.settings} | ({"set": list(settings.items())} if settings else {})
            if "log" in own:
                own["log"] = Path(own["log"]).resolve() / label
            path = request.path.parent / label / request.path.name
            found[label] = replace(request, path=path, seed=seed, settings=own)
    return found


def run_all(
    name: str,
    requests: Mapping[str, TrainingRequest],
    kept: Kept,
    progress: ProgressCallback = quiet,
    overwrite: bool = False,
) -> list[Run]:
    """Train as requested, in processes; what an earlier run of the same study did is taken up.

    Args:
        name: Of the training.
        requests: By label.
        kept: Of the study, which is open.
        progress: Shows what is done.
        overwrite: Whether what is there of other studies may be replaced.

    Raises:
        FileExistsError: It is there, and may not.
    """
    study = kept.name
    if not overwrite:
        check_unclaimed([request.path for request in requests.values()], study)
    with _watched(requests, study, progress) as show:
        return run_cases(
            requests.items(),
            lambda case: _trained(name, case[1], study),
            kinds=(Run,),
            kept=kept,
            key=lambda case: case[0],
            label=lambda case: case[0],
            arrived=lambda case, found: _with_files(case[1], *found),
            progress=show,
        )


def _with_files(request: TrainingRequest, run: Run, files: dict[str, bytes]) -> Run:
    """A run whose files are here, also if it was done on another machine."""
    for file, content in files.items():
        path = request.path.with_name(file)
        if not path.is_file() or path.read_bytes() != content:
            with atomic_write(path) as aside:
                aside.write_bytes(content)
    return run


def described(name: str, request: TrainingRequest) -> Run:
    """What is known of a run before it is begun."""
    settings, folder = dict(request.settings.get("set", ())), request.path.parent.name
    return Run(name, request.robot.name, request.seed, settings, folder)


def with_curve(run: Run, curve: list[dict[str, float]]) -> Run:
    """A run with what its checks say."""
    if not curve:
        return run
    best = max(curve, key=lambda point: point["reward"])
    return replace(
        run,
        steps=int(curve[-1]["steps"]),
        reward=best["reward"],
        max_error=1e-3 * best["max_mm"],
        failures=int(best["failures"]),
        best_steps=int(best["steps"]),
        curve=curve,
    )


def _trained(name: str, request: TrainingRequest, study: str) -> tuple[Run, dict[str, bytes]]:
    """A run, and the files that it wrote; a training that cannot go on is a failure of its own."""
    training, folder, began = TRAININGS[name], request.path.parent, perf_counter()
    settings, run = dict(request.settings), described(name, request)
    learns = "checkpoint" in training.options
    if learns:
        settings |= {"checkpoint": folder, "resume": goes_on(folder, study)}
    else:
        write_text(folder / _STUDY, study)
    figures: Metrics = []
    try:
        with using(Workers(1)):
            figures = training.run(replace(request, settings=settings), _noting(folder))
    except (ArithmeticError, ValueError, RuntimeError) as error:
        run = replace(run, failure=str(error).partition("\n")[0] or type(error).__name__)
    if learns:
        run = with_curve(run, _curve(request, run.failure))
    results = [(key, value) for key, value in figures if isinstance(value, Quantity)]
    numbers, minutes = {key: value.value for key, value in results}, (perf_counter() - began) / 60
    left = [path for path in (request.path, curve_file(request.path)) if path.is_file()]
    files = {path.name: path.read_bytes() for path in left if run.failure is None}
    return replace(run, figures=numbers, reported=results, minutes=minutes), files


def _noting(folder: Path) -> ProgressCallback:
    """What writes the share that is done of a run to its folder, now and then."""
    last = -inf

    def show(_: str, done: int, total: int) -> None:
        nonlocal last
        if total and perf_counter() - last > _EVERY:
            last = perf_counter()
            write_text(folder / _SHARE, f"{done / total:.3f}")

    return show


@contextmanager
def _watched(
    requests: Mapping[str, TrainingRequest], study: str, progress: ProgressCallback
) -> Iterator[ProgressCallback]:
    """What jobs tell their progress to; runs under way count by what is in their folders."""
    done: set[str] = set()
    over = Event()

    def watch() -> None:
        while not over.wait(_EVERY):
            shares = [name in done or _share(o.path.parent, study) for name, o in requests.items()]
            text = f"{len(done)} of {len(requests)} runs"
            progress(text, round(1000 * sum(shares)), 1000 * len(requests))

    thread = Thread(target=watch, daemon=True)
    thread.start()
    try:
        yield lambda name, *_: done.add(name)
    finally:
        over.set()
        thread.join()


def _share(folder: Path, study: str) -> float:
    """Share of a run that is done, as far as its folder says."""
    with suppress(OSError, ValueError):
        if _of(folder) == study:
            return float((folder / _SHARE).read_text("utf-8"))
    return 0.0


def goes_on(folder: Path, study: str) -> bool:
    """Whether a folder has a checkpoint of a study; those of another one are deleted."""
    from ..checkpoint import forget, read

    if _of(folder) == study:
        with suppress(ValueError):
            return read(folder) is not None
    forget(folder)
    write_text(folder / _STUDY, study)
    return False


def _of(folder: Path) -> str | None:
    """The study that a folder is of."""
    named = folder / _STUDY
    return named.read_text("utf-8") if named.is_file() else None


def check_unclaimed(paths: Sequence[Path], study: str) -> None:
    """Refuse to replace what is not of a study."""
    for path in paths:
        other = _of(path.parent)
        if other not in (None, study) or (other is None and path.is_file()):
            raise FileExistsError(
                f"{path.parent} is of another command, files or version: --overwrite replaces it, "
                "--out writes elsewhere"
            )


def _curve(request: TrainingRequest, failure: str | None) -> list[dict[str, float]]:
    """Checks of a run that is done, or until it failed."""
    if failure is None:
        return read_facts(curve_file(request.path))
    from ..checkpoint import read

    with suppress(ValueError):
        found = read(request.path.parent)
        return [] if found is None else found.curve
    return []
