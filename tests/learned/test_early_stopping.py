"""Training with early stopping and inference, against mathematics that they do not use."""

import numpy as np
import pytest
from scipy.optimize import least_squares

from softrobot_env.learned.early_stopping import Dataset, train
from softrobot_env.learned.inference import CompiledInference
from softrobot_env.learned.levenberg_marquardt import LeastSquares
from softrobot_env.learned.network import Scaling, initial_network
from softrobot_env.learned.plain_inference import PlainInference


def make_network(hidden, n_in, n_out, seed=0):
    """A network with scalings that are not symmetric."""
    rng = np.random.default_rng(seed)
    ranges = [Scaling(-rng.uniform(1, 2, n), rng.uniform(2, 3, n)) for n in (n_in, n_out)]
    return initial_network(hidden, *ranges, rng)


def draw(function, count, rng, noise=0.0):
    x = rng.uniform(-1, 1, (count, 2))
    y = function(x)
    return Dataset(x, y + noise * rng.standard_normal(y.shape))


def smooth(x):
    return np.hstack([np.sin(3 * x[:, :1]) * x[:, 1:], np.exp(-(x[:, 1:] ** 2))])


# ---------------------------------------------------------------- least squares


@pytest.fixture(params=[(), (4,), (5, 3), (6, 5, 4)], ids="hidden {}".format)
def problem(request):
    """Errors of 9 samples, a numerical Jacobian (complex steps), and the parameters."""
    network = make_network(request.param, 3, 2)
    rng = np.random.default_rng(1)
    x, y = rng.uniform(-1, 1, (9, 3)), rng.uniform(-1, 1, (9, 2))
    p = network.parameters
    scaled = network.inputs.scale(x)

    def error(parameters):
        values = network.with_parameters(parameters).activations(scaled)[-1]
        return (values - network.outputs.scale(y)).ravel()

    jacobian = np.stack([error(p + h).imag / 1e-30 for h in 1e-30j * np.eye(len(p))], axis=1)
    return LeastSquares(network, Dataset(x, y)), error(p), jacobian, p


@pytest.mark.parametrize("damping", [1e-3, 1.0])
@pytest.mark.parametrize("form", ["linearize", "linearize_dual"])
def test_steps_solve_the_damped_normal_equations(problem, form, damping):
    least, error, jacobian, p = problem
    near = getattr(least, form)(p)
    square = jacobian.T @ jacobian + damping * np.eye(len(p))
    np.testing.assert_allclose(near.slope, jacobian.T @ error, atol=1e-12)
    expected = np.linalg.solve(square, jacobian.T @ error)
    np.testing.assert_allclose(near.step(damping), expected, atol=1e-9)
    assert least.squared_error(p) == pytest.approx(error @ error)
    assert least.errors == len(error)


# ---------------------------------------------------------------- training


def test_affine_fit_is_the_linear_regression():
    rng = np.random.default_rng(3)
    x = rng.uniform(-1, 1, (60, 3))
    y = x @ rng.uniform(-1, 1, (3, 2)) + 0.1 * rng.standard_normal((60, 2))
    fit = train(make_network((), 3, 2), Dataset(x, y), Dataset(x, y))
    basis = np.hstack([x, np.ones((60, 1))])
    expected = basis @ np.linalg.lstsq(basis, y, rcond=None)[0]
    np.testing.assert_allclose(fit.network(x), expected, atol=1e-7)
    assert fit.reason == "gradient" and fit.iterations < 10


def test_a_minimum_is_that_of_another_solver():
    """From where training ends, SciPy's least squares finds nothing lower nearby."""
    rng = np.random.default_rng(4)
    data = draw(smooth, 80, rng, noise=0.05)
    fit = train(make_network((4,), 2, 2, seed=1), data, data)
    network = fit.network

    def errors(parameters):
        values = network.with_parameters(parameters)(data.inputs)
        return ((values - data.outputs) / network.outputs.half).ravel()

    found = least_squares(errors, network.parameters, xtol=1e-12, ftol=1e-12, gtol=1e-12)
    assert fit.reason == "gradient"
    assert fit.training_error == pytest.approx(2 * found.cost / data.outputs.size, rel=1e-6)


