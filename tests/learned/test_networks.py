"""Networks, their training and training data against mathematics that they do not use."""

import numpy as np
import pytest
from scipy.optimize import minimize
from scipy.stats import kstest, multivariate_normal

from softrobot_env.beams.constant_curvature import ConstantCurvatureStatics
from softrobot_env.learned.bayesian import train
from softrobot_env.learned.network import Dataset, Network, Scaling, initial_network
from softrobot_env.robots import ARM
from softrobot_env.thesis.arm import quasi_static

STATICS = ConstantCurvatureStatics(ARM)


def unscaled(size):
    return Scaling(-np.ones(size), np.ones(size))


def make_network(hidden, n_in, n_out, seed=0):
    rng = np.random.default_rng(seed)
    return initial_network(hidden, unscaled(n_in), unscaled(n_out), rng)


# ---------------------------------------------------------------- network


@pytest.mark.parametrize("hidden", [(), (5,), (4, 6), (3, 2, 4)])
def test_jacobian_is_the_complex_step_derivative(hidden):
    network = make_network(hidden, 3, 2)
    x = np.random.default_rng(1).uniform(-1, 1, (7, 3))
    parameters = network.parameters
    steps = 1e-30j * np.eye(len(parameters))
    columns = [
        network.with_parameters(parameters + h).activations(x)[-1].imag / 1e-30 for h in steps
    ]
    np.testing.assert_allclose(network.jacobian(x), np.stack(columns, axis=-1), atol=1e-14)


def test_output_is_that_of_the_formula():
    inputs = Scaling(np.array([0.0, 10.0]), np.array([2.0, 30.0]))
    outputs = Scaling(np.array([-3.0]), np.array([1.0]))
    weights = (np.array([[0.2, -0.7]]), np.array([[1.5]]))
    network = Network(weights, (np.array([0.1]), np.array([-0.4])), inputs, outputs)
    x, y = 0.5, 25.0
    hidden = np.tanh(0.2 * (x - 1) - 0.7 * (y - 20) / 10 + 0.1)
    assert network(np.array([[x, y]])) == pytest.approx(2 * (1.5 * hidden - 0.4) - 1)
    assert network.sizes == (2, 1, 1)


def test_saved_networks_come_back(tmp_path):
    network = make_network((4, 3), 2, 3)
    network.save(tmp_path / "network", {"robot": "arm", "length": 0.5})
    loaded, about = Network.load(tmp_path / "network")
    np.testing.assert_array_equal(loaded.parameters, network.parameters)
    x = np.random.default_rng(0).uniform(-1, 1, (5, 2))
    np.testing.assert_array_equal(loaded(x), network(x))
    assert str(about["robot"]) == "arm" and about["length"] == 0.5


def test_layers_must_fit():
    network = make_network((4,), 2, 3)
    with pytest.raises(ValueError, match="do not fit together"):
        Network(network.weights[::-1], network.biases, network.inputs, network.outputs)
    with pytest.raises(ValueError, match="low < high"):
        Scaling(np.zeros(2), np.array([1.0, 0.0]))


# ---------------------------------------------------------------- Bayesian training


@pytest.fixture(scope="module")
def ridge():
    """Data of an affine function, noise of standard deviation 0.3, and the fit to them."""
    rng = np.random.default_rng(3)
    x = rng.uniform(-1, 1, (200, 6))
    y = x @ np.array([[1.0, -0.5, 0.02, 0.0, 0.7, 0.01]]).T + 0.2
    y += 0.3 * rng.standard_normal(y.shape)
    return x, y, train(make_network((), 6, 1), Dataset(x, y))


def test_affine_fit_maximises_the_evidence(ridge):
    """alpha and beta against a direct search on the marginal likelihood of the data."""
    x, y, fit = ridge
    basis = np.hstack([x, np.ones((len(x), 1))])

    def surprise(logs):
        alpha, beta = np.exp(logs)
        covariance = basis @ basis.T / (2 * alpha) + np.eye(len(x)) / (2 * beta)
        return -multivariate_normal.logpdf(y[:, 0], cov=covariance)

    best = minimize(surprise, np.zeros(2), method="Nelder-Mead", options={"xatol": 1e-6})
    np.testing.assert_allclose([fit.alpha, fit.beta], np.exp(best.x), rtol=1e-3)
    assert fit.converged


def test_affine_fit_is_the_ridge_regression(ridge):
    x, y, fit = ridge
    basis = np.hstack([x, np.ones((len(x), 1))])
    ratio = fit.alpha / fit.beta
    expected = np.linalg.solve(basis.T @ basis + ratio * np.eye(7), basis.T @ y)[:, 0]
    np.testing.assert_allclose(fit.network.parameters, expected, atol=1e-6)
    values = np.linalg.eigvalsh(basis.T @ basis)
    assert fit.effective_parameters == pytest.approx(np.sum(values / (values + ratio)), rel=1e-5)


def test_noise_is_recovered(ridge):
    # Its standard deviation is estimated from 200 samples, to within 5 % (one sigma).
    assert 1 / np.sqrt(2 * ridge[2].beta) == pytest.approx(0.3, rel=0.15)


