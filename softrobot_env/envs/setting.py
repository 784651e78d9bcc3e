"""What an environment is built from and never changes: task, plant, spaces, starts.

Single and vectorised environments of a robot hold the same setting.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from gymnasium import spaces

from softrobot_env.envs.disturbances import NOISE_ROOM
from softrobot_env.envs.observations.camera import FARTHEST
from softrobot_env.envs.observations.table import (
    ARM_OBSERVABLES,
    RIG_OBSERVABLES,
    Sizes,
    observation_space,
    speed_limit,
)
from softrobot_env.envs.options import (
    ARM_OPTIONS,
    RIG_OPTIONS,
    ResetOptions,
    check_timing,
    unexpected_argument,
)
from softrobot_env.envs.options import parse_options as parse
from softrobot_env.envs.reference import AXES, ReferenceTable, sample_reference
from softrobot_env.envs.simulation.beam_plant import BeamPlant
from softrobot_env.envs.simulation.mujoco_plant import MujocoPlant
from softrobot_env.fields import check_argument
from softrobot_env.interfaces import PlantFactory
from softrobot_env.robots import LENGTH_SCALE, RIG, RobotParams
from softrobot_env.robots.actuation import TendonMap
from softrobot_env.robots.twin import (
    FRAME,
    LARGEST_ERROR,
    LARGEST_NOISE,
    Twin,
    nominal_twin,
    rig3d_twin,
    twin_or_ideal,
)
from softrobot_env.scene.config import DEFAULT_SHARE
from softrobot_env.scene.quadrature import HingeLayout
from softrobot_env.tasks import OPTIONS, RIG_TASKS, Task, defaults, make_task

DEFAULT_ACCURACY = DEFAULT_SHARE


class Start(NamedTuple):
    """How an episode begins.

    Attributes:
        input: (n_inputs,), of the robot.
        posture: Coordinates of the plant, hinge angles [rad] of a chain.
    """

    input: np.ndarray
    posture: np.ndarray


class Setting:
    """A task, what is simulated for it, and its spaces.

    Attributes:
        task: The task.
        control_period: [s].
        plant: Builds simulations of its robot.
        observation_space, action_space: Spaces of one robot.
        input_scale: (n_inputs,), input of a full-scale action.
        axes: The coordinates out of x, y and z that positions have, a slice of (3,).
        reference: Of the task.
    """

    plant: MujocoPlant | BeamPlant
    observation_space: spaces.Dict
    input_scale: np.ndarray

    def __init__(self, task: Task, control_period: float, preview: tuple[float, ...]) -> None:
        check_timing(control_period, preview)
        self.task, self.control_period, self.axes = task, control_period, AXES[task.axes]
        self._preview = np.array(preview, dtype=float)

    def _make_spaces(
        self, observe: tuple[str, ...] | str, known: tuple[str, ...], sizes: Sizes
    ) -> None:
        self.observation_space = observation_space(observe, known, sizes)
        self.action_space = spaces.Box(-1.0, 1.0, (sizes.n_inputs,), dtype=np.float32)
        self.reference = self.reference_of(self.task)

    def reference_of(self, task: Task) -> ReferenceTable:
        """The sampled reference of a task.

        Raises:
            ValueError: It is not finite, too far or too fast.
        """
        return sample_reference(task, self.control_period, self._preview)

    def parse_options(self, options: dict[str, Any] | None) -> ResetOptions:
        """The checked options of a `reset`; raises ValueError."""
        raise NotImplementedError

    def start(self, options: ResetOptions, task: Task) -> Start:
        """How the options, or else the task, let an episode begin.

        Raises:
            ValueError: A start out of range.
            EquilibriumError: There is no equilibrium there.
        """
        raise NotImplementedError


class TensionSetting(Setting):
    """A planar robot whose tendons are driven in tension.

    Attributes:
        tendon_map: From reduced inputs to tensions.
    """

    def __init__(
        self,
        task: str | Task,
        *,
        control_period: float,
        observe: tuple[str, ...] | str,
        preview: tuple[float, ...],
        plant: PlantFactory | None = None,
        pieces: int | None = None,
        rule: str | None = None,
        timestep: float | None = None,
        integrator: str | None = None,
        accuracy: float | str = DEFAULT_ACCURACY,
    ) -> None:
        """Arguments as those of `TrackingEnv`."""
        chain = {"pieces": pieces, "rule": rule, "timestep": timestep, "integrator": integrator}
        check_argument("task", task, str | Task)
        check_argument("plant", plant, Callable | None)
        chain["accuracy"] = accuracy
        task = make_task(task) if isinstance(task, str) else task
        super().__init__(task, control_period, preview)
        robot = task.robot
        self.tendon_map = TendonMap(robot)
        self.input_scale = self.tendon_map.input_scale
        self.plant = _tension_plant(robot, control_period, plant, chain)
        sizes = Sizes(
            robot,
            self.plant.layout,
            self.plant.layout.pieces,
            self.plant.speed,
            directions=1,
            n_preview=len(preview),
            n_inputs=self.tendon_map.n_inputs,
            strain=self.plant.strain,
            noise=NOISE_ROOM,
        )
        self._make_spaces(observe, ARM_OBSERVABLES, sizes)

    def parse_options(self, options: dict[str, Any] | None) -> ResetOptions:
        """See `Setting`."""
        pieces = self.plant.layout.pieces
        sizes = {"start_input": len(self.input_scale), "start_curvature": pieces}
        return parse(options, ARM_OPTIONS, sizes)

    def start(self, options: ResetOptions, task: Task) -> Start:
        """See `Setting`."""
        given = task.start_input if options.start_input is None else options.start_input
        chosen = np.asarray(given, dtype=float)
        if np.any(np.abs(chosen) > self.input_scale):
            raise ValueError(
                f"start_input must lie within +-{self.input_scale.tolist()} N, got "
                f"{chosen.tolist()}"
            )
        if options.start_curvature is None:
            return Start(chosen, self.plant.equilibrium(self.tendon_map.tension(chosen)))
        limit = self.task.robot.curvature_limit
        if np.any(np.abs(options.start_curvature) > limit):
            raise ValueError(f"start_curvature must lie within +-{limit:g} 1/m")
        return Start(chosen, self.plant.bent(options.start_curvature))


def _tension_plant(
    robot: RobotParams, control_period: float, factory: PlantFactory | None, chain: dict[str, Any]
) -> MujocoPlant | BeamPlant:
    if factory is None:
        return MujocoPlant(robot, control_period, **chain)
    given = {k: v for k, v in chain.items() if v not in (None, DEFAULT_ACCURACY)}
    if given:
        raise ValueError(
            f"{', '.join(given)} belong to the MuJoCo chain; another plant has its own options"
        )
    return BeamPlant(robot, control_period, factory)


class LengthSetting(Setting):
    """The spatial test rig, whose tendons are driven in length by servos.

    Attributes:
        twin: The rig that is simulated.
    """

    def __init__(
        self,
        task: str | Task,
        task_options: dict[str, float],
        twin: Twin | int | None,
        *,
        control_period: float,
        observe: tuple[str, ...] | str,
        preview: tuple[float, ...],
        **chain: Any,
    ) -> None:
        """Arguments as those of `RigEnv`."""
        super().__init__(rig_task(task, task_options), control_period, preview)
        self.twin = _twin_for(twin, self.task)
        robot = self.twin.robot
        self.input_scale = np.full(len(robot.tendons), LENGTH_SCALE)
        speed = speed_limit(self.task.robot)  # policies do not know the twin
        self.plant = MujocoPlant(
            robot, control_period, speed, bending="spatial", actuation="length", **chain
        )
        sizes = rig_sizes(robot, self.plant.layout, speed, len(preview))
        self._make_spaces(observe, RIG_OBSERVABLES, sizes)

    def parse_options(self, options: dict[str, Any] | None) -> ResetOptions:
        """See `Setting`."""
        return parse(options, RIG_OPTIONS, {"start_length": len(self.input_scale)})

    def start(self, options: ResetOptions, task: Task) -> Start:
        """See `Setting`."""
        given = task.start_input if options.start_length is None else options.start_length
        length = np.array(given, dtype=float)
        if np.any(np.abs(length) > self.input_scale):
            raise ValueError(
                f"option 'start_length' must lie within +-{LENGTH_SCALE:g} m, got {length.tolist()}"
            )
        return Start(length, self.plant.equilibrium(length + np.array(self.twin.servo_offset)))


def rig_task(task: str | Task, options: dict[str, float]) -> Task:
    """A task of the rig, made if it is a name.

    Raises:
        ValueError: A bad name or option, or options of a task that is made already.
    """
    check_argument("task", task, str | Task)
    if isinstance(task, str):
        return make_task(task, among=RIG_TASKS, **options)
    if options:
        raise ValueError(f"options of a task need its name, got a task and {', '.join(options)}")
    return task


def check_task_options(kind: type, task: str | Task, options: dict[str, float]) -> None:
    """Raise TypeError for an argument of an environment class that is no option of any task."""
    make = RIG_TASKS.get(task) if isinstance(task, str) else None
    own = [] if make is None else list(defaults(make))
    for name in options:
        if name not in own and name not in OPTIONS:
            raise unexpected_argument(kind, name, own)


def rig_sizes(robot: RobotParams, layout: HingeLayout, speed: float, n_preview: int) -> Sizes:
    """What sizes and bounds of the rig's observables depend on, with room for any twin's errors."""
    return Sizes(
        robot,
        layout,
        robot.pieces,
        speed,
        directions=2,
        n_preview=n_preview,
        n_inputs=len(robot.tendons),
        pulled=LENGTH_SCALE + LARGEST_ERROR,
        tip_room=FARTHEST * LARGEST_NOISE,
        speed_room=4 * FARTHEST * LARGEST_NOISE / FRAME,  # pictures are half a frame apart or more
    )


def _twin_for(twin: Twin | int | None, task: Task) -> Twin:
    check_argument("twin", twin, Twin | int | None)
    if twin is None:
        return twin_or_ideal(None) if task.robot == RIG else nominal_twin(task.robot)
    if not isinstance(twin, Twin) and task.robot != RIG:
        raise ValueError(
            f"the seed of a twin stands for a {RIG.name!r} with its errors, and task "
            f"{task.label!r} has another robot, {task.robot.name!r}: give a `Twin` of it"
        )
    made = twin if isinstance(twin, Twin) else rig3d_twin(twin)
    if len(made.robot.tendons) != len(task.robot.tendons):
        raise ValueError(
            f"the twin has {len(made.robot.tendons)} tendons, the task's robot "
            f"{len(task.robot.tendons)}"
        )
    return made
