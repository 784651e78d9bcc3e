"""Tip tracking with one simulated robot."""

from dataclasses import replace
from typing import Any

import gymnasium
import numpy as np

from softrobot_env.envs.base import EpisodeEnv
from softrobot_env.envs.disturbances import (
    NEUTRAL,
    Drives,
    SensorNoise,
    rounded,
    split,
    told_variation,
)
from softrobot_env.envs.observations.readouts import noisy
from softrobot_env.envs.observations.table import DEFAULT_OBSERVABLES, Measured
from softrobot_env.envs.options import ResetOptions, unexpected_argument
from softrobot_env.envs.randomization import Randomization
from softrobot_env.envs.rewards import TrackingReward
from softrobot_env.envs.setting import DEFAULT_ACCURACY, Start, TensionSetting
from softrobot_env.envs.simulation.beam_plant import BeamSimulation
from softrobot_env.fields import check_argument
from softrobot_env.interfaces import Observation, PlantFactory
from softrobot_env.scene.simulation import Simulation
from softrobot_env.tasks import Task

#: [s].
DEFAULT_PERIOD = 0.01


# Learning libraries tell environments by their direct bases: `gymnasium.Env` is one of them.
class TrackingEnv(EpisodeEnv, gymnasium.Env[Observation, np.ndarray]):
    """Move the tip of a tendon-driven robot along a reference.

    The action is a vector in [-1, 1], one entry per tendon pair. Times `input_scale` [N] it is the
    reduced input of (6.5): positive pulls the tendon on the +x side, negative the opposite
    one, and the redundancy is resolved by minimum tension, so tendons never push. It is held for
    one `control_period`.

    Observations are a dict of float64 vectors in SI units; positions are (x, z). The bounds of the
    space are those of the workspace, plus room for the largest noise that the sensors can be given.
    Those of velocities and rates are some thirty times what the robot can do: scale by experience
    (`gymnasium.wrappers.NormalizeObservation`), not by them:

    | key | size | what | unit |
    |---|---|---|---|
    | tip_position, tip_velocity | 2 | tip | m, m/s |
    | curvature, curvature_rate | pieces | mean over each piece | 1/m, 1/(m s) |
    | tendon_tension, tendon_length | tendons | applied tension, length inside the robot | N, m |
    | reference, reference_velocity | 2 | reference now | m, m/s |
    | reference_preview | 2 x preview | reference after each of the `preview` times | m |
    | previous_action | inputs | action of the step before | 1 |

    The reward is the sum of these terms, also in `info` as `reward_tracking` and so on (e is the
    distance of tip and reference, a the action; weights and scales are those of `TrackingReward`):

    | term | what | range |
    |---|---|---|
    | tracking | 0.5 exp(-e / 50 mm) | (0, 0.5] |
    | precision | 0.5 exp(-e / 5 mm) | (0, 0.5] |
    | effort | -0.01 mean(a^2) | [-0.01, 0] |
    | smoothness | -0.05 mean((a - previous a)^2) | [-0.2, 0] |
    | failure | -10 if the step failed, the other terms are then 0 | {-10, 0} |

    An episode ends with `truncated` when the task's duration is over, and with `terminated` when
    the simulation diverged, a piece bent sharper than 1 / outer radius, where its inner side would
    fold, or the robot moved faster than `observations.table.speed_limit` allows.
    `info["failure"]` then says what and when, and the observation is the one
    before the failure, as the caller holds it.

    `info` holds the error [m], time [s], tendon tension [N] and length [m], and reward terms; after
    a divergence error and lengths may not be finite. The reset option `vary` and `randomization`
    vary the robot and what lies between it and the policy. The drives may apply another tension
    than commanded (`tension_gain`), up to the tendon's limit, and later (`delay`, a multiple of the
    control period); until the first action arrives the start tension is in force. A varied robot
    starts in the posture of the nominal one, with the same tensions (thesis sec. 6.6.3), times the
    `tension_gain`; names and units of `vary` are those of `Randomization`. Sensors may be noisy
    (`sensor_noise`). Rewards, error, failures and `previous_action` keep to the true state and the
    commanded action, and with noise `info` also holds the true tip_position and curvature.

    Attributes:
        task: The task, `task.robot` its nominal robot.
        control_period: [s].
        input_scale: (n_inputs,) [N], reduced input of a full-scale action.
        model, data: The MuJoCo objects of the running scene; None with another plant.
    """

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
        rule: str | None = None,
        timestep: float | None = None,
        integrator: str | None = None,
        accuracy: float | str = DEFAULT_ACCURACY,
        plant: PlantFactory | None = None,
        render_mode: str | None = None,
        width: int = 640,
        height: int = 480,
        **unknown: Any,
    ) -> None:
        """Build the environment.

        Args:
            task: Task or its name.
            control_period: [s], between 1 ms and 200 ms.
            observe: Names of the observables in an observation, or "all".
            preview: Times [s] ahead of now of `reference_preview`.
            reward: Weights and scales of the reward.
            randomization: Ranges of what varies, drawn by `np_random` for every episode that is
                reset without `vary`, and told in `info["variation_density"]` and so on.
            pieces, rule, timestep, integrator, accuracy: Of the MuJoCo chain, see `SceneConfig`.
            plant: Builds the model that is simulated in place of the MuJoCo chain, for instance
                `beams.registry.BeamPlant("pcc")`.
            render_mode: None, "rgb_array" or "human".
            width, height: Size of a frame in pixels.

        Raises:
            ValueError: An argument out of range; the message names what is allowed.
            TypeError: An unknown argument.
        """
        for name in unknown:
            raise unexpected_argument(type(self), name)
        check_argument("randomization", randomization, Randomization | None)
        self._randomization = randomization
        self._drives: Drives | None = None
        self._noise: SensorNoise | None = None
        setting = TensionSetting(
            task,
            control_period=control_period,
            observe=observe,
            preview=preview,
            plant=plant,
            pieces=pieces,
            rule=rule,
            timestep=timestep,
            integrator=integrator,
            accuracy=accuracy,
        )
        self._tendon_map, self.input_scale = setting.tendon_map, setting.input_scale
        self._pull = setting.tendon_map.per_action().tension
        super().__init__(setting, reward, render_mode, (width, height))

    def _make_readout(self, simulation: Simulation | BeamSimulation) -> Measured:
        readout = self._setting.plant.readout(simulation)
        return readout if self._noise is None else noisy(readout, self._noise, 0)

    def _move(self, action: np.ndarray) -> bool:
        if self._drives is None:
            self._pull(action, self._ctrl)
        else:
            self._ctrl[:] = self._drives.apply(self._pull(action))[0]
        return self._advance()

    # ------------------------------------------------------------------ episodes

    def _parse(self, options: dict[str, Any] | None) -> ResetOptions:
        parsed = super()._parse(options)
        if self._randomization is None or "vary" in (options or {}):
            return parsed
        drawn = self._randomization.draw(self.np_random)
        return replace(parsed, vary=rounded(drawn, self.control_period))

    def _start(self, options: ResetOptions, start: Start) -> None:
        plant = self._setting.plant
        robot_vary, disturbance = split(options.vary, self.control_period)
        # The running simulation goes on if it is of the wanted robot.
        simulation = self._simulation
        if robot_vary != self._robot_vary:
            simulation = plant.simulation(robot_vary)
        self._robot_vary = robot_vary
        if self._randomization is not None:
            self._variation = told_variation(NEUTRAL | options.vary)
        noise = disturbance.noise(plant.layout.pieces, self.np_random)
        if simulation is not self._simulation or noise is not self._noise:
            self._noise = noise
            self._install(simulation)
        tension = self._tendon_map.tension(start.input)
        limit = np.array([t.tension_limit for t in self.task.robot.tendons])
        self._drives = disturbance.drives(limit, tension)
        if self._drives is not None:
            tension = self._drives.tension[0]
        self._simulation.reset(start.posture, tension)
