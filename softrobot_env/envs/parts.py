"""The constant parts of an environment: task, plant, spaces, starts.

Single and vectorised environments of a robot use the same parts.
"""

from collections.abc import Iterable, Mapping
from copy import copy
from dataclasses import replace
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from gymnasium import spaces
from gymnasium.envs.registration import EnvSpec
from numpy import ndarray

from softrobot_env.core.records import check_argument
from softrobot_env.core.vector_reading import Reading
from softrobot_env.robots import CAMERA_PERIOD, VARIATIONS, RobotParams, Sensor
from softrobot_env.robots.actuation import Inputs, check_inputs, robot_inputs
from softrobot_env.robots.twin import LARGEST_ERROR, LARGEST_NOISE, Twin, twin_of
from softrobot_env.scene.config import DEFAULT_SHARE
from softrobot_env.scene.servos import Servos
from softrobot_env.tasks import Task, made_by

from .config import CHAIN, ControlPeriod, EnvConfig
from .disturbances import periods
from .observations.readouts import FARTHEST, NOISE_ROOM, Camera, Cameras
from .observations.table import (
    OBSERVABLES,
    SENSOR_NOISE,
    Sizes,
    VectorView,
    entries,
    known_of,
    observation_space,
    speed_limit,
    usual_of,
)
from .options import SIMULATED_OPTIONS, ResetOptions
from .options import parse_options as parse
from .randomization import incompatibility
from .reference import AXES, ReferenceTable, sample_reference
from .rewards import reward_of
from .simulation.plants import BeamPlant, MujocoPlant

if TYPE_CHECKING:
    from softrobot_env.sensing.array import SensorArray

#: Largest change of an input in a step, over full scale, if actions change inputs: this share of
#: full scale in the time in which the phase of the first mode advances by 1 rad.
CHANGE = 1.0


class EpisodeSpec:
    """The attribute `spec`, with the number of steps of the environment's episodes.

    Episodes end by themselves, so the registry adds no wrapper that truncates them. Their length
    depends on the options: `spec.max_episode_steps` is the environment's own `max_episode_steps`,
    that of episodes without the reset option `duration`.
    """

    def __get__(self, env: Any, _kind: type) -> EnvSpec | None:
        return None if env is None else env.__dict__.get("_spec")

    def __set__(self, env: Any, spec: EnvSpec | None) -> None:
        env._spec = spec = copy(spec)
        if spec is not None:
            spec.max_episode_steps = env.max_episode_steps


class Start(NamedTuple):
    """How an episode begins.

    Attributes:
        input: (n_inputs,), inputs of the robot.
        action: (n_inputs,), the same over full scale.
        command: (n_tendons,) [N] or [m], what the drives apply.
        posture: Coordinates of the plant, hinge angles [rad] of a chain.
    """

    input: ndarray
    action: ndarray
    command: ndarray
    posture: ndarray


class Beginning(NamedTuple):
    """The task of an episode that begins, its reference, and the robot's start."""

    task: Task
    reference: ReferenceTable
    start: Start


