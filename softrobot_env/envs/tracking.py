"""Tip tracking with one simulated robot."""

from dataclasses import replace
from math import dist
from typing import Any, ClassVar

import gymnasium
import numpy as np
from numpy import float64, ndarray

from softrobot_env.core.interfaces import Seen
from softrobot_env.robots.variations import VARIATIONS, neutral
from softrobot_env.scene.build import Scene
from softrobot_env.scene.simulation import Simulation
from softrobot_env.tasks import Task

from .config import DEFAULT_PERIOD, PICTURES, SIMULATED, EnvConfig
from .disturbances import BETWEEN, Drives, Periphery, reported_variation, rounded
from .observations.table import Measured, Sources, each_of, reads
from .options import ResetOptions, one_action
from .parts import EpisodeSpec, SimulatedParts, Start
from .reference import ReferenceTable
from .rendering import Frame, Pictured, WindowRenderer, lifted, make_renderer
from .simulation.plants import BeamSimulation

__all__ = ["DEFAULT_PERIOD", "TrackingEnv"]

_FIRST = np.array([0])

#: Attributes that `_install` takes from a simulation; copies and pickles omit them.
_REBUILT = {
    "model",
    "data",
    "_readout",
    "_exact",
    "_reads",
    "_renderer",
    "_advance",
    "command",
    "_estimates",
}


