"""Springs that make a chain of hinges bend as the beam does.

Between the hinges of a station: it bends alike in all directions
-----------------------------------------------------------------

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

Between the pieces: a chain errs by the fourth power of their length
--------------------------------------------------------------------
Between its hinges a chain is straight. Let K be the curvature, t and n the tangent and the normal,
F the force in a section, and H the length of a piece. The angles of the chain wander about those of
the beam by K P(s): P is the length of beam that the hinges up to s stand for, less s, and has the
mean 0 and the mean square p. That adds, in the mean,

    p / 2 times the integral of (F . t) K^2

to the energy of the beam. So a chain whose hinges are as stiff as the beam is too stiff by p F . t
where it is pulled along, too soft where it is pressed. Loads along the rod make that error, which
no rule avoids: p is at least a twelfth of the hinges' distance squared, 1 / 6 - 1 / (2 sqrt 12)
times H^2 with `gauss2`, which has no other error of this order. But at rest

    EI K'' = (F . t) K - w . n        under a load w per length,

so the same energy comes from a moment M in a section that bends not this section alone:

    angle of a piece = (H + p H d2/ds2) M / EI.

It takes back the error, and p / 2 times the integral of w . t' too much. Weight and inertia are
such loads w; what they lose the masses give back: p / 2 rho A times more (mass times height) at the
begin of the coupled pieces, as much less at their end, and p rho A more rotary inertia per length.

In space the same holds for both directions of bending. Along a rod that is alike in all directions
the torque is the same between two loads: torsion needs no coupling. What stays of second order is
p (EI - GJ) times twist times the turning of the bend, which is zero without twist.

At the ends of coupled pieces an error of third order is left. Loads inside a rod break K and K'.
So pieces are coupled only between two loads, guides, discs, ends of tendons or of sections; fewer
than three of them, and those that taper, stay as they are. Forces that the scene does not know
beforehand (contacts, pushes) keep an error of second order.

A tendon in a channel presses the rod by its tension, and on it by as much load as keeps that in
balance: of the two only the moment is left, whose second derivative bends nothing. Robots with such
tendons take `gauss2`, unless another rule is asked for.

At 12 stations the mean error of a tip under random wrenches in space falls from 0.20 to 0.05 mm
(thermoplastic, 0.4 m). Large moments alone bend the outer pieces, whose second derivative is their
neighbours', unevenly: a rod bent to a full circle is 1.5 mm off with 12 stations, 0.07 mm with 24,
uncoupled 0.37 and 0.023 mm (`softrobot benchmark accuracy`).
"""

from collections.abc import Iterable, Iterator
from itertools import pairwise, product
from math import prod, sqrt

import numpy as np
from mujoco import MjsJoint, MjsTendon
from numpy import ndarray

from softrobot_env.robots import RobotParams

from .chain import Chain, order_of, station_stiffness

#: Of the term in b^2 g^2, for robots with linear channels.
_WITH_CHANNELS = 0.5


def add_springs(chain: Chain, robot: RobotParams, exact: bool = False) -> None:
    """Add what the hinges' own springs lack to a chain that bends in space on hinges.

    `exact` tells whether channels pull by how links turn, as guides do, else by hinge angles.
    """
    if "side" not in chain.kinds:
        return
    turning = exact or all(tendon.guides for tendon in robot.tendons)
    share = 1.0 if turning else _WITH_CHANNELS
    bending, torsion = station_stiffness(robot.backbone, chain.layout)
    bends = (bending / chain.layout.weights).tolist()
    twists = (torsion / chain.layout.weights).tolist()
    for index, (bend, twist) in enumerate(zip(bends, twists, strict=True)):
        if "twist" in chain.kinds:
            _couple_three(chain, index, bend, twist, robot.anisotropy * bend, share)
        else:
            # (b + g)^4 + (b - g)^4 = 2 b^4 + 12 b^2 g^2 + 2 g^4.
            _tie(chain, index, {"hinge": 1.0, "side": 1.0}, 0.0, -share * bend / 6 / 12)


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
    _tie(chain, index, {"hinge": 1.0, "side": 1.0, "twist": ratio}, third, both / 24)


def _tie(chain: Chain, index: int, arms: dict[str, float], third: float, fourth: float) -> None:
    """Tendons along b +- g, or b +- g +- l t, that store `third` x^3 uv + `fourth` x^4.

    The hinges' own powers of that are taken from their springs.
    """
    signs = list(product((1,), *[(1, -1)] * (len(arms) - 1)))
    for number, sign in enumerate(signs):
        tendon = chain.spec.add_tendon(name=f"spring{index}_{number}")
        for way, (kind, arm) in zip(sign, arms.items(), strict=True):
            tendon.wrap_joint(f"{kind}{index}", way * arm)
        tendon.stiffness[1:3] = 3 * prod(sign) * third, 4 * fourth
    for kind, arm in arms.items():
        chain.spec.joint(f"{kind}{index}").stiffness[2] -= 4 * len(signs) * fourth * arm**4


# ---------------------------------------------------------------- between the pieces

#: p / H^2 of two hinges at the Gauss points of a piece.
_WANDERING = 1 / 6 - 1 / (2 * sqrt(12))

