"""Tip tracking with one simulated robot."""

from dataclasses import replace
from typing import Any, ClassVar

import numpy as np
from gymnasium import spaces

from softrobot_env.envs.base import EpisodeEnv
from softrobot_env.envs.disturbances import (
    NEUTRAL,
    Disturbance,
    Drives,
    SensorNoise,
    rounded,
    split,
    with_noise,
)
from softrobot_env.envs.observations.arm import (
    DEFAULT_OBSERVABLES,
    OBSERVABLES,
    Sizes,
    observation_space,
)
from softrobot_env.envs.observations.readout import NoisyReadout
from softrobot_env.envs.options import (
    ResetOptions,
    check_arguments,
    check_render_mode,
    parse_options,
)
from softrobot_env.envs.randomization import Randomization
from softrobot_env.envs.reference import sample_reference
from softrobot_env.envs.rewards import TrackingReward
from softrobot_env.envs.simulation.beam_plant import BeamPlant, BeamSimulation
from softrobot_env.envs.simulation.mujoco import Simulation
from softrobot_env.envs.simulation.mujoco_plant import MujocoPlant
from softrobot_env.interfaces import Observation, PlantFactory
from softrobot_env.robots.actuation import TendonMap
from softrobot_env.tasks import Task, make_task

#: [s].
DEFAULT_PERIOD = 0.01

_DEFAULT_RULE = "balanced2"


