import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.linalg import expm
from support.oscillators import chain

from softrobot_env.beams import mechanics, signals
from softrobot_env.beams.numerics import integration
from softrobot_env.beams.numerics.compilation import reference
from softrobot_env.beams.numerics.integration import METHODS, Control, integrate, samples, workspace

STIFF = chain([40.0, 90.0, 60.0, 2.0e6], damping=0.01)


def run(model, method, times, q, v, step=None, tolerance=1e-7, signal=None, max_steps=10**6):
    times = np.atleast_1d(np.asarray(times, dtype=float))
    q, v = np.array(q, dtype=float), np.array(v, dtype=float)
    found = samples(times, len(q))
    signal = signals.constant(np.empty(0)) if signal is None else signal
    control = Control(step is None, step or 1e-3, tolerance, max_steps)
    work = workspace(len(q), 1, len(METHODS[method].b), signal.coefficients.shape[2])
    given = (reference(x) for x in (METHODS[method], control, signal, work))
    code, reached = integrate(model, *given, (q, v), found)
    return code, reached, found.q, found.v, work.counters, work.steps


def exact(model, times, q, v):
    """Motion of the linear chain by the matrix exponential."""
    n = model.n
    k, d = np.empty((n, n)), np.empty((n, n))
    zero, base, moved = np.zeros(n), np.empty(n), np.empty(n)
    mechanics.residual(model, zero, zero, zero, np.empty(0), base)
    for j, e in enumerate(np.eye(n)):
        mechanics.residual(model, e, zero, zero, np.empty(0), moved)
        k[:, j] = moved - base
        mechanics.residual(model, zero, e, zero, np.empty(0), moved)
        d[:, j] = moved - base
    a = np.block([[np.zeros((n, n)), np.eye(n)], [-k, -d]])
    return np.array([expm(a * t) @ np.concatenate([q, v]) for t in times])[:, :n]


def accurate(model, times, q, v):
    """Accurate motion (k, 2 n) of any chain."""
    n = model.n

    def derivative(t, y):
        out = np.empty(n)
        mechanics.acceleration(model, y[:n].copy(), y[n:].copy(), np.empty(0), out)
        return np.concatenate([y[n:], out])

    span = (times[0], times[-1])
    return solve_ivp(derivative, span, [*q, *v], "DOP853", times, rtol=1e-13, atol=1e-13).y.T


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
    model, q, v = chain([40.0, 90.0, 60.0], damping=0.01, cubic=400.0), [0.3, 0.1, 0.4], [0, 1, 0]
    expected = METHODS[method].order
    coarse = {1: 5e-4, 2: 2e-3, 4: 1e-2, 5: 1e-2}[expected]
    times = np.linspace(0, 1, 6)  # whole numbers of steps
    truth = accurate(model, times, q, v)[:, :3]
    steps = [coarse, coarse / 2, coarse / 4]
    errors = [np.max(np.abs(run(model, method, times, q, v, h)[2] - truth)) for h in steps]
    assert abs(np.log(errors[0] / errors[2]) / np.log(4) - expected) < 0.3, errors


def test_stiff_chain_takes_large_steps_only_implicitly():
    q, v = np.full(4, 0.1), np.zeros(4)
    truth = exact(STIFF, [0.5], q, v)[0]
    code, _, out, *_ = run(STIFF, "sdirk4", [0, 0.5], q, v, step=0.01)
    assert code == integration.DONE
    assert np.max(np.abs(out[-1] - truth)) < 1e-5
    assert run(STIFF, "rk4", [0, 0.5], q, v, step=0.01)[0] == integration.DIVERGED


