"""Pictures of the thesis benchmark, one per group of figures."""

import re
from collections.abc import Iterable
from pathlib import Path

from softrobot_env.benchmarks.thesis.figures import accuracy, cosserat, cost, quadrature, spiral
from softrobot_env.benchmarks.thesis.rows import Row
from softrobot_env.rendering.figures import add_title, new_figure, save

#: What is appended to a picture's name -> its module, with the panels line by line, and its size.
_PICTURES = {"": accuracy} | {
    f"_{module.__name__.rpartition('.')[2]}": module
    for module in (cosserat, quadrature, cost, spiral)
}

#: Relative distance of what is near a printed number.
_NEAR = 0.05


def plot(rows: list[Row], path: Path | str) -> None:
    """Draw the figures as PNG.

    Args:
        rows: Rows of `benchmarks.thesis.run`.
        path: File of the figures on accuracy; the other groups' names are appended to it.
    """
    path = Path(path)
    for name, module in _PICTURES.items():
        columns = module.COLUMNS
        figure, axes = new_figure(len(module.PANELS) // columns, columns, module.SIZE)
        for axis, (title, draw) in zip(axes.flat, module.PANELS.items(), strict=True):
            axis.set_title(title, fontsize=10)
            axis.tick_params(labelsize=8.5)
            draw(axis, rows)
        add_title(figure, _message(rows, module.PANELS), f"As in the thesis: {module.SUBJECT}")
        save(figure, path.with_stem(path.stem + name))


def _message(rows: list[Row], panels: Iterable[str]) -> str:
    """How many printed numbers of some figures come out again."""
    figures = {_key(title) for title in panels}
    known = [row for row in rows if row.thesis and row.y is not None and row.figure in figures]
    good = sum(abs(row.y - row.thesis) <= _NEAR * abs(row.thesis) for row in known)
    if not known:
        return ""
    return f"{good} of {len(known)} printed numbers come out again within {100 * _NEAR:g} %"


def _key(title: str) -> str:
    """The figure of a panel, as rows name it."""
    found = re.match(r"(Fig|Tab)\. (\d+\.\d+)", title)
    if found is None:
        return ""
    return found[2] if found[1] == "Fig" else f"tab{found[2]}"
