from dataclasses import replace

import numpy as np
import pytest

from softrobot_env.robots import ARM, RIG
from softrobot_env.thesis.rig.three_tendons import ThreeTendons

#: Tendons with errors of azimuth [degrees] and radius [m], as on a real robot.
ROUGH = replace(
    RIG,
    tendons=tuple(
        replace(t, offset=(r * np.cos(np.radians(a)), r * np.sin(np.radians(a))), pretension=p)
        for t, a, r, p in zip(
            RIG.tendons, (7.0, 124.0, 231.0), (5.5e-3, 5.2e-3, 5.9e-3), (0.5, 0.2, 0.8), strict=True
        )
    ),
)
ROBOTS = pytest.mark.parametrize("robot", [RIG, ROUGH], ids=["exact", "rough"])


def directions(count=721):
    """Reduced inputs (count, 2) [N] in all quadrants and on all axes."""
    angle = np.linspace(0, 2 * np.pi, count)
    return 3 * np.column_stack([np.cos(angle), np.sin(angle)])


@ROBOTS
def test_reduced_input_is_the_moment_over_the_lever(robot):
    tendons, tension = ThreeTendons(robot), np.array([1.0, 2.0, 4.0])
    offsets = np.array([t.offset for t in robot.tendons])
    np.testing.assert_allclose(tendons.lever * tendons.reduced(tension), offsets.T @ tension)


def test_phi_is_that_of_the_thesis():
    half, side = np.sin(np.radians(30)), np.cos(np.radians(30))
    expected = [[1, -half, -half], [0, side, -side]]
    np.testing.assert_allclose(ThreeTendons(RIG).phi, expected, atol=1e-15)


@ROBOTS
def test_tensions_invert_the_projection_in_all_quadrants(robot):
    tendons, reduced = ThreeTendons(robot), directions()
    for tension in (tendons.tension(reduced), tendons.tension(reduced, total=30.0)):
        np.testing.assert_allclose(tendons.reduced(tension), reduced, atol=1e-14)
        assert np.all(tension - tendons.pretension >= -1e-14)


@ROBOTS
def test_least_tensions_leave_one_tendon_at_its_pretension(robot):
    """Less co-contraction would go below it, so none can be spared."""
    tendons = ThreeTendons(robot)
    above = tendons.tension(directions()) - tendons.pretension
    np.testing.assert_allclose(above.min(axis=1), 0, atol=1e-14)
    assert np.all(tendons.null > 0)
    np.testing.assert_allclose(tendons.phi @ tendons.null, 0, atol=1e-15)


def test_tensions_are_the_audits_at_120_degrees():
    tendons, reduced = ThreeTendons(RIG), directions()
    azimuth = 2 * np.pi / 3 * np.arange(3)
    pull = (
        2
        / 3
        * (np.outer(reduced[:, 0], np.cos(azimuth)) + np.outer(reduced[:, 1], np.sin(azimuth)))
    )
    least = pull - pull.min(axis=1, keepdims=True) + 0.5
    np.testing.assert_allclose(tendons.tension(reduced), least, atol=1e-14)
    np.testing.assert_allclose(tendons.tension(reduced, total=12.0), 4 + pull, atol=1e-14)


@ROBOTS
def test_tensions_are_continuous(robot):
    """Halving the steps halves the largest jump; a jump would stay."""
    tendons = ThreeTendons(robot)
    coarse, fine = (
        np.abs(np.diff(tendons.tension(directions(n)), axis=0)).max() for n in (721, 1441)
    )
    assert coarse / fine == pytest.approx(2, rel=0.02)


def test_constant_sum_keeps_the_sum_of_lengths():
    """Audit: the sum of the lengths is then constant, whatever the bending."""
    tendons, reduced = ThreeTendons(RIG), directions()
    curvature = 5 * reduced[::-1]
    tension = tendons.tension(reduced, total=12.0)
    np.testing.assert_allclose(tension.sum(axis=1), 12.0)
    total = tendons.pulled(tension, curvature).sum(axis=1)
    np.testing.assert_allclose(total, (12.0 - 1.5) / 980.0)


def test_a_sum_too_small_is_refused_with_the_least_one():
    tendons = ThreeTendons(RIG)
    with pytest.raises(ValueError, match=r"leaves a tendon .* give at least 7\.5 N"):
        tendons.tension(np.array([[-3.0, 0.0], [2.0, 0.0]]), total=5.0)
    assert tendons.tension(np.array([-3.0, 0.0]), total=7.5).sum() == pytest.approx(7.5)


@ROBOTS
def test_lengths_stretch_the_tendons_by_their_tensions(robot):
    tendons, curvature = ThreeTendons(robot), 7 * directions()
    tension = tendons.tension(directions()[::-1])
    pulled = tendons.pulled(tension, curvature)
    stretch = pulled - tendons.geometric(curvature)
    np.testing.assert_allclose(
        tendons.pretension + tendons.stiffness * stretch, tension, atol=1e-12
    )


@ROBOTS
def test_channels_shorten_on_the_inner_side(robot):
    """A channel at the offset p runs on an arc of radius 1 / kappa - p."""
    tendons, bend = ThreeTendons(robot), 6.0
    expected = [
        robot.length - (1 / bend - t.offset[1]) * bend * robot.length for t in robot.tendons
    ]
    np.testing.assert_allclose(tendons.geometric(np.array([0.0, bend])), expected, atol=1e-15)


@pytest.mark.parametrize(
    ("robot", "reason"),
    [
        (ARM, "need three tendons"),
        (replace(RIG, tendons=()), "got none"),
        (
            replace(RIG, tendons=(replace(RIG.tendons[0], end=0.1), *RIG.tendons[1:])),
            "of one length",
        ),
        (
            replace(RIG, tendons=(replace(RIG.tendons[0], offset=(-5e-3, 0.0)), *RIG.tendons[1:])),
            "do not surround",
        ),
        (
            replace(
                RIG,
                tendons=tuple(
                    replace(t, offset=(x, 0.0))
                    for t, x in zip(RIG.tendons, (1e-3, -1e-3, 2e-3), strict=True)
                ),
            ),
            "do not surround",
        ),
    ],
)
def test_other_tendons_are_refused(robot, reason):
    with pytest.raises(ValueError, match=reason):
        ThreeTendons(robot)
