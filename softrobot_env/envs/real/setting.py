"""What the real rig's environment is built from: task, robot file, spaces."""

from dataclasses import replace
from pathlib import Path
from typing import Any

from softrobot_env.core.records import check_argument
from softrobot_env.envs.observations.table import OBSERVABLES, speed_limit
from softrobot_env.envs.options import REAL_OPTIONS, ResetOptions, parse_options
from softrobot_env.envs.rewards import TrackingReward
from softrobot_env.envs.setting import Setting, make_env_task, sizes_of
from softrobot_env.hardware.robot_file import RobotFile, read_robot_file, rig_file
from softrobot_env.scene.config import DEFAULT_RULE
from softrobot_env.scene.quadrature import place_hinges
from softrobot_env.scene.registry import RIG_PIECES
from softrobot_env.tasks import RIG_TASKS, Task

#: Needs a board that measures forces.
TENSION = "tendon_tension"

#: What a rig can measure.
_SEEN = tuple(name for name in OBSERVABLES if not name.startswith(("curvature", "sensors")))


class RealSetting(Setting):
    """The test rig over a serial line.

    Attributes:
        file: The robot file.
        reach: Box of the tip positions that lie within reach.
        speed: [m/s], limit of the tip's speed.
    """

    def __init__(
        self,
        task: str | Task,
        task_options: dict[str, float],
        robot_file: str | Path | RobotFile | None,
        port: str | None,
        *,
        control_period: float | None,
        observe: tuple[str, ...] | str | None,
        preview: tuple[float, ...],
        observe_as: str,
        act_as: str | None,
        reward: TrackingReward | str | None,
    ) -> None:
        """Arguments as those of `RealRigEnv`."""
        check_argument("robot_file", robot_file, str | Path | RobotFile | None)
        check_argument("port", port, str | None)
        task = make_env_task(task, None, task_options)
        if task.axes != "xy" or task.robot.drive.kind != "length":
            raise ValueError(
                f"the real rig is driven by length and its camera sees x and y, unlike task "
                f"{task.label!r} of robot {task.robot.name!r}; choose from {', '.join(RIG_TASKS)}"
            )
        if any(task.start_input):
            raise ValueError(f"task {task.label!r} does not start with all tendons at length zero")
        self.file = _choose_file(robot_file, port, task)
        period = self.file.control_period if control_period is None else control_period
        super().__init__(task, period, preview, observe_as, act_as, reward)
        _check_period(self.file, period)
        robot = task.robot
        self.speed = speed_limit(robot)
        layout = place_hinges(robot.length, RIG_PIECES, DEFAULT_RULE)
        sizes = sizes_of(task, layout, robot.pieces, len(preview), directions=2)
        self.reach = OBSERVABLES["tip_position"].space(sizes)
        if observe == "all":
            observe = tuple(name for name in _SEEN if name != TENSION)
        self._make_spaces(observe, _SEEN, sizes)

    def parse_options(self, options: dict[str, Any] | None) -> ResetOptions:
        """See `Setting`."""
        return parse_options(options, REAL_OPTIONS)


def _choose_file(given: str | Path | RobotFile | None, port: str | None, task: Task) -> RobotFile:
    """The robot file, read if it is a path, with another `port` if one is given.

    Raises:
        ValueError: What the file must not say, or another number of tendons than the task's.
        FileNotFoundError: No such file.
    """
    if given is None:
        file = rig_file()
    else:
        file = given if isinstance(given, RobotFile) else read_robot_file(Path(given))
    tendons = len(task.robot.tendons)
    if len(file.tendons) != tendons:
        raise ValueError(
            f"robot {file.name!r} has {len(file.tendons)} tendons, the task's robot {tendons}"
        )
    return file if port is None else replace(file, port=port)


def _check_period(file: RobotFile, control_period: float) -> None:
    """Raise ValueError for a control period [s] that does not fit to a robot file.

    It must be longer than what the board waits to answer, and leave the watchdog some patience.
    """
    if control_period <= file.state_delay:
        raise ValueError(
            f"control_period must be longer than the state delay of {file.state_delay:g} s, got "
            f"{control_period:g} s"
        )
    if control_period > file.watchdog / 2:
        raise ValueError(
            f"control_period must be at most half of the watchdog of {file.watchdog:g} s, got "
            f"{control_period:g} s"
        )
