"""Protocols shared by environments, controllers, learned policies and models."""

from collections.abc import Callable
from typing import TYPE_CHECKING, Any, NamedTuple, Protocol

from numpy import ndarray

if TYPE_CHECKING:
    from softrobot_env.robots import RobotParams

Observation = dict[str, ndarray]

#: An observation as an agent sees it: its observables, or one vector of them.
Seen = Observation | ndarray

#: Shows how far a long piece of work is: a description, how much is done and how much there is.
ProgressCallback = Callable[[str, int, int], None]


def quiet(what: str, done: int, total: int) -> None:
    """Progress that nobody wants to see."""


class Measurement(NamedTuple):
    """What can be measured of a robot.

    Attributes:
        tip_position: (axes,) [m], in the world.
        tip_velocity: (axes,) [m/s].
        curvature: [1/m], mean over each of the robot's pieces: (robot.pieces,) in the plane,
            (2 robot.pieces,) in space, (beta, gamma) piece by piece.
        curvature_rate: [1/(m s)], as the curvature.
        tendon_length: (n_tendons,) [m] inside the robot.
    """

    tip_position: ndarray
    tip_velocity: ndarray
    curvature: ndarray
    curvature_rate: ndarray
    tendon_length: ndarray


class PlantModel(Protocol):
    """Equations of motion of a robot in place of a MuJoCo scene.

    The controls are its tendons' tensions [N] or lengths pulled in [m]. The state is kept by the
    caller: coordinates q and velocities v, both (n,).

    Attributes:
        robot: The robot.
        strain: Largest axial strain [1], of either sign, for which read-outs make sense; zero if
            the model is inextensible.
        cells: (k + 1,) [m], edges of the parts whose rotation `shape` tells; needed by robots with
            sensors only.
    """

    robot: "RobotParams"
    strain: float
    cells: ndarray

    def rest(self) -> ndarray:
        """Coordinates (n,) of the straight pose."""

    def equilibrium(self, control: ndarray) -> ndarray:
        """Coordinates (n,) at rest under controls (n_tendons,).

        Raises:
            EquilibriumError: There is none, or it is unstable.
        """

    def bent(self, curvature: ndarray) -> ndarray:
        """Coordinates (n,) whose measured curvature is this, as in `Measurement`.

        Raises:
            ValueError: The model cannot take this shape; the message says why.
        """

    def advance(self, q: ndarray, v: ndarray, control: ndarray, duration: float) -> str | None:
        """Move the state on in place.

        Args:
            q, v: The state.
            control: (n_tendons,) held, or (1 + k, n_tendons): at the start and after each of k
                equal parts of the duration, steady in between.
            duration: [s].

        Returns:
            What went wrong, after how many seconds and with which method; None if nothing did.
        """

    def measure(self, q: ndarray, v: ndarray) -> Measurement:
        """New arrays with everything that can be measured in a state."""

    def tension(self, q: ndarray, control: ndarray) -> ndarray:
        """Tensions (n_tendons,) [N] in a posture under controls (n_tendons,)."""

    def strains(self, q: ndarray) -> ndarray:
        """Mean beta, gamma and torsion (robot.pieces, 3) [1/m] of the robot's pieces, to draw."""

    def shape(self, q: ndarray) -> ndarray:
        """The same (k, 3) of the parts between `cells`, for sensors."""


class PlantFactory(Protocol):
    """Builds the model of a robot; a variation of the robot needs another model."""

    def __call__(
        self, robot: "RobotParams", *, axes: slice, bending: str, torsion: bool, actuation: str
    ) -> PlantModel:
        """Build a model.

        Args:
            robot: The robot.
            axes: Coordinates out of x, y and z of the tip that are measured.
            bending: "planar" (in the x-z plane) or "spatial".
            torsion: Whether a model in space twists too; one that always does may ignore it.
            actuation: "tension" or "length", what the controls are.

        Raises:
            ValueError: The model cannot do that; the message says what.
        """


class Policy(Protocol):
    """A policy with the signature of stable-baselines3's `predict`.

    Integrators, warm starts and held actions live in the returned state, so that policies can
    be swapped, shared between environments and used by stable-baselines3's tools.
    """

    def predict(
        self,
        observation: Observation,
        state: Any = None,
        episode_start: ndarray | None = None,
        deterministic: bool = True,
    ) -> tuple[ndarray, Any]:
        """Choose actions.

        Args:
            observation: Arrays by name, either of one environment or stacked along a first
                axis for several.
            state: What the previous call returned, None at first.
            episode_start: (n_envs,) bool, where an episode has just begun.
            deterministic: Ignored by policies without randomness.

        Returns:
            Action (n_inputs,) or (n_envs, n_inputs) in [-1, 1], and the next state.
        """