class EnvParts:
    """A task and its spaces.

    Attributes:
        config: The options.
        task: The task.
        control_period: [s].
        observe_as, act_as: Format of observations and meaning of actions, see `EnvConfig`.
        observation_space, action_space: Spaces of one robot.
        observed: Space of the observables, equal to `observation_space` unless they are shown as a
            vector.
        view: Converts them to that vector, or None.
        change: [1], largest change of an input in a step, over full scale, if actions change
            inputs; None if they are inputs.
        reward: Of a step.
        inputs: Of the robot, represented by actions.
        axes: Coordinates of positions among x, y and z, a slice of (3,).
        reference: Of the task.
    """

    observation_space: spaces.Dict | spaces.Box
    view: VectorView | None = None
    change: float | None = None

    def __init__(self, config: EnvConfig, task: Task, control_period: float | None) -> None:
        check_argument("control_period", control_period, ControlPeriod)
        self.config, self.task, self.control_period = config, task, control_period
        self.observe_as = config.observe_as
        self.act_as = config.act_as or ("change" if config.is_for_learning else "input")
        self.reward = reward_of(config.reward, task.robot, config.is_for_learning)
        self.axes = AXES[task.axes]
        self.inputs: Inputs = robot_inputs(task.robot)
        self._preview = np.array(config.preview, float)

    def _make_spaces(
        self, observe: tuple[str, ...] | str | None, known: tuple[str, ...], sizes: Sizes
    ) -> None:
        if observe is None:
            observe = usual_of(self.task.robot)
        self.observed = self.observation_space = observation_space(observe, known, sizes)
        if self.observe_as == "vector":
            self.view = VectorView(self.observed, entries(self.observed, sizes))
            self.observation_space = self.view.space
        if self.act_as == "change":
            self.change = min(1.0, CHANGE * sizes.frequency * self.control_period)
        self.action_space = spaces.Box(-1.0, 1.0, (sizes.n_inputs,), dtype=np.float32)
        self.reference = self._sampled(self.task)

    def reference_of(self, task: Task) -> ReferenceTable:
        """The sampled reference of a task.

        Raises:
            ValueError: It is not finite, out of reach or too fast.
        """
        if task == self.task:
            return self.reference
        return self._sampled(task)

    def _sampled(self, task: Task) -> ReferenceTable:
        return sample_reference(task, self.control_period, self._preview, self.config.lead)

    @property
    def vector_layout(self) -> dict[str, slice] | None:
        """Slices of the vector by name; None where observations are dicts."""
        return None if self.view is None else self.view.layout

    @property
    def reading(self) -> Reading | None:
        """Description, for files, of the vector and of the actions; None without a vector."""
        if self.view is None:
            return None
        own = {"period": self.control_period, "preview": self._preview}
        return replace(self.view.reading, **own, change=self.change or 0.0)

    def wanted(self, action: ndarray, previous: ndarray) -> ndarray:
        """Inputs (..., n_inputs) over full scale requested by actions.

        Args:
            action: (..., n_inputs), in [-1, 1].
            previous: (..., n_inputs), current inputs over full scale.
        """
        if self.change is None:
            return action
        return (previous + self.change * action).clip(-1.0, 1.0)

    def parse_options(self, options: dict[str, Any] | None) -> ResetOptions:
        """The checked options of a `reset`; raises ValueError."""
        raise NotImplementedError

    def show_in(self, env: Any) -> None:
        """Set the attributes that all kinds of environments have."""
        env._parts, env._reward = self, self.reward
        env.task, env.axes, env.control_period = self.task, self.axes, self.control_period
        env.vector_layout, env.reading = self.vector_layout, self.reading
        env.observe_as, env.act_as = self.observe_as, self.act_as
        env.input_scale, env.max_episode_steps = self.inputs.input_scale, self.reference.last_index
        env.observation_space, env.action_space = self.observation_space, self.action_space


