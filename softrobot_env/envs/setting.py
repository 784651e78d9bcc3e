"""What an environment is built from and never changes: task, plant, spaces, starts.

Single and vectorised environments of a robot hold the same setting.
"""

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import TYPE_CHECKING, Any, Literal, NamedTuple

import numpy as np
from gymnasium import spaces

from softrobot_env.core.arrays import HOST, HostArrays
from softrobot_env.core.interfaces import PlantFactory, Seen
from softrobot_env.core.records import check_argument
from softrobot_env.core.vector_reading import Reading
from softrobot_env.envs.disturbances import NOISE_ROOM
from softrobot_env.envs.observations.camera import FARTHEST
from softrobot_env.envs.observations.table import (
    OBSERVABLES,
    SENSOR_NOISE,
    Sizes,
    Sources,
    known_of,
    observation_space,
    observer,
    speed_limit,
)
from softrobot_env.envs.observations.vector import VectorView
from softrobot_env.envs.options import (
    SIMULATED_OPTIONS,
    ResetOptions,
    check_timing,
    unexpected_argument,
)
from softrobot_env.envs.options import parse_options as parse
from softrobot_env.envs.randomization import Randomization
from softrobot_env.envs.reference import AXES, ReferenceTable, sample_reference
from softrobot_env.envs.rewards import TrackingReward, reward_of
from softrobot_env.envs.simulation.beam_plant import BeamPlant
from softrobot_env.envs.simulation.mujoco_plant import MujocoPlant
from softrobot_env.robots import CAMERA_PERIOD, RobotParams, Sensor
from softrobot_env.robots.actuation import Inputs, check_inputs, robot_inputs
from softrobot_env.robots.twin import (
    LARGEST_ERROR,
    LARGEST_NOISE,
    Twin,
    twin_of,
)
from softrobot_env.scene.config import DEFAULT_SHARE
from softrobot_env.scene.quadrature import HingeLayout
from softrobot_env.scene.servos import Servos
from softrobot_env.tasks import OPTIONS, Task, make_task, options_of

if TYPE_CHECKING:
    from softrobot_env.sensing.array import SensorArray

DEFAULT_ACCURACY = DEFAULT_SHARE

#: How an environment may be seen, and what its actions may stand for.
OBSERVE_AS, ACT_AS = ("dict", "vector"), ("input", "change")

#: Largest change of an input in a step, over full scale, where actions change inputs: this share of
#: full scale in the time in which the first mode turns by 1 rad.
CHANGE = 1.0

#: Beginnings of the observables that are not observed unless asked for, by drive. What is left of a
#: robot driven by length is what a lab has of it: camera, servos and reference.
_ASKED_FOR = {
    "tension": ("tendon", "reference_acceleration", "sensors"),
    "length": ("curvature", "tendon_tension", "sensors"),
}


class Start(NamedTuple):
    """How an episode begins.

    Attributes:
        input: (n_inputs,), of the robot.
        command: (n_tendons,) [N] or [m], what the drives apply.
        posture: Coordinates of the plant, hinge angles [rad] of a chain.
    """

    input: np.ndarray
    command: np.ndarray
    posture: np.ndarray


