"""Clamped rods that press on something without friction, in closed form or as elasticas.

Frame as in `truths.analytic`: the straight rod lies along +z from its clamp and bends in the x-z
plane, towards +x by a positive angle; points and forces are pairs (x, z). The rods bend only.
"""

from dataclasses import dataclass

import numpy as np
from numpy import ndarray

from softrobot_env.core.equilibrium import EquilibriumError
from studies.truths.analytic import Section, planar_slope
from studies.truths.shooting import grown, integral


def propped_reaction(
    length: float, bending_stiffness: float, load: float, station: float, give: float = 0.0
) -> float:
    """Force [N] of a prop on a cantilever under a uniform load, of small deflection.

    Without it the beam sinks by q a^2 (6 L^2 - 4 L a + a^2) / (24 EI) at a; its force lifts it by
    R a^3 / (3 EI) and presses the prop down by R c. With a = L and c = 0, R = 3/8 q L
    (Timoshenko, Strength of Materials).

    Args:
        length: L [m].
        bending_stiffness: EI [N m2].
        load: q [N/m].
        station: a [m].
        give: c [m/N], how far the prop gives way.
    """
    a = station
    sunk = load * a**2 * (6 * length**2 - 4 * length * a + a**2) / (24 * bending_stiffness)
    return sunk / (a**3 / (3 * bending_stiffness) + give)


@dataclass(frozen=True)
class Touching:
    """A rod that touches something.

    Attributes:
        station: [m], arc length where it parts from it.
        contact: (2,) [N], force of all contacts on the rod.
        pressed: [N], sum of the contacts' sizes.
        tip: (2,) [m].
    """

    station: float
    contact: ndarray
    pressed: float
    tip: ndarray


def rod_on_post(
    length: float,
    bending_stiffness: float,
    force: tuple[float, float],
    post: tuple[float, float],
    radius: float,
) -> Touching:
    """A rod pressed on a round post in one point, by a dead force at its tip.

    The post stands on the side of +x. Its force is across the rod, whose moment M is zero at the
    tip, with M' = N_z sin t - N_x cos t of the internal force N and t' = M / EI.

    Args:
        length: [m].
        bending_stiffness: EI [N m2].
        force: (2,) [N] at the tip.
        post: (2,) [m], centre of the post.
        radius: [m] of the post, and of the rod added.

    Raises:
        EquilibriumError: None was found, or the rod would lie on the post in more than a point.
    """
    dead, centre = np.array(force), np.array(post)

    def follow(x: ndarray) -> tuple[ndarray, ndarray]:
        moment, pressed, station, angle = x
        push = -pressed * _across(angle)
        first = _elastica(np.array([0, 0, 0, moment]), station, dead + push, bending_stiffness)
        return first, _elastica(first, length - station, dead, bending_stiffness)

    def residual(x: ndarray, _: float) -> ndarray:
        touching, tip = follow(x)
        angle = x[3]
        apart = touching[:2] + radius * _across(angle) - centre
        bend = length / bending_stiffness
        return np.array([*(apart / length), touching[2] - angle, tip[3] * bend])

    size = np.linalg.norm(dead)
    guess = np.array([0.0, size * length / centre[1], centre[1], 0.0])
    found = grown(residual, guess, "a rod on the post", steps=1)
    touching, tip = follow(found)
    _, pressed, station, angle = found
    if pressed < 0 or touching[3] * radius > bending_stiffness:
        raise EquilibriumError("the rod lies on the post in none or in more than a point")
    push = -pressed * _across(angle)
    return Touching(float(station), push, float(pressed), tip[:2])


def rod_round_cylinder(
    length: float,
    bending_stiffness: float,
    force: tuple[float, float],
    post: tuple[float, float],
    radius: float,
) -> Touching:
    """A rod bent over a round post, on an arc of which it lies, by a dead force at its tip.

    On the arc its curvature is 1 / R, the moment EI / R is constant, there is no shear force, and
    the tension T presses with T / R per length. At both ends of the arc an edge takes the shear
    force of the free parts.

    Args:
        length, bending_stiffness, force, post, radius: As of `rod_on_post`.

    Raises:
        EquilibriumError: None was found, or the rod touches in less than an arc.
    """
    dead, centre = np.array(force), np.array(post)

    def parts(x: ndarray) -> tuple[ndarray, ndarray, float, ndarray]:
        moment, edge, first, angle, last = x
        turned = angle + (last - first) / radius
        tension = float(dead @ [np.sin(turned), np.cos(turned)])
        inside = tension * np.array([np.sin(angle), np.cos(angle)]) - edge * _across(angle)
        begun = _elastica(np.array([0, 0, 0, moment]), first, inside, bending_stiffness)
        left = np.array([*(centre - radius * _across(turned)), turned, bending_stiffness / radius])
        return begun, inside, tension, _elastica(left, length - last, dead, bending_stiffness)

    def residual(x: ndarray, _: float) -> ndarray:
        begun, _, _, tip = parts(x)
        apart = begun[:2] + radius * _across(x[3]) - centre
        moments = np.array([begun[3] - bending_stiffness / radius, tip[3]])
        return np.array([*(apart / length), begun[2] - x[3], *moments * length / bending_stiffness])

    # As a straight beam that is held where the arc begins.
    moment, first = bending_stiffness / radius, centre[1]
    guess = np.array([-moment / 2, 1.5 * moment / first, first, first / radius / 4, 1.2 * first])
    found = grown(residual, guess, "a rod on an arc of the post", steps=1)
    _, edge, first, angle, last = found
    if edge < 0 or last < first:
        raise EquilibriumError("the rod lies on no arc of the post")
    _, inside, tension, tip = parts(found)
    arc = (last - first) / radius
    edges = edge + float(dead @ _across(angle + arc))
    return Touching(float(last), inside - dead, edges + tension * arc, tip[:2])


def _across(angle: float) -> ndarray:
    """Unit vector (2,) across a rod at an angle [rad], towards +x of a straight one."""
    return np.array([np.cos(angle), -np.sin(angle)])


def _elastica(start: ndarray, length: float, force: ndarray, bending_stiffness: float) -> ndarray:
    """State (x, z, angle, moment) at the end of a part with the internal force (2,) [N]."""
    rod = Section(bending_stiffness)
    return integral(lambda _, y: planar_slope(y, force, rod), (0.0, length), start)
