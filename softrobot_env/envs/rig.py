"""Tip tracking with the spatial test rig, its servos and its camera."""

from typing import ClassVar

import gymnasium
import numpy as np

from softrobot_env.envs.base import EpisodeEnv
from softrobot_env.envs.disturbances import noise_seed
from softrobot_env.envs.observations.camera import Camera, filmed
from softrobot_env.envs.observations.table import DEFAULT_RIG_OBSERVABLES, Measured
from softrobot_env.envs.options import ResetOptions
from softrobot_env.envs.rendering.renderer import lifted
from softrobot_env.envs.rewards import TrackingReward
from softrobot_env.envs.setting import (
    DEFAULT_ACCURACY,
    LengthSetting,
    Start,
    check_task_options,
)
from softrobot_env.interfaces import Observation
from softrobot_env.robots import LENGTH_SCALE
from softrobot_env.robots.twin import Twin
from softrobot_env.scene.registry import RIG_PIECES
from softrobot_env.scene.servos import Servos
from softrobot_env.scene.simulation import Simulation
from softrobot_env.tasks import Task


# Learning libraries tell environments by their direct bases: `gymnasium.Env` is one of them.
class RigEnv(EpisodeEnv, gymnasium.Env[Observation, np.ndarray]):
    """Move the tip of the spatial test rig along a reference in x and y.

    The action is a vector in [-1, 1], one entry per tendon. Times `length_scale` [m] it is the
    length that a servo is to pull in, from the straight pose on, held for one `control_period`.
    Servos have a limited speed and what else the twin says (`scene.servos`); a tendon that
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
    length_scale = LENGTH_SCALE

    def __init__(
        self,
        task: str | Task = "triangle",
        *,
        twin: Twin | int | None = None,
        control_period: float = 0.02,
        observe: tuple[str, ...] | str = DEFAULT_RIG_OBSERVABLES,
        preview: tuple[float, ...] = (0.05, 0.1, 0.2, 0.4),
        reward: TrackingReward | None = None,
        pieces: int = RIG_PIECES,
        rule: str | None = None,
        timestep: float | None = None,
        integrator: str | None = None,
        accuracy: float | str = DEFAULT_ACCURACY,
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
            pieces, rule, timestep, integrator, accuracy: Of the MuJoCo chain, see `SceneConfig`;
                pieces must be a multiple of the robot's.
            render_mode: None, "rgb_array" or "human".
            width, height: Size of a frame in pixels.
            **task_options: Of a task given by name, see `tasks.make_task`.

        Raises:
            ValueError: An argument out of range; the message names what is allowed.
            TypeError: An unknown argument.
        """
        check_task_options(type(self), task, task_options)
        setting = LengthSetting(
            task,
            task_options,
            twin,
            control_period=control_period,
            observe=observe,
            preview=preview,
            pieces=pieces,
            rule=rule,
            timestep=timestep,
            integrator=integrator,
            accuracy=accuracy,
        )
        self.twin = twin = setting.twin
        self._servos = Servos(twin.servo_speed, twin.servo_offset, twin.backlash)
        self._camera: Camera | None = None
        super().__init__(setting, reward, render_mode, (width, height))

    def _make_readout(self, simulation: Simulation) -> Measured:
        simulation.drive_by(self._servos)
        readout = self._setting.plant.readout(simulation, self._servos)
        return readout if self._camera is None else filmed(readout, self._camera)

    def _move(self, action: np.ndarray) -> bool:
        np.multiply(action, self.length_scale, out=self._servos.command)
        return self._advance()

    def _start(self, options: ResetOptions, start: Start) -> None:
        self._servos.start(start.input)
        self._simulation.reset(start.posture, self._servos.horn)
        self._camera = self._make_camera()
        self._install(self._simulation)
        if self._camera is not None:
            self._camera.start(np.array(self._readout.tip))

    def _make_camera(self) -> Camera | None:
        """The camera of an episode; None without errors, and then nothing is drawn."""
        twin = self.twin
        delay = round(twin.camera_delay / self.control_period)
        if twin.camera_noise == 0 and delay == 0:
            return None
        seed = noise_seed(self.np_random) if twin.camera_noise else 0
        return Camera(twin.camera_noise, delay, self.control_period, seed)

    def _in_space(self, points: np.ndarray) -> np.ndarray:
        return lifted(self.task.robot, points)
