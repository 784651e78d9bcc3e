"""A file of what was identified of a rig in tests: a network that says the same of every place."""

import numpy as np

from softrobot_env.learned.network import Network, Scaling
from softrobot_env.robots import LENGTH_SCALE, RIG
from softrobot_env.thesis.rig.parameters import IdentifiedParameters

#: (3,), of full scale: the actions of the quasi-static policy with this network.
ALWAYS = np.array([0.1, 0.05, -0.05])


def constant_identified(twin=None):
    """What is identified of a twin, a rig that needs the same lengths everywhere."""
    scale = LENGTH_SCALE * np.ones(3)
    network = Network(
        (np.zeros((1, 2)), np.zeros((3, 1))),
        (np.zeros(1), ALWAYS),
        Scaling(-np.ones(2), np.ones(2)),
        Scaling(-scale, scale),
    )
    return IdentifiedParameters(
        network, stiffness=1.2, turn=0.0, damping=1.0, backlash=0.0, twin=twin
    )


def identified_file(path, twin=None):
    """Write it; returns the path."""
    constant_identified(twin).save(path, RIG, {})
    return path
