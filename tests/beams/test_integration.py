"""How motions are integrated: methods, steps, samples and failures, against SciPy's on PCC."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from softrobot_env.beams import signals
from softrobot_env.beams.model import IntegrationError, State
from softrobot_env.beams.numerics import band
from softrobot_env.beams.numerics.integration import METHODS
from softrobot_env.beams.pcc import PCC
from softrobot_env.robots import CANTILEVER_WEAK


def falling(pieces, **changes):
    """A rod in the plane that is let go, and its state then."""
    model = PCC(replace(CANTILEVER_WEAK, **changes), pieces, axes="planar")
    return model, State(np.linspace(1.0, 2.0, pieces), np.linspace(5.0, -5.0, pieces))


def accurate(model, start, times):
    """Accurate motion (k, 2 n)."""
    right_side = model.first_order(np.empty(0))
    y = np.concatenate(start)
    span = (times[0], times[-1])
    return solve_ivp(right_side, span, y, "DOP853", times, rtol=1e-12, atol=1e-12).y.T


@pytest.mark.parametrize("method", METHODS)
def test_order_conditions(method):
    m = METHODS[method]
    a, b, c = m.a, m.b, m.c
    conditions = {
        1: [(b.sum(), 1)],
        2: [(b @ c, 1 / 2)],
        3: [(b @ c**2, 1 / 3), (b @ a @ c, 1 / 6)],
        4: [
            (b @ c**3, 1 / 4),
            ((b * c) @ a @ c, 1 / 8),
            (b @ a @ c**2, 1 / 12),
            (b @ a @ a @ c, 1 / 24),
        ],
        5: [(b @ c**4, 1 / 5)],
    }
    met = [p for p in conditions if all(abs(x - y) < 1e-13 for x, y in conditions[p])]
    assert met == list(range(1, min(m.order, 5) + 1))
    if m.adaptive:
        embedded = b - m.error
        low = [embedded.sum() - 1, embedded @ c - 1 / 2, embedded @ c**2 - 1 / 3]
        assert np.max(np.abs(low)) < 1e-13
        assert m.estimate == m.order - 1


@pytest.mark.parametrize("method", ["implicit_euler", "sdirk2", "sdirk4"])
def test_l_stability(method):
    """The stability function vanishes at infinity and stays below one on the imaginary axis."""
    m = METHODS[method]
    one = np.ones(len(m.b))

    def growth(z):
        return abs(1 + z * m.b @ np.linalg.solve(np.eye(len(m.b)) - z * m.a, one))

    assert growth(-1e8) < 1e-6
    assert max(growth(1j * y) for y in np.geomspace(1e-3, 1e6, 200)) <= 1 + 1e-12


@pytest.mark.parametrize(
    "method", [pytest.param(m, marks=pytest.mark.slow) if "euler" in m else m for m in METHODS]
)
def test_observed_order(method):
    model, start = falling(3, damping_time=0.0)
    expected = METHODS[method].order
    coarse = {1: 4e-5, 2: 2e-3, 4: 8e-3, 5: 8e-3}[expected]
    times = np.linspace(0, 1, 6)  # whole numbers of steps
    truth = accurate(model, start, times)[:, :3]
    errors = []
    for step in (coarse, coarse / 2, coarse / 4):
        found = model.simulate(1.0, start=start, method=method, step=step, samples=times)
        errors.append(np.abs(found.q - truth).max())
    assert abs(np.log(errors[0] / errors[2]) / np.log(4) - expected) < 0.3, errors


def test_stiff_rods_take_large_steps_only_implicitly():
    model, start = falling(12)
    truth = accurate(model, start, [0, 0.5])[-1, :12]
    found = model.simulate(0.5, start=start, step=0.01)
    assert np.abs(found.q[-1] - truth).max() < 1e-3 * np.abs(truth).max()
    with pytest.raises(IntegrationError, match="diverged at t") as caught:
        model.simulate(0.5, start=start, method="rk4", step=0.01)
    assert 0 <= caught.value.time < 0.5


@pytest.mark.parametrize("method", ["sdirk4", "dormand_prince"])
def test_adaptive_error_follows_the_tolerance(method):
    model, start = falling(3, gravity=(0.0, 0.0, 0.0))
    times = np.linspace(0, 2, 41)
    truth = accurate(model, start, times)
    size, errors = np.abs(truth).max(axis=0), []
    for tolerance in (1e-4, 1e-6, 1e-8):
        found = model.simulate(2, start=start, method=method, tolerance=tolerance, samples=times)
        errors.append(np.abs((np.hstack([found.q, found.v]) - truth) / size).max())
    assert errors[0] < 200e-4 and errors[1] < 200e-6
    assert errors[0] > 10 * errors[1] > 100 * errors[2]
    assert found.steps < 2000


def test_samples_between_steps_are_as_accurate_as_the_steps():
    model, start = falling(1)
    times = np.linspace(0, 1, 201)
    found = model.simulate(1.0, start=start, step=0.05, samples=times)
    off = np.abs(found.q - accurate(model, start, times)[:, :1])
    assert off.max() < 1.3 * off[::10].max()


def test_failures_are_named():
    model, start = falling(3)
    with pytest.raises(IntegrationError, match="steps") as caught:
        model.simulate(5.0, start=start, max_steps=5)
    assert 0 < caught.value.time < 5
    nowhere, start = falling(1)  # no stage has a solution
    nowhere.data.gravity[:] = np.nan
    for step in (0.1, None):
        with pytest.raises(IntegrationError, match="at t = 0 s") as caught:
            nowhere.simulate(1.0, start=start, step=step)
    with pytest.raises(IntegrationError, match="diverged"):
        nowhere.simulate(1.0, start=start, method="dormand_prince")


def test_the_band_solver_against_dense_algebra():
    rng = np.random.default_rng(0)
    for k in (1, 3, 7):
        dense = rng.normal(size=(12, 12))
        dense[np.abs(np.subtract.outer(np.arange(12), np.arange(12))) > k] = 0
        rows = np.zeros((12, 3 * k + 1))
        for i in range(12):
            for j in range(max(0, i - k), min(12, i + k + 1)):
                rows[i, j - i + k] = dense[i, j]
        x = rng.normal(size=12)
        truth, pivot = np.linalg.solve(dense, x), np.empty(12, int)
        assert band.factor(rows, k, pivot)
        band.solve(rows, k, pivot, x)
        np.testing.assert_allclose(x, truth, rtol=1e-9)
    assert not band.factor(np.zeros((3, 4)), 1, np.empty(3, int))


def test_signals():
    out = np.empty(2)
    steps = signals.held(np.array([[1.0, 2.0], [3.0, 4.0]]), 0.5)
    for t, truth in ((-1, [1, 2]), (0.49, [1, 2]), (0.5, [3, 4]), (9, [3, 4])):
        signals.evaluate(steps, t, out)
        assert out.tolist() == truth
    wave = signals.smooth(lambda t: np.array([np.sin(10 * t), np.cos(10 * t)]), 3.0)
    for t in np.linspace(0, 3, 77):
        signals.evaluate(wave, t, out)
        np.testing.assert_allclose(out, [np.sin(10 * t), np.cos(10 * t)], atol=1e-8)
