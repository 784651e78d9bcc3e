"""What environments with one simulated robot share: steps, failures, `info` and pictures."""

from math import hypot
from typing import Any, ClassVar

import gymnasium
import numpy as np

from softrobot_env.envs.options import action_values
from softrobot_env.envs.reference import PLANE
from softrobot_env.envs.rendering.renderer import Frame, make_renderer
from softrobot_env.interfaces import Observation
from softrobot_env.scene.build import Scene

#: What `_install` takes from a simulation anew; a copy or a pickle goes without.
_REBUILT = {"model", "data", "_advance", "_ctrl", "_readout", "_readers", "_renderer"}


class EpisodeEnv(gymnasium.Env[Observation, np.ndarray]):
    """Episodes of one robot whose tip follows a reference.

    A subclass builds the spaces, installs a simulation and begins the episodes; see `TrackingEnv`.

    Attributes:
        axes: The coordinates out of x, y and z that positions have, a slice of (3,).
        control_period: [s].
        model, data: The MuJoCo objects of the running scene; None with another plant.
    """

    axes: ClassVar[slice] = PLANE

    @property
    def scene(self) -> Scene | None:
        """The scene of the running episode; None with another plant than the MuJoCo chain."""
        return self._simulation.scene

    def _bind_observation(self, index: int) -> None:
        """Prepare the observations from control instant `index` on.

        Every observation takes the next row of the episode's own copies of the reference: none is
        shared between observations, and none is copied in a step.
        """
        sources = self._readout.sources()
        sources |= {name: iter(rows[index:]).__next__ for name, rows in self._rows.items()}
        sources["previous_action"] = lambda: self._action_array
        self._readers = [(name, sources[name]) for name in self.observation_space]

    def __getstate__(self) -> dict:
        return {k: v for k, v in self.__dict__.items() if k not in _REBUILT}

    # ------------------------------------------------------------------ steps

    def step(self, action: np.ndarray) -> tuple[Observation, float, bool, bool, dict[str, Any]]:
        """Apply an action (n_inputs,) in [-1, 1] for one control period.

        Raises:
            ValueError: Wrong shape, NaN, or a value outside [-1, 1].
            gymnasium.error.ResetNeeded: The episode is over or was never started.
        """
        values = self._checked(action)
        self._action_array = array = action.astype(np.float64)
        self._pull(array, self._ctrl)
        healthy = self._advance()
        self._index = index = self._index + 1
        previous, self._action = self._action, values
        failure = self._measure()
        if not healthy:
            failure = self._simulation.failure() or failure
        if failure is not None:
            return self._fail(failure)
        terms = self._reward.terms(self._error, values, previous)
        truncated = index >= self._last_index
        self._running = not truncated
        self._last_observation = observation = {name: read() for name, read in self._readers}
        if self.render_mode == "human":
            self.render()
        return observation, sum(terms.values()), False, truncated, self._info(terms)

    def _checked(self, action: np.ndarray) -> list[float]:
        """The action as a list of floats."""
        if not self._running:
            raise gymnasium.error.ResetNeeded("call reset() before step(): no episode is running")
        return action_values(action, self._action_shape)

    def _measure(self) -> str | None:
        """Update measurements and error; return what left the workspace, or None."""
        readout = self._readout
        outside = readout.update()
        x, z = readout.tip
        x_ref, z_ref = self._points[self._index]
        self._error = hypot(x - x_ref, z - z_ref)
        return outside

    def _fail(self, failure: str) -> tuple[Observation, float, bool, bool, dict[str, Any]]:
        self._running = False
        terms = self._reward.failed_terms()
        last = {name: value.copy() for name, value in self._last_observation.items()}
        return last, sum(terms.values()), True, False, self._info(terms) | {"failure": failure}

    def _info(self, terms: dict[str, float]) -> dict[str, Any]:
        return {
            "time": self._index * self.control_period,
            "error": self._error,
            "tendon_tension": self._readout.tendon_tension(),
            "tendon_length": self._readout.tendon_length(),
            "reward_terms": terms,
            **self._truth(),
        }

    def _truth(self) -> dict[str, np.ndarray]:
        """What sensors with errors are to measure, for `info`; empty where they have none."""
        return {}

    # ------------------------------------------------------------------ pictures

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
            self._renderer = make_renderer(self.render_mode, self._plant.config, self._frame_size)
        return self._renderer.draw(self._frame())

    def _frame(self) -> Frame:
        return Frame(
            episode=self._episode,
            time=self._simulation.time,
            qpos=self._simulation.posture,
            tension=self._readout.tendon_tension(),
            target=self._in_space(np.array(self._points[self._index])),
            path=self._path(),
            jumps=getattr(self._current.trajectory, "jumps", False),
        )

    def _in_space(self, point: np.ndarray) -> np.ndarray:
        """Where to draw a point (2,) [m] of the reference, (3,)."""
        placed = np.zeros(3)
        placed[self.axes] = point
        return placed

    def _path(self) -> np.ndarray:
        """Points (k, 3) [m] of the reference, where to draw them."""
        return self._current.trajectory.path()

    def close(self) -> None:
        """Free the renderer; closing twice is harmless."""
        if self._renderer is not None:
            self._renderer.close()
            self._renderer = None
