"""A thing that has a name looks the same in every figure, and like nothing else beside it."""

import ast
from itertools import combinations
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

import softrobot_env
from softrobot_env.beams.registry import PLANTS
from softrobot_env.control.registry import POLICIES, RIG_POLICIES
from softrobot_env.rendering import figures, recordings
from softrobot_env.rendering.curves import Curve, end_errors
from softrobot_env.rendering.figures import (
    STYLES,
    add_legend,
    label_lines,
    new_figure,
    save,
    style_of,
)
from softrobot_env.scene.quadrature import RULES

SOURCES = sorted(Path(softrobot_env.__file__).parent.rglob("*.py"))


#: Policies of one figure: those of rigs have one of their own, with two for any robot.
OF_ARMS = tuple(name for name in POLICIES if name not in RIG_POLICIES)


def test_every_policy_has_a_colour_and_line_of_its_own():
    names = [*dict.fromkeys([*POLICIES, *RIG_POLICIES])]
    assert not [name for name in names if name not in STYLES]
    assert len({style_of(name).colour for name in names}) == len(names)
    assert len({(style_of(name).colour, style_of(name).line) for name in names}) == len(names)


@pytest.mark.parametrize("names", [OF_ARMS, tuple(RIG_POLICIES), tuple(RULES)])
def test_colours_in_one_figure_can_be_told_apart(names):
    """Those that are near each other differ in their lines or markers."""
    from matplotlib.colors import to_rgb

    for a, b in combinations((style_of(name) for name in names), 2):
        near = np.linalg.norm(np.subtract(to_rgb(a.colour), to_rgb(b.colour))) < 0.2
        assert not near or a.line != b.line or a.marker != b.marker
    assert len({style_of(name).marker for name in names}) == len(names)


def test_every_model_and_hinge_rule_has_a_style():
    models = [name for name in PLANTS if name != "mujoco"]
    assert {"mujoco_chain", *models, *RULES} <= STYLES.keys()


def test_unknown_names_have_styles_that_depend_on_the_name_alone():
    names = [f"mine_{i}" for i in range(30)]
    styles = [style_of(name) for name in names]
    assert styles == [style_of(name) for name in reversed(names)][::-1]
    assert len({(style.colour, style.line) for style in styles}) == len(names)


def test_figures_are_made_in_one_place():
    """`new_figure` is the only maker of figures, and nothing needs a display."""
    makers, states = [], []
    for path in SOURCES:
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Call) and ast.unparse(node.func).split(".")[-1] == "Figure":
                makers.append(path)
            if isinstance(node, ast.Import | ast.ImportFrom) and "pyplot" in ast.unparse(node):
                states.append(path)
    assert makers == [Path(figures.__file__)]
    assert not states


def test_a_figure_has_its_panels_legend_and_size(tmp_path):
    from matplotlib.image import imread

    figure, axes = new_figure(2, 3, (6, 4))
    assert axes.shape == (2, 3)
    axes[0, 0].plot([0, 1], **style_of("lqi").curve, label="lqi")
    add_legend(figure, axes[0, 0])
    assert [text.get_text() for text in figure.legends[0].get_texts()] == ["lqi"]
    assert imread(save(figure, tmp_path / "figure.png")).shape[:2] == (600, 900)


def boxes(axis):
    """(left, low, right, high) of all names on an axis, in pixels."""
    axis.figure.draw_without_rendering()
    return [text.get_window_extent().extents for text in axis.texts]


def are_apart(found):
    return not any(
        (one[:2] < other[2:]).all() and (other[:2] < one[2:]).all()
        for one, other in combinations(found, 2)
    )


def test_names_at_the_ends_of_lines_do_not_overlap():
    _, ((axis,),) = new_figure(1, 1, (5, 4))
    axis.set(xlim=(0, 1), ylim=(0, 1))
    label_lines(axis, [(f"line {k}\nof two", 0.97 + 0.005 * k, "black") for k in range(4)])
    assert are_apart(boxes(axis))


def test_how_far_episodes_end_counts_those_that_failed():
    """Ends 1 and 2 mm off, and one that failed, which is nearer than both."""

    def curve(name, off, failure=None):
        error = np.array([9.0, off])
        return Curve(name, SimpleNamespace(error=1e-3 * error, failure=failure), {})

    good, worse, bad = curve("a", 1.0), curve("b", 2.0), curve("c", 0.1, "diverged")
    assert end_errors([good, worse]) == "all end within 2 mm of the reference"
    assert end_errors([good, worse, bad]) == "2 of 3 end within 2 mm of the reference, 1 failed"
    assert end_errors([good]) == "a ends within 1 mm of the reference"
    assert end_errors([bad]) == end_errors([bad, bad]) == "all failed"


@pytest.mark.parametrize("height", [0.1, np.nan], ids=["measured", "not measured"])
def test_an_identification_shows_all_errors_also_of_a_marker_without_height(height, monkeypatch):
    """A camera may see no height; one panel's errors may be larger than another's."""
    drawn = {}
    monkeypatch.setattr(
        recordings, "save", lambda figure, path: drawn.setdefault(path.stem, figure)
    )
    points = np.linspace(0, 0.1, 12).reshape(4, 3)
    points[:, 2] = height
    error = np.full((4, 3), 1e-3) + 0 * points
    known = SimpleNamespace(parameter="mass", value=0.1, deviation=0.02, prior=0.4)
    given = {"fitted": error, "cross-validated": 3 * error}
    recordings.plot_identification(points, given, [known], "a robot", Path())
    size = np.sqrt(np.isfinite(error[0]).sum())  # mm
    panels = drawn["identify_errors"].axes
    assert [panel.get_title(loc="left").split("RMS ")[1] for panel in panels] == [
        f"{size:.2f} mm",
        f"{3 * size:.2f} mm",
    ]
    assert all(panel.get_ylim()[0] == 0 and panel.get_ylim()[1] > 3 * size for panel in panels)
    assert len(drawn["identify_workspace"].axes) == (3 if np.isfinite(height) else 1)