#: Least number of pieces that have a second derivative.
_LEAST = 3

#: Pieces farther apart, which are coupled by 1e-5 of their stiffness, are left uncoupled.
_REACH = 3


def couple_pieces(chain: Chain, robot: RobotParams, loaded: Iterable[float] = ()) -> None:
    """Couple neighbouring pieces of a chain on hinges with the hinges of `gauss2`.

    Those of sections that taper stay as they are.

    Args:
        chain: The chain, with the springs of its hinges.
        robot: The robot.
        loaded: Arc lengths [m] where loads act.
    """
    for first, end in _runs(_breaks(robot, loaded), chain.layout.edges):
        middle = chain.layout.edges[first : first + 2].mean(keepdims=True)
        if not robot.backbone.sections[robot.backbone.index(middle)[0]].is_uniform:
            continue
        for kind, share in (
            ("hinge", 1 + robot.anisotropy / 2),
            ("side", 1 - robot.anisotropy / 2),
        ):
            if kind in chain.kinds:
                bending = share * float(robot.backbone.bending(middle)[0])
                time = float(robot.backbone.damping_time(middle)[0])
                _couple(chain, kind, (bending, time), first, end)
        _correct_masses(chain, float(robot.backbone.mass(middle)[0]), first, end)


def _breaks(robot: RobotParams, loaded: Iterable[float]) -> list[float]:
    """Arc lengths [m] where something acts, or where the backbone changes, in order."""
    breaks = {*robot.backbone.ends.tolist(), *loaded, *(disc.station for disc in robot.discs)}
    for tendon in robot.tendons:
        breaks |= {*tendon.guides, tendon.end, *(point[0] for point in tendon.route)}
    return sorted(breaks)


def excess_stiffness(pieces: int) -> ndarray:
    """Stiffness (k, k) [1] of k >= 3 coupled pieces less that of free ones, over EI / H.

    The second difference of an outermost piece is its neighbour's: under moments that vary
    linearly all of them turn together, and about the clamp, as much as without coupling.
    """
    second = np.zeros((pieces, pieces))
    for k in range(pieces):
        middle = min(max(k, 1), pieces - 2)
        second[k, middle - 1 : middle + 2] = 1, -2, 1
    compliance = np.eye(pieces) + _WANDERING / 2 * (second + second.T)
    return np.linalg.inv(compliance) - np.eye(pieces)


def _runs(breaks: list[float], edges: ndarray) -> Iterator[tuple[int, int]]:
    """First piece and end of each run of whole pieces between two breaks [m]."""
    tolerance = 1e-9 * edges[-1]
    for low, high in pairwise(breaks):
        first = int(np.searchsorted(edges, low - tolerance))
        end = int(np.searchsorted(edges, high + tolerance, side="right")) - 1
        if end - first >= _LEAST:
            yield first, end


def _couple(chain: Chain, kind: str, beam: tuple[float, float], first: int, end: int) -> None:
    """Springs between pieces; what is left of a piece's own goes to its hinges, half and half.

    `beam` is bending stiffness [N m2] and damping time [s].
    """
    bending, time = beam
    added = bending / chain.layout.sizes[first] * excess_stiffness(end - first)
    for i in range(end - first):
        for j in range(i + 1, min(i + 1 + _REACH, end - first)):
            # As long as the difference of the angles of the two, at rest as they are.
            tendon = chain.spec.add_tendon(name=f"couple_{kind}{first + i}_{first + j}")
            rest = 0.0
            for piece, arm in ((first + i, 1.0), (first + j, -1.0)):
                for joint in _hinges(chain, kind, piece):
                    tendon.wrap_joint(joint.name, arm)
                    rest += arm * joint.springref
            tendon.springlength = [rest, rest]
            _stiffen(tendon, -added[i, j], time)
        for joint in _hinges(chain, kind, first + i):
            _stiffen(joint, 2 * added[i].sum(), time)


def _hinges(chain: Chain, kind: str, piece: int) -> list[MjsJoint]:
    """The hinges of a kind in a piece."""
    return [chain.spec.joint(f"{kind}{k}") for k in np.flatnonzero(chain.layout.piece == piece)]


def _stiffen(part: MjsJoint | MjsTendon, stiffness: float, time: float) -> None:
    """Add a stiffness [N m], damped over a time [s]."""
    part.stiffness[0] += stiffness
    part.damping[0] += time * stiffness


def _correct_masses(chain: Chain, density: float, first: int, end: int) -> None:
    """Move masses and add rotary inertia, see the module; `density` is rho A [kg/m]."""
    edges = chain.layout.edges
    square = _WANDERING * chain.layout.sizes[first] ** 2
    bounds = np.append(chain.layout.stations, chain.length).clip(edges[first], edges[end])
    for body, length in zip(chain.bodies[1:], np.diff(bounds), strict=True):
        body.inertia = body.inertia + square * density * length * np.array([1.0, 1.0, 0.0])
    for station, sign in ((edges[first], 1), (edges[end], -1)):
        body, _ = chain.locate(station)
        if body is not chain.bodies[0]:
            body.ipos[2] += sign * square / 2 * density / body.mass
