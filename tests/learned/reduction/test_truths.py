"""Reduced models against systems whose manifolds and normal forms are known."""

from functools import cache

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.linalg import expm
from scipy.special import ellipk
from support.linear_systems import states

from softrobot_env.learned.reduction import (
    Record,
    Refinement,
    Settings,
    fit,
    normal_form,
    refine,
    spectrum,
)

PERIOD = 0.01

#: Exact derivatives of smooth, clean data.
CLEAN = {"constant": False, "window": 9, "degree": 8, "ridge": 0.0, "lag": 0, "mixed": False}


def record(outputs, inputs=None):
    inputs = np.zeros((len(outputs), 1)) if inputs is None else inputs
    return Record(outputs, inputs, PERIOD)


def by_frequency(values):
    return np.array(sorted(values, key=lambda one: one.imag))


def solved(rate, start, duration=20.0):
    """Motion of an autonomous system, sampled."""
    times = np.arange(0, duration, PERIOD)
    found = solve_ivp(rate, (0, duration), start, t_eval=times, rtol=1e-11, atol=1e-13)
    return found.y.T


def oscillators():
    """Two that are coupled: rates of positions and velocities, and the effect of a force."""
    a = np.zeros((4, 4))
    a[:2, 2:] = np.eye(2)
    a[2:, :2] = [[-25.0, 6.0], [6.0, -60.0]]
    a[2:, 2:] = -0.8 * np.eye(2)
    return a, np.array([[0.0], [0.0], [3.0], [1.0]])


def test_a_forced_linear_system_is_found_exactly():
    """Predicted to 1e-8 over 4 s of inputs that were not seen."""
    a, b = oscillators()
    whole = expm(PERIOD * np.block([[a, b], [np.zeros((1, 5))]]))
    rng = np.random.default_rng(0)
    records = []
    for _ in range(4):
        start, inputs = rng.normal(size=4), rng.normal(size=(400, 1))
        rows = states(whole[:4, :4], start, inputs @ whole[:4, 4:].T)
        records.append(record(rows, inputs))
    how = CLEAN | {"constant": True}
    how = Settings(**how, dimension=4, delays=1, shape_order=1, order=1, input_order=1)
    model = fit([], records[:3], how)
    np.testing.assert_allclose(
        by_frequency(model.eigenvalues()), by_frequency(np.linalg.eigvals(a)), rtol=1e-8
    )
    predicted = model.predict_record(records[3])
    assert np.abs(predicted - records[3].outputs).max() < 1e-8


def test_decays_of_a_linear_system_by_rates_and_delays():
    """Its places alone are seen; rates of change by polynomials of degree 8."""
    a, _ = oscillators()
    step, rng = expm(PERIOD * a), np.random.default_rng(0)
    decays = [record(states(step, rng.normal(size=4))[:, :2]) for _ in range(3)]
    how = Settings(**CLEAN, dimension=4, delays=3, shape_order=1, order=1, substeps=4)
    model = fit(decays[:2], [], how, np.zeros(2))
    np.testing.assert_allclose(
        by_frequency(model.eigenvalues()), by_frequency(np.linalg.eigvals(a)), rtol=1e-6
    )
    assert np.abs(model.predict_record(decays[2]) - decays[2].outputs[2:]).max() < 1e-6


W, ZETA, KAPPA = 5.0, 0.02, 40.0


@cache
def duffing():
    """Decays of q'' + 2 zeta w q' + w^2 q + kappa q^3 = 0, and a model of order 7."""

    def rate(_, y):
        return [y[1], -2 * ZETA * W * y[1] - W * W * y[0] - KAPPA * y[0] ** 3]

    decays = [record(solved(rate, [a, 0.0])[:, :1]) for a in (0.2, 0.3, 0.45)]
    how = Settings(**CLEAN, dimension=2, delays=3, shape_order=3, order=7, substeps=1)
    return decays, fit(decays, [], how, np.zeros(1))


def test_the_backbone_of_a_duffing_oscillator():
    """Frequency by amplitude against the exact elliptic integral, within 0.5 %."""
    form = normal_form(duffing()[1])
    radius = np.linspace(0.02, 0.4, 9)
    radius = radius / form.amplitude(np.array([1e-3]))[0, 0] * 1e-3
    size = form.amplitude(radius)[:, 0]
    share = KAPPA * size**2 / 2 / (W**2 + KAPPA * size**2)
    exact = np.pi * np.sqrt(W**2 + KAPPA * size**2) / 2 / ellipk(share)
    exact = exact * np.sqrt(1 - ZETA**2)
    assert size[-1] > 0.35 and exact[-1] > 1.08 * W
    np.testing.assert_allclose(form.frequency(radius), exact, rtol=5e-3)


def test_the_normal_form_of_a_duffing_oscillator():
    """c_1 = 3 i kappa / (8 w) per squared amplitude, to the order of the damping."""
    form = normal_form(duffing()[1], 3)
    per_radius = form.amplitude(np.array([1e-4]))[0, 0] / 1e-4
    found = form.coefficients[1] / per_radius**2
    assert abs(found - 3j * KAPPA / (8 * W)) < 0.01 * abs(found) + 2 * ZETA * abs(found)
    assert found.imag == pytest.approx(3 * KAPPA / (8 * W), rel=0.01)


