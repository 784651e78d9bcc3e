"""Tip tracking with one simulated robot."""

from dataclasses import replace
from typing import Any

import gymnasium
import numpy as np

from softrobot_env.core.interfaces import PlantFactory, Seen
from softrobot_env.core.records import check_argument
from softrobot_env.envs.base import EpisodeEnv
from softrobot_env.envs.disturbances import (
    NEUTRAL,
    Drives,
    SensorNoise,
    noise_seed,
    rounded,
    split,
    told_variation,
)
from softrobot_env.envs.observations.camera import Camera, filmed
from softrobot_env.envs.observations.readouts import fitted, noisy
from softrobot_env.envs.observations.table import Measured
from softrobot_env.envs.options import ResetOptions
from softrobot_env.envs.randomization import Randomization
from softrobot_env.envs.rewards import TrackingReward
from softrobot_env.envs.setting import (
    DEFAULT_ACCURACY,
    SimulatedSetting,
    Start,
    check_task_options,
)
from softrobot_env.envs.simulation.beam_plant import BeamSimulation
from softrobot_env.robots import RobotParams
from softrobot_env.robots.twin import Twin
from softrobot_env.scene.simulation import Simulation
from softrobot_env.tasks import Task

#: [s].
DEFAULT_PERIOD = 0.01


