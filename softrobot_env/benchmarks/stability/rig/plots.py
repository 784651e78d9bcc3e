"""The rig's map of stability as a picture."""

from pathlib import Path

from softrobot_env.benchmarks.stability.map_plot import Names, draw_map
from softrobot_env.benchmarks.stability.rig.cases import DURATION
from softrobot_env.benchmarks.stability.rig.run import ASKED, MAP, RULE
from softrobot_env.benchmarks.stability.rig.runs import BOUND, JOINTS, TENSION_BOUND
from softrobot_env.benchmarks.stability.runs import Row
from softrobot_env.robots import RIG

_NAMES = Names(
    f"The spatial rig with {JOINTS} joints: servos bend it to and fro for {DURATION:g} s.\n"
    f"Green: within {1e3 * BOUND:g} mm (5 % of the length) and {TENSION_BOUND:g} N of tension in "
    "the mean of a refined run",
    "damping x {:g}",
    "tendon stiffness / nylon's",
)

#: Cases of the map by the names that the picture gives them.
_CASES = {MAP: "map", RULE: "rule", ASKED: "rule_asked"}


def plot(rows: list[Row], path: Path | str) -> None:
    """Draw the map as PNG.

    Args:
        rows: Rows of `benchmarks.stability.run`; without the rig's no file is written.
        path: File to write.
    """
    shown = [_on_map(row) for row in rows if row["case"] in _CASES and _is_rig_itself(row)]
    cells = [row for row in shown if row["case"] == "map"]
    if cells:
        dampings = {row["damping_ratio"] for row in cells}
        picks = [row for row in shown if row["case"] != "map" and row["damping_ratio"] in dampings]
        draw_map(cells, picks, _NAMES, Path(path))


def _is_rig_itself(row: Row) -> bool:
    """Whether nothing but damping and tendon stiffness differs from the rig."""
    usual = 1.0, RIG.tendons[0].pretension, 0.0, "bend"
    return (row["stiffness_scale"], row["pretension"], row["friction"], row["motion"]) == usual


def _on_map(row: Row) -> Row:
    """The row with the two scales that the picture is drawn over."""
    return row | {
        "case": _CASES[row["case"]],
        "stiffness_scale": row["tendon_stiffness_scale"],
        "damping_ratio": row["damping_scale"],
    }
