"""Tip tracking with the spatial test rig, its servos and its camera."""

from dataclasses import replace
from typing import Any, ClassVar

import numpy as np
from gymnasium import spaces

from softrobot_env.envs.base import EpisodeEnv
from softrobot_env.envs.disturbances import noise_seed
from softrobot_env.envs.observations.arm import observation_space
from softrobot_env.envs.observations.rig import (
    DEFAULT_RIG_OBSERVABLES,
    REFERENCE_ACCELERATION,
    RIG_OBSERVABLES,
    RigSizes,
)
from softrobot_env.envs.observations.rig_readout import Camera, CameraReadout, RigReadout
from softrobot_env.envs.options import check_arguments, check_render_mode
from softrobot_env.envs.reference import TOP, sample_reference
from softrobot_env.envs.rendering.lifting import lifted
from softrobot_env.envs.rewards import TrackingReward
from softrobot_env.envs.rig_options import RigResetOptions, parse_rig_options
from softrobot_env.envs.simulation.mujoco import Simulation
from softrobot_env.envs.simulation.mujoco_plant import MujocoPlant
from softrobot_env.envs.simulation.servos import Servos
from softrobot_env.interfaces import Observation
from softrobot_env.robots import LENGTH_SCALE, RIG
from softrobot_env.robots.twin import Twin, nominal_twin, rig3d_twin, twin_or_ideal
from softrobot_env.scene.registry import RIG_PIECES
from softrobot_env.tasks.rig import RigTask, make_rig_task, remake_rig_task