class Setting:
    """A task and its spaces.

    Attributes:
        task: The task.
        control_period: [s].
        observe_as, act_as: How agents see and act, see `TrackingEnv`.
        observation_space, action_space: Spaces of one robot.
        observed: Space of the observables, which `observation_space` is unless they are shown as a
            vector.
        view: What makes that vector of them, or None.
        change: [1], largest change of an input in a step, over full scale, where actions change
            inputs; None where they are inputs.
        reward: Of a step.
        inputs: Of the robot, and what actions stand for.
        axes: The coordinates out of x, y and z that positions have, a slice of (3,).
        reference: Of the task.
    """

    observation_space: spaces.Dict | spaces.Box
    view: VectorView | None = None
    change: float | None = None

    def __init__(
        self,
        task: Task,
        control_period: float,
        preview: tuple[float, ...],
        observe_as: str,
        act_as: str | None,
        reward: TrackingReward | str | None,
    ) -> None:
        check_timing(control_period, preview)
        check_argument("observe_as", observe_as, Literal[OBSERVE_AS])
        check_argument("act_as", act_as, Literal[ACT_AS] | None)
        learns = observe_as == "vector"
        self.observe_as, self.act_as = observe_as, act_as or ("change" if learns else "input")
        self.reward = reward_of(reward, task.robot, learns)
        self.task, self.control_period, self.axes = task, control_period, AXES[task.axes]
        self.inputs: Inputs = robot_inputs(task.robot)
        self._preview = np.array(preview, dtype=float)

    def _make_spaces(
        self, observe: tuple[str, ...] | str | None, known: tuple[str, ...], sizes: Sizes
    ) -> None:
        if observe is None:
            without = _ASKED_FOR[self.task.robot.drive.kind]
            observe = tuple(name for name in OBSERVABLES if not name.startswith(without))
        self.observed = self.observation_space = observation_space(observe, known, sizes)
        if self.observe_as == "vector":
            self.view = VectorView(self.observed, sizes)
            self.observation_space = self.view.space
        if self.act_as == "change":
            self.change = min(1.0, CHANGE * sizes.frequency * self.control_period)
        self.action_space = spaces.Box(-1.0, 1.0, (sizes.n_inputs,), dtype=np.float32)
        self.reference = self.reference_of(self.task)

    def reference_of(self, task: Task) -> ReferenceTable:
        """The sampled reference of a task.

        Raises:
            ValueError: It is not finite, too far or too fast.
        """
        return sample_reference(task, self.control_period, self._preview)

    @property
    def vector_layout(self) -> dict[str, slice] | None:
        """Slices of the vector by name; None where observations are dicts."""
        return None if self.view is None else self.view.layout

    @property
    def reading(self) -> Reading | None:
        """What a file tells of the vector and of what actions do; None where there is none."""
        if self.view is None:
            return None
        told = {"period": self.control_period, "preview": self._preview}
        return replace(self.view.reading, **told, change=self.change or 0.0)

    def observer(self, sources: Sources, arrays: HostArrays = HOST) -> Callable[[], Seen]:
        """Function that makes a new observation of `arrays`, as the environment is seen."""
        view = self.view
        if view is not None and arrays is not HOST:
            view = view.on(arrays)
        return observer(self.observed, sources, view)

    def wanted(self, action: np.ndarray, previous: np.ndarray) -> np.ndarray:
        """Inputs (..., n_inputs) over full scale that actions ask for.

        Args:
            action: (..., n_inputs), in [-1, 1].
            previous: (..., n_inputs), inputs in force over full scale.
        """
        if self.change is None:
            return action
        return (previous + self.change * action).clip(-1.0, 1.0)

    def action_of(self, inputs: np.ndarray) -> np.ndarray:
        """Inputs (n_inputs,) over full scale."""
        return (inputs - self.inputs.input_centre) / self.inputs.input_scale

    def parse_options(self, options: dict[str, Any] | None) -> ResetOptions:
        """The checked options of a `reset`; raises ValueError."""
        raise NotImplementedError


