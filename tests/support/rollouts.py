"""Records of episodes, made by hand."""

import numpy as np

from softrobot_env.evaluation.rollout import Rollout


def made_rollout(time, reference, tip, **changed):
    """Of an episode (T,) [s] of which but reference and tip (T, 3) [m] all is zero, or changed."""
    zeros, one = np.zeros((len(time), 3)), np.zeros(len(time))
    names = ("action", "tendon_tension", "tendon_length", "curvature")
    decisions = {"policy_time": one[1:] + 1e-5, "policy_status": np.full(len(time) - 1, "")}
    values = dict.fromkeys(names, zeros) | {"reward": one, "wall_time": 1.0} | decisions
    return Rollout(time, reference, tip, **values | changed)