@pytest.mark.parametrize("method", ["sdirk4", "dormand_prince"])
def test_adaptive_error_follows_the_tolerance(method):
    model = chain([40.0, 90.0, 60.0], damping=0.01, cubic=400.0)
    q, v = [0.3, 0.1, 0.4], [0.0, 1.0, 0.0]
    times = np.linspace(0, 2, 41)
    truth = accurate(model, times, q, v)
    errors = []
    for tolerance in (1e-4, 1e-6, 1e-8):
        code, _, out, out_v, counters, _ = run(model, method, times, q, v, tolerance=tolerance)
        assert code == integration.DONE
        errors.append(np.max(np.abs(np.hstack([out, out_v / 10]) - truth / [1, 1, 1, 10, 10, 10])))
        assert errors[-1] < 200 * tolerance
    assert errors[0] > 10 * errors[1] > 100 * errors[2]
    assert counters[integration.STEPS] < 2000


def test_samples_between_steps_are_as_accurate_as_the_steps():
    model = chain([40.0], damping=0.0)
    times = np.linspace(0, 1, 201)
    out = run(model, "sdirk4", times, [1.0], [0.0], step=0.05)[2][:, 0]
    at_steps = np.max(np.abs(out - np.cos(np.sqrt(40) * times))[::10])
    assert np.max(np.abs(out - np.cos(np.sqrt(40) * times))) < 1.3 * at_steps


def test_implicit_midpoint_conserves_the_energy_of_a_linear_chain():
    model = chain([40.0, 90.0, 60.0])
    _, _, q, v, *_ = run(
        model, "implicit_midpoint", [0, 100], [0.1, 0.2, 0.3], [0, 0, 0], 0.01, tolerance=1e-12
    )

    def energy(q, v):
        stretch = np.diff(q, prepend=0)
        return 0.5 * v @ v + 0.5 * model.stiffness @ stretch**2

    assert energy(q[-1], v[-1]) == pytest.approx(energy(q[0], v[0]), rel=1e-9)


def test_failures_are_named():
    explosive = chain([-1e3, 1.0])
    assert run(explosive, "rk4", [0, 10], [0.1, 0], [0, 0], 0.01)[0] == integration.DIVERGED
    code, reached, *_ = run(STIFF, "sdirk4", [0, 5], np.full(4, 0.1), np.zeros(4), max_steps=5)
    assert code == integration.TOO_MANY_STEPS
    assert 0 < reached < 5
    nowhere = chain([1.0], pull=np.nan)  # no stage has a solution
    for step in (0.1, None):
        code, reached, *_ = run(nowhere, "sdirk4", [0, 1], [0.5], [0.0], step)
        assert (code, reached) == (integration.NOT_CONVERGED, 0)
    assert run(nowhere, "dormand_prince", [0, 1], [0.5], [0.0])[0] == integration.DIVERGED


def test_iteration_matrix_and_band_solver_against_dense_algebra():
    from softrobot_env.beams.numerics import band

    rng = np.random.default_rng(0)
    for k in (1, 3, 7):
        dense = rng.normal(size=(12, 12))
        dense[np.abs(np.subtract.outer(np.arange(12), np.arange(12))) > k] = 0
        rows = np.zeros((12, 3 * k + 1))
        for i in range(12):
            for j in range(max(0, i - k), min(12, i + k + 1)):
                rows[i, j - i + k] = dense[i, j]
        x = rng.normal(size=12)
        truth, pivot = np.linalg.solve(dense, x), np.empty(12, dtype=np.int64)
        assert band.factor(rows, k, pivot)
        band.solve(rows, k, pivot, x)
        np.testing.assert_allclose(x, truth, rtol=1e-9)
    assert not band.factor(np.zeros((3, 4)), 1, np.empty(3, dtype=np.int64))
    n, matrix = STIFF.n, np.empty((STIFF.n, 4))
    zero = np.zeros(n)
    mechanics.iteration_matrix(STIFF, zero, zero, zero, np.empty(0), 2.0, 3.0, matrix)
    dense = np.diag(matrix[:, 1]) + np.diag(matrix[1:, 0], -1) + np.diag(matrix[:-1, 2], 1)
    k = STIFF.stiffness
    truth = np.diag(k + np.append(k[1:], 0)) - np.diag(k[1:], 1) - np.diag(k[1:], -1)
    np.testing.assert_allclose(dense, truth * 1.02 + 3 * np.eye(n), atol=1e-3)


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