class TrackingEnv(EpisodeEnv):
    """Move the tip of a tendon-driven robot along a reference.

    The action is a vector in [-1, 1], one entry per tendon pair. Times `input_scale` [N] it is the
    reduced input of (6.5): positive pulls the tendon on the +x side, negative the opposite
    one, and the redundancy is resolved by minimum tension, so tendons never push. It is held for
    one `control_period`.

    Observations are a dict of float64 vectors in SI units; positions are (x, z). The bounds of the
    space are those of the workspace, for velocities and rates those beyond which MuJoCo reports
    a divergence, plus room for the largest noise that the sensors can be given: scale by
    experience (`gymnasium.wrappers.NormalizeObservation`), not by them:

    | key | size | what | unit |
    |---|---|---|---|
    | tip_position, tip_velocity | 2 | tip | m, m/s |
    | curvature, curvature_rate | pieces | mean over each piece | 1/m, 1/(m s) |
    | tendon_tension, tendon_length | tendons | applied tension, length inside the robot | N, m |
    | reference, reference_velocity | 2 | reference now | m, m/s |
    | reference_preview | 2 x preview | reference after each of the `preview` times | m |
    | previous_action | inputs | action of the step before | 1 |

    The reward is the sum of these terms, also in `info["reward_terms"]` (e is the distance of tip
    and reference, a the action; weights and scales are those of `TrackingReward`):

    | term | what | range |
    |---|---|---|
    | tracking | 0.5 exp(-e / 50 mm) | (0, 0.5] |
    | precision | 0.5 exp(-e / 5 mm) | (0, 0.5] |
    | effort | -0.01 mean(a^2) | [-0.01, 0] |
    | smoothness | -0.05 mean((a - previous a)^2) | [-0.2, 0] |
    | failure | -10 if the step failed, the other terms are then 0 | {-10, 0} |

    An episode ends with `truncated` when the task's duration is over, and with `terminated` when
    the simulation diverged or a piece bent sharper than 1 / outer radius, where its inner side
    would fold. `info["failure"]` then says what and when, and the observation is the one
    before the failure, as the caller holds it.

    `info` holds the error [m], time [s], tendon tension [N] and length [m], and reward terms; after
    a divergence error and lengths may not be finite. The reset option `vary` and `randomization`
    vary the robot and what lies between it and the policy. The drives may apply another tension
    than commanded (`tension_gain`), up to the tendon's limit, and later (`delay`); until the first
    action arrives the start tension is in force. Sensors may be noisy (`sensor_noise`). Rewards,
    error, failures and `previous_action` keep to the true state and the commanded action, and
    with noise `info` also holds the true tip_position and curvature.

    Attributes:
        task: The task, `task.robot` its nominal robot.
        control_period: [s].
        input_scale: (n_inputs,) [N], reduced input of a full-scale action.
        model, data: The MuJoCo objects of the running scene; None with another plant.
    """

    metadata: ClassVar = {"render_modes": ["rgb_array", "human"], "render_fps": 100}

    def __init__(
        self,
        task: str | Task = "swing",
        *,
        control_period: float = DEFAULT_PERIOD,
        observe: tuple[str, ...] | str = DEFAULT_OBSERVABLES,
        preview: tuple[float, ...] = (0.05, 0.1, 0.2, 0.4),
        reward: TrackingReward | None = None,
        randomization: Randomization | None = None,
        pieces: int | None = None,
        rule: str = _DEFAULT_RULE,
        timestep: float | None = None,
        integrator: str | None = None,
        plant: PlantFactory | None = None,
        render_mode: str | None = None,
        width: int = 640,
        height: int = 480,
    ) -> None:
        """Build the environment.

        Args:
            task: Task or its name.
            control_period: [s], between 1 ms and 200 ms.
            observe: Names of the observables in an observation, or "all".
            preview: Times [s] ahead of now of `reference_preview`.
            reward: Weights and scales of the reward.
            randomization: Ranges of what varies, drawn by `np_random` for every episode that is
                reset without `vary`, and told in `info["variation"]`.
            pieces, rule, timestep, integrator: Of the MuJoCo chain, see `SceneConfig`.
            plant: Builds the model that is simulated in place of the MuJoCo chain, for instance
                `beams.registry.BeamPlant("pcc")`.
            render_mode: None, "rgb_array" or "human".
            width, height: Size of a frame in pixels.

        Raises:
            ValueError: An argument out of range; the message names what is allowed.
        """
        self.task = make_task(task) if isinstance(task, str) else task
        observe = (observe,) if isinstance(observe, str) and observe != "all" else observe
        check_arguments(control_period, preview, (width, height))
        check_render_mode(render_mode, self.metadata["render_modes"])
        self.control_period = control_period
        self.render_mode = render_mode
        self.metadata = {**self.metadata, "render_fps": max(1, round(1 / control_period))}
        self._reward = TrackingReward() if reward is None else reward
        self._randomization = randomization
        self._preview = np.array(preview, dtype=float)
        options = {"pieces": pieces, "rule": rule, "timestep": timestep, "integrator": integrator}
        self._frame_size = (width, height)
        self._renderer = None
        self._tendon_map = TendonMap(self.task.robot)
        self._commanded = self._pull = self._tendon_map.per_action().tension
        self.input_scale = self._tendon_map.input_scale
        self._plant = self._make_plant(plant, options)
        self._make_spaces(tuple(OBSERVABLES) if observe == "all" else tuple(observe))
        self._vary: dict[str, float] = {}
        self._robot_vary: dict[str, float] = {}
        self._drives: Drives | None = None
        self._noise: SensorNoise | None = None
        self._current: Task | None = None
        self._install(self._plant.simulation({}))
        self._follow(self.task)
        self._running = False
        self._episode = 0
        self._last_observation: Observation | None = None

    def _make_plant(
        self, factory: PlantFactory | None, options: dict[str, Any]
    ) -> MujocoPlant | BeamPlant:
        robot = self.task.robot
        if factory is None:
            return MujocoPlant(robot, self.control_period, **options)
        given = {k: v for k, v in options.items() if v not in (None, _DEFAULT_RULE)}
        if given:
            raise ValueError(
                f"{', '.join(given)} belong to the MuJoCo chain; another plant has its own options"
            )
        return BeamPlant(robot, self.control_period, factory)

    def _make_spaces(self, observe: tuple[str, ...]) -> None:
        layout = self._plant.layout
        sizes = Sizes(self.task.robot, self._tendon_map, layout, len(self._preview))
        self.observation_space = with_noise(self._plant.widen(observation_space(observe, sizes)))
        self._n_inputs = self._tendon_map.n_inputs
        self._action_shape = (self._n_inputs,)
        self.action_space = spaces.Box(-1.0, 1.0, (self._n_inputs,), dtype=np.float32)

    # ------------------------------------------------------------------ simulation

    def _install(self, simulation: Simulation | BeamSimulation) -> None:
        """Make a simulation the running one."""
        self._simulation = simulation
        self.model, self.data = simulation.model, simulation.data
        self._bind()

    def _bind(self) -> None:
        """Connect to the simulation's data, so that a step looks nothing up."""
        simulation = self._simulation
        self._advance, self._ctrl = simulation.advance, simulation.ctrl
        readout = self._plant.readout(simulation)
        self._readout = readout if self._noise is None else NoisyReadout(readout, self._noise)

    def __setstate__(self, state: dict) -> None:
        self.__dict__.update(state)
        self._renderer = None
        if not self._robot_vary:  # one model, as before
            self._plant.adopt(self._simulation)
        self._install(self._simulation)
        if self._last_observation is not None:
            self._bind_observation(self._index + 1)

    def _follow(self, task: Task) -> None:
        """Make a task's reference the current one."""
        if task != self._current:
            self._reference = sample_reference(task, self.control_period, self._preview)
            self._points, self._last_index = self._reference.points, self._reference.last_index
            self._current = task

    # ------------------------------------------------------------------ episodes

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Observation, dict[str, Any]]:
        """Start an episode at rest.

        Args:
            seed: Seed of `np_random`. Only `randomization` and the noise of sensors draw from it.
            options: See `softrobot_env.envs.options.OPTIONS`; each holds for this episode only.
                Names and units of `vary` are those of `Randomization`; a delay must be a multiple
                of the control period. A varied robot starts in the posture of the nominal one, with
                the same tensions (thesis sec. 6.6.3), times the `tension_gain`.

        Raises:
            ValueError: A bad option; the message names what is allowed.
        """
        super().reset(seed=seed)
        parsed = parse_options(options, self._n_inputs, self._plant.layout.pieces)
        if self._randomization is not None and "vary" not in (options or {}):
            drawn = self._randomization.draw(self.np_random)
            parsed = replace(parsed, vary=rounded(drawn, self.control_period))
        # Everything that can be refused comes before anything is changed.
        task = self._task_for(parsed)
        start_input = self._start_input(parsed, task)
        posture = self._start_posture(parsed, start_input)
        robot_vary, disturbance = split(parsed.vary, self.control_period)
        simulation = self._simulation_for(robot_vary)
        self._follow(task)
        self._vary, self._robot_vary = dict(parsed.vary), robot_vary
        noise = disturbance.noise(self._plant.layout.pieces, self.np_random)
        if simulation is not self._simulation or noise is not self._noise:
            self._noise = noise
            self._install(simulation)
        self._begin(start_input, posture, disturbance)
        if self.render_mode == "human":
            self.render()
        return self._last_observation, self._info({})

    def _task_for(self, options: ResetOptions) -> Task:
        task = self.task
        if options.step_width is not None:
            if task.step_width is None:
                raise ValueError(f"step_width applies to the step task only, not to {task.name!r}")
            wider = make_task("step", options.step_width)
            task = replace(task, trajectory=wider.trajectory, step_width=wider.step_width)
        if options.duration is not None:
            task = replace(task, duration=options.duration)
        return task

    def _simulation_for(self, vary: dict[str, float]) -> Simulation | BeamSimulation:
        """The running simulation if it is of the wanted robot, else a new one."""
        return self._simulation if vary == self._robot_vary else self._plant.simulation(vary)

    def _start_input(self, options: ResetOptions, task: Task) -> np.ndarray:
        chosen = task.start_input if options.start_input is None else options.start_input
        chosen = np.asarray(chosen, dtype=float)
        if np.any(np.abs(chosen) > self.input_scale):
            raise ValueError(
                f"start_input must lie within +-{self.input_scale.tolist()} N, got "
                f"{chosen.tolist()}"
            )
        return chosen

    def _start_posture(self, options: ResetOptions, start_input: np.ndarray) -> np.ndarray:
        """Coordinates of the plant, hinge angles (nq,) [rad] of the MuJoCo chain."""
        if options.start_curvature is None:
            return self._plant.equilibrium(self._tendon_map.tension(start_input))
        limit = self.task.robot.curvature_limit
        if np.any(np.abs(options.start_curvature) > limit):
            raise ValueError(f"start_curvature must lie within +-{limit:g} 1/m")
        return self._plant.bent(options.start_curvature)

    def _begin(
        self, start_input: np.ndarray, posture: np.ndarray, disturbance: Disturbance
    ) -> None:
        tension = self._tendon_map.tension(start_input)
        limit = np.array([t.tension_limit for t in self.task.robot.tendons])
        self._drives = disturbance.drives(limit, tension)
        self._pull = self._commanded
        if self._drives is not None:
            self._pull, tension = self._pull_through_drives, self._drives.tension[0]
        self._simulation.reset(posture, tension)
        self._action_array = start_input / self.input_scale
        self._action = self._action_array.tolist()
        self._rows = self._reference.rows()
        self._index = 0
        self._episode += 1
        self._bind_observation(0)
        self._running = True
        self._measure()
        self._last_observation = {name: read() for name, read in self._readers}

    def _pull_through_drives(self, action: np.ndarray, out: np.ndarray) -> None:
        out[:] = self._drives.apply(self._commanded(action))[0]

    def _truth(self) -> dict[str, np.ndarray]:
        return {} if self._noise is None else self._readout.truth()

    def _info(self, terms: dict[str, float]) -> dict[str, Any]:
        info = super()._info(terms)
        if self._randomization is not None:
            info["variation"] = NEUTRAL | self._vary
        return info