def test_training_stops_before_it_learns_the_noise():
    rng = np.random.default_rng(5)
    training, validation = (draw(smooth, n, rng, noise=0.1) for n in (60, 30))
    fresh = draw(smooth, 1000, rng)
    errors = []
    for seed in range(4):
        start = make_network((20,), 2, 2, seed)
        stopped = train(start, training, validation)
        # Its own judge does not stop it.
        fitted = train(start, training, training, iterations=100)
        assert stopped.reason == "validation" and stopped.iterations == stopped.best + 6
        assert fitted.training_error < 0.5 * stopped.training_error
        offs = [fit.network(fresh.inputs) - fresh.outputs for fit in (stopped, fitted)]
        errors.append([np.sqrt(np.mean(off**2)) for off in offs])
    stopped, fitted = np.median(errors, axis=0)
    assert 2 * stopped < fitted


def test_the_network_kept_is_the_best_on_the_validation_data():
    rng = np.random.default_rng(6)
    training, validation = (draw(smooth, n, rng, noise=0.1) for n in (40, 20))
    start = make_network((15,), 2, 2, seed=3)
    best = train(start, training, validation)
    scaled = best.network.outputs.half
    off = (best.network(validation.inputs) - validation.outputs) / scaled
    assert best.validation_error == pytest.approx(np.mean(off**2))
    # Stopped after any other number of steps, it is no better.
    for steps in range(1, best.iterations):
        other = train(start, training, validation, iterations=steps)
        assert other.validation_error >= best.validation_error
        assert (other.iterations, other.best) == (steps, min(steps, other.best))


def test_more_parameters_than_errors_are_fitted_exactly():
    rng = np.random.default_rng(7)
    data = draw(smooth, 30, rng)
    fit = train(make_network((20, 20), 2, 2), data, data, iterations=100)
    np.testing.assert_allclose(fit.network(data.inputs), data.outputs, atol=1e-4)


def test_data_that_cannot_be_used_are_refused():
    good, network = draw(smooth, 9, np.random.default_rng(8)), make_network((3,), 2, 2)
    none = good.take(slice(0))
    for training, validation in ((good, none), (none, good)):
        with pytest.raises(ValueError, match="at least one sample"):
            train(network, training, validation)
    with pytest.raises(ValueError, match="shapes"):
        train(network, good, Dataset(good.inputs, good.outputs[:, :1]))
    with pytest.raises(ValueError, match="finite"):
        train(network, Dataset(good.inputs, np.full((9, 2), np.nan)), good)


# ---------------------------------------------------------------- inference


@pytest.mark.parametrize("hidden", [(), (1,), (10, 10), (7, 2, 9)])
@pytest.mark.parametrize("make", [CompiledInference, PlainInference])
def test_inference_is_the_network(hidden, make):
    for n_in, n_out in ((3, 2), (2, 3)):
        network = make_network(hidden, n_in, n_out)
        infer = make(network)
        x = np.random.default_rng(9).uniform(-2, 3, (20, n_in))
        np.testing.assert_allclose([infer(row) for row in x], network(x), atol=1e-13)
        for other in (x[0].tolist(), x[:, ::-1][0, ::-1], np.asfortranarray(x)[0]):
            np.testing.assert_allclose(infer(other), network(x[:1])[0], atol=1e-13)


def test_batches_are_single_samples():
    network = make_network((10, 10), 3, 2)
    infer = CompiledInference(network)
    x = np.random.default_rng(10).uniform(-2, 3, (20, 3))
    np.testing.assert_array_equal(infer.batch(x), [infer(row) for row in x])
    np.testing.assert_array_equal(infer.batch(np.asfortranarray(x)), infer.batch(x))
    assert infer.batch(np.empty((0, 3))).shape == (0, 2)


def test_what_is_returned_is_the_callers_own():
    infer = CompiledInference(make_network((), 2, 2))
    x = np.zeros(2)
    one = infer(x)
    kept = one.copy()
    infer(np.ones(2))
    np.testing.assert_array_equal(one, kept)
    assert not np.shares_memory(one, x)


@pytest.mark.parametrize("make", [CompiledInference, PlainInference])
@pytest.mark.parametrize("bad", [np.zeros(3), np.zeros((1, 2)), 0.0])
def test_inputs_of_other_shapes_are_refused(make, bad):
    infer = make(make_network((4,), 2, 3))
    with pytest.raises(ValueError, match=r"inputs of shape \(2,\), got"):
        infer(bad)


def test_batches_of_other_shapes_are_refused():
    infer = CompiledInference(make_network((4,), 2, 3))
    with pytest.raises(ValueError, match=r"inputs of shape \(k, 2\), got \(2,\)"):
        infer.batch(np.zeros(2))
