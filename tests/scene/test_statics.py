"""Equilibria of the chain against closed forms and the elastica."""

from dataclasses import replace

import numpy as np
import pytest
from support.chains import SIMPLE_RULES
from support.postures import posed

from softrobot_env.beams.constant_curvature import ConstantCurvatureStatics
from softrobot_env.robots import ARM, CANTILEVER_WEAK
from softrobot_env.robots.actuation import TendonMap
from softrobot_env.robots.loads import Load
from softrobot_env.scene.build import build_scene
from softrobot_env.scene.chain import joint_angles
from softrobot_env.scene.config import SceneConfig
from softrobot_env.scene.quadrature import RULES
from softrobot_env.scene.statics import EquilibriumError, equilibrium
from softrobot_env.scene.tangent import RubbingForces
from studies.truths.analytic import arc_tip, elastica

WEIGHTLESS = replace(CANTILEVER_WEAK, gravity=(0.0, 0.0, 0.0))
LENGTH, EI = WEIGHTLESS.length, WEIGHTLESS.bending_stiffness
WEIGHT = CANTILEVER_WEAK.mass_per_length * 9.81


def tip(robot, n, rule, ctrl=(), **options):
    """Of a chain of n hinges, in equilibrium."""
    config = SceneConfig(robot, pieces=n // len(RULES[rule]), rule=rule, **options)
    model = build_scene(config).model
    return posed(model, equilibrium(model, np.array(ctrl, float))).site("tip").xpos[[0, 2]]


def moment_error(n, rule, moment=1.0):
    load = Load("load", LENGTH, moment=(0.0, moment, 0.0))
    found = tip(WEIGHTLESS, n, rule, [1.0], loads=(load,))
    return np.linalg.norm(found - arc_tip(LENGTH, moment / EI))


def weight_error(n, rule):
    truth = elastica(LENGTH, EI, weight=(-WEIGHT, 0.0)).tip
    return np.linalg.norm(tip(CANTILEVER_WEAK, n, rule) - truth)


def force_error(n, rule, force=(3.0, -1.0)):
    load = Load("load", LENGTH, force=(force[0], 0.0, force[1]))
    found = tip(WEIGHTLESS, n, rule, [1.0], loads=(load,))
    return np.linalg.norm(found - elastica(LENGTH, EI, force=force).tip)


def tendon_error(n, rule, reduced=(10.0, -5.0, 20.0)):
    reduced = np.array(reduced)
    found = tip(ARM, n, rule, TendonMap(ARM).tension(reduced))
    return np.linalg.norm(found - ConstantCurvatureStatics(ARM).tip(reduced))


# A hinge in the middle of each piece, or a pair of them, sees the curvature with an error of
# second order in the piece length, and so do straight links in the place of arcs. With g = 1/3
# the second-order term of the chords' shortening cancels; odd ones never occur. The order
# observed on finite chains is off by the next term, a few per cent here.
@pytest.mark.parametrize("rule", SIMPLE_RULES)
@pytest.mark.parametrize(
    ("error", "constant"),
    [(weight_error, False), (force_error, False), (moment_error, True), (tendon_error, True)],
    ids=["self_weight", "tip_force", "tip_moment", "tendon"],
)
def test_tip_error_is_of_the_rules_order(error, constant, rule):
    order = 4 if constant and rule == "chord2" else 2
    coarse, fine = (18, 36) if rule == "gauss3" else (12, 24)  # ends of pieces are the tendons'
    found = np.log2(error(coarse, rule) / error(fine, rule))
    assert found == pytest.approx(order, abs=0.15 if constant else 0.2)


@pytest.mark.parametrize("inputs", [(0, 0, 20), (10, -5, 20), (-40, 60, -30)])
def test_tendons_turn_every_hinge_by_the_exact_curvature(inputs):
    scene = build_scene(SceneConfig(ARM))
    reduced = np.array(inputs, float)
    posture = equilibrium(scene.model, TendonMap(ARM).tension(reduced))
    curvature = ConstantCurvatureStatics(ARM).curvature(reduced, scene.layout.stations)
    np.testing.assert_allclose(posture, curvature * scene.layout.weights, rtol=1e-9)


def test_no_equilibrium_is_reported(monkeypatch):
    """No load so bad is known; what remains is to forbid the path's steps."""
    monkeypatch.setattr("softrobot_env.core.continuation._STEPS", 1)
    with pytest.raises(EquilibriumError, match=r"no equilibrium beyond .* of the loads"):
        tip(CANTILEVER_WEAK, 12, "balanced2")


@pytest.mark.parametrize("bending", ["planar", "spatial"])
def test_a_backbone_that_rubs_keeps_a_bend_within_its_friction(bending):
    """A moment M bends it to (M - f) / EI; released, it opens where EI k - M would be beyond f."""
    held, most = 0.5 * EI / LENGTH, 1.3 * EI / LENGTH
    robot = replace(WEIGHTLESS, bending_friction=held)
    load = Load("load", LENGTH, moment=(0.0, 1.0, 0.0))
    built = build_scene(SceneConfig(robot, pieces=6, bending=bending, loads=(load,)))
    q = built.equilibrium(np.zeros(1))
    rubbing = RubbingForces(built.model, q)
    for moment, bend in ((most, most - held), (most / 2, most - held), (0.0, held)):
        q = equilibrium(built.model, np.array([moment]), q, rubbing=rubbing)
        curvature = joint_angles(built.model, q)[:, 0] / built.layout.weights
        assert EI * curvature == pytest.approx(bend, abs=0.02 * EI / LENGTH)  # it gives by 0.01


def test_a_scene_with_a_backbone_that_rubs_is_not_for_our_integrator():
    robot = replace(WEIGHTLESS, bending_friction=1e-3)
    assert build_scene(SceneConfig(robot)).timestep.integrator != "extrapolation"
