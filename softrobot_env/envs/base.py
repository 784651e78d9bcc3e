"""What environments with one simulated robot share: steps, failures, `info` and pictures."""

from math import dist
from typing import Any, ClassVar

import gymnasium
import numpy as np
from numpy import float64

from softrobot_env.core.interfaces import Seen
from softrobot_env.envs.observations.table import Measured, Sources, copied
from softrobot_env.envs.options import ResetOptions, check_rendering, one_action
from softrobot_env.envs.reference import ReferenceTable
from softrobot_env.envs.rendering.renderer import Frame, WindowRenderer, lifted, make_renderer
from softrobot_env.envs.rewards import NO_REWARD
from softrobot_env.envs.setting import SimulatedSetting, Start
from softrobot_env.envs.simulation.beam_plant import BeamSimulation
from softrobot_env.envs.spec import EpisodeSpec
from softrobot_env.scene.build import Scene
from softrobot_env.scene.simulation import Simulation
from softrobot_env.tasks import Task

#: What `_install` takes from a simulation anew; a copy or a pickle goes without.
_REBUILT = {
    "model",
    "data",
    "_readout",
    "_exact",
    "_see",
    "_renderer",
    "_advance",
    "_target",
    "_estimates",
}


class EpisodeEnv(gymnasium.Env[Seen, np.ndarray]):
    """Episodes of one simulated robot whose tip follows a reference.

    A subclass gives a setting and declares how an episode starts, how an action reaches the plant
    and what is measured of it: `_start`, `_move` and `_make_readout`.

    Attributes:
        task: The task, `task.robot` its nominal robot.
        control_period: [s].
        axes: The coordinates out of x, y and z that positions have, a slice of (3,).
        observe_as, act_as: As given, or what is usual.
        vector_layout: Slices of an observation by name, where it is one vector; else None.
        reading: What a file tells of that vector, see `vector_reading`.
        model, data: The MuJoCo objects of the running scene; None with another plant.
    """

    spec = EpisodeSpec()
    metadata: ClassVar = {"render_modes": ["rgb_array", "human"], "render_fps": 100}
    _robot_vary: ClassVar[dict[str, float]] = {}  # of the running simulation

    def __init__(
        self,
        setting: SimulatedSetting,
        render_mode: str | None,
        frame_size: tuple[int, int],
    ) -> None:
        check_rendering(render_mode, self.metadata["render_modes"], frame_size)
        self._setting = setting
        self.task, self.control_period = setting.task, setting.control_period
        self.axes = setting.axes
        self.observation_space = setting.observation_space
        self.action_space = setting.action_space
        self.vector_layout, self.reading = setting.vector_layout, setting.reading
        self.observe_as, self.act_as = setting.observe_as, setting.act_as
        self.render_mode = render_mode
        self.metadata = {**self.metadata, "render_fps": max(1, round(1 / self.control_period))}
        self._reward = setting.reward
        self._frame_size, self._renderer = frame_size, None
        self._follow(self.task, setting.reference)
        self.max_episode_steps = setting.reference.last_index
        self._running = False
        self._episode = self._index = 0
        self._error = 0.0
        self._action_shape = self.action_space.shape
        self._action_array = np.zeros(self._action_shape)
        self._action: list[float] = self._action_array.tolist()
        self._rows: dict[str, np.ndarray] = {}
        self._last_observation: Seen | None = None
        self._variation: dict[str, float64] = {}  # as `info` tells it
        self._install(setting.plant.simulation({}))

    # ------------------------------------------------------------------ hooks

    def _parse(self, options: dict[str, Any] | None) -> ResetOptions:
        """The checked options of a reset."""
        return self._setting.parse_options(options)

    def _start(self, options: ResetOptions, start: Start) -> None:
        """Bring the simulation to a start; refuse what is wrong before anything is changed."""
        raise NotImplementedError

    def _move(self, action: np.ndarray) -> bool:
        """Put an action (n_inputs,) in force and advance by a control period; whether it went."""
        raise NotImplementedError

    def _make_readout(self, simulation: Simulation | BeamSimulation) -> Measured:
        """What is measured of a simulation."""
        raise NotImplementedError

    # ------------------------------------------------------------------ simulation

    @property
    def current_task(self) -> Task:
        """The task of the running episode: `task`, with what was drawn and given to `reset`."""
        return self._current

    @property
    def scene(self) -> Scene | None:
        """The scene of the running episode; None with another plant than the MuJoCo chain."""
        return self._simulation.scene

    @property
    def simulation(self) -> Simulation | BeamSimulation:
        """What is advanced; another one after a reset that varies the robot."""
        return self._simulation

    def _install(self, simulation: Simulation | BeamSimulation) -> None:
        """Connect to a simulation, so that a step looks nothing up."""
        self._simulation = simulation
        self.model, self.data = simulation.model, simulation.data
        self._advance = simulation.advance
        self._estimates = simulation.estimates
        self._readout = self._make_readout(simulation)

    def _follow(self, task: Task, reference: ReferenceTable) -> None:
        """Make a task the current one."""
        self._current, self._reference = task, reference
        self._points, self._last_index = reference.points, reference.last_index

    def _reference_of(self, task: Task) -> ReferenceTable:
        """Reference of a task, which may be the current one."""
        return self._reference if task == self._current else self._setting.reference_of(task)

    def __getstate__(self) -> dict:
        return {k: v for k, v in self.__dict__.items() if k not in _REBUILT}

    def __setstate__(self, state: dict) -> None:
        self.__dict__.update(state)
        self._renderer = None
        self._install(self._simulation)
        if not self._robot_vary:  # one model, as before
            self._setting.plant.adopt(self._simulation)
        if self._last_observation is not None:
            self._bind_observation(self._index + 1)

    # ------------------------------------------------------------------ episodes

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Seen, dict[str, Any]]:
        """Start an episode at rest.

        Args:
            seed: Seed of `np_random`. Only `randomization` and the noise of sensors and of a twin's
                camera draw from it.
            options: `SIMULATED_OPTIONS` of `envs.options`, see there; each holds for this episode
                only.

        Raises:
            ValueError: A bad option; the message names what is allowed.
            EquilibriumError: There is no equilibrium at the start.
        """
        super().reset(seed=seed)
        parsed = self._parse(options)
        # Everything that can be refused comes before anything is changed.
        task = parsed.changed(self.task)
        start, reference = self._setting.start(parsed, task), self._reference_of(task)
        self._start(parsed, start)
        self._follow(task, reference)
        self._action_array = self._setting.action_of(start.input)
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
        return observation, self._info(NO_REWARD)

    def _bind_observation(self, index: int) -> None:
        """Prepare the observations from control instant `index` on.

        Every observation takes the next row of the episode's own copies of the reference: none is
        shared between observations, and none is copied in a step.
        """
        sources = Sources(
            self._readout,
            lambda column: iter(self._rows[column][index:]).__next__,
            lambda: self._action_array,
        )
        self._see = self._setting.observer(sources)

    # ------------------------------------------------------------------ steps

    def step(self, action: np.ndarray) -> tuple[Seen, float, bool, bool, dict[str, Any]]:
        """Apply an action (n_inputs,) in [-1, 1] for one control period.

        Raises:
            ValueError: Not n_inputs real numbers, or one beyond [-1, 1] by more than 1e-6.
            gymnasium.error.ResetNeeded: The episode is over or was never started.
        """
        if not self._running:
            raise gymnasium.error.ResetNeeded("call reset() before step(): no episode is running")
        previous = self._action
        given, self._action = one_action(action, self._action_shape)
        if self._setting.change is not None:
            given = self._setting.wanted(given, self._action_array)
            self._action = given.tolist()
        self._action_array = given
        healthy = self._move(self._action_array)
        self._index += 1
        failure = self._measure()
        if not healthy:
            failure = self._simulation.failure() or failure
        if failure is not None:
            return self._fail(failure)
        return self._go_on(*self._reward.terms(self._error, self._action, previous))

    def _measure(self) -> str | None:
        """Update measurements and error; return what left the workspace, or None."""
        readout = self._readout
        outside = readout.update()
        self._error = dist(readout.tip, self._points[self._index])
        return outside

    def _observe(self) -> Seen:
        self._last_observation = observation = self._see()
        return observation

    def _go_on(
        self, reward: float, terms: dict[str, float64]
    ) -> tuple[Seen, float, bool, bool, dict[str, Any]]:
        self._running = self._index < self._last_index
        observation = self._observe()
        if self.render_mode == "human":
            self.render()
        return observation, reward, False, not self._running, self._info(terms)

    def _fail(self, failure: str) -> tuple[Seen, float, bool, bool, dict[str, Any]]:
        self._running = False
        reward, terms = self._reward.failed_terms()
        last = copied(self._last_observation)
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
        if self._variation:
            info |= self._variation
        return info if readout.truth is None else info | readout.truth()

    # ------------------------------------------------------------------ pictures

    @property
    def metres_per_pixel(self) -> float | None:
        """[m] in the plane of pictures that `render` makes as arrays; None before the first."""
        return None if self._renderer is None else self._renderer.metres / self._frame_size[1]

    def render(self) -> np.ndarray | None:
        """Frame (height, width, 3) uint8 in mode "rgb_array"; None otherwise.

        Raises:
            RenderError: No OpenGL (or, in mode "human", no display); says what to install.
            gymnasium.error.ResetNeeded: Nothing was started yet.
        """
        if self._last_observation is None:
            raise gymnasium.error.ResetNeeded("call reset() before render()")
        if self.render_mode is None:
            gymnasium.logger.warn(
                'render() does nothing without a render mode; pass render_mode="rgb_array"'
            )
            return None
        if self._renderer is None:
            scene = self._setting.plant.config
            self._renderer = make_renderer(self.render_mode, scene, self._frame_size)
        return self._renderer.draw(self._frame())

    def open_window(self) -> WindowRenderer:
        """The window of render mode "human", opened with sliders for the drives if it is not open.

        Raises:
            RenderError: There is no display.
        """
        if self._renderer is None:
            self._renderer = WindowRenderer(self._setting.plant.config, controls=True)
        return self._renderer

    def _frame(self) -> Frame:
        return Frame(
            episode=self._episode,
            time=self._simulation.time,
            qpos=self._simulation.posture,
            tension=self._readout.tendon_tension(),
            target=self._in_space(np.array(self._points[self._index])[None])[0],
            path=self._in_space(self._current.trajectory.path()[:, self.axes]),
            jumps=getattr(self._current.trajectory, "jumps", False),
        )

    def _in_space(self, points: np.ndarray) -> np.ndarray:
        """Where to draw points (k, d) [m] of the reference, (k, 3)."""
        if self.task.axes == "xy":
            return lifted(self.task.robot, points)
        base = self.task.robot.base
        placed = np.tile((0.0, 0.0, 0.0) if base is None else base.position, (len(points), 1))
        placed[:, self.axes] = points
        return placed

    def close(self) -> None:
        """Free the renderer; closing twice is harmless."""
        if self._renderer is not None:
            self._renderer.close()
            self._renderer = None
