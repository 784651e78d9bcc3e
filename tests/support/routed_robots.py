"""Robots of several or tapered sections, with tendons on any route."""

from dataclasses import replace

from softrobot_env.robots import RobotParams, Section, Tendon

#: Silicone rod of 0.4 m.
ROD = RobotParams(
    "rod",
    length=0.4,
    outer_radius=0.012,
    inner_radius=0.0,
    youngs_modulus=1e6,
    density=1100.0,
    damping_time=0.03,
    pieces=12,
    poisson_ratio=0.45,
)


def tendon(name: str, offset: tuple[float, float], end: float, **options: object) -> Tendon:
    """A tendon of 20 N that lengths can drive."""
    return Tendon(name, offset, end, 0, 20.0, stiffness=2e3, **options)


#: One tendon that winds half a turn round the rod: it bends and twists it into a helix.
HELICAL = replace(ROD, tendons=(tendon("helical", (0.008, 0.0), 0.4, turns=0.5),))

#: A thick, stiff section and a thin, soft one; a tendon ends where they meet.
TWO = RobotParams(
    "two",
    sections=(
        Section(0.25, 0.014, 8e5, 1100.0, 0.03, 6),
        Section(0.15, 0.010, 5e5, 1000.0, 0.02, 6),
    ),
    tendons=(tendon("inner", (0.008, 0.0), 0.25), tendon("outer", (-0.004, 0.007), 0.4)),
)

#: A tendon that comes nearer to the fibre, and one along via-points round it.
CONVERGING = replace(
    ROD, tendons=(tendon("nearer", (0.010, 0.0), 0.4, route=((0.4, 0.002, 0.0),)),)
)
VIA = replace(
    ROD,
    tendons=(
        tendon(
            "via",
            (0.010, 0.0),
            0.4,
            route=((0.13, 0.0, 0.009), (0.3, -0.006, 0.004), (0.4, 0.002, 0.0)),
        ),
    ),
)

#: A planar robot with one input: its tip moves on a line.
ONE_PAIR = RobotParams(
    name="one_pair",
    length=0.1,
    outer_radius=0.01,
    inner_radius=0.0,
    youngs_modulus=5e5,
    density=1000.0,
    damping_time=0.02,
    pieces=3,
    tendons=(Tendon("up", (0.008, 0.0), 0.1, 0, 10.0), Tendon("low", (-0.008, 0.0), 0.1, 0, 10.0)),
)

#: A cone, half as thick at its tip.
TAPERED = RobotParams(
    "tapered",
    sections=(Section(0.4, (0.012, 0.006), 1e6, 1100.0, 0.03, 12, poisson_ratio=0.45),),
    tendons=(tendon("straight", (0.005, 0.0), 0.4),),
)

#: Robot and tensions [N] that move its tip by 25 to 140 mm.
PULLED = {
    "helical": (HELICAL, [4.0]),
    "two sections": (TWO, [6.0, 2.0]),
    "converging": (CONVERGING, [4.0]),
    "via-points": (VIA, [4.0]),
    "tapered": (TAPERED, [0.5]),
}

#: Robot and tensions [N] that bend and twist it: helices of opposite hands, a tightly wound one
#: beside a straight tendon, a spiral in a cone, and via-points that are no ends of pieces.
WINDING = {
    "opposite hands": (
        replace(
            ROD,
            tendons=(
                tendon("right", (0.009, 0.0), 0.4, turns=1.2),
                tendon("left", (0.0, 0.008), 0.4, turns=-0.8),
            ),
        ),
        [10.0, 6.0],
    ),
    "tight": (
        replace(
            ROD,
            tendons=(
                tendon("helical", (0.009, 0.0), 0.4, turns=-3.0),
                tendon("straight", (-0.006, 0.004), 0.4),
            ),
        ),
        [9.0, 5.0],
    ),
    "spiral": (
        replace(
            TAPERED,
            tendons=(tendon("s", (0.010, 0.0), 0.4, turns=1.0, route=((0.4, 0.004, 0.0),)),),
        ),
        [2.0],
    ),
    "via-points": (VIA, [15.0]),
}