class SimulatedSetting(Setting):
    """Any robot, simulated: what stands for it may be a twin or a beam model.

    Attributes:
        twin: What is simulated of a robot driven by length, its servos and camera; else None.
        plant: Builds simulations.
        noise_sizes: Of the observables whose sensors can have noise.
        dimensions: Number d of the coordinates that positions have.
        most: (n_tendons,) [N], what drives apply at most; lengths have no bound of their own.
    """

    def __init__(
        self,
        task: str | Task,
        task_options: dict[str, float],
        *,
        robot: str | RobotParams | None = None,
        twin: Twin | int | None = None,
        control_period: float,
        observe: tuple[str, ...] | str | None,
        preview: tuple[float, ...],
        observe_as: str,
        act_as: str | None,
        reward: TrackingReward | str | None,
        plant: PlantFactory | None = None,
        **chain: Any,
    ) -> None:
        """Arguments as those of `TrackingEnv`."""
        check_argument("plant", plant, Callable | None)
        task = make_env_task(task, robot, task_options)
        super().__init__(task, control_period, preview, observe_as, act_as, reward)
        self.twin = _twin_for(twin, self.task)
        built = self.task.robot if self.twin is None else self.twin.robot
        speed = speed_limit(self.task.robot)  # policies do not know the twin
        self._offset = 0.0 if self.twin is None else np.array(self.twin.servo_offset)
        self.plant = plant = _plant(built, control_period, speed, self.axes, plant, chain)
        sizes = sizes_of(
            self.task, plant.layout, plant.pieces, len(preview), plant.directions, plant.strain
        )
        self.noise_sizes = {name: OBSERVABLES[name].space(sizes).shape[0] for name in SENSOR_NOISE}
        self.dimensions = sizes.dimensions
        limits = [tendon.tension_limit for tendon in self.task.robot.tendons]
        self.most = np.array(limits) if self.twin is None else np.full(len(limits), np.inf)
        self._bends = self.noise_sizes["curvature"]
        self._make_spaces(observe, known_of(self.task.robot), sizes)
        self._sensors = built.sensors
        if [(s.kind, s.size) for s in built.sensors] != [
            (s.kind, s.size) for s in self.task.robot.sensors
        ]:
            raise ValueError("a twin needs sensors of the same kinds as the task's robot")

    def servos(self, count: int | None = None) -> Servos | None:
        """Servos of the twin, for one robot or for `count`; None of a robot driven by tension."""
        twin = self.twin
        if twin is None:
            return None
        return Servos(twin.servo_speed, twin.servo_offset, twin.backlash, count)

    def bank(self, count: int = 1) -> "SensorArray | None":
        """Curvature sensors of `count` robots, if they are observed."""
        if "sensors" not in self.observed.spaces:
            return None
        from softrobot_env.sensing.array import SensorArray  # compiled code takes time to load

        return SensorArray(self._sensors, self.plant.cells, self.control_period, count)

    def built_sensors(self, errors: float, seed: int) -> tuple[Sensor, ...]:
        """Sensors of a robot whose specimen is drawn, with a scale of errors [1]."""
        return tuple(sensor.with_imperfections(errors, seed >> 32) for sensor in self._sensors)

    @property
    def is_drawn(self) -> bool:
        """Whether the task is drawn from a seed."""
        return self.task.option("seed") is not None

    def parse_options(self, options: dict[str, Any] | None) -> ResetOptions:
        """See `Setting`."""
        n = self.inputs.n_inputs
        sizes = {"start_input": n, "start_length": n, "start_curvature": self._bends}
        parsed = parse(options, SIMULATED_OPTIONS, sizes)
        if parsed.start_length is not None and self.twin is None:
            raise ValueError(
                "option 'start_length' is for robots driven by length, robot "
                f"{self.task.robot.name!r} is driven by tension: give start_input"
            )
        self.check_variation(parsed.vary)
        return parsed

    def check_variation(self, variation: Mapping[str, Any]) -> None:
        """Raise ValueError for a value, or one of an array, that this robot cannot have."""
        if np.any(np.asarray(variation.get("tension_gain", 1.0)) != 1):
            self._check_gain()
        if np.any(np.asarray(variation.get("sensor_errors", 0.0)) != 0):
            self._check_sensors()

    def check_randomization(self, randomization: Randomization | None) -> None:
        """Raise ValueError for what cannot vary between episodes of this robot."""
        if randomization is not None and tuple(randomization.tension_gain) != (1, 1):
            self._check_gain()
        if randomization is not None and tuple(randomization.sensor_errors) != (0, 0):
            self._check_sensors()

    def _check_sensors(self) -> None:
        if not self.task.robot.sensors:
            raise ValueError(
                f"sensor_errors varies curvature sensors; robot {self.task.robot.name!r} has none"
            )

    def _check_gain(self) -> None:
        if self.twin is not None:
            raise ValueError(
                f"tension_gain varies tensions that drives apply; robot {self.task.robot.name!r} "
                "is driven by length"
            )

    def start(self, options: ResetOptions, task: Task) -> Start:
        """How the options, or else the task, let an episode begin.

        Raises:
            ValueError: A start out of range.
            EquilibriumError: There is no equilibrium there.
        """
        given = options.start_length if options.start_input is None else options.start_input
        chosen = np.array(task.start_input if given is None else given, dtype=float)
        name = "start_input" if options.start_length is None else "start_length"
        check_inputs(self.inputs, chosen, f"option {name!r}")
        command = self.inputs.command(chosen)
        if options.start_curvature is None:
            return Start(chosen, command, self.plant.equilibrium(command + self._offset))
        limit = self.task.robot.curvature_limit
        if np.any(np.abs(options.start_curvature) > limit):
            raise ValueError(f"start_curvature must lie within +-{limit:g} 1/m")
        return Start(chosen, command, self.plant.bent(options.start_curvature))


