"""Networks, their training and training data against mathematics that they do not use."""

import numpy as np
import pytest
from scipy.optimize import least_squares, minimize
from scipy.stats import kstest, multivariate_normal

from softrobot_env.beams.constant_curvature import ConstantCurvatureStatics
from softrobot_env.learned.inference import CompiledInference
from softrobot_env.learned.network import Dataset, Network, Scaling, initial_network
from softrobot_env.learned.plain_inference import PlainInference
from softrobot_env.learned.training import LeastSquares, train_regularised, train_validated
from softrobot_env.robots import ARM
from softrobot_env.thesis.arm import quasi_static

STATICS = ConstantCurvatureStatics(ARM)


def unscaled(size):
    return Scaling(-np.ones(size), np.ones(size))


def make_network(hidden, n_in, n_out, seed=0):
    rng = np.random.default_rng(seed)
    return initial_network(hidden, unscaled(n_in), unscaled(n_out), rng)


def skewed(hidden, n_in, n_out, seed=0):
    """A network with scalings that are not symmetric."""
    rng = np.random.default_rng(seed)
    ranges = [Scaling(-rng.uniform(1, 2, n), rng.uniform(2, 3, n)) for n in (n_in, n_out)]
    return initial_network(hidden, *ranges, rng)


def draw(count, rng, noise=0.0):
    """Data of a smooth function with noise."""
    x = rng.uniform(-1, 1, (count, 2))
    y = smooth(x)
    return Dataset(x, y + noise * rng.standard_normal(y.shape))


def smooth(x):
    return np.hstack([np.sin(3 * x[:, :1]) * x[:, 1:], np.exp(-(x[:, 1:] ** 2))])


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
    """Data of an affine function, its basis, noise of deviation 0.3, and the fit to them."""
    rng = np.random.default_rng(3)
    x = rng.uniform(-1, 1, (200, 6))
    y = x @ np.array([[1.0, -0.5, 0.02, 0.0, 0.7, 0.01]]).T + 0.2
    y += 0.3 * rng.standard_normal(y.shape)
    basis = np.hstack([x, np.ones((len(x), 1))])
    return basis, y, train_regularised(make_network((), 6, 1), Dataset(x, y))


def test_affine_fit_maximises_the_evidence(ridge):
    """alpha and beta against a direct search on the marginal likelihood of the data."""
    basis, y, fit = ridge

    def surprise(logs):
        alpha, beta = np.exp(logs)
        covariance = basis @ basis.T / (2 * alpha) + np.eye(len(y)) / (2 * beta)
        return -multivariate_normal.logpdf(y[:, 0], cov=covariance)

    best = minimize(surprise, np.zeros(2), method="Nelder-Mead", options={"xatol": 1e-6})
    np.testing.assert_allclose([fit.alpha, fit.beta], np.exp(best.x), rtol=1e-3)
    assert fit.converged


def test_affine_fit_is_the_ridge_regression(ridge):
    basis, y, fit = ridge
    ratio = fit.alpha / fit.beta
    expected = np.linalg.solve(basis.T @ basis + ratio * np.eye(7), basis.T @ y)[:, 0]
    np.testing.assert_allclose(fit.network.parameters, expected, atol=1e-6)
    values = np.linalg.eigvalsh(basis.T @ basis)
    assert fit.effective_parameters == pytest.approx(np.sum(values / (values + ratio)), rel=1e-5)


def test_smooth_function_is_learned_and_not_its_noise():
    rng = np.random.default_rng(4)
    x, fresh = rng.uniform(-1, 1, (400, 2)), rng.uniform(-1, 1, (400, 2))
    noisy = Dataset(x, smooth(x) + 0.05 * rng.standard_normal((400, 2)))
    fit = train_regularised(make_network((20,), 2, 2, seed=1), noisy, iterations=100)
    error = np.sqrt(np.mean((fit.network(fresh) - smooth(fresh)) ** 2))
    assert error < 0.02  # of a range of two, and well below the noise
    assert 1 / np.sqrt(2 * fit.beta) == pytest.approx(0.05, rel=0.1)
    assert fit.effective_parameters < 0.8 * len(fit.network.parameters)


def test_progress_reports_falling_errors_and_every_step():
    rng = np.random.default_rng(5)
    x = rng.uniform(-1, 1, (100, 1))
    seen = []
    network = make_network((5,), 1, 1)
    fit = train_regularised(
        network, Dataset(x, np.sin(3 * x)), 30, lambda *values: seen.append(values)
    )
    assert [done for done, _, _ in seen] == list(range(1, fit.iterations + 1))
    assert seen[-1][2] == fit.squared_error < 1e-3 * seen[0][2]


# ---------------------------------------------------------------- least squares


@pytest.fixture(params=[(), (4,), (5, 3), (6, 5, 4)], ids="hidden {}".format)
def problem(request):
    """Errors of 9 samples, a numerical Jacobian (complex steps), and the parameters."""
    network = skewed(request.param, 3, 2)
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


# ---------------------------------------------------------------- early stopping


def test_a_validated_affine_fit_is_the_linear_regression():
    rng = np.random.default_rng(3)
    x = rng.uniform(-1, 1, (60, 3))
    y = x @ rng.uniform(-1, 1, (3, 2)) + 0.1 * rng.standard_normal((60, 2))
    fit = train_validated(skewed((), 3, 2), Dataset(x, y), Dataset(x, y))
    basis = np.hstack([x, np.ones((60, 1))])
    expected = basis @ np.linalg.lstsq(basis, y, rcond=None)[0]
    np.testing.assert_allclose(fit.network(x), expected, atol=1e-7)
    assert fit.reason == "gradient" and fit.iterations < 10


