"""Pieces that taper, and how many pieces a chain needs."""

import numpy as np
import pytest
from scipy.integrate import quad

from softrobot_env.robots import RobotParams, Section
from softrobot_env.robots.loads import Load
from softrobot_env.robots.sections import Backbone
from softrobot_env.scene.build import build_scene
from softrobot_env.scene.config import SceneConfig
from softrobot_env.scene.quadrature import RULES, place_between

LENGTH, MODULUS = 0.3, 2e6


def cone(*radii: float, pieces: int = 1, inner: float = 0.0) -> RobotParams:
    """A straight rod of such radii [m] at base and tip, without weight."""
    section = Section(LENGTH, radii, MODULUS, 1050.0, 0.02, pieces, inner, 0.4)
    return RobotParams("cone", sections=(section,))


@pytest.mark.parametrize("radii", [(0.012, 0.002), (0.004, 0.01)])
@pytest.mark.parametrize(("rule", "pieces"), [("gauss2", 1), ("gauss2", 3), ("gauss3", 1)])
def test_tip_of_a_cone_under_a_small_force_is_exact(radii, rule, pieces):
    """Castigliano: F times the integral of (L - s)^2 / EI."""
    robot, force = cone(*radii, pieces=pieces), 1e-7
    load = Load("push", LENGTH, (force, 0.0, 0.0))
    scene = build_scene(SceneConfig(robot, rule=rule, loads=(load,)))

    def give(s: float) -> float:
        return (LENGTH - s) ** 2 / robot.backbone.bending(np.array([s]))[0]

    exact = force * quad(give, 0, LENGTH, epsabs=0, epsrel=1e-10)[0]
    tip = scene.tip(scene.equilibrium(np.ones(1)))
    assert tip[0] == pytest.approx(exact, rel=1e-5)


@pytest.mark.parametrize("rule", list(RULES))
@pytest.mark.parametrize("inner", [0.0, 0.8])
@pytest.mark.parametrize("ratio", [0.02, 0.3, 0.999, 1.1, 4.0, 50.0])
def test_hinges_of_any_taper_lie_in_their_parts(rule, inner, ratio):
    radii = (0.01, 0.01 * ratio)
    hollow = tuple(inner * r for r in radii)
    section = Section(LENGTH, radii, MODULUS, 1050.0, 0.02, 2, hollow)
    edges = np.array([0.0, 0.5, 1.0]) * LENGTH
    layout = place_between(edges, rule, Backbone([section]))
    parts = np.append(0.0, np.cumsum(layout.weights))
    assert parts[-1] == pytest.approx(LENGTH)
    assert layout.piece.tolist() == sorted([0, 1] * len(RULES[rule]))
    assert np.all(parts[:-1] < layout.stations) and np.all(layout.stations < parts[1:])


@pytest.mark.parametrize("rule", list(RULES))
def test_a_cone_of_nearly_no_taper_is_a_uniform_rod(rule):
    near, plain = (SceneConfig(cone(0.01, r), pieces=3, rule=rule) for r in (0.01 + 1e-9, 0.01))
    for name in ("stations", "weights"):
        got, wanted = (getattr(config.layout, name) for config in (near, plain))
        np.testing.assert_allclose(got, wanted, rtol=1e-5)
