"""Maps of stability as pictures, one per model and resolution."""

from pathlib import Path

from softrobot_env.benchmarks.stability.groups import groups
from softrobot_env.benchmarks.stability.map import MOST_STEPS
from softrobot_env.benchmarks.stability.map_plot import Names, draw_map
from softrobot_env.benchmarks.stability.rig import plots as rig_stability_plots
from softrobot_env.benchmarks.stability.runs import CHAIN, Row


def plot(rows: list[Row], path: Path | str) -> None:
    """Draw one picture per model and resolution as PNG.

    Args:
        rows: Rows of `benchmarks.stability.run`.
        path: File of the first model's picture; the others get the model's name appended, that of
            the rig "_rig".
    """
    path = Path(path)
    rig_stability_plots.plot(rows, path.with_stem(f"{path.stem}_rig"))
    maps = groups((row for row in rows if row["case"] == "map"), "model", "n")
    for index, ((model, n), cells) in enumerate(maps.items()):
        picks = [
            row
            for row in rows
            if row["case"] in ("rule", "rule_asked") and (row["model"], row["n"]) == (model, n)
        ]
        name = f"{path.stem}_{model.split('/')[0]}_{n}{path.suffix}"
        names = Names(_title(cells[0]), "damping ratio {:.2g}", "stiffness / arm's")
        draw_map(cells, picks, names, path if index == 0 else path.with_name(name))


def _title(row: Row) -> str:
    if row["model"] == CHAIN:
        what = f"the MuJoCo chain with {row['n']} hinges"
    else:
        what = f"the beam model {row['model']} with {row['n']} pieces"
    return (
        f"Which timestep is safe? {what[0].upper()}{what[1:]}: step of the tendon tensions, "
        f"three first periods or {MOST_STEPS} steps.\nGreen: the tip stays within "
        f"{1e3 * row['e_bound']:g} mm (5 % of the length) of a refined run of the same model"
    )