def test_smooth_function_is_learned_and_not_its_noise():
    rng = np.random.default_rng(4)

    def function(x):
        return np.hstack([np.sin(3 * x[:, :1]) * x[:, 1:], np.exp(-(x[:, 1:] ** 2))])

    x, fresh = rng.uniform(-1, 1, (400, 2)), rng.uniform(-1, 1, (400, 2))
    noisy = function(x) + 0.05 * rng.standard_normal((400, 2))
    fit = train(make_network((20,), 2, 2, seed=1), Dataset(x, noisy), iterations=100)
    error = np.sqrt(np.mean((fit.network(fresh) - function(fresh)) ** 2))
    assert error < 0.02  # of a range of two, and well below the noise
    assert 1 / np.sqrt(2 * fit.beta) == pytest.approx(0.05, rel=0.1)
    assert fit.effective_parameters < 0.8 * len(fit.network.parameters)


def test_progress_reports_falling_errors_and_every_step():
    rng = np.random.default_rng(5)
    x = rng.uniform(-1, 1, (100, 1))
    seen = []
    network = make_network((5,), 1, 1)
    fit = train(network, Dataset(x, np.sin(3 * x)), 30, lambda *values: seen.append(values))
    assert [done for done, _, _ in seen] == list(range(1, fit.iterations + 1))
    assert seen[-1][2] == fit.squared_error < 1e-3 * seen[0][2]


@pytest.mark.parametrize(
    ("x", "y", "message"),
    [
        (np.zeros((50, 2)), np.zeros((50, 1)), "shapes"),
        (np.full((50, 1), np.nan), np.zeros((50, 1)), "finite"),
        (np.zeros((3, 1)), np.zeros((3, 1)), "more samples"),
    ],
)
def test_unusable_data_are_refused(x, y, message):
    with pytest.raises(ValueError, match=message):
        train(make_network((5,), 1, 1), Dataset(x, y))


# ---------------------------------------------------------------- quasi-static data


@pytest.fixture(scope="module")
def samples():
    return quasi_static.sample(STATICS.tip, 3, quasi_static.Sampling(), np.random.default_rng(6))


def test_training_inputs_keep_their_bounds(samples):
    before, after = samples.inputs[:, 4:], samples.outputs
    assert len(before) == 10_000
    assert np.abs(before).max() <= 20 and np.abs(after).max() <= 20
    assert np.linalg.norm(after - before, axis=1).max() < 1.0  # 5 % of 20 N
    assert np.abs(before).max(axis=0).min() > 19.9  # the whole range is used


def test_changes_are_uniform_in_the_ball(samples):
    before, after = samples.inputs[:, 4:], samples.outputs
    change = (after - before)[np.abs(before).max(axis=1) < 19]  # where the bound cuts nothing off
    radius = np.linalg.norm(change, axis=1)
    assert kstest(radius**3, "uniform").pvalue > 1e-3
    # Coordinates of a uniform direction are uniform in [-1, 1] (Archimedes).
    for cosine in (change / radius[:, None]).T:
        assert kstest((cosine + 1) / 2, "uniform").pvalue > 1e-3


def test_positions_are_the_statics_and_the_noise_is_on_the_first(samples):
    k = slice(0, 10_000, 10)
    here = np.array([STATICS.tip(u) for u in samples.inputs[k, 4:]])
    there = np.array([STATICS.tip(u) for u in samples.outputs[k]])
    np.testing.assert_allclose(samples.inputs[k, 2:4], there, atol=1e-15)
    noise = samples.inputs[k, :2] - here
    assert kstest(noise.ravel() / 1.5e-3, "norm").pvalue > 1e-3


def test_workspace_holds_the_points_and_nothing_far_off(samples):
    reached = samples.inputs[:, 2:4]
    ranges = quasi_static.workspace(reached)
    angle = np.arctan2(reached[:, 0], reached[:, 1])
    sector = np.floor((angle + np.pi) / (2 * np.pi) * len(ranges)).astype(int)
    low, high = (ranges[sector] + [-1e-12, 1e-12]).T  # rounding
    distance = np.linalg.norm(reached, axis=1)
    assert np.all((low <= distance) & (distance <= high))
    assert ranges[0, 0] == np.inf  # straight down: never reached
    assert ranges[len(ranges) // 2].min() > 0.48  # straight up: a thin crescent


def test_training_is_reproducible_by_seed():
    def fit(seed):
        rng = np.random.default_rng(seed)
        how = quasi_static.Sampling(pairs=300)
        samples = quasi_static.sample(STATICS.tip, 3, how, rng)
        network = samples.new_network(quasi_static.HIDDEN, rng)
        return train(network, samples, iterations=5).network

    one, again, other = fit(0), fit(0), fit(1)
    np.testing.assert_array_equal(one.parameters, again.parameters)
    assert one.sizes == (7, 30, 3)
    assert np.abs(one.parameters - other.parameters).max() > 0.1