class SimulatedParts(EnvParts):
    """Any simulated robot; the simulation may be a twin or a beam model.

    Attributes:
        twin: Twin of a robot driven by length, with its servos and camera; else None.
        plant: Builds simulations.
        noise_sizes: Sizes of the observables whose sensors can have noise.
        dimensions: Number d of the coordinates of positions.
        most: (n_tendons,) [N], largest tension of drives; lengths are not bounded here.
        is_resampled: Whether the task is sampled from a new seed for every episode.
    """

    def __init__(self, config: EnvConfig) -> None:
        super().__init__(config, make_env_task(config), config.control_period)
        self.twin = _twin_for(self.task.robot, config.twin)
        built = self.task.robot if self.twin is None else self.twin.robot
        self._rest: Start | None = None
        self._offset = 0.0 if self.twin is None else self.twin.rest_offset
        # The twin is unknown to policies.
        self.plant = plant = _plant(config, built, speed_limit(self.task.robot), self.axes)
        sizes = with_room(plant.sizes, self.task.robot, len(self._preview))
        self.noise_sizes = {name: OBSERVABLES[name].space(sizes).shape[0] for name in SENSOR_NOISE}
        self.dimensions = sizes.dimensions
        limits = self.task.robot.of_tendons("tension_limit")
        self.most = limits if self.twin is None else np.full(len(limits), np.inf)
        self.bends = self.noise_sizes["curvature"]
        self._make_spaces(config.observe, known_of(self.task.robot), sizes)
        self._sensors = built.sensors
        if [(s.kind, s.size) for s in built.sensors] != [
            (s.kind, s.size) for s in self.task.robot.sensors
        ]:
            raise ValueError("a twin needs sensors of the same kinds as the task's robot")
        by_name = isinstance(config.task, str) and "seed" not in config.task_options
        self.is_resampled = by_name and self.task.option("seed") is not None
        if config.randomization is not None:
            self.check_varied(config.randomization.varied)

    def servos(self, count: int | None = None) -> Servos | None:
        """Servos of the twin, for one robot or `count`; None for a robot driven by tension."""
        twin = self.twin
        if twin is None:
            return None
        return Servos.of(twin, self.control_period, count)

    def sensors(self, count: int = 1) -> "SensorArray | None":
        """Curvature sensors of `count` robots, if they are observed."""
        if "sensors" not in self.observed.spaces:
            return None
        from softrobot_env.sensing.array import SensorArray  # compiled code takes time to load

        return SensorArray(self._sensors, self.plant.cells, self.control_period, count)

    def cameras(self, count: int | None = None) -> Camera | Cameras | None:
        """Camera of the twin, for one robot or `count`; None without errors."""
        twin = self.twin
        delay = 0 if twin is None else round(twin.camera_delay / self.control_period)
        if twin is None or (twin.camera_noise == 0 and delay == 0):
            return None
        how = twin.camera_noise, delay, self.control_period, self.dimensions
        return Camera(*how) if count is None else Cameras(count, *how)

    def built_sensors(self, errors: float, seed: int) -> tuple[Sensor, ...]:
        """Sensors with sampled deviations from the nominal ones, with a scale of errors [1]."""
        return tuple(sensor.with_imperfections(errors, seed >> 32) for sensor in self._sensors)

    def parse_options(self, options: dict[str, Any] | None) -> ResetOptions:
        """See `EnvParts`."""
        n = self.inputs.n_inputs
        sizes = {"start_input": n, "start_length": n, "start_curvature": self.bends}
        parsed = parse(options, SIMULATED_OPTIONS, sizes)
        if parsed.start_length is not None and self.twin is None:
            raise ValueError(
                "option 'start_length' is for robots driven by length, robot "
                f"{self.task.robot.name!r} is driven by tension: give start_input"
            )
        self.check_variation(parsed.vary)
        periods(parsed.vary.get("delay", 0.0), self.control_period)
        return parsed

    def check_variation(self, variation: Mapping[str, Any]) -> None:
        """Raise ValueError for a value, or an array with a value, that this robot cannot have."""
        self.check_varied(
            name
            for name, value in variation.items()
            if np.any(np.asarray(value) != VARIATIONS[name].neutral)
        )

    def check_varied(self, names: Iterable[str]) -> None:
        """Raise ValueError for parameters that cannot vary for this robot."""
        for name in names:
            why = incompatibility(name, self.task.robot)
            if why is not None:
                raise ValueError(why)

    def is_sampled(self, options: ResetOptions) -> bool:
        """Whether every episode with these options samples a new task."""
        return self.is_resampled and "seed" not in options.task

    def sampled(self, options: ResetOptions, generator: np.random.Generator) -> ResetOptions:
        """Options with the seed of a sampled task; its duration is kept."""
        if not self.is_sampled(options):
            return options
        task = options.task | {"seed": int(generator.integers(2**31))}
        return replace(options, task=task, duration=options.duration or self.task.duration)

    def beginning(self, options: ResetOptions) -> Beginning:
        """The beginning of an episode with these options.

        Raises:
            ValueError: An option that the task does not have, or a value out of range.
            EquilibriumError: There is no equilibrium at the start.
        """
        task = options.changed(self.task)
        return Beginning(task, self.reference_of(task), self._start(options, task))

    def _start(self, options: ResetOptions, task: Task) -> Start:
        """The start given by the options, or else the task; most starts equal the previous one.

        Raises:
            ValueError: A start out of range.
            EquilibriumError: There is no equilibrium at this start.
        """
        given = options.start_length if options.start_input is None else options.start_input
        chosen = np.array(task.start_input if given is None else given, float)
        bent = options.start_curvature
        if bent is None and self._rest is not None and np.array_equal(chosen, self._rest.input):
            return self._rest
        name = "start_input" if options.start_length is None else "start_length"
        check_inputs(self.inputs, chosen, f"option {name!r}")
        command, action = self.inputs.command(chosen), self.inputs.to_actions(chosen)
        if bent is None:
            posture = self.plant.equilibrium(command + self._offset)
            self._rest = Start(chosen, action, command, posture)
            for array in self._rest:
                array.flags.writeable = False
            return self._rest
        limit = self.task.robot.curvature_limit
        if np.any(np.abs(bent) > limit):
            raise ValueError(f"start_curvature must lie within +-{limit:g} 1/m")
        return Start(chosen, action, command, self.plant.bent(bent))


