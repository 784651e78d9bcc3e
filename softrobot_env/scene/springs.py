"""Springs between the hinges of a station, with which it bends alike in all directions.

A station's hinges turn by b (towards +x), g (towards +y) and, with torsion, t (about the axis). A
share of beam stores k / 2 times the square of its bend and k_t / 2 times that of its twist, the
hinges' own springs k (b^2 + g^2) / 2 + k_t t^2 / 2. But hinges that share a point act one after the
other: the rotation vector of three of them is, to second order,

    (b + g t / 2) towards +x,    (g - b t / 2) towards +y,    (t + s b g / 2) about the axis,

s = 1 where the first of them bends towards +x, else -1. Carried on to fourth order, the hinges'
springs lack

    s k_t / 2 b g t + (k_t / 8 - k / 6) b^2 g^2 + (k / 24 - k_t / 12) (b^2 + g^2) t^2.

Without the first term a bent station twists for nothing. A chain without torsion lacks
-k / 6 b^2 g^2: its universal joints, which tilt by the root of b^2 + g^2 - b^2 g^2 / 3, are stiffer
between their axes. Fixed tendons along b +- g +- l t with springs of third and fourth order store
what is missing; nothing changes in a plane through an axis, nor for small angles.

A linear channel counts hinge angles, which are more than the bend by a share of the same order.
With all of the term in b^2 g^2 it bends too much between the axes, by a share of up to theta^2 / 8
for stations that bend by theta; without it, too little by theta^2 / 24, and a load by theta^2 / 6.
Robots with linear channels get half of it: theta^2 / 24 and theta^2 / 12.

The energy grows with the angles of a station up to 2.4 rad together; at a right angle of the second
hinge its joint is singular anyway.

Under random forces and moments in space the tips of slender rods with 12 stations of `balanced2`
are 0.20 mm off in the mean (thermoplastic, 0.4 m) and 0.25 mm (steel wire, 0.6 m), and their sag at
45 degrees as much as along an axis (softrobot benchmark accuracy). Without these springs and with
the order of the hinges changed at every station it was 0.67 and 0.96 mm, and the sag 3.2 times. A
ball joint of EI / w with a twist hinge of EI / (nu w) below it comes to the same errors, but their
inertia about the axis is one, so that its mass matrix is singular; and it serves no channels.
"""

from math import sqrt

from softrobot_env.robots import RobotParams
from softrobot_env.scene.chain import Chain, order_of

#: Of the term in b^2 g^2, for robots with linear channels.
_WITH_CHANNELS = 0.5

#: Signs (k, 2) of g and t in the tendons of a station without and with torsion.
_BENDING = ((1, 0), (-1, 0))
_TWISTING = ((1, 1), (1, -1), (-1, 1), (-1, -1))


def add_springs(chain: Chain, robot: RobotParams, exact: bool = False) -> None:
    """Add what the hinges' own springs lack to a chain that bends in space on hinges.

    `exact` tells whether channels pull by how links turn, as guides do, else by hinge angles.
    """
    if "side" not in chain.kinds:
        return
    turning = exact or all(tendon.guides for tendon in robot.tendons)
    share = 1.0 if turning else _WITH_CHANNELS
    stations, weights = chain.layout.stations, chain.layout.weights
    bends = (robot.backbone.bending(stations) / weights).tolist()
    twists = (robot.backbone.torsion(stations) / weights).tolist()
    for index, (bend, twist) in enumerate(zip(bends, twists, strict=True)):
        if "twist" in chain.kinds:
            _couple_three(chain, index, bend, twist, robot.anisotropy * bend, share)
        else:
            _couple_two(chain, bend, index, share)


def _couple_two(chain: Chain, bend: float, index: int, share: float) -> None:
    """(b + g)^4 + (b - g)^4 = 2 b^4 + 12 b^2 g^2 + 2 g^4."""
    fourth = -share * bend / 6 / 12
    for number, (side, _) in enumerate(_BENDING):
        joints = {"hinge": 1.0, "side": side}
        _add_spring(chain, index, number, joints, 0.0, 4 * fourth)
    for kind in ("hinge", "side"):
        chain.spec.joint(f"{kind}{index}").stiffness[2] -= 8 * fourth


def _couple_three(
    chain: Chain, index: int, bend: float, twist: float, more: float, share: float
) -> None:
    """Sums over the four tendons x = b + u g + v l t, u and v = +-1:

    of u v x^3 = 24 l b g t, of x^4 = 4 b^4 + 4 g^4 + 4 l^4 t^4
    + 24 (b^2 g^2 + l^2 b^2 t^2 + l^2 g^2 t^2); `more` is how much stiffer b is than g.
    """
    sign = 1 if order_of(chain.kinds, index)[0] == "hinge" else -1
    both, each = twist / 8 - share * bend / 6, bend / 24 - twist / 12
    # Where no l makes both terms, it makes the first.
    ratio = sqrt(each / both) if 0 < each * both <= both**2 else 1.0
    third = (more + sign * twist) / 2 / (24 * ratio)
    fourth = both / 24
    for number, (side, turn) in enumerate(_TWISTING):
        joints = {"hinge": 1.0, "side": side, "twist": turn * ratio}
        _add_spring(chain, index, number, joints, 3 * side * turn * third, 4 * fourth)
    for kind, arm in (("hinge", 1.0), ("side", 1.0), ("twist", ratio)):
        chain.spec.joint(f"{kind}{index}").stiffness[2] -= 16 * fourth * arm**4


def _add_spring(
    chain: Chain,
    index: int,
    number: int,
    joints: dict[str, float],
    square: float,
    cube: float,
) -> None:
    """Tendon along the hinges of a station, with the force of a power law of its length."""
    tendon = chain.spec.add_tendon(name=f"spring{index}_{number}")
    for kind, arm in joints.items():
        tendon.wrap_joint(f"{kind}{index}", arm)
    tendon.stiffness[1:3] = square, cube