def _plant(
    robot: RobotParams,
    control_period: float,
    speed: float,
    axes: slice,
    factory: PlantFactory | None,
    chain: dict[str, Any],
) -> MujocoPlant | BeamPlant:
    if factory is None:
        return MujocoPlant(robot, control_period, speed, axes, **chain)
    given = {k: v for k, v in chain.items() if v not in (None, DEFAULT_ACCURACY)}
    if given:
        raise ValueError(
            f"{', '.join(given)} belong to the MuJoCo chain; another plant has its own options"
        )
    return BeamPlant(robot, control_period, factory, speed, axes)


def make_env_task(
    task: str | Task, robot: str | RobotParams | None, options: dict[str, float]
) -> Task:
    """The task of an environment, made if it is a name.

    Raises:
        ValueError: A bad name or option, or options or a robot for a task that is made already.
    """
    check_argument("task", task, str | Task)
    check_argument("robot", robot, str | RobotParams | None)
    if isinstance(task, str):
        return make_task(task, robot=robot, **options)
    if options or robot is not None:
        given = ", ".join([*options, *(["robot"] if robot is not None else [])])
        raise ValueError(f"a task that is made already has its robot and options, got {given}")
    return task


def check_task_options(
    kind: type, task: str | Task, robot: str | RobotParams | None, options: dict[str, float]
) -> None:
    """Raise TypeError for an argument of an environment class that is no option of any task."""
    check_argument("robot", robot, str | RobotParams | None)
    own = options_of(task, robot) if isinstance(task, str) else ()
    for name in options:
        if name not in own and name not in OPTIONS:
            raise unexpected_argument(kind, name, own)


def sizes_of(
    task: Task,
    layout: HingeLayout,
    pieces: int,
    n_preview: int,
    directions: int,
    strain: float = 0.0,
) -> Sizes:
    """What sizes and bounds of a robot's observables depend on.

    They leave room for noise, and for the errors of servos and cameras of any twin.
    """
    robot = task.robot
    common = {
        "robot": robot,
        "layout": layout,
        "pieces": pieces,
        "speed": speed_limit(robot),
        "directions": directions,
        "axes": AXES[task.axes],
        "n_preview": n_preview,
        "n_inputs": robot_inputs(robot).n_inputs,
        "strain": strain,
        "noise": NOISE_ROOM,
    }
    if robot.drive.kind == "tension":
        return Sizes(**common)
    return Sizes(
        **common,
        pulled=float(robot_inputs(robot).input_scale.max()) + LARGEST_ERROR,
        tip_room=FARTHEST * LARGEST_NOISE,
        # Pictures are half a period of the camera apart, or more.
        speed_room=4 * FARTHEST * LARGEST_NOISE / CAMERA_PERIOD,
    )


def _twin_for(twin: Twin | int | None, task: Task) -> Twin | None:
    check_argument("twin", twin, Twin | int | None)
    robot = task.robot
    if robot.drive.kind == "tension":
        if twin is not None:
            raise ValueError(
                f"a twin is a robot whose tendons are wound up by servos; robot {robot.name!r} is "
                "driven by tension (use `vary` or `randomization`)"
            )
        return None
    made = twin_of(robot, twin)
    if len(made.robot.tendons) != len(robot.tendons):
        raise ValueError(
            f"the twin has {len(made.robot.tendons)} tendons, the task's robot {len(robot.tendons)}"
        )
    return made
