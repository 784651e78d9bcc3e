"""Pictures of the thesis benchmark, one per group of figures."""

from pathlib import Path

from softrobot_env.benchmarks.thesis.figures import accuracy, cosserat, cost, quadrature, spiral
from softrobot_env.benchmarks.thesis.rows import Row
from softrobot_env.rendering.figures import add_legend, add_title, new_figure, save

#: What is appended to a picture's name -> its module, with the panels line by line, its size, what
#: it says, and the entries of its legend.
_PICTURES = {"": accuracy} | {
    f"_{module.__name__.rpartition('.')[2]}": module
    for module in (cosserat, quadrature, cost, spiral)
}


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
        add_legend(figure, module.legend(rows))
        add_title(figure, module.message(rows), f"As in the thesis: {module.SUBJECT}")
        save(figure, path.with_stem(path.stem + name))
