"""Friction in proportion to tension, along a tendon's way: at rest and in motion."""

import sys
from dataclasses import replace
from functools import cache
from pathlib import Path

import mujoco
import numpy as np
import pytest

from softrobot_env.robots import CANTILEVER_WEAK, Load, Tendon
from softrobot_env.robots.tendons import FeedLine
from softrobot_env.scene.build import build_scene
from softrobot_env.scene.config import SceneConfig
from softrobot_env.scene.integration.zones import Zones
from softrobot_env.scene.statics import equilibrium
from softrobot_env.scene.tangent import RubbingForces

sys.path.insert(0, str(Path(__file__).parents[2] / "scripts"))
from studies.truths.capstan import HangingRod

LENGTH, DISTANCE, PULL = CANTILEVER_WEAK.length, 0.02, 40.0
MIDDLE = np.array([LENGTH / 2])
BENDING = float(CANTILEVER_WEAK.backbone.bending(MIDDLE)[0])
WEIGHT = 9.81 * float(CANTILEVER_WEAK.backbone.mass(MIDDLE)[0])
LOAD = (-0.1, 0.2)

#: Tension [N]: pulled, let go by a quarter, and pulled again, less far.
LOOP = PULL * np.concatenate(
    [np.linspace(0, 1, 21)[1:], np.linspace(1, 0.75, 21)[1:], np.linspace(0.75, 0.95, 21)[1:]]
)


def rod(coefficient, gravity=0.0, pieces=12, loaded=False, **changes):
    """Hangs, with one tendon; 24 stations."""
    tendon = {"friction_coefficient": coefficient} | changes
    tendons = (Tendon("t", (DISTANCE, 0.0), LENGTH, 0, PULL, **tendon),)
    robot = replace(CANTILEVER_WEAK, gravity=(0.0, 0.0, gravity), tendons=tendons)
    loads = (Load("tip", LENGTH, (LOAD[0], 0.0, LOAD[1]), (0.0, 0.0, 0.0)),) if loaded else ()
    return build_scene(SceneConfig(robot, pieces=pieces, loads=loads))


# ---------------------------------------------------------------- the truth itself


def test_the_exact_rod_without_weight_is_the_formula():
    mu, exact = 0.2, HangingRod(LENGTH, BENDING, DISTANCE, 0.2)
    found = exact.tip_angles(LOOP)
    way = mu * DISTANCE * LENGTH / BENDING
    assert found[:20] == pytest.approx(np.log1p(way * LOOP[:20]) / mu, abs=1e-9)
    # Let go, tension is T0 / (1 - mu r T0 s / EI) up to where it was that before.
    s = np.linspace(0, LENGTH, 100_001)
    for tension, angle in zip(LOOP[20:40], found[20:40], strict=True):
        along = way * s / LENGTH
        grown = tension / np.maximum(1 - along * tension, 1e-9)
        before = PULL / (1 + along * PULL)
        kappa = DISTANCE * np.minimum(grown, before) / BENDING
        assert angle == pytest.approx(np.trapezoid(kappa, s), abs=1e-8)


def test_the_exact_rod_refuses_what_it_does_not_solve():
    sideways = HangingRod(LENGTH, BENDING, DISTANCE, 0.2, load=(1.0, -1.0))
    with pytest.raises(ValueError, match="slides"):
        sideways.tip_angles(LOOP)


# ---------------------------------------------------------------- loops


@cache
def exact_loop(coefficient, loaded):
    loads = {"weight": WEIGHT, "load": LOAD} if loaded else {}
    return HangingRod(LENGTH, BENDING, DISTANCE, coefficient, **loads).tip_angles(LOOP)


def worst_of(found, coefficient, loaded):
    """Largest error of tip angles in a loop, over its width where it was let go."""
    exact = exact_loop(coefficient, loaded)
    width = exact[39] - np.interp(LOOP[39], LOOP[:20], exact[:20])
    return np.abs(found - exact).max() / width


@pytest.mark.parametrize(("coefficient", "loaded"), [(0.05, False), (0.2, False), (0.2, True)])
def test_hysteresis_of_equilibria(coefficient, loaded):
    model = rod(coefficient, 9.81 if loaded else 0.0, loaded=loaded).model
    loads = np.ones(model.nu - 1)
    q = equilibrium(model, np.append(0.0, loads))
    rubbing, found = RubbingForces(model, q), []
    for tension in LOOP:
        q = equilibrium(model, np.append(tension, loads), q, rubbing=rubbing)
        found.append(q.sum())
    assert worst_of(found, coefficient, loaded) < 0.01


def test_equilibria_hold_what_sticks():
    """Also what is left inside of a reversal, however often they are found again."""
    model = rod(0.2).model
    q = equilibrium(model, np.zeros(1))
    rubbing = RubbingForces(model, q)
    q = equilibrium(model, np.array([PULL]), q, rubbing=rubbing)
    once = equilibrium(model, np.array([0.9 * PULL]), q, rubbing=rubbing)
    for _ in range(100):
        again = equilibrium(model, np.array([0.9 * PULL]), once, rubbing=rubbing)
    assert np.abs(again - once).max() < 1e-9


def test_hysteresis_of_slow_motion():
    scene = rod(0.2)
    corners = np.array([0.0, PULL, 0.75 * PULL, 0.95 * PULL])
    times = np.array([0.0, 20.0, 25.0, 29.0])
    asked = np.interp(np.arange(60), [-1, 19, 39, 59], times)

    def pull(t):
        return np.array([np.interp(t, times, corners)])

    motion = scene.simulate(29.0, pull, samples=np.append(0.0, asked))
    assert worst_of(motion.q[1:].sum(axis=1), 0.2, False) < 0.01


def test_nothing_creeps_while_held():
    scene = rod(0.2, 9.81)

    def pull(t):
        return PULL * np.array([np.interp(t, [0.0, 2.0, 3.0], [0.0, 1.0, 0.8])])

    motion = scene.simulate(70.0, pull, samples=1.0)
    tips = np.array([scene.tip(q) for q in motion.q[10:]])
    assert np.abs(tips - tips[0]).max() < 1e-6 * LENGTH
