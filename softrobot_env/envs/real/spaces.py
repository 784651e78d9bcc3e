"""What the real rig observes and is told."""

from typing import NamedTuple

import numpy as np
from gymnasium import spaces

from softrobot_env.envs.observations.arm import observation_space
from softrobot_env.envs.observations.rig import RIG_OBSERVABLES, RigSizes
from softrobot_env.robots import LENGTH_SCALE, RobotParams
from softrobot_env.scene.quadrature import place_hinges
from softrobot_env.scene.registry import RIG_PIECES

#: Needs a board that measures forces.
TENSION = "tendon_tension"

#: What the rig cannot measure.
_UNSEEN = ("curvature", "curvature_rate")


class RealSpaces(NamedTuple):
    """Spaces of observations and actions, and of the tip position: what lies within reach."""

    observation: spaces.Dict
    action: spaces.Box
    reach: spaces.Box


def real_spaces(observe: tuple[str, ...] | str, robot: RobotParams, n_preview: int) -> RealSpaces:
    """Spaces of an environment.

    Args:
        observe: Names of the observables, or "all", which are those that every rig has.
        robot: The rig.
        n_preview: Number of preview times.

    Raises:
        ValueError: A name that is not known, or that the rig cannot measure.
    """
    known = {name: make for name, make in RIG_OBSERVABLES.items() if name not in _UNSEEN}
    names = (observe,) if isinstance(observe, str) else observe
    if observe == "all":
        names = [name for name in known if name != TENSION]
    layout = place_hinges(robot.length, RIG_PIECES, "balanced2")
    sizes = RigSizes(robot, layout, n_preview, LENGTH_SCALE)
    return RealSpaces(
        observation_space(tuple(names), sizes, known),
        spaces.Box(-1.0, 1.0, (sizes.n_tendons,), dtype=np.float32),
        known["tip_position"](sizes),
    )
