"""Estimating the state of a reduced model, and planning its inputs, as machine code."""

import numpy as np
from numpy import ndarray

from softrobot_env.compile.kernels import kernel
from softrobot_env.learned.reduction.polynomials import Motion, add_gradient, advance, linearise


@kernel
def outputs(shape: Motion, origin: ndarray, x: ndarray, z: ndarray, slope: ndarray) -> None:
    """Outputs z (o,) at x (n,), and their derivative by x, slope (o, n).

    The shape holds polynomials in x for the outputs minus their origin (o,).
    """
    count, n = len(shape.parents), len(x)
    z[:] = origin
    add_gradient(shape, x, x[:0], np.empty(count), np.empty((count, n)), z, slope)


@kernel
def estimate(
    motion: Motion,
    x: ndarray,
    disturbance: ndarray,
    covariance: ndarray,
    acted: ndarray,
    measured: ndarray,
    process: ndarray,
    noise: ndarray,
) -> None:
    """One step of an extended Kalman filter, in place.

    Model errors are treated as slowly changing inputs added to the commanded ones, so that plans
    leave no steady error.

    Args:
        motion: The model.
        x: (n,), state a sample ago.
        disturbance: (m,) of the inputs.
        covariance: (n + m, n + m), of both.
        acted: (m,), inputs that acted since.
        measured: (n,), the state computed from the outputs.
        process: (n + m, n + m), added to the covariance in a sample.
        noise: (n, n), covariance of the measurement.
    """
    n, m = len(x), len(disturbance)
    transition, effect = np.empty((n, n)), np.empty((n, m))
    linearise(motion, x, acted + disturbance, transition, effect)
    whole = np.eye(n + m)
    whole[:n, :n] = transition
    whole[:n, n:] = effect
    predicted = whole @ covariance @ whole.T + process
    spread = predicted[:n, :n] + noise
    gain = np.linalg.solve(spread, predicted[:n, :].copy()).T
    change = gain @ (measured - x)
    x += change[:n]
    disturbance += change[n:]
    kept = predicted - gain @ predicted[:n, :].copy()
    covariance[:] = (kept + kept.T) / 2


@kernel
def ahead(motion: Motion, x: ndarray, disturbance: ndarray, inputs: ndarray) -> ndarray:
    """State (n,) when the next input acts, after those commanded (lag, m)."""
    now, terms = x.copy(), np.empty(len(motion.parents))
    for row in range(len(inputs)):
        advance(motion, now, inputs[row] + disturbance, terms)
    return now


@kernel
def program(
    motion: Motion,
    shape: Motion,
    origin: ndarray,
    x: ndarray,
    disturbance: ndarray,
    weights: ndarray,
    nodes: ndarray,
    reference: ndarray,
    last: ndarray,
    smoothness: float,
) -> tuple[ndarray, ndarray]:
    """Hessian (c m, c m) and gradient (c m,) of half a plan's cost, by Gauss-Newton.

    The cost is the sum of the squares of the outputs' errors, and `smoothness` times that of the
    changes of the inputs.

    Args:
        motion: The model.
        shape, origin: See `outputs`.
        x: (n,), where the plan begins.
        disturbance: (m,).
        weights: (t, c), inputs of the samples are `weights @ nodes`.
        nodes: (c, m), the plan to linearise about.
        reference: (t, o), of the outputs after each sample.
        last: (m,), the input before the plan.
        smoothness: See above.
    """
    (count, m), n, size = nodes.shape, len(x), nodes.size
    hessian, gradient = np.zeros((size, size)), np.zeros(size)
    now, z, slope = x.copy(), np.empty(reference.shape[1]), np.empty((reference.shape[1], n))
    transition, effect = np.empty((n, n)), np.empty((n, m))
    sensitivity = np.zeros((n, size))
    before, before_weights = last.copy(), np.zeros(count)
    for t in range(len(reference)):
        u = weights[t] @ nodes
        linearise(motion, now, u + disturbance, transition, effect)
        sensitivity = transition @ sensitivity
        for c in range(count):
            if weights[t, c] != 0.0:
                for i in range(n):
                    for j in range(m):
                        sensitivity[i, c * m + j] += effect[i, j] * weights[t, c]
        outputs(shape, origin, now, z, slope)
        tip = slope @ sensitivity
        hessian += tip.T @ tip
        gradient += tip.T @ (z - reference[t])
        change = weights[t] - before_weights
        for c in range(count):
            if change[c] == 0.0:
                continue
            for j in range(m):
                gradient[c * m + j] += smoothness * change[c] * (u[j] - before[j])
                for d in range(count):
                    hessian[c * m + j, d * m + j] += smoothness * change[c] * change[d]
        before, before_weights = u, weights[t]
    return hessian, gradient
