"""A picture of a robot's workspace."""

from pathlib import Path

import numpy as np

from softrobot_env.core.files import file_name
from softrobot_env.robots import RobotParams
from softrobot_env.scene.inverse import Sample, Workspace, sample_of, workspace_of

from .figures import BLACK, BLUE, GREY, VERMILLION, Axes, finish, label_plane, new_figure, save

_SHAPES, _POINTS = 9, 60
_NAMES = "xyz"


def draw_workspace(robot: RobotParams, folder: Path | str) -> Path:
    """Draw the tips of a sample: x-z of a planar robot; from the side and from above else.

    Returns:
        Path of the PNG, `workspace_NAME.png` in the folder, which is made.

    Raises:
        ValueError, EquilibriumError: As `scene.inverse.workspace_of`.
        ImportError: matplotlib is not installed.
    """
    space, sample = workspace_of(robot), sample_of(robot)
    views = ["xz"] if space.scene.config.bending == "planar" else ["xz", "xy"]
    figure, axes = new_figure(1, len(views), (5.2 * len(views), 5.6))
    for axis, view in zip(axes[0], views, strict=True):
        _draw(axis, space, sample, view)
    finish(figure, axes[0, 0], f"{robot.name}: tips at rest, {len(sample.tips)} of a sample")
    Path(folder).mkdir(parents=True, exist_ok=True)
    return save(figure, picture_of(robot, folder))


def picture_of(robot: RobotParams, folder: Path | str) -> Path:
    """The picture of `draw_workspace`."""
    return Path(folder) / file_name(f"workspace_{robot.name}.png")


def _draw(axis: Axes, space: Workspace, sample: Sample, view: str) -> None:
    """One view in mm."""
    plane = [_NAMES.index(name) for name in view]
    stations = np.linspace(0, space.scene.config.robot.length, _POINTS)
    some = np.linspace(0, len(sample.tips) - 1, _SHAPES).astype(int)
    for k, shape in zip(some, space.scene.positions(sample.postures[some], stations), strict=True):
        bold = {"color": BLACK, "linewidth": 2.2, "label": "action 0", "zorder": 3}
        others = {"color": GREY, "linewidth": 0.7, "label": "some shapes" if k == some[1] else None}
        axis.plot(*1e3 * shape[:, plane].T, **(others if k else bold))
    axis.plot(*1e3 * sample.tips[:, plane].T, ".", color=BLUE, markersize=3.5, label="tips")
    _draw_ground(axis, space, plane)
    label_plane(axis, view)


def _draw_ground(axis: Axes, space: Workspace, plane: list[int]) -> None:
    """The ellipse in which tasks take place; from the side its edge lies where the tip rests."""
    ground = space.ground
    if ground.radius == 0:
        return
    turn = np.linspace(0, 2 * np.pi, 81)[:, None]
    along, across = ground.length * ground.axes[0], ground.radius * ground.axes[1]
    flat = ground.middle + np.cos(turn) * along + np.sin(turn) * across
    held = space.inverse.solve(0.999 * flat + 0.001 * ground.middle, ground.inputs)
    edge = np.where(held.errors[:, None] <= space.inverse.tolerance, 1.0, np.nan)
    edge = edge * space.scene.tip(held.postures)
    axis.plot(*1e3 * edge[:, plane].T, color=VERMILLION, linewidth=1.4, label="ground of tasks")