def test_a_minimum_is_that_of_another_solver():
    """From where training ends, SciPy's least squares finds nothing lower nearby."""
    rng = np.random.default_rng(4)
    data = draw(80, rng, noise=0.05)
    fit = train_validated(skewed((4,), 2, 2, seed=1), data, data)
    network = fit.network

    def errors(parameters):
        values = network.with_parameters(parameters)(data.inputs)
        return ((values - data.outputs) / network.outputs.half).ravel()

    found = least_squares(errors, network.parameters, xtol=1e-12, ftol=1e-12, gtol=1e-12)
    assert fit.reason == "gradient"
    assert fit.training_error == pytest.approx(2 * found.cost / data.outputs.size, rel=1e-6)


def test_training_stops_before_it_learns_the_noise():
    rng = np.random.default_rng(5)
    training, validation = (draw(n, rng, noise=0.1) for n in (60, 30))
    fresh = draw(1000, rng)
    errors = []
    for seed in range(4):
        start = skewed((20,), 2, 2, seed)
        stopped = train_validated(start, training, validation)
        # Its own judge does not stop it.
        fitted = train_validated(start, training, training, iterations=100)
        assert stopped.reason == "validation" and stopped.iterations == stopped.best + 6
        assert fitted.training_error < 0.5 * stopped.training_error
        offs = [fit.network(fresh.inputs) - fresh.outputs for fit in (stopped, fitted)]
        errors.append([np.sqrt(np.mean(off**2)) for off in offs])
    stopped, fitted = np.median(errors, axis=0)
    assert 2 * stopped < fitted


def test_the_network_kept_is_the_best_on_the_validation_data():
    rng = np.random.default_rng(6)
    training, validation = (draw(n, rng, noise=0.1) for n in (40, 20))
    start = skewed((15,), 2, 2, seed=3)
    best = train_validated(start, training, validation)
    scaled = best.network.outputs.half
    off = (best.network(validation.inputs) - validation.outputs) / scaled
    assert best.validation_error == pytest.approx(np.mean(off**2))
    # Stopped after any other number of steps, it is no better.
    for steps in range(1, best.iterations):
        other = train_validated(start, training, validation, iterations=steps)
        assert other.validation_error >= best.validation_error
        assert (other.iterations, other.best) == (steps, min(steps, other.best))


def test_more_parameters_than_errors_are_fitted_exactly():
    rng = np.random.default_rng(7)
    data = draw(30, rng)
    fit = train_validated(skewed((20, 20), 2, 2), data, data, iterations=100)
    np.testing.assert_allclose(fit.network(data.inputs), data.outputs, atol=1e-4)


def data(count, n_out=1, value=0.0):
    return Dataset(np.full((count, 1), value), np.zeros((count, n_out)))


@pytest.mark.parametrize(
    ("train", "given", "message"),
    [
        (train_regularised, [data(50, 2)], "shapes"),
        (train_regularised, [data(50, value=np.nan)], "finite"),
        (train_regularised, [data(3)], "more samples"),
        (train_validated, [data(9), data(0)], "at least one sample"),
        (train_validated, [data(0), data(9)], "at least one sample"),
        (train_validated, [data(9), data(9, 2)], "shapes"),
        (train_validated, [data(9, value=np.nan), data(9)], "finite"),
    ],
)
def test_data_that_cannot_be_used_are_refused(train, given, message):
    with pytest.raises(ValueError, match=message):
        train(make_network((5,), 1, 1), *given)


# ---------------------------------------------------------------- inference


@pytest.mark.parametrize("hidden", [(), (1,), (10, 10), (7, 2, 9)])
@pytest.mark.parametrize("make", [CompiledInference, PlainInference])
def test_inference_is_the_network(hidden, make):
    for n_in, n_out in ((3, 2), (2, 3)):
        network = skewed(hidden, n_in, n_out)
        infer = make(network)
        x = np.random.default_rng(9).uniform(-2, 3, (20, n_in))
        np.testing.assert_allclose([infer(row) for row in x], network(x), atol=1e-13)
        for other in (x[0].tolist(), x[:, ::-1][0, ::-1], np.asfortranarray(x)[0]):
            np.testing.assert_allclose(infer(other), network(x[:1])[0], atol=1e-13)


def test_batches_are_single_samples():
    network = skewed((10, 10), 3, 2)
    infer = CompiledInference(network)
    x = np.random.default_rng(10).uniform(-2, 3, (20, 3))
    np.testing.assert_array_equal(infer.batch(x), [infer(row) for row in x])
    np.testing.assert_array_equal(infer.batch(np.asfortranarray(x)), infer.batch(x))
    assert infer.batch(np.empty((0, 3))).shape == (0, 2)
    with pytest.raises(ValueError, match=r"inputs of shape \(k, 3\), got \(3,\)"):
        infer.batch(x[0])


def test_what_is_returned_is_the_callers_own():
    infer = CompiledInference(skewed((), 2, 2))
    x = np.zeros(2)
    one = infer(x)
    kept = one.copy()
    infer(np.ones(2))
    np.testing.assert_array_equal(one, kept)
    assert not np.shares_memory(one, x)


@pytest.mark.parametrize("make", [CompiledInference, PlainInference])
@pytest.mark.parametrize("bad", [np.zeros(3), np.zeros((1, 2)), 0.0])
def test_inputs_of_other_shapes_are_refused(make, bad):
    infer = make(skewed((4,), 2, 3))
    with pytest.raises(ValueError, match=r"inputs of shape \(2,\), got"):
        infer(bad)


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
        return train_regularised(network, samples, iterations=5).network

    one, again, other = fit(0), fit(0), fit(1)
    np.testing.assert_array_equal(one.parameters, again.parameters)
    assert one.sizes == (7, 30, 3)
    assert np.abs(one.parameters - other.parameters).max() > 0.1