class RigEnv(EpisodeEnv):
    """Move the tip of the spatial test rig along a reference in x and y.

    The action is a vector in [-1, 1], one entry per tendon. Times `length_scale` [m] it is the
    length that a servo is to pull in, from the straight pose on, held for one `control_period`.
    Servos have a limited speed and what else the twin says (`envs.servos`); a tendon that
    slackens pulls no more, and none pulls more than its limit. The dry friction of a twin's tendons
    is not part of the tension and acts on slack tendons too: there it can push.

    Observations are a dict of float64 vectors in SI units; positions are (x, y) of the head's
    output point. The bounds of the space leave room for the errors of any twin:

    | key | size | what | unit |
    |---|---|---|---|
    | tip_position, tip_velocity | 2 | tip, as the camera sees it | m, m/s |
    | curvature, curvature_rate | 2 x pieces | (beta, gamma), mean over each piece | 1/m, 1/(m s) |
    | tendon_length | tendons | pulled in, as the servos' potentiometers read | m |
    | tendon_tension | tendons | applied tension | N |
    | reference, reference_velocity, reference_acceleration | 2 | reference now | m, m/s, m/s2 |
    | reference_preview | 2 x preview | reference after each of the `preview` times | m |
    | previous_action | tendons | action of the step before | 1 |

    A camera without noise and delay sees the true position and velocity. Otherwise it takes a
    picture every `twin.FRAME` (90 a second, or one per control period where that is longer), each
    at the control instant that follows, the velocity is the difference of its last two over the
    time between them, and `info` holds the true tip_position. Potentiometers know neither offset
    nor play of a servo. Curvature and tension have no sensor on the rig; they are exact.

    Rewards and their terms, `truncated`, `terminated` and `info["failure"]` are those of
    `TrackingEnv`: an episode fails when the simulation diverged or a piece of the chain bent
    sharper than 1 / outer radius. `info` holds the true error [m], time [s], tendon tension [N],
    tendon length [m] pulled in by the servos' horns, and reward terms.

    Attributes:
        task: The task, `task.robot` its nominal robot.
        twin: The rig that is simulated; policies are not meant to look.
        control_period: [s].
        length_scale: [m], pulled in by a full-scale action.
        model, data: The MuJoCo objects of the scene.
    """

    metadata: ClassVar = {"render_modes": ["rgb_array", "human"], "render_fps": 50}
    axes = TOP
    length_scale = LENGTH_SCALE

    def __init__(
        self,
        task: str | RigTask = "triangle",
        *,
        twin: Twin | int | None = None,
        control_period: float = 0.02,
        observe: tuple[str, ...] | str = DEFAULT_RIG_OBSERVABLES,
        preview: tuple[float, ...] = (0.05, 0.1, 0.2, 0.4),
        reward: TrackingReward | None = None,
        pieces: int = RIG_PIECES,
        rule: str = "balanced2",
        timestep: float | None = None,
        integrator: str | None = None,
        render_mode: str | None = None,
        width: int = 640,
        height: int = 480,
        **task_options: float,
    ) -> None:
        """Build the environment.

        Args:
            task: Task or its name.
            twin: The rig that is simulated, or the seed of one (`twin.rig3d_twin`) where the task's
                robot is `RIG`. Unless given, a rig without errors: the task's robot as its
                parameters say, or for `RIG` `robots.EQUIVALENT_RIG`, which stands as the thesis'
                model of one piece with these parameters does.
            control_period: [s], between 1 ms and 200 ms.
            observe: Names of the observables in an observation, or "all".
            preview: Times [s] ahead of now of `reference_preview`.
            reward: Weights and scales of the reward.
            pieces, rule, timestep, integrator: Of the MuJoCo chain, see `SceneConfig`; pieces must
                be a multiple of the robot's.
            render_mode: None, "rgb_array" or "human".
            width, height: Size of a frame in pixels.
            **task_options: Of a task given by name, see `rig_tasks.make_rig_task`.

        Raises:
            ValueError: An argument out of range; the message names what is allowed.
        """
        self.task = _make_task(task, task_options)
        self.twin = _make_twin(twin, self.task)
        observe = (observe,) if isinstance(observe, str) and observe != "all" else observe
        check_arguments(control_period, preview, (width, height))
        check_render_mode(render_mode, self.metadata["render_modes"])
        self.control_period = control_period
        self.render_mode = render_mode
        self.metadata = {**self.metadata, "render_fps": max(1, round(1 / control_period))}
        self._reward = TrackingReward() if reward is None else reward
        self._preview = np.array(preview, dtype=float)
        self._frame_size, self._renderer = (width, height), None
        chain = {"pieces": pieces, "rule": rule, "timestep": timestep, "integrator": integrator}
        self._plant, self._servos = _make_plant(self.twin, control_period, chain)
        self._make_spaces(tuple(RIG_OBSERVABLES) if observe == "all" else tuple(observe))
        self._camera: Camera | None = None
        self._current: RigTask | None = None
        self._install(self._plant.simulation({}))
        self._follow(self.task)
        self._running = False
        self._episode = 0
        self._last_observation: Observation | None = None

    def _make_spaces(self, observe: tuple[str, ...]) -> None:
        layout, robot = self._plant.layout, self.twin.robot
        sizes = RigSizes(robot, layout, len(self._preview), self.length_scale)
        self.observation_space = observation_space(observe, sizes, RIG_OBSERVABLES)
        self._n_inputs = sizes.n_tendons
        self._action_shape = (self._n_inputs,)
        self.action_space = spaces.Box(-1.0, 1.0, self._action_shape, dtype=np.float32)

    # ------------------------------------------------------------------ simulation

    def _install(self, simulation: Simulation) -> None:
        """Connect to a simulation's data, so that a step looks nothing up."""
        self._simulation = simulation
        self.model, self.data = simulation.model, simulation.data
        self._ctrl, self._times = simulation.ctrl, simulation.step_times
        readout = RigReadout(simulation, self.twin.robot, self._servos)
        self._readout = readout if self._camera is None else CameraReadout(readout, self._camera)

    def __setstate__(self, state: dict) -> None:
        self.__dict__.update(state)
        self._renderer = None
        self._plant.adopt(self._simulation)
        self._install(self._simulation)
        if self._last_observation is not None:
            self._bind_observation(self._index + 1)

    def _follow(self, task: RigTask) -> None:
        """Make a task's reference the current one."""
        if task == self._current:
            return
        reference = sample_reference(task, self.control_period, self._preview, self.axes)
        fastest = REFERENCE_ACCELERATION * task.robot.reach
        if not np.abs(reference.acceleration).max() <= fastest:
            raise ValueError(
                f"the acceleration of task {task.label!r} must be finite and below {fastest} m/s2"
            )
        self._reference = reference
        self._points, self._last_index = reference.points, reference.last_index
        self._current = task

    def _pull(self, action: np.ndarray, _ctrl: np.ndarray) -> None:
        self._horns = self._servos.move(self.length_scale * action, self._times)

    def _advance(self) -> bool:
        return self._simulation.advance_through(self._horns)

    # ------------------------------------------------------------------ episodes

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Observation, dict[str, Any]]:
        """Start an episode at rest.

        Args:
            seed: Seed of `np_random`. Only the noise of a twin's camera draws from it.
            options: See `softrobot_env.envs.rig_options.OPTIONS`; each holds for this episode only.

        Raises:
            ValueError: A bad option; the message names what is allowed.
            EquilibriumError: There is no equilibrium at the start's tendon lengths.
        """
        super().reset(seed=seed)
        parsed = parse_rig_options(options, self._n_inputs, self.length_scale)
        # Everything that can be refused comes before anything is changed.
        task = self._task_for(parsed)
        given = parsed.start_length
        start = np.array(task.start_length if given is None else given, dtype=float)
        posture = self._plant.equilibrium(start + np.array(self.twin.servo_offset))
        self._follow(task)
        self._begin(start, posture)
        if self.render_mode == "human":
            self.render()
        return self._last_observation, self._info({})

    def _task_for(self, options: RigResetOptions) -> RigTask:
        task = self.task
        if options.task:
            task = remake_rig_task(task, **options.task)
        return task if options.duration is None else replace(task, duration=options.duration)

    def _begin(self, start: np.ndarray, posture: np.ndarray) -> None:
        self._servos.start(start)
        self._simulation.reset(posture, self._servos.horn)
        self._camera = self._make_camera()
        self._install(self._simulation)
        if self._camera is not None:
            self._camera.start(np.array(self._readout.tip))
        self._action_array = start / self.length_scale
        self._action = self._action_array.tolist()
        self._rows = self._reference.rows()
        self._index = 0
        self._episode += 1
        self._bind_observation(0)
        self._running = True
        self._measure()
        self._last_observation = {name: read() for name, read in self._readers}

    def _make_camera(self) -> Camera | None:
        """The camera of an episode; None without errors, and then nothing is drawn."""
        twin = self.twin
        delay = round(twin.camera_delay / self.control_period)
        if twin.camera_noise == 0 and delay == 0:
            return None
        seed = noise_seed(self.np_random) if twin.camera_noise else 0
        return Camera(twin.camera_noise, delay, self.control_period, seed)

    def _truth(self) -> dict[str, np.ndarray]:
        return {} if self._camera is None else self._readout.truth()

    # ------------------------------------------------------------------ pictures

    def _in_space(self, point: np.ndarray) -> np.ndarray:
        return lifted(self.task.robot, point[None])[0]

    def _path(self) -> np.ndarray:
        return lifted(self.task.robot, self._current.trajectory.path()[:, self.axes])


def _make_task(task: str | RigTask, options: dict[str, float]) -> RigTask:
    if isinstance(task, str):
        return make_rig_task(task, **options)
    if options:
        raise ValueError(f"options of a task need its name, got a task and {', '.join(options)}")
    return task


def _make_twin(twin: Twin | int | None, task: RigTask) -> Twin:
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


def _make_plant(
    twin: Twin, control_period: float, chain: dict[str, Any]
) -> tuple[MujocoPlant, Servos]:
    """The chain that is simulated, and the servos that drive it."""
    plant = MujocoPlant(twin.robot, control_period, bending="spatial", actuation="length", **chain)
    return plant, Servos(twin.servo_speed, twin.servo_offset, twin.backlash)