# Learning libraries tell environments by their direct bases: `gymnasium.Env` is one of them.
class TrackingEnv(EpisodeEnv, gymnasium.Env[Seen, np.ndarray]):
    """Move the tip of a tendon-driven robot along a reference.

    The action is a vector in [-1, 1], held for one `control_period`, and stands for the inputs of
    the robot (`robots.actuation`). Of a robot driven by tension these are reduced ones [N], such as
    (6.5): each group of opposing tendons has one that bends it to either side of a plane, or two
    that bend it in space; the redundancy is resolved by least tensions, so tendons never push. Of
    a robot driven by length they are the lengths [m] that servos are to pull in, from the straight
    pose on. Servos have a limited speed and what else the twin says; a tendon that slackens pulls
    no more, and none pulls more than its limit. Dry friction of a twin's tendons is not part of the
    tension and acts on slack tendons too: there it can push.

    Observations are a dict of float64 vectors in SI units; d is the number of the coordinates that
    the task names: (x, z), (x, y) or (x, y, z). The bounds of the space are those of the workspace,
    plus room for the largest noise that the sensors can be given, and for any twin's errors. Those
    of velocities and rates are some thirty times what the robot can do:

    | key | size | what | unit |
    |---|---|---|---|
    | tip_position, tip_velocity | d | tip, as the camera sees it where there is one | m, m/s |
    | curvature, curvature_rate | pieces | beta; in space gamma, torsion too | 1/m, 1/(m s) |
    | sensors | readings | curvature sensors, light over that when straight; tags | 1, rad |
    | tendon_tension | tendons | applied tension | N |
    | tendon_length | tendons | inside the robot, or pulled in as the servos read | m |
    | reference, reference_velocity, reference_acceleration | d | reference now | m, m/s, m/s2 |
    | reference_preview | d x preview | reference after each of the `preview` times | m |
    | previous_action | inputs | inputs in force, over full scale | 1 |

    The reward is the sum of these terms, also in `info` as `reward_tracking` and so on (e is the
    distance of tip and reference, a the inputs over full scale; weights and scales are those of
    `TrackingReward`):

    | term | what | range |
    |---|---|---|
    | tracking | 0.5 exp(-e / 50 mm) | (0, 0.5] |
    | precision | 0.5 exp(-e / 5 mm) | (0, 0.5] |
    | effort | -0.01 mean(a^2) | [-0.01, 0] |
    | smoothness | -0.05 mean((a - previous a)^2) | [-0.2, 0] |
    | failure | -10 if the step failed, the other terms are then 0 | {-10, 0} |

    For learning libraries there is `observe_as="vector"`: the same observables as one float32
    vector of order 1, scaled by the robot's own length, first frequency and full scale
    (`observations.vector.VectorView`), so that no running statistics need to be kept with a policy.
    `vector_layout` says which entries are what. The reference is then its distance to the tip, on a
    coarse and on a fine scale, and the preview what lies ahead of it. Unless told otherwise, such
    an environment also has what helps an agent that begins with nothing:

    * `act_as="change"`: an action is the change of the inputs in force, by at most as much as the
      first mode turns in a control period (full scale per radian). Random actions then move the
      robot gently, and an agent that knows only the sign of an error can remove it.
    * `reward="log"`: the term tracking is 1 - log(1 + e / s) / log(1 + 2 R / s), with the reach R
      and s = R / 500; precision, effort and smoothness are zero (`rewards.LogReward`).

    An episode ends with `truncated` when the task's duration is over, and with `terminated` when
    the simulation diverged, a piece bent sharper than 1 / outer radius, where its inner side would
    fold, or the robot moved faster than `observations.table.speed_limit` allows.
    `info["failure"]` then says what and when, and the observation is the one
    before the failure, as the caller holds it.

    `info` holds the error [m], time [s], tendon tension [N] and length [m] (of servos what their
    horns pull in), and reward terms; after a divergence error and lengths may not be finite. The
    reset option `vary` and `randomization` vary the robot and what lies between it and the policy.
    The drives may apply another tension than commanded (`tension_gain`), up to the tendon's limit,
    and any command later (`delay`, a multiple of the control period); until the first action
    arrives the start is in force. A varied robot starts in the posture of the nominal one, with the
    same commands (thesis sec. 6.6.3), times the `tension_gain`; names and units of `vary` are
    those of `Randomization`. Sensors may be noisy (`sensor_noise`). Rewards, error, failures and
    `previous_action` keep to the true state and the commanded action, and with noise or a camera
    that errs `info` also holds the true tip_position, and curvature.

    A camera without noise and delay sees the true position and velocity. Otherwise it takes a
    picture every `robots.CAMERA_PERIOD` (90 a second, or one per control period where that is
    longer), each at the control instant that follows, and the velocity is the difference of its
    last two over the time between them. Potentiometers know neither offset nor backlash of a servo.

    A task that is drawn from a seed (`random`, `reach`) and given by name without one is drawn anew
    for every episode, by `np_random`, and keeps its duration; with `seed=` it stays.

    Attributes:
        task: The task, `task.robot` its nominal robot.
        twin: What is simulated of a robot driven by length, which policies are not meant to look
            at; None of another.
        control_period: [s].
        input_scale: (n_inputs,) [N] or [m], input of a full-scale action.
        observe_as, act_as: As given, or what is usual.
        vector_layout: Slices of an observation by name, where it is one vector; else None.
        reading: What a file tells of that vector, see `vector_reading`.
        model, data: The MuJoCo objects of the running scene; None with another plant.
    """

    def __init__(
        self,
        task: str | Task = "swing",
        *,
        robot: str | RobotParams | None = None,
        twin: Twin | int | None = None,
        control_period: float = DEFAULT_PERIOD,
        observe: tuple[str, ...] | str | None = None,
        preview: tuple[float, ...] = (0.05, 0.1, 0.2, 0.4),
        observe_as: str = "dict",
        act_as: str | None = None,
        reward: TrackingReward | str | None = None,
        randomization: Randomization | None = None,
        pieces: int | tuple[int, ...] | None = None,
        rule: str | None = None,
        timestep: float | None = None,
        integrator: str | None = None,
        accuracy: float | str = DEFAULT_ACCURACY,
        plant: PlantFactory | None = None,
        render_mode: str | None = None,
        width: int = 640,
        height: int = 480,
        **task_options: float,
    ) -> None:
        """Build the environment.

        Args:
            task: Task or its name.
            robot: The robot of a task given by name: itself, its name, or a robot file (*.toml).
                Unless given, the one that the task is made for.
            twin: Of a robot driven by length, the one that is simulated; or the seed of a rig with
                errors (`twin.rig3d_twin`). Unless given, a robot as its parameters say.
            control_period: [s], between 1 ms and 200 ms.
            observe: Names of the observables in an observation, or "all": all but `sensors`, which
                are asked for by name. Unless given, all but these and
                tensions, lengths and reference_acceleration of a robot driven by tension, and all
                but curvatures and tensions of one driven by length, as a lab can measure them.
            preview: Times [s] ahead of now of `reference_preview`.
            observe_as: "dict", or "vector": one float32 vector of order 1, see below.
            act_as: What actions stand for: "input", or "change" of the inputs in force. Unless
                given, inputs, and with vectors changes.
            reward: Weights and scales of the reward, or the name of one: "tracking" or "log".
                Unless given "tracking", and with vectors "log".
            randomization: Ranges of what varies, drawn by `np_random` for every episode that is
                reset without `vary`, and told in `info["variation_density"]` and so on.
            pieces, rule, timestep, integrator, accuracy: Of the MuJoCo chain, see `SceneConfig`; in
                space, pieces must be a multiple of the robot's.
            plant: Builds the model that is simulated in place of the MuJoCo chain, for instance
                `beams.registry.BeamPlant("pcc")`.
            render_mode: None, "rgb_array" or "human".
            width, height: Size of a frame in pixels.
            **task_options: Of a task given by name, see `tasks.make_task`.

        Raises:
            ValueError: An argument out of range; the message names what is allowed.
            TypeError: An unknown argument.
        """
        check_task_options(type(self), task, robot, task_options)
        check_argument("randomization", randomization, Randomization | None)
        self._drives: Drives | None = None
        self._noise: SensorNoise | None = None
        self._camera: Camera | None = None
        setting = SimulatedSetting(
            task,
            task_options,
            robot=robot,
            twin=twin,
            control_period=control_period,
            observe=observe,
            preview=preview,
            observe_as=observe_as,
            act_as=act_as,
            reward=reward,
            plant=plant,
            pieces=pieces,
            rule=rule,
            timestep=timestep,
            integrator=integrator,
            accuracy=accuracy,
        )
        setting.check_randomization(randomization)
        self._randomization = randomization
        self.twin, self._servos = setting.twin, setting.servos()
        self._bank = setting.bank()
        self.input_scale = setting.inputs.input_scale
        self._command = setting.inputs.per_action().command
        self._redrawn = isinstance(task, str) and "seed" not in task_options and setting.is_drawn
        super().__init__(setting, render_mode, (width, height))

    @property
    def command(self) -> np.ndarray:
        """(nu,) what the drives are told [N or m], to be written to by who acts without `step`."""
        return self._target

    def _make_readout(self, simulation: Simulation | BeamSimulation) -> Measured:
        self._target = simulation.ctrl
        if self._servos is not None:
            simulation.drive_by(self._servos)
            self._target = self._servos.command
        readout = self._setting.plant.readout(simulation, self._servos)
        self._exact = readout
        if self._bank is not None:
            readout = fitted(readout, self._bank, 0)
        if self._camera is not None:
            readout = filmed(readout, self._camera)
        return readout if self._noise is None else noisy(readout, self._noise, 0)

    def _move(self, action: np.ndarray) -> bool:
        if self._drives is None:
            self._command(action, self._target)
        else:
            self._target[:] = self._drives.apply(self._command(action))[0]
        return self._advance()

    # ------------------------------------------------------------------ episodes

    def _parse(self, options: dict[str, Any] | None) -> ResetOptions:
        parsed = super()._parse(options)
        if self._redrawn and "seed" not in parsed.task:
            drawn = int(self.np_random.integers(2**31))
            lasts = parsed.duration or self.task.duration  # whatever the draw
            parsed = replace(parsed, task=parsed.task | {"seed": drawn}, duration=lasts)
        if self._randomization is None or "vary" in (options or {}):
            return parsed
        drawn = self._randomization.draw(self.np_random)
        return replace(parsed, vary=rounded(drawn, self.control_period))

    def _start(self, options: ResetOptions, start: Start) -> None:
        setting = self._setting
        robot_vary, disturbance = split(options.vary, self.control_period)
        # The running simulation goes on if it is of the wanted robot.
        simulation = self._simulation
        if robot_vary != self._robot_vary:
            simulation = setting.plant.simulation(robot_vary)
        drives = disturbance.drives(setting.most, start.command)
        self._robot_vary, self._drives = robot_vary, drives
        if self._randomization is not None:
            self._variation = told_variation(NEUTRAL | options.vary)
        command = start.command if drives is None else drives.tension[0]
        noise, camera = disturbance.noise(setting.noise_sizes, self.np_random), self._make_camera()
        changed = simulation is not self._simulation
        if self._servos is not None:
            self._servos.start(command)
            command = self._servos.horn
        simulation.reset(start.posture, command)
        if changed or noise is not self._noise or camera is not self._camera:
            self._noise, self._camera = noise, camera
            self._install(simulation)
        if camera is not None:
            camera.start(np.array(self._readout.tip))
        if self._bank is not None:
            self._start_bank(disturbance.sensor_errors)

    def _start_bank(self, errors: float) -> None:
        """Start the curvature sensors, of a specimen drawn if it errs [1]."""
        seed, first = noise_seed(self.np_random), np.array([0])
        self._exact.update()
        built = self._setting.built_sensors(errors, seed)
        self._bank.start(first, [built], [seed], self._exact.shape())

    def _make_camera(self) -> Camera | None:
        """The camera of an episode; None without errors, and then nothing is drawn."""
        twin = self.twin
        if twin is None:
            return None
        delay = round(twin.camera_delay / self.control_period)
        if twin.camera_noise == 0 and delay == 0:
            return None
        seed = noise_seed(self.np_random) if twin.camera_noise else 0
        return Camera(twin.camera_noise, delay, self.control_period, seed, self._setting.dimensions)
