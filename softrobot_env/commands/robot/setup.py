"""The spatial test rig over a serial line: a real one, or a virtual one in its own process."""

from argparse import Namespace
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import gymnasium

from softrobot_env.beams.registry import MUJOCO
from softrobot_env.control.registry import FEEDBACKS
from softrobot_env.envs.real import RealRigEnv
from softrobot_env.evaluation.report import REAL, VIRTUAL
from softrobot_env.evaluation.runner import Case
from softrobot_env.hardware.robot_file import RobotFile
from softrobot_env.hardware.transport import Transport
from softrobot_env.robots import RobotParams, default_robot
from softrobot_env.tasks import Task

from ..setups import Setup
from .link import opened, robot_of
from .virtual import virtual_process

#: Arguments of simulated robots alone -> their value unless given.
_SIMULATED = {"vary": [], "randomize": [], "feedback": FEEDBACKS[0], "plant": MUJOCO}


class RealSetup(Setup):
    """A rig over a serial line; tasks of other robots are simulated."""

    def __init__(self, args: Namespace) -> None:
        """Arguments of `softrobot evaluate`."""
        super().__init__(args)
        self.plant, self._own = args.env, default_robot(on_a_line=True)

    def twins(self, robot: RobotParams) -> list[int | None]:
        """Seeds for virtual robots; a real one is what it is."""
        return super().twins(robot) if self.plant == VIRTUAL else [None]

    def complete(self, case: Case) -> Case:
        """See `Setup`."""
        case = super().complete(case)
        return replace(case, plant=self.plant) if case.task.robot == self._own else case

    def check(self, cases: list[Case]) -> None:
        """Refuse what belongs to a virtual robot or to none, and unfit references."""
        args = self._args
        if not any(case.task.robot == self._own for case in cases):
            raise ValueError(f"--env {self.plant}: only with tasks of the {self._own.name}")
        if self.plant == REAL and args.twin is not None:
            raise ValueError("--twin: only with simulated and virtual robots")
        if self.plant == VIRTUAL and (args.robot_file is not None or args.port is not None):
            raise ValueError("--robot-file, --port: only with --env real")
        if self.plant == VIRTUAL and None in self.twins(self._own):
            raise ValueError("--twin none: only with simulated robots")
        foreign = [f"--{name}" for name, value in _SIMULATED.items() if vars(args)[name] != value]
        if foreign:
            raise ValueError(f"{', '.join(foreign)}: only with simulated robots")
        super().check(cases)

    def environment(self, case: Case, **drawing: Any) -> gymnasium.Env:
        """Environment for a case; its `close` ends a virtual robot's process."""
        if case.task.robot != self._own:
            return super().environment(case, **drawing)
        if self.plant == VIRTUAL:
            return VirtualRigEnv(case.task, case.twin, partial(self._line, case), observe="all")
        file = robot_of(self._args)
        return RealRigEnv(case.task, robot_file=file, observe="all", line=self._line(case, file))

    def _line(self, case: Case, file: RobotFile) -> Callable[[], Transport]:
        """Opens the way to a robot, recorded where that is wanted."""
        folder = self._args.record
        return lambda: opened(file, None if folder is None else _free_name(folder, case))


class VirtualRigEnv(RealRigEnv):
    """The real rig's environment with a virtual robot that lives as long as it does."""

    def __init__(
        self,
        task: Task,
        twin: int,
        line: Callable[[RobotFile], Callable[[], Transport]] | None = None,
        **options: Any,
    ) -> None:
        """Start a virtual robot.

        Args:
            task: The task.
            twin: Seed of the twin.
            line: From the robot's file to what opens the way to it; its port unless given.
            **options: Of `RealRigEnv`.
        """
        with ExitStack() as started:
            robot = started.enter_context(virtual_process(twin))
            options["line"] = None if line is None else line(robot.file)
            super().__init__(task, robot_file=robot.file, tip=robot.tip, **options)
            self._process = started.pop_all()

    def close(self) -> None:
        """Ramp down, and end the process."""
        try:
            super().close()
        finally:
            self._process.close()


def _free_name(folder: Path, case: Case) -> Path:
    """A file for a log that is not there yet."""
    folder.mkdir(parents=True, exist_ok=True)
    number = 1
    while (path := folder / f"{case.task.name}_{case.policy}_{number}.link").exists():
        number += 1
    return path
