"""Angles of fibres against chord geometry and integrals that share no code with the package."""

from itertools import pairwise

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.spatial.transform import Rotation
from support.exponentials import pose

from softrobot_env.sensing.shape import Places


def test_two_arcs_meet_at_half_the_sum_of_their_turns():
    """Corrected (4.6), at a joint between pieces of constant curvature."""
    edges, kappa = np.array([0.0, 0.03, 0.05, 0.09]), np.array([12.0, -5.0, 9.0])
    strain = np.zeros((1, 3, 3))
    strain[0, :, 0] = kappa
    places = Places(edges, [tuple(edges[:3]), tuple(edges[1:])], [(0.0, 0.09)])
    angles, spans = places.turns(strain)
    bends = kappa * np.diff(edges)
    np.testing.assert_allclose(angles[0, :, 0], (bends[1:] + bends[:-1]) / 2, atol=1e-14)
    np.testing.assert_allclose(angles[0, :, 1], 0.0, atol=1e-14)
    np.testing.assert_allclose(spans[0, 0], [bends.sum(), 0.0], atol=1e-14)


def _clothoid_angle(ends, a, b):
    """Angle at the joint of chords of kappa = a + b s, by adaptive quadrature."""

    def tangent(s):
        return np.exp(1j * (a * s + b * s**2 / 2))

    chords = [quad(tangent, low, high, complex_func=True)[0] for low, high in pairwise(ends)]
    return np.diff(np.angle(chords))[0]


def test_cells_converge_to_a_clothoid_with_second_order():
    ends, a, b = (0.013, 0.047, 0.081), 4.0, 250.0
    exact, errors = _clothoid_angle(ends, a, b), []
    for cells in (4, 16, 64):
        edges = np.linspace(0, 0.09, cells + 1)
        strain = np.zeros((1, cells, 3))
        strain[0, :, 0] = a + b * (edges[1:] + edges[:-1]) / 2
        errors.append(abs(Places(edges, [ends], []).turns(strain)[0][0, 0, 0] - exact))
    assert errors[0] < 3e-3 and errors[2] < errors[0] / 100


def test_a_twisted_shape_in_space_against_exponentials():
    rng = np.random.default_rng(1)
    edges = np.array([0.0, 0.02, 0.05, 0.08, 0.12])
    strain, ends = rng.uniform(-8, 8, (4, 3)), (0.0, 0.06, 0.12)
    beta, gamma, torsion = strain.T
    poses = [pose(np.stack([-gamma, beta, torsion], axis=1), edges, s) for s in ends]
    first, second = np.diff(poses, axis=0)[:, :3, 3]
    axis = np.cross(first, second)
    turn = axis / np.linalg.norm(axis) * np.arctan2(np.linalg.norm(axis), first @ second)
    local = poses[1][:3, :3].T @ turn
    angles, _ = Places(edges, [ends], []).turns(strain[None])
    np.testing.assert_allclose(angles[0, 0], [local[1], -local[0]], atol=1e-12)


def test_turning_the_robot_turns_its_angles():
    rng = np.random.default_rng(2)
    edges = np.linspace(0, 0.1, 6)
    strain = rng.uniform(-6, 6, (3, 5, 3)) * [1, 1, 0]
    places = Places(edges, [(0.0, 0.05, 0.1)], [(0.0, 0.1)])
    turned = strain.copy()
    spin = Rotation.from_euler("z", 0.7).as_matrix()[:2, :2]
    turned[..., :2] = strain[..., :2] @ spin.T
    every, _ = places.turns(strain)
    np.testing.assert_allclose(places.turns(turned)[0], every @ spin.T, atol=1e-13)


def test_a_diverged_shape_is_not_hidden():
    angles, _ = Places(np.array([0.0, 0.1]), [(0.0, 0.05, 0.1)], []).turns(
        np.full((1, 1, 3), np.nan)
    )
    assert np.isnan(angles).all()


@pytest.mark.parametrize("turn", [1e-9, 1e-4, 9.99e-4, 1.01e-3, 3.0])
def test_small_and_large_bends_are_exact(turn):
    strain = np.zeros((1, 1, 3))
    strain[0, 0, 0] = turn / 0.1
    angles, _ = Places(np.array([0.0, 0.1]), [(0.0, 0.05, 0.1)], []).turns(strain)
    assert angles[0, 0, 0] == pytest.approx(turn / 2, rel=1e-9)
