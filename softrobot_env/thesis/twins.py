"""Twins of the spatial test rig, see `robots.twin`.

`EQUIVALENT`: the thesis' EI belongs to its model of one piece of constant curvature. A real beam
also bends unevenly, and its heavy head makes it softer than that model. With 1.2 times the modulus
it stands where the model says, within 2 % up to 120 mm, and with 1.2 times the damping it calms
down at the model's rate, within 10 % (tests hold it).
"""

from softrobot_env.robots.twin import Twin, sampled_twin, twin_of
from softrobot_env.thesis.robots import RIG


def rig3d_twin(seed: int) -> Twin:
    """A rig with errors of manufacturing, of its servos and its camera, sampled from a seed.

    Raises:
        ValueError: The seed is no whole number of zero or more.
    """
    return sampled_twin(RIG, seed)


def twin_or_ideal(seed: int | None) -> Twin:
    """The twin of a seed; without one the ideal rig, which the one-piece model describes."""
    return twin_of(RIG, seed)