def _plant(
    config: EnvConfig, robot: RobotParams, speed: float, axes: slice
) -> MujocoPlant | BeamPlant:
    chain, period = {name: getattr(config, name) for name in CHAIN}, config.control_period
    if config.plant is None:
        return MujocoPlant(robot, period, speed, axes, **chain)
    given = [name for name, value in chain.items() if value not in (None, DEFAULT_SHARE)]
    if given:
        raise ValueError(
            f"{', '.join(given)} belong to the MuJoCo chain; another plant has its own options"
        )
    return BeamPlant(robot, period, config.plant, speed, axes)


def make_env_task(config: EnvConfig) -> Task:
    """The task of an environment, made if it is a name.

    Raises:
        ValueError: A bad name or option, or options or a robot given for a finished task.
    """
    task, options = config.task, config.task_options
    check_argument("task", task, str | Task)
    if isinstance(task, str):
        return made_by(config.maker, task, options)
    if options or config.robot is not None:
        given = ", ".join([*options, *(["robot"] if config.robot is not None else [])])
        raise ValueError(f"a task that is made already has its robot and options, got {given}")
    return task


def with_room(sizes: Sizes, robot: RobotParams, n_preview: int) -> Sizes:
    """The `Sizes` of a robot's observables, with its actions and previews.

    They include margins for noise, and for the errors of servos and cameras of any twin.
    """
    inputs = robot_inputs(robot)
    own = {"robot": robot, "n_preview": n_preview, "n_inputs": inputs.n_inputs, "noise": NOISE_ROOM}
    if robot.drive.kind == "tension":
        return replace(sizes, **own)
    return replace(
        sizes,
        **own,
        pulled=float(inputs.input_scale.max()) + LARGEST_ERROR,
        tip_room=FARTHEST * LARGEST_NOISE,
        # Pictures are at least half a camera period apart.
        speed_room=4 * FARTHEST * LARGEST_NOISE / CAMERA_PERIOD,
    )


def _twin_for(robot: RobotParams, given: Twin | int | None) -> Twin | None:
    """The twin of a robot driven by length; None for one driven by tension."""
    if robot.drive.kind == "tension":
        if given is not None:
            raise ValueError(
                f"a twin is a robot whose tendons are wound up by servos; robot {robot.name!r} is "
                "driven by tension (use `vary` or `randomization`)"
            )
        return None
    made = twin_of(robot, given)
    if len(made.robot.tendons) != len(robot.tendons):
        raise ValueError(
            f"the twin has {len(made.robot.tendons)} tendons, the task's robot {len(robot.tendons)}"
        )
    return made
