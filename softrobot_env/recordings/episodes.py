"""Recordings of environments' episodes: what the drives were told, and where the tip was seen."""

from collections.abc import Sequence

import numpy as np

from softrobot_env.recordings.header import Commands, Frame, Header, Marker, Time
from softrobot_env.recordings.recording import Recording
from softrobot_env.robots import RobotParams
from softrobot_env.robots.actuation import robot_inputs

_UNIT = {"length": "m", "tension": "N"}


def episode_header(robot: RobotParams, axes: slice, source: str | None = None) -> Header:
    """Header of a robot's episodes: its tendons' lengths or tensions, and its tip.

    Args:
        robot: The robot.
        axes: Coordinates out of x, y and z that are measured.
        source: Where the recording comes from, for people.
    """
    kind, names = robot.drive.kind, tuple(tendon.name for tendon in robot.tendons)
    measured = {axis: f"tip_{axis}" for axis in "xyz"[axes]}
    return Header(
        commands=Commands(
            kind,
            tuple(f"{name}_{_UNIT[kind]}" for name in names),
            _UNIT[kind],
            tendons=names,
            in_force="until",
        ),
        marker=(Marker(**measured),),
        time=Time("time"),
        runs="run",
        label="label",
        frame=Frame(),
        robot=robot.name,
        source=source,
    )


def episode_recording(
    robot: RobotParams,
    axes: slice,
    times: np.ndarray,
    actions: np.ndarray,
    tips: np.ndarray,
    *,
    labels: Sequence[str] | None = None,
    runs: np.ndarray | None = None,
    source: str | None = None,
) -> Recording:
    """The recording of a robot's episodes.

    Args:
        robot: What was told; commands are what its drives apply for the actions.
        axes: Coordinates out of x, y and z that were measured.
        times: (t,) [s] since the start of each episode.
        actions: (t, n_inputs), in force just before each time.
        tips: (t, d) [m], the coordinates that were measured.
        labels: (t,) of the rows; none unless given.
        runs: (t,) number of the episode; one unless given.
        source: See `episode_header`.

    Raises:
        ValueError: A number is not finite, or times do not rise within an episode.
    """
    rows = len(times)
    markers = np.full((rows, 1, 3), np.nan)
    markers[:, 0, axes] = tips
    return Recording(
        header=episode_header(robot, axes, source),
        times=np.asarray(times, dtype=float),
        commands=robot_inputs(robot).per_action().command(np.asarray(actions, dtype=float)),
        markers=markers,
        labels=np.full(rows, "") if labels is None else np.array(labels, dtype=str),
        runs=np.zeros(rows, dtype=int) if runs is None else runs,
    )


def at_their_time(times: np.ndarray, ages: np.ndarray, tips: np.ndarray) -> np.ndarray:
    """Tips (t, d) [m] at times (t,) [s], from what was seen then, each some age (t,) [s] old."""
    if not np.any(ages):
        return tips
    taken, first = np.unique(times - ages, return_index=True)
    return np.stack([np.interp(times, taken, column[first]) for column in tips.T], axis=1)
