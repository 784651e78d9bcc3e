"""What can be trained, by the name of the policy that acts on it.

A training writes one file, of one robot, where policies look for it (`artifacts.find_artifact`).
What it needs is loaded when it runs.
"""

from collections.abc import Mapping
from functools import partial
from typing import Any

from softrobot_env.beams.registry import MUJOCO
from softrobot_env.control.registry import POLICIES, find_policy
from softrobot_env.core.interfaces import ProgressCallback
from softrobot_env.core.registry import Registry
from softrobot_env.robots import RobotParams, entry_of

from .request import LEARNERS, WARP, Metrics, Train, Training, TrainingRequest

#: The last operating points, by robot, plant and whether they are few.
_FOUND: dict[tuple[RobotParams, str, bool], Any] = {}


def _table(policy: str, request: TrainingRequest, show: ProgressCallback) -> Metrics:
    """Gains at operating points all over the workspace of a robot, by the design of a law."""
    from softrobot_env.control.scheduled.law import build_table, save_table

    robot, plant = request.robot, request.settings.get("plant", MUJOCO)
    points = _points(robot, plant, "quick" in request.settings, show)
    design = POLICIES[policy].loaded().design(robot)
    table = build_table(robot, design, points, partial(show, "gains"))
    save_table(request.path, table, robot, points.errors)
    off = points.errors[-1] / robot.reach
    return [
        ("operating points", f"{len(points.points)} of {points.candidates} equilibria"),
        ("error of the tip between them", f"{100 * off:.3g} % of the reach"),
        ("gains per point", str(table.rows.shape[1])),
    ]


def _points(robot: RobotParams, plant: str, quick: bool, show: ProgressCallback) -> Any:
    """Operating points of a robot; those that were found last are kept for its other tables."""
    from softrobot_env.control.scheduled.operating_points import find_points

    asked = robot, plant, quick
    if asked not in _FOUND:
        size = {"most": 40, "candidates": 120} if quick else {}
        found = find_points(robot, progress=partial(show, "equilibria"), plant=plant, **size)
        _FOUND.clear()
        _FOUND[asked] = found
    return _FOUND[asked]


def _teachers_package(robot: RobotParams, settings: Mapping[str, Any]) -> tuple[str, ...]:
    """What the teacher of an imitation needs."""
    package = find_policy(settings.get("teacher") or entry_of(robot).teacher, robot).package
    return () if package is None else (package,)


def _reinforcement(policy: str, request: TrainingRequest, show: ProgressCallback) -> Metrics:
    """Network that learns by reward; its learning curve is written beside it."""
    from .rl import run

    return run(policy, request, show)


#: Policies that act on a table of gains.
_TABLES = ("lqi", "lq_preview", "mpc", "mpc_preview")

#: Settings of reinforcement learning, see `commands.train`.
REINFORCEMENT = (
    *("task", "start", "randomize", "steps", "set", "checkpoint", "resume", "log"),
    *("backend", "device"),
)

_HERE = "softrobot_env.training"

_TRAININGS = (
    Training("qs_nn", f"{_HERE}.quasi_static:run", ("quick",)),
    *(
        Training(
            policy,
            partial(_table, policy),
            ("quick",),
            ("daqp",) if policy.startswith("mpc") else (),
            is_random=False,
        )
        for policy in _TABLES
    ),
    Training("ssm", f"{_HERE}.ssm:run", ("twin", "recording", "quick")),
    Training("sensors", f"{_HERE}.sensors:run", ("twin", "quick")),
    Training(
        "imitation",
        f"{_HERE}.imitation:run",
        ("teacher", "quick"),
        ("torch",),
        also=_teachers_package,
    ),
    Training("shac", f"{_HERE}.first_order:run", ("quick", "task", "steps", "set"), ("torch",)),
    *(
        Training(
            policy,
            partial(_reinforcement, policy),
            ("quick", *REINFORCEMENT),
            ("torch", "stable_baselines3"),
            also=lambda robot, given: (WARP,) if given.get("backend") == "warp" else (),
        )
        for policy in LEARNERS
    ),
)

#: Name of the policy and its file -> how to make it.
TRAININGS: Registry[Training] = Registry("training", {one.policy: one for one in _TRAININGS})


def register_training(
    name: str,
    run: Train | str,
    robot: RobotParams | None = None,
    *,
    replace: bool = False,
    **facts: Any,
) -> None:
    """Add a training, by the name of the policy that acts on what it makes.

    Args:
        name: Its name.
        run: Trains as asked, writes the file and returns what it found; or its path.
        robot: The only robot it is of; any unless given.
        replace: Whether it may take the place of another of this name.
        **facts: Others of `Training`.

    Raises:
        ValueError: The name is taken.
    """
    TRAININGS.register(name, Training(name, run, robot=robot, **facts), replace)