class TrackingEnv(Pictured, gymnasium.Env[Seen, ndarray]):
    """Move the tip of a tendon-driven robot along a reference.

    The action is a vector in [-1, 1], held for one `control_period`, and represents the inputs of
    the robot (`robots.actuation`). For a robot driven by tension these are reduced inputs [N], such
    as (6.5): each group of opposing tendons has one that bends it to either side of a plane, or two
    that bend it in space; the redundancy is resolved by the smallest tensions, so tendons never
    push. For a robot driven by length they are the lengths [m] that servos pull in, measured from
    the straight pose. Servos have a limited speed and the errors of the twin; a slack tendon does
    not pull, and none pulls more than its limit. Dry friction of a twin's tendons is not part of
    the tension and also acts on slack tendons, which it can push.

    Observations are a dict of float64 vectors in SI units; d is the number of the coordinates that
    the task names: (x, z), (x, y) or (x, y, z). The bounds of the space are those of the workspace,
    plus a margin for the largest sensor noise that can be set and for any twin's errors. Those of
    velocities and rates are about thirty times what the robot can reach:

    | key | size | what | unit |
    |---|---|---|---|
    | tip_position, tip_velocity | d | tip, as measured by the camera if there is one | m, m/s |
    | curvature, curvature_rate | pieces | beta; in space also gamma, torsion | 1/m, 1/(m s) |
    | sensors | readings | curvature sensors, light relative to straight; tags | 1, rad |
    | tendon_tension | tendons | applied tension | N |
    | anchor_tension | tendons | at their far ends, beyond the friction along them | N |
    | tendon_length | tendons | inside the robot, or pulled in as the servos report | m |
    | motor_force | tendons | force of the position loop of servos with a gain | N |
    | reference | d | reference now | m |
    | reference_velocity, reference_acceleration | d | now, or `lead` later | m/s, m/s2 |
    | reference_preview | d x preview | reference after each of the `preview` times | m |
    | previous_action | inputs | current inputs, relative to full scale | 1 |

    The reward is the sum of these terms, also in `info` as `reward_tracking` and so on (e is the
    distance between tip and reference, a the inputs relative to full scale; weights and scales are
    those of `TrackingReward`):

    | term | what | range |
    |---|---|---|
    | tracking | 0.5 exp(-e / 50 mm) | (0, 0.5] |
    | precision | 0.5 exp(-e / 5 mm) | (0, 0.5] |
    | effort | -0.01 mean(a^2) | [-0.01, 0] |
    | smoothness | -0.05 mean((a - previous a)^2) | [-0.2, 0] |
    | failure | -10 if the step failed, the other terms are then 0 | {-10, 0} |

    For learning libraries there is `observe_as="vector"`: the same observables as one float32
    vector of order 1, scaled by the robot's own length, first frequency and full scale
    (`observations.table.VectorView`), so that policies need no running statistics. `vector_layout`
    says which entries are what. The reference is then given relative to the tip, on a coarse and a
    fine scale, and the preview relative to the reference. By default such an environment also has
    two features that help an agent trained from scratch:

    * `act_as="change"`: an action is a change of the current inputs, limited to the phase that the
      first mode passes in a control period (full scale per radian). Random actions then move the
      robot gently, and an agent that knows only the sign of an error can remove it.
    * `reward="log"`: the term tracking is 1 - log(1 + e / s) / log(1 + 2 R / s), with the reach R
      and s = R / 500; precision, effort and smoothness are zero (`rewards.LogReward`).

    An episode ends with `truncated` when the task's duration is over, and with `terminated` when
    the simulation diverged, a piece bent sharper than 1 / outer radius, where its inner side would
    fold, or the robot moved faster than `observations.table.speed_limit` allows.
    `info["failure"]` then says what happened and when, and the observation is the last one
    before the failure, which the caller already has.

    `info` holds the error [m], time [s], tendon tension [N] and length [m] (for servos, what their
    horns pull in), and reward terms; after a divergence, error and lengths may not be finite. The
    reset option `vary` and `randomization` vary the robot, its drives and its sensors. The drives
    may apply a tension other than the commanded one (`tension_gain`), up to the tendon's limit, and
    apply commands late (`delay`, a multiple of the control period); the start inputs apply until
    the first action arrives. A varied robot starts in the posture of the nominal one, with the
    same commands (thesis sec. 6.6.3), times the `tension_gain`; names and units of `vary` are
    those of `robots.variations`. Sensors may be noisy (`sensor_noise`). Rewards, error, failures
    and `previous_action` refer to the true state and the commanded action, and with noise or an
    imperfect camera `info` also holds the true tip_position and curvature.

    A camera without noise and delay measures the true position and velocity. Otherwise it takes a
    picture every `robots.CAMERA_PERIOD` (90 a second, or one per control period where that is
    longer), each at the control instant that follows, and the velocity is the difference of its
    last two over the time between them. Potentiometers do not show the offset or backlash of a
    servo.

    A task that is sampled from a seed (`random`, `reach`), if given by name without one, is
    resampled for every episode by `np_random`, with the same duration; `seed=` fixes it.

    Attributes:
        takes: Names of its options, see `config.EnvConfig`.
        config: The options.
        task: The task, `task.robot` its nominal robot.
        twin: The simulated twin of a robot driven by length, unknown to policies; None for others.
        control_period: [s].
        axes: Coordinates of positions among x, y and z, a slice of (3,).
        input_scale: (n_inputs,) [N] or [m], input of a full-scale action.
        observe_as, act_as: As given, or the defaults.
        vector_layout: Slices of an observation by name, if it is one vector; otherwise None.
        reading: Description of that vector for files, see `vector_reading`.
        model, data: The MuJoCo objects of the running scene; None with another plant.
        current_task: The task of the running episode: `task`, with sampled values and options of
            `reset`.
        simulation: The running simulation, replaced by a reset that varies the robot.
        command: (nu,) commands of the drives [N or m], which can be written to act without
            `step`.
    """

    spec = EpisodeSpec()
    metadata: ClassVar = {"render_modes": ["rgb_array", "human"], "render_fps": 100}
    takes: ClassVar[tuple[str, ...]] = (*SIMULATED, "plant", *PICTURES)
    usual: ClassVar[dict[str, Any]] = {}
    _robot_vary: ClassVar[dict[str, float]] = {}  # of the running simulation

    def __init__(self, task: str | Task = "swing", **options: Any) -> None:
        """Build the environment.

        Args:
            task: A task or its name.
            **options: Those named in `TrackingEnv.takes`, see `config.EnvConfig`, and those of a
                task given by name, see `tasks.make_task`.

        Raises:
            ValueError: An option out of range; the message names what is allowed.
            TypeError: An unknown option.
        """
        self.config = config = EnvConfig.of(type(self), {"task": task, **options})
        self._parts = parts = SimulatedParts(config)
        parts.show_in(self)
        self._take_pictures(config)
        self.twin, self._servos, self._periphery = parts.twin, parts.servos(), Periphery(parts)
        self._command = parts.inputs.per_action().command
        self._drives: Drives | None = None
        self._view, self._nothing_earned = parts.view, parts.reward.none
        self._changes = parts.change is not None
        self._follow(self.task, parts.reference)
        self._running = False
        self._episode = self._index = 0
        self._error = 0.0
        self._action_shape = self.action_space.shape
        self._action_array = np.zeros(self._action_shape)
        self._action: list[float] = self._action_array.tolist()
        self._rows: dict[str, ndarray] = {}
        self._last_observation: Seen | None = None
        self._variation: dict[str, float64] = {}  # as in `info`
        self._discretization = float64(parts.plant.discretization_error)
        self._install(parts.plant.simulation({}))

    # ------------------------------------------------------------------ simulation

    @property
    def scene(self) -> Scene | None:
        """The scene of the running episode; None for plants other than the MuJoCo chain."""
        return self.simulation.scene

    def _install(self, simulation: Simulation | BeamSimulation) -> None:
        """Connect to a simulation, so that steps need no look-ups."""
        self.simulation = simulation
        self.model, self.data = simulation.model, simulation.data
        self._advance = simulation.advance
        self._estimates = simulation.estimates
        self.command = simulation.ctrl
        if self._servos is not None:
            simulation.drive_by(self._servos)
            self.command = self._servos.command
        self._exact = self._parts.plant.readout(simulation, self._servos)
        self._readout: Measured = self._periphery.readout(self._exact)

    def _follow(self, task: Task, reference: ReferenceTable) -> None:
        """Make a task the current one."""
        self.current_task, self._reference = task, reference
        self._points, self._last_index = reference.points, reference.last_index

    def __getstate__(self) -> dict:
        return {k: v for k, v in self.__dict__.items() if k not in _REBUILT}

    def __setstate__(self, state: dict) -> None:
        self.__dict__.update(state)
        self._install(self.simulation)
        if not self._robot_vary:  # one model, as before
            self._parts.plant.adopt(self.simulation)
        if self._last_observation is not None:
            self._bind_observation(self._index + 1)

    # ------------------------------------------------------------------ episodes

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Seen, dict[str, Any]]:
        """Start an episode at rest.

        Args:
            seed: Seed of `np_random`. Only `randomization` and the noise of sensors and of a twin's
                camera sample from it.
            options: `SIMULATED_OPTIONS` of `envs.options`; each holds for this episode only.

        Raises:
            ValueError: A bad option; the message names what is allowed.
            EquilibriumError: There is no equilibrium at the start.
        """
        super().reset(seed=seed)
        parsed = self._parse(options)
        # Everything that can be refused comes before anything is changed.
        task, reference, start = self._parts.beginning(parsed)
        self._start(parsed, start)
        self._follow(task, reference)
        self._action_array = start.action.copy()
        self._action = self._action_array.tolist()
        self._rows = self._reference.rows()
        self._index = 0
        self._episode += 1
        self._bind_observation(0)
        self._running = True
        self._measure()
        observation = self._observe()
        if self.render_mode == "human":
            self.render()
        return observation, self._info(self._nothing_earned)

    def _bind_observation(self, index: int) -> None:
        """Prepare the observations from control instant `index` on.

        Every observation takes the next row of the episode's own copy of the reference: rows are
        not shared between observations, and not copied in a step.
        """
        sources = Sources(
            self._readout,
            lambda column: iter(self._rows[column][index:]).__next__,
            lambda: self._action_array,
        )
        self._reads = reads(self._parts.observed, sources)

    def _parse(self, options: dict[str, Any] | None) -> ResetOptions:
        """The checked options of a reset, with sampled values."""
        parsed = self._parts.sampled(self._parts.parse_options(options), self.np_random)
        if self.config.randomization is None or "vary" in (options or {}):
            return parsed
        sampled = self.config.randomization.draw(self.np_random)
        return replace(parsed, vary=rounded(sampled, self.control_period))

    def _start(self, options: ResetOptions, start: Start) -> None:
        """Bring the simulation to a start; errors are raised before anything is changed."""
        parts, vary = self._parts, options.vary
        robot_vary = {n: v for n, v in vary.items() if VARIATIONS[n].apply is not None}
        values = {n: np.array([vary.get(n, usual)]) for n, usual in BETWEEN.items()}
        # The running simulation is reused if it has the right robot.
        simulation = self.simulation
        if robot_vary != self._robot_vary:
            simulation = parts.plant.simulation(robot_vary)
        self._robot_vary = robot_vary
        if self.config.randomization is not None:
            self._variation = reported_variation(neutral() | vary)
        command = self._periphery.start_drives(_FIRST, values, start.command[None])[0]
        self._drives = self._periphery.drives
        if self._servos is not None:
            self._servos.start(command)
            command = self._servos.horn
        simulation.reset(start.posture, command)
        if simulation is not self.simulation:
            self._install(simulation)
        if self._periphery.start_sensors(_FIRST, values, [self.np_random], self._exact):
            self._readout = self._periphery.readout(self._exact)

    # ------------------------------------------------------------------ steps

    def step(self, action: ndarray) -> tuple[Seen, float, bool, bool, dict[str, Any]]:
        """Apply an action (n_inputs,) in [-1, 1] for one control period.

        Raises:
            ValueError: Not n_inputs real numbers, or one beyond [-1, 1] by more than 1e-6.
            gymnasium.error.ResetNeeded: The episode is over or was never started.
        """
        if not self._running:
            raise gymnasium.error.ResetNeeded("call reset() before step(): no episode is running")
        previous = self._action
        given, self._action = one_action(action, self._action_shape)
        if self._changes:
            given = self._parts.wanted(given, self._action_array)
            self._action = given.tolist()
        self._action_array = given
        if self._drives is None:
            self._command(given, self.command)
        else:
            self.command[:] = self._drives.apply(self._command(given))[0]
        healthy = self._advance()
        self._index += 1
        failure = self._measure()
        if not healthy:
            failure = self.simulation.failure() or failure
        if failure is not None:
            return self._fail(failure)
        reward, terms = self._reward.terms(self._error, self._action, previous, self._exact)
        self._running = self._index < self._last_index
        observation = self._observe()
        if self.render_mode == "human":
            self.render()
        return observation, reward, False, not self._running, self._info(terms)

    def _measure(self) -> str | None:
        """Update measurements and error; return what left the workspace, or None."""
        readout = self._readout
        outside = readout.update()
        self._error = dist(readout.tip, self._points[self._index])
        return outside

    def _observe(self) -> Seen:
        seen = {}
        for name, read in self._reads:  # a comprehension would be one more call
            seen[name] = read()
        self._last_observation = seen if self._view is None else self._view(seen)
        return self._last_observation

    def _fail(self, failure: str) -> tuple[Seen, float, bool, bool, dict[str, Any]]:
        self._running = False
        reward, terms = self._reward.failed_terms()
        last = each_of(self._last_observation, ndarray.copy)
        return last, reward, True, False, self._info(terms) | {"failure": failure}

    def _info(self, terms: dict[str, float64]) -> dict[str, Any]:
        readout = self._readout
        info = {
            "time": float64(self._index * self.control_period),
            "error": float64(self._error),
            "tendon_tension": readout.tendon_tension(),
            "tendon_length": readout.true_length(),
            **terms,
        }
        if self._estimates is not None:
            info["integration_error"] = self._estimates[0]
            info["discretization_error"] = self._discretization
        if self._variation:
            info |= self._variation
        return info if readout.truth is None else info | readout.truth()

    # ------------------------------------------------------------------ pictures

    def render(self) -> ndarray | None:
        """Frame (height, width, 3) uint8 in mode "rgb_array"; None otherwise.

        Raises:
            RenderError: No OpenGL (or, in mode "human", no display); the message says what to
                install.
            gymnasium.error.ResetNeeded: No episode has been started.
        """
        if self._last_observation is None:
            raise gymnasium.error.ResetNeeded("call reset() before render()")
        if self.render_mode is None:
            gymnasium.logger.warn(
                'render() does nothing without a render mode; pass render_mode="rgb_array"'
            )
            return None
        if self._renderer is None:
            scene = self._parts.plant.config
            self._renderer = make_renderer(self.render_mode, scene, self._frame_size)
        return self._renderer.draw(self._frame())

    def open_window(self) -> WindowRenderer:
        """The window of render mode "human", opened with sliders for the drives if it is not open.

        Raises:
            RenderError: There is no display.
        """
        if self._renderer is None:
            self._renderer = WindowRenderer(self._parts.plant.config, controls=True)
        return self._renderer

    def _frame(self) -> Frame:
        return Frame(
            episode=self._episode,
            time=self.simulation.time,
            qpos=self.simulation.posture,
            tension=self._readout.tendon_tension(),
            target=self._in_space(np.array(self._points[self._index])[None])[0],
            path=self._in_space(self.current_task.trajectory.path()[:, self.axes]),
            jumps=getattr(self.current_task.trajectory, "jumps", False),
        )

    def _in_space(self, points: ndarray) -> ndarray:
        """Positions (k, 3) at which to show points (k, d) [m] of the reference."""
        if self.task.axes == "xy":
            return lifted(self.task.robot, points)
        base = self.task.robot.base
        placed = np.tile((0.0, 0.0, 0.0) if base is None else base.position, (len(points), 1))
        placed[:, self.axes] = points
        return placed
