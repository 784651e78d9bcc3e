"""The verdict on stability against Ziegler's and Euler's columns of two links.

Two links of length 1 with masses 2 m and m at their ends and springs c at their joints, m = c = 1;
p is the force on the end, along the rod. Ziegler, Ingenieur-Archiv 20 (1952): a follower force
never buckles it, but makes it flutter from 7/2 - sqrt(2) on without damping. A dead one buckles it
at (3 - sqrt(5)) / 2.
"""

import numpy as np
import pytest

from softrobot_env.core import equilibrium

MASS = np.array([[3.0, 1.0], [1.0, 1.0]])
SPRING = np.array([[2.0, -1.0], [-1.0, 1.0]])
FLUTTER, BUCKLING = 3.5 - np.sqrt(2), (3 - np.sqrt(5)) / 2
#: Second flutter limit: beyond it both modes leave without swinging, though det K > 0.
APART = 3.5 + np.sqrt(2)


def follower(p):
    return SPRING + p * np.array([[-1.0, 1.0], [0.0, 0.0]])


def dead(p):
    return SPRING - p * np.eye(2)


def refused(kind, stiffness, damping=0.0):
    try:
        equilibrium.require_stable(kind, stiffness, MASS, damping * SPRING)
    except equilibrium.EquilibriumError as error:
        return str(error)
    return None


def test_a_dead_force_buckles_at_eulers_load():
    for kind in ("static", "dynamic"):
        assert refused(kind, dead(0.999 * BUCKLING)) is None
        assert "check_stability=False" in refused(kind, dead(1.001 * BUCKLING))


def test_a_follower_force_flutters_and_only_dynamic_refuses_it():
    assert refused("dynamic", follower(0.999 * FLUTTER)) is None
    assert "check_stability='static'" in refused("dynamic", follower(1.001 * FLUTTER))
    assert refused("static", follower(0.999 * APART)) is None
    assert "deviations on" in refused("static", follower(1.001 * APART))


def test_a_little_damping_lowers_the_flutter_load():
    """Ziegler's paradox: damping in both joints, here proportional to the springs."""
    assert refused("dynamic", follower(1.9)) is None
    assert refused("dynamic", follower(1.9), damping=1e-3) is not None


def test_growth_is_that_of_the_undamped_motion():
    wanted = np.sqrt(-np.linalg.eigvals(np.linalg.solve(MASS, dead(1.0))).real.min())
    assert equilibrium.static_growth(dead(1.0), MASS) == pytest.approx(wanted, rel=1e-12)
    assert equilibrium.static_growth(np.diag([1.0, 0.0]), MASS) == 0.0


def test_the_verdict_survives_stiffnesses_of_very_different_size():
    """A slender rod: its soft modes are 1e-12 of its stiffest one."""
    turn = np.linalg.qr(np.random.default_rng(0).normal(size=(4, 4)))[0]
    for soft, stable in ((1e-12, True), (-1e-12, False)):
        scale = np.diag([1e6, 1e3, 1.0, 1.0])
        stiffness = scale @ (turn @ np.diag([1.0, 1.0, 1.0, 1.0]) @ turn.T) @ scale
        stiffness[3, 3] = soft + stiffness[3, :3] @ np.linalg.solve(
            stiffness[:3, :3], stiffness[:3, 3]
        )
        assert (equilibrium.static_growth(stiffness, np.eye(4)) is None) == stable


def test_words_and_numbers_are_checked():
    assert [equilibrium.stability_asked(x) for x in (True, "static", "dynamic", False)] == [
        "static",
        "static",
        "dynamic",
        None,
    ]
    with pytest.raises(ValueError, match="'static', 'dynamic'"):
        equilibrium.stability_asked("flutter")
    assert equilibrium.checked_load_steps(np.int64(3)) == 3
    for wrong in (0, -1, 1.5, 0.2):
        with pytest.raises(ValueError, match="whole number, at least one"):
            equilibrium.checked_load_steps(wrong)
