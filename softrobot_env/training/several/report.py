"""Tables and pictures of several runs of a training."""

from collections.abc import Sequence
from itertools import cycle
from pathlib import Path

from rich.console import Group

from softrobot_env.rendering.figures import COLOURS, Style, save
from softrobot_env.rendering.learning import checks_figure
from softrobot_env.rendering.tables import Column, PlainTable, make_table, new_table, spread

from .runs import Run

_LINES = ("-", "-.", ":")

#: Most kinds of runs that a picture tells apart.
_MOST = 12


def best_of(runs: Sequence[Run]) -> Run | None:
    """The run whose network has the largest reward, of equal ones the one that ended best.

    None where none was checked.
    """
    checked = [run for run in runs if run.reward is not None and run.failure is None]
    return max(checked, key=lambda run: (run.reward, run.curve[-1]["reward"]), default=None)


def _setting(run: Run, name: str) -> str:
    return f"{run.settings[name]:.6g}" if name in run.settings else "-"


def varied_in(runs: Sequence[Run]) -> list[str]:
    """Names of the settings that have several values."""
    names = dict.fromkeys(name for run in runs for name in run.settings)
    return [name for name in names if len({run.settings.get(name) for run in runs}) > 1]


def tables(runs: Sequence[Run]) -> Group:
    """Best, median and spread of the seeds by settings, what else they tell, and every run."""
    parts = [_compared(runs)] if any(run.reward is not None for run in runs) else []
    if any(run.reported for run in runs):
        parts.append(_results(runs))
    return Group(*parts, runs_table(runs))


def runs_table(runs: Sequence[Run], heading: str = "seed") -> PlainTable:
    """A line for each run.

    Args:
        runs: The runs.
        heading: "seed", or "folder" where that tells them apart.
    """
    columns = [Column(heading, form=">")]
    for name in varied_in(runs):
        columns.append(Column(name, lambda run, name=name: run.settings.get(name), ".3g"))
    learned = any(run.reward is not None for run in runs)
    if learned:
        columns += [
            Column("steps", form=","),
            Column("reward", form=".4f"),
            Column("max mm", "max_error", ".3g", "mm"),
            Column("failed", "failures", "d"),
            Column("at step", "best_steps", ","),
        ]
    ended = Column("", lambda r: "FAILED" if r.failure else "pruned" if r.pruned else "", ">")
    columns += [Column("minutes", form=".1f"), ended]
    failed = [f"{run.folder} failed: {run.failure}" for run in runs if run.failure]
    title = "every run: its best check, and the steps at it" if learned else "every run"
    return make_table(title, columns, runs, caption="\n".join(failed))


def _kinds(runs: Sequence[Run]) -> dict[str, list[Run]]:
    """Runs by the settings that tell them apart, for people."""
    varied = varied_in(runs)
    found: dict[str, list[Run]] = {}
    for run in runs:
        kind = ", ".join(f"{name} {_setting(run, name)}" for name in varied)
        found.setdefault(kind, []).append(run)
    return found


def _compared(runs: Sequence[Run]) -> PlainTable:
    """A line for each choice of settings: the best of its seeds, and median and range of them."""
    varied = varied_in(runs)
    out = new_table(
        "seeds together: best, and median (least to largest)",
        right=(*varied, "seeds", "best reward", "reward", "largest error mm", "failed"),
    )
    for mine in _kinds(runs).values():
        best, failed = best_of(mine), sum(run.failure is not None for run in mine)
        out.add_row(
            *(_setting(mine[0], name) for name in varied),
            len(mine),
            None if best is None else f"{best.reward:.4f}",
            spread([run.reward for run in mine], ".4f"),
            spread([run.max_error for run in mine], ".3g", "mm"),
            failed,
        )
    return out


def _results(runs: Sequence[Run]) -> PlainTable:
    """What the trainings reported at their ends."""
    kinds = _kinds([run for run in runs if run.reported])
    out = new_table(
        "figures of the results: median (least to largest)",
        ("",),
        ("unit", *(kind or "all seeds" for kind in kinds)),
    )
    for key, like in {key: value for run in runs for key, value in run.reported}.items():
        cells = [
            spread([run.figures.get(key) for run in mine], like.form, like.unit)
            for mine in kinds.values()
        ]
        out.add_row(key, like.unit, *cells)
    return out


def plot(runs: Sequence[Run], path: Path | str) -> None:
    """Draw the checks: median and range of the seeds, by settings; of many, the best ones.

    Raises:
        ImportError: matplotlib is not installed.
    """
    kinds = _kinds([run for run in runs if run.curve])
    order = sorted(kinds, key=lambda kind: -max(run.reward for run in kinds[kind]))[:_MOST]
    shown = {kind: mine for kind, mine in kinds.items() if kind in order}
    styles = cycle(Style(colour, line=line) for line in _LINES for colour in COLOURS)
    trainings = {
        kind or runs[0].training: (next(styles), [run.curve for run in mine])
        for kind, mine in shown.items()
    }
    left = len(kinds) - len(shown)
    note = f"; the best {len(shown)} of {len(kinds)} choices" if left else ""
    title = f"Closed-loop checks of {runs[0].training}: median and range of the seeds{note}"
    save(checks_figure(trainings, title), path)
