"""A robot of one's own, in one file, with what the package shall know of it."""

from softrobot_env.robots import RobotEntry, RobotParams, Tendon, register_entry

WORM = RobotParams(
    name="worm",
    length=0.3,
    outer_radius=0.02,
    inner_radius=0.0,
    youngs_modulus=5e5,
    density=1070.0,
    damping_time=0.05,
    pieces=4,
    tendons=tuple(
        Tendon(f"{side}{pair}", (sign * 0.02, 0.0), end, pair, 30.0)
        for pair, end in enumerate((0.15, 0.3))
        for side, sign in (("up", 1), ("low", -1))
    ),
)


def register():
    """What an entry point of the group `softrobot_env` names."""
    register_entry(RobotEntry(WORM, task="figure_eight", policy="feedforward_pi"))
