"""How should a rod taper, and where should tendons run, to reach points with little tension?"""

from dataclasses import replace
from pathlib import Path

import numpy as np
from scipy.optimize import LinearConstraint, minimize

from softrobot_env.gradients import Rollout
from softrobot_env.gradients.parameters import Parameter
from softrobot_env.rendering.figures import new_figure, save
from softrobot_env.robots import find_robot
from softrobot_env.scene.build import build_scene
from softrobot_env.scene.config import SceneConfig

robot = find_robot("silicone_rod")
section, limit = robot.backbone.sections[0], robot.tendons[0].tension_limit
points = np.array([[0.08, 0.0, 0.09], [-0.04, 0.05, 0.12], [-0.03, -0.07, 0.10]])  # m


def designed(tip, away):
    """The rod with another radius [m] at its tip, and tendons as far [m] from its axis."""
    moved = [replace(t, offset=tuple(away * np.array(t.offset) / 0.01)) for t in robot.tendons]
    tapered = robot.with_sections(replace(section, outer_radius=(section.outer_radii[0], tip)))
    return replace(tapered, tendons=tuple(moved))


def rests(x, parameters=()):
    """Equilibria for x: radii of tip and tendons [cm], and shares of the limits of tensions."""
    built = build_scene(SceneConfig(designed(*1e-2 * x[:2]), pieces=8, bending="spatial"))
    rollout = Rollout(built, parameters)
    return [rollout.rest(limit * share) for share in x[2:].reshape(points.shape)]


def cost(x):
    """Squares of misses [cm2] and of shares of tension, and their derivatives."""
    tip, away = 1e-2 * x[:2]
    tips = Parameter("tip", lambda _, value: designed(value, away), tip, tip)
    tendons = Parameter("tendons", lambda _, value: designed(tip, value), away, away)
    value, slope = 0.05 * (x[2:] ** 2).sum(), np.append([0.0, 0.0], 0.1 * x[2:])
    for k, rest in enumerate(rests(x, [tips, tendons])):
        missed = 1e2 * (rest.observed.tip - points[k])
        value, (by_tension, by_design) = value + (missed**2).sum(), rest.vjp(tip=2e2 * missed)
        slope[:2] += 1e-2 * np.array([by_design["tip"], by_design["tendons"]])
        slope[2 + 3 * k : 5 + 3 * k] += limit * by_tension
    return value, slope


figure, ((axes,),) = new_figure(1, 1, (7, 4))
inside = LinearConstraint([[0.9, -1] + 9 * [0]], 0)  # tendons within 90 % of the tip's radius
free = {"as it is": [(1.5, 1.5), (1.0, 1.0)], "designed": [(0.6, 2.0), (0.4, 1.6)]}  # cm
for label, radii in free.items():
    given = {"bounds": radii + 9 * [(0, 1)], "constraints": inside, "method": "SLSQP"}
    x = minimize(cost, [1.5, 1.0, *9 * [0.3]], jac=True, **given).x
    gaps = [1e3 * np.linalg.norm(r.observed.tip - p) for r, p in zip(rests(x), points, strict=True)]
    found = f"{label}: radii {x[0]:.2f} and {x[1]:.2f} cm, misses by {max(gaps):.1f} mm"
    axes.plot(limit * x[2:], "o-", label=found)
    print(found, f"with {limit * x[2:].max():.1f} N at most")
axes.legend(title="tension [N] of each tendon at each point")
picture = save(figure, Path("out/examples/design_tendons.png"))
