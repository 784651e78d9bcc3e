"""Options of all environments: declared, checked and documented in one place."""

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property
from typing import Annotated, Any, Literal

from gymnasium.vector import AutoresetMode

from softrobot_env.core.records import (
    Count,
    NotNegative,
    Positive,
    Range,
    Whole,
    check_argument,
    check_fields,
    whole_numbers,
)
from softrobot_env.robots import Gripper, RobotParams
from softrobot_env.robots.ranges import Pieces
from softrobot_env.robots.twin import Twin
from softrobot_env.scene.assembly import Resolution
from softrobot_env.scene.config import DEFAULT_SHARE
from softrobot_env.tasks import OPTIONS, Maker, Task, defaults, find_maker
from softrobot_env.tasks.gripper import GripTask

from .randomization import Randomization
from .rewards import GripReward, TrackingReward

#: Sides of pictures in pixels; no renderer has more.
MOST_PIXELS = 8192
Pixels = Annotated[int, whole_numbers(1, MOST_PIXELS)]

#: [s].
ControlPeriod = Annotated[float, Range("between 0.001 and 0.2 s", lambda x: 1e-3 <= x <= 0.2)]

#: [s].
DEFAULT_PERIOD = 0.01

AUTORESET_MODES = tuple(mode.value for mode in AutoresetMode)

#: Options accepted by environments: all but the gripper's, simulated ones, those with pictures,
#: vectorised ones, vectorised robots, the real rig, any real robot, and grippers.
TRACKING = ("task", "control_period", "observe", "preview", "lead", "observe_as", "act_as")
TRACKING += ("reward",)
CHAIN = ("pieces", "rule", "timestep", "integrator", "accuracy")
SIMULATED = (*TRACKING, "robot", "twin", "randomization", *CHAIN)
PICTURES = ("render_mode", "width", "height")
MANY = ("num_envs", "threads", "backend", "autoreset_mode", "render_mode")
VECTOR = (*SIMULATED, *MANY, "device", "max_episode_steps")
REAL = (*TRACKING, "port", "robot_file", "line", "tip", "max_missed", "oldest")
REAL_ROBOT = (*REAL, "robot")
GRIPPER = ("task", "control_period", "observe", "observe_as", "reward", "gripper", "fineness")
GRIPPER += ("pieces", "timestep", "backend")