def test_a_manifold_of_two_time_scales():
    """q'' + 2 c q' + w^2 q = 0 drives y' = -mu y + q^2: y = a q^2 + b q q' + d q'^2, solved."""
    w, c, mu = 3.0, 0.15, 25.0
    equations = np.array([[mu, -w * w, 0.0], [2.0, mu - 2 * c, -2 * w * w], [0.0, 1.0, mu - 4 * c]])
    exact = np.linalg.solve(equations, [1.0, 0.0, 0.0])

    def rate(_, y):
        return [y[1], -2 * c * y[1] - w * w * y[0], -mu * y[2] + y[0] ** 2]

    starts = ([1.0, 0.0, 0.1], [0.3, 2.0, 0.0], [-0.7, 1.0, 0.0])
    decays = [record(solved(rate, start)[100:]) for start in starts]
    how = Settings(**CLEAN, dimension=2, delays=1, shape_order=3, order=3, substeps=1)
    model = fit(decays, [], how, np.zeros(3))
    angle = np.linspace(0, 2 * np.pi, 40)
    x = 0.6 * np.stack([np.cos(angle), np.sin(angle)], axis=1) * model.scale[:2] / 3
    q, speed, y = model.decode(np.concatenate([x, 0.5 * x])).T
    found = np.linalg.lstsq(np.stack([q * q, q * speed, speed * speed], axis=1), y, rcond=None)[0]
    np.testing.assert_allclose(found, exact, rtol=0.01)


def test_the_slow_manifold_of_a_von_karman_beam():
    """Two modes of a beam whose stretching couples them: q2 is a cubic of q1 and its rate.

    q1'' + 2 c q1' + w^2 q1 + a q1^3 = 0, q2'' + 2 d q2' + v^2 q2 + b q1^3 = 0. On cubics the
    flow of the first mode, linear at this order, is a matrix L: (L^2 + 2 d L + v^2) h = -b q1^3.
    """
    w, c, v, d, a, b = 3.0, 0.06, 8.3, 2.5, 4.0, 30.0
    powers = [(3, 0), (2, 1), (1, 2), (0, 3)]
    flow = np.zeros((4, 4))
    for column, (j, k) in enumerate(powers):  # d/dt q^j p^k with q' = p, p' = -2 c p - w^2 q
        flow[column, column] -= 2 * c * k
        if j:
            flow[column + 1, column] += j
        if k:
            flow[column - 1, column] -= w * w * k
    exact = np.linalg.solve(flow @ flow + 2 * d * flow + v * v * np.eye(4), [-b, 0, 0, 0])

    def rate(_, y):
        q, p, other, speed = y
        first = -2 * c * p - w * w * q - a * q**3
        return [p, first, speed, -2 * d * speed - v * v * other - b * q**3]

    starts = ([0.3, 0.0, 0.05, 0.0], [0.1, 0.7, 0.0, 0.1], [-0.2, 0.5, 0.0, 0.0])
    decays = [record(solved(rate, start)[400:, :3]) for start in starts]
    how = Settings(**CLEAN, dimension=2, delays=1, shape_order=5, order=5, substeps=1)
    model = fit(decays, [], how, np.zeros(3))
    angle = np.linspace(0, 2 * np.pi, 40)
    x = np.stack([np.cos(angle), np.sin(angle)], axis=1) * model.scale[:2] / 3
    q, p, other = model.decode(np.concatenate([0.3 * x, 0.2 * x])).T
    terms = np.stack([q**j * p**k for j, k in powers], axis=1)
    found = np.linalg.lstsq(terms, other, rcond=None)[0]
    reach = np.abs(terms).max(axis=0)
    np.testing.assert_allclose(
        found * reach, exact * reach, atol=0.01 * np.abs(exact * reach).max()
    )


def test_a_gap_in_the_spectrum_is_reported():
    def rate(_, y):
        return [y[1], -0.6 * y[1] - 9 * y[0], -12.0 * y[2]]

    rng = np.random.default_rng(0)
    decays = [record(solved(rate, rng.normal(size=3), 25.0) @ rng.normal(size=(3, 3)))]
    found = spectrum(decays, 1, 2, 3)
    np.testing.assert_allclose(np.sort(found.eigenvalues.real), [-12, -0.3, -0.3], rtol=0.05)
    assert found.separated and found.separation == pytest.approx(40, rel=0.1)
    assert not spectrum(decays, 1, 1, 3).separated
    assert "separated" in str(found)


def test_refinement_finds_what_noise_hides():
    """A regression on noisy samples is biased; stretches tell the coefficients 5 times better."""
    rng = np.random.default_rng(0)
    a = expm(PERIOD * np.array([[0.0, 1.0], [-30.0, -0.7]]))
    true = np.sort_complex(np.log(np.linalg.eigvals(a)) / PERIOD)
    records = []
    for _ in range(6):
        rows = states(a, rng.normal(size=2))[:, :1]
        records.append(record(rows + 0.01 * rng.normal(size=(400, 1))))
    how = Settings(dimension=2, delays=8, shape_order=1, order=1, constant=False)
    first = fit(records, [], how, np.zeros(1))
    better = refine(first, records, Refinement(lengths=(0.5, 1.0), stretches=60))
    off = [np.abs(np.sort_complex(m.eigenvalues()) - true).max() for m in (first, better)]
    assert off[1] < off[0] / 5 and off[1] < 0.1