@dataclass(frozen=True)
class EnvConfig:
    """Options of environments, keyword arguments of `gymnasium.make` and `gymnasium.make_vec`.

    Each environment takes those listed in its attribute `takes`, and for a task given by name also
    the options of that task, see `tasks.make_task`.

    Attributes:
        task: A task or its name.
        robot: The robot of a task given by name: an object, a name, or a robot file (*.toml). By
            default the robot that the task is made for.
        twin: For a robot driven by length, the twin that is simulated, or the seed of one with
            errors (`twin.rig3d_twin`). By default the nominal robot.
        control_period: [s], between 1 ms and 200 ms. For the real rig, by default that of the
            robot file; longer than its `state_delay`, and at most half of its watchdog.
        observe: Names of the observables in an observation, or "all": all except `sensors` and
            registered ones, which must be named. By default all except these and tensions, lengths
            and reference_acceleration for a robot driven by tension, and all except curvatures and
            tensions for one driven by length, which is what a lab can measure. On the real rig
            "tendon_tension" needs a board that measures forces. For grippers, names from
            `simulation.grippers.KNOWN`.
        preview: Times [s] ahead of now of `reference_preview`.
        lead: Time [s] ahead of now of `reference_velocity` and `reference_acceleration`, for
            policies that compensate for a delay; not with vectors, whose policies do not support
            it.
        observe_as: "dict", or "vector": one float32 vector of order 1.
        act_as: What actions represent: "input", or "change" of the current inputs. By default
            inputs, with vectors changes.
        reward: Weights and scales of the reward, or a name from `rewards.REWARDS`.
            By default "tracking", with vectors "log"; for grippers a `GripReward`.
        randomization: Ranges of the parameters to vary, sampled by `np_random` at every reset
            without `vary`, and reported in `info["variation_density"]` and so on.
        pieces, rule, timestep, integrator, accuracy: Of the MuJoCo chain, see `SceneConfig`; for
            spatial robots, pieces must be a multiple of the robot's. For a gripper, the pieces of
            each finger and the timestep [s]; by default those of its fineness.
        plant: Factory of the model that is simulated instead of the MuJoCo chain, for example
            `beams.registry.BeamPlant("pcc")`.
        render_mode: None, "rgb_array" or "human"; vectorised environments are not rendered.
        width, height: Size of a frame in pixels.
        num_envs: Number n of environments.
        threads: Size of the thread pool; 0 chooses as many as can be kept busy.
        backend: "mujoco", or "warp" (extra `gpu`), which does not support contacts.
        device: For the backend "warp": "cuda:0" or "cpu"; by default the first CUDA device.
        max_episode_steps: Number of steps after which an episode is truncated, if it has not ended
            before.
        autoreset_mode: One of `AutoresetMode`, or its value.
        gripper: A name from `GRIPPERS`, the path of a file, or a gripper.
        fineness: A name from `scene.assembly.FINENESS`: "quick" has few pieces and long
            timesteps, with a mean error of 1 degree in bends; "rule" follows the rule for
            contacts, and is 50 times slower (`softrobot benchmark gripper`).
        port: Serial port instead of the robot file's.
        robot_file: Calibration and limits of a board or of motors, or the path of their TOML file;
            by default the table `[hardware]` of the robot's file, or the rig's default.
        line: Opens the connection to the hardware, instead of the serial port.
        tip: Source of tip measurements (`hardware.tip.TipSource`), instead of that of the robot
            file.
        max_missed: Control periods that may be missed in an episode.
        oldest: [s], largest age of a measurement that is still accepted.
        task_options: Options of a task given by name.
    """

    task: str | Task | GripTask = "swing"
    robot: str | RobotParams | None = None
    twin: Twin | int | None = None
    control_period: ControlPeriod | None = DEFAULT_PERIOD
    observe: object = None  # names, checked where the known ones are available
    preview: tuple[NotNegative, ...] = (0.05, 0.1, 0.2, 0.4)
    lead: NotNegative = 0.0
    observe_as: Literal["dict", "vector"] = "dict"
    act_as: Literal["input", "change"] | None = None
    reward: TrackingReward | GripReward | str | None = None
    randomization: Randomization | None = None
    pieces: Pieces | tuple[Pieces, ...] | None = None
    rule: str | None = None
    timestep: Positive | None = None
    integrator: str | None = None
    accuracy: float | str = DEFAULT_SHARE
    plant: Callable[..., Any] | None = None
    render_mode: str | None = None
    width: Pixels = 640
    height: Pixels = 480
    num_envs: Count = 1
    threads: Whole = 0
    backend: Literal["mujoco", "warp"] = "mujoco"
    device: str | None = None
    max_episode_steps: Count | None = None
    autoreset_mode: AutoresetMode | Literal[AUTORESET_MODES] = AutoresetMode.NEXT_STEP
    gripper: str | Gripper = "gripper"
    fineness: str | Resolution = "quick"
    port: str | None = None
    robot_file: object = None  # and `tip`: their types take time to load
    line: Callable[..., Any] | None = None
    tip: object = None
    max_missed: Whole = 25
    oldest: Positive = 0.1
    task_options: dict[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        check_fields(self, "environment")
        if not self.preview:
            raise ValueError("environment: preview needs one or more times, got none")
        if self.lead and self.is_for_learning:
            raise ValueError(f"environment: lead must be 0 with vectors, got {self.lead!r}")

    @classmethod
    def of(cls, kind: type, options: dict[str, Any]) -> "EnvConfig":
        """The options given to an environment class.

        Raises:
            ValueError: An option is out of range; the message names what is allowed.
            TypeError: Neither the class nor any task has this option.
        """
        rest = {**kind.usual, **options}
        config = cls(**{n: rest.pop(n) for n in kind.takes if n in rest}, task_options=rest)
        own, known = (), () if "gripper" in kind.takes else OPTIONS
        if known and isinstance(config.task, str):
            own = tuple(defaults(config.maker))
        for name in rest:
            if name not in own and name not in known:
                raise TypeError(
                    f"{kind.__name__}.__init__() got an unexpected keyword argument {name!r}; "
                    f"allowed are {', '.join(dict.fromkeys([*kind.takes, *own]))}"
                )
        modes = tuple(kind.metadata["render_modes"])
        check_argument(
            "render_mode", config.render_mode, Literal[modes] | None if modes else type(None)
        )
        return config

    @cached_property
    def maker(self) -> Maker:
        """The factory of the task given by name; raises ValueError like `tasks.find_maker`."""
        return find_maker(self.task, self.robot)

    @property
    def is_for_learning(self) -> bool:
        """Whether agents see vectors, which changes the default rewards and actions."""
        return self.observe_as == "vector"
