"""Time integration methods as coefficients, and compiled stepping of any beam model with them."""

from math import sqrt
from typing import NamedTuple

import numpy as np
from numpy import ndarray

from softrobot_env.compile.kernels import kernel, structure
from softrobot_env.core.registry import Registry

from .. import signals
from ..mechanics import acceleration, bandwidth, iteration_matrix, project, residual
from . import band

#: What `integrate` returns.
DONE, STEP_TOO_SMALL, NOT_CONVERGED, DIVERGED, TOO_MANY_STEPS = range(5)

#: What these codes mean.
FAILURES = {
    STEP_TOO_SMALL: "the step size fell below its limit",
    NOT_CONVERGED: "Newton's iteration did not converge",
    DIVERGED: "the motion diverged",
    TOO_MANY_STEPS: "the largest number of steps was used up",
}

#: Rows of its counters.
STEPS, REJECTED, RESIDUALS, MATRICES = range(4)

_NEWTON_ITERATIONS = 10
_CAREFUL_ITERATIONS = 50
_CAREFUL_CHANGE = 0.3  # of a coordinate's scale in one iteration
_ROUNDING = 1e-10  # change relative to the scale that may be all rounding error
_SLOW = 0.3  # contraction per iteration beyond which the iteration matrix is formed anew
_NEWTON_SHARE = 0.02  # of the tolerance that the iteration's error may take
_SMALLEST_STEP = 1e-9  # of the whole duration
_SHRINK, _GROW, _MARGIN, _WORTHWHILE = 0.2, 4.0, 0.9, 1.2
_MOST_INTERVALS = 32  # of a smooth signal in one step
_NUDGE = 1e-6  # of a step, by which stages keep off its ends, where inputs may jump
_HUGE = 1e6  # sizes of a coordinate beyond which a motion counts as diverged


@structure
class Method(NamedTuple):
    """A Runge-Kutta method, explicit or diagonally implicit with one diagonal element.

    Attributes:
        a: (s, s), lower triangular.
        b, c: (s,).
        error: (s,) weights of the error estimate, b less those of the embedded method; zero if
            there is none.
        diagonal: Element of a's diagonal, 0 for an explicit method.
        order: Order of convergence.
        estimate: Order of the embedded method, 0 if there is none.
        last: Whether the last stage is the new state (b is a's last row).
    """

    a: ndarray
    b: ndarray
    c: ndarray
    error: ndarray
    diagonal: float
    order: int
    estimate: int
    last: bool

    @property
    def adaptive(self) -> bool:
        """Whether the method estimates its error."""
        return self.estimate > 0


def _method(
    a: list[list[float]], b: list[float], order: int, embedded: list[float] | None = None
) -> Method:
    full = np.zeros((len(b), len(b)))
    for i, row in enumerate(a):
        full[i, : len(row)] = row
    weights = np.array(b)
    return Method(
        a=full,
        b=weights,
        c=full.sum(axis=1),
        error=np.zeros(len(b)) if embedded is None else weights - np.array(embedded),
        diagonal=float(full[0, 0]),
        order=order,
        estimate=0 if embedded is None else order - 1,
        last=bool(np.array_equal(full[-1], weights)),
    )


_ALEXANDER = 1 - 1 / sqrt(2)

#: implicit_euler and sdirk2 (Alexander 1977) are L-stable; sdirk4 is the L-stable method of
#: order 4 with an estimate of order 3 of Hairer and Wanner, Solving ODEs II, (IV.6.16);
#: implicit_midpoint conserves quadratic invariants; dormand_prince is the explicit pair of
#: orders 5 and 4 behind MATLAB's ode45 (Hairer, Norsett and Wanner, Solving ODEs I, Tab. II.5.2).
METHODS = Registry(
    "method",
    {
        "implicit_euler": _method([[1.0]], [1.0], 1),
        "implicit_midpoint": _method([[0.5]], [1.0], 2),
        "sdirk2": _method(
            [[_ALEXANDER], [1 - _ALEXANDER, _ALEXANDER]], [1 - _ALEXANDER, _ALEXANDER], 2
        ),
        "sdirk4": _method(
            [
                [1 / 4],
                [1 / 2, 1 / 4],
                [17 / 50, -1 / 25, 1 / 4],
                [371 / 1360, -137 / 2720, 15 / 544, 1 / 4],
                [25 / 24, -49 / 48, 125 / 16, -85 / 12, 1 / 4],
            ],
            [25 / 24, -49 / 48, 125 / 16, -85 / 12, 1 / 4],
            4,
            [59 / 48, -17 / 96, 225 / 32, -85 / 12, 0.0],
        ),
        "rk4": _method([[], [1 / 2], [0, 1 / 2], [0, 0, 1]], [1 / 6, 1 / 3, 1 / 3, 1 / 6], 4),
        "dormand_prince": _method(
            [
                [],
                [1 / 5],
                [3 / 40, 9 / 40],
                [44 / 45, -56 / 15, 32 / 9],
                [19372 / 6561, -25360 / 2187, 64448 / 6561, -212 / 729],
                [9017 / 3168, -355 / 33, 46732 / 5247, 49 / 176, -5103 / 18656],
                [35 / 384, 0, 500 / 1113, 125 / 192, -2187 / 6784, 11 / 84],
            ],
            [35 / 384, 0, 500 / 1113, 125 / 192, -2187 / 6784, 11 / 84, 0],
            5,
            [5179 / 57600, 0, 7571 / 16695, 393 / 640, -92097 / 339200, 187 / 2100, 1 / 40],
        ),
    },
)


def find_method(name: str, step: float | None) -> Method:
    """The method of a name, checked to work with a fixed step [s] or with None.

    Raises:
        ValueError: Unknown name, a step that is not positive, or no step for a method that
            cannot estimate its error.
    """
    method = METHODS.find(name)
    if step is None and not method.adaptive:
        adaptive = ", ".join(key for key, m in METHODS.items() if m.adaptive)
        raise ValueError(f"{name} needs a step; without one choose from {adaptive}")
    if step is not None and not step > 0:
        raise ValueError(f"step must be positive, got {step!r}")
    return method


# ---------------------------------------------------------------- stepping


@structure
class Control(NamedTuple):
    """How to choose steps.

    Attributes:
        adaptive: Whether the step follows the error estimate.
        step: [s], fixed or first step.
        tolerance: Error per step relative to `model.scale`; a fixed step uses it for Newton's
            iteration only.
        max_steps: Steps after which to give up.
    """

    adaptive: bool
    step: float
    tolerance: float
    max_steps: int


@structure
class Work(NamedTuple):
    """Arrays of one integration: stages, Newton's matrix with what it was formed for, and efforts.

    Stages are (s, n), states and u vectors; matrix to formed belong to Newton's iteration. counters
    are (4,) int, rows STEPS to MATRICES, increased; steps (2,) [s] are set to the smallest and
    largest step taken.
    """

    stage_v: ndarray
    stage_a: ndarray
    start_q: ndarray
    start_v: ndarray
    q: ndarray
    v: ndarray
    a: ndarray
    change: ndarray
    u: ndarray
    matrix: ndarray
    pivot: ndarray
    formed: ndarray
    counters: ndarray
    steps: ndarray


def workspace(n: int, width: int, stages: int, n_inputs: int) -> Work:
    """Arrays for n coordinates and a Newton matrix with `width` diagonals to either side."""
    return Work(
        stage_v=np.zeros((stages, n)),
        stage_a=np.zeros((stages, n)),
        start_q=np.zeros(n),
        start_v=np.zeros(n),
        q=np.zeros(n),
        v=np.zeros(n),
        a=np.zeros(n),
        change=np.zeros(n),
        u=np.zeros(n_inputs),
        matrix=np.zeros((n, 3 * width + 1)),
        pivot=np.zeros(n, np.int64),
        formed=np.zeros(1),
        counters=np.zeros(4, np.int64),
        steps=np.zeros(2),
    )


class Step(NamedTuple):
    """A step of size h [s] from time t [s] and a state: q, v and its acceleration a (n,)."""

    t: float
    h: float
    q: ndarray
    v: ndarray
    a: ndarray


class Samples(NamedTuple):
    """A motion as it is sampled.

    Attributes:
        times: (k,) [s], increasing, two or more.
        q, v: (k, n), filled.
    """

    times: ndarray
    q: ndarray
    v: ndarray


def samples(times: ndarray, n: int) -> Samples:
    """Samples of n coordinates at times (k,) [s], to be filled."""
    return Samples(times, *np.empty((2, len(times), n)))


@kernel
def copy(source, out):
    """Copy a vector; an assignment of slices would take seconds more to compile."""
    for i in range(len(out)):
        out[i] = source[i]


@kernel
def _size(model, x):
    """Root mean square of x (n,) relative to the model's scale."""
    total = 0.0
    for i in range(len(x)):
        total += (x[i] / model.scale[i]) ** 2
    return np.sqrt(total / len(x))


@kernel
def _newton_matrix(model, q, v, a, h, work):
    """Form and factor K + D / h + M / h^2, the derivative by a stage's position; h = diagonal
    element times step."""
    iteration_matrix(model, q, v, a, work.u, 1 / h, 1 / h**2, work.matrix)
    work.formed[0] = h
    work.counters[MATRICES] += 1
    return band.factor(work.matrix, bandwidth(model), work.pivot)


@kernel
def _inside(c):
    """Place c (0 to 1) of a stage in its step, kept off the ends."""
    return _NUDGE + c * (1 - 2 * _NUDGE)


@kernel
def _place(h, work):
    """Position and velocity of a stage from its acceleration work.a."""
    for i in range(len(work.a)):
        work.v[i] = work.start_v[i] + h * work.a[i]
        work.q[i] = work.start_q[i] + h * work.v[i]


@kernel
def _correct(model, h, largest, work):
    """One iteration of Newton's method; the size of the change it made.

    A change beyond `largest` times a coordinate's scale is shortened to it.
    """
    residual(model, work.q, work.v, work.a, work.u, work.change)
    work.counters[RESIDUALS] += 1
    band.solve(work.matrix, bandwidth(model), work.pivot, work.change)
    peak = 0.0
    for i in range(model.n):
        peak = max(peak, abs(work.change[i]) / model.scale[i])
    share = largest / peak if peak > largest else 1.0
    for i in range(model.n):
        work.a[i] -= share * work.change[i] / h**2
    _place(h, work)
    return _size(model, work.change)


@kernel
def _solve_stage(model, h, limit, work):
    """Simplified Newton iteration for a stage; whether it converges.

    A slow contraction asks for a new matrix in the next step.
    """
    _place(h, work)
    before, contraction = np.inf, 0.0
    for iteration in range(_NEWTON_ITERATIONS):
        size = _correct(model, h, np.inf, work)
        if not size < _HUGE:
            return False
        if iteration > 0:
            contraction = max(contraction, size / before)
            if contraction > _SLOW:
                work.formed[0] = 0.0
            if contraction >= 1.0:  # no progress: rounding error, or no convergence
                return size < max(limit, _ROUNDING)
        # What is left after this iteration is about rate / (1 - rate) times this change.
        rate = contraction if iteration > 0 else 0.5
        if size == 0.0 or size * rate / max(1e-3, 1 - rate) < limit:
            return True
        before = size
    return False


@kernel
def _solve_stage_carefully(model, h, limit, hold, work):
    """Newton iteration with a new matrix and a bounded change each time, for very large steps.

    It starts from constant position (hold) or velocity.
    """
    for i in range(model.n):
        work.a[i] = -work.start_v[i] / h if hold else 0.0
    _place(h, work)
    before = np.inf
    for _ in range(_CAREFUL_ITERATIONS):
        if not _newton_matrix(model, work.q, work.v, work.a, h, work):
            return False
        work.formed[0] = 0.0  # not for other steps
        size = _correct(model, h, _CAREFUL_CHANGE, work)
        if not size < _HUGE:
            return False
        if size < limit or (size < _ROUNDING and size > 0.5 * before):
            return True
        before = size
    return False


@kernel
def _start_stage(method, s, step, work, start_q, start_v):
    """Set start_q and start_v (n,) to the step's state moved on by the stages before s."""
    h, q, v = step.h, step.q, step.v
    for i in range(len(q)):
        dq, dv = 0.0, 0.0
        for j in range(s):
            dq += method.a[s, j] * work.stage_v[j, i]
            dv += method.a[s, j] * work.stage_a[j, i]
        start_q[i] = q[i] + h * dq
        start_v[i] = v[i] + h * dv


@kernel
def _implicit_stages(model, method, signal, step, limit, careful, work):
    """All stages of a diagonally implicit step; whether they were found."""
    gamma = method.diagonal * step.h
    copy(step.a, work.a)
    for s in range(len(method.b)):
        signals.evaluate(signal, step.t + _inside(method.c[s]) * step.h, work.u)
        _start_stage(method, s, step, work, work.start_q, work.start_v)
        if careful:
            found = _solve_stage_carefully(model, gamma, limit, False, work)
            if not found:
                found = _solve_stage_carefully(model, gamma, limit, True, work)
        else:
            found = _solve_stage(model, gamma, limit, work)
        if not found:
            return False
        copy(work.v, work.stage_v[s])
        copy(work.a, work.stage_a[s])
    return True


@kernel
def _solve_stages(model, method, signal, step, limit, careful, work):
    """All stages with the old Newton matrix, else with a new one, else carefully; whether found."""
    gamma = method.diagonal * step.h
    if gamma == 0:
        _explicit_stages(model, method, signal, step, work)
        return True
    for attempt in range(3 if careful else 2):
        ready = work.formed[0] == gamma or attempt == 2
        if attempt == 1:
            signals.evaluate(signal, step.t, work.u)
            ready = _newton_matrix(model, step.q, step.v, step.a, gamma, work)
        if ready and _implicit_stages(model, method, signal, step, limit, attempt == 2, work):
            return True
    work.formed[0] = 0.0
    return False


@kernel
def _explicit_stages(model, method, signal, step, work):
    """All stages of an explicit step; the first is the state it starts from."""
    copy(step.v, work.stage_v[0])
    copy(step.a, work.stage_a[0])
    for s in range(1, len(method.b)):
        signals.evaluate(signal, step.t + _inside(method.c[s]) * step.h, work.u)
        _start_stage(method, s, step, work, work.q, work.v)
        copy(work.v, work.stage_v[s])
        acceleration(model, work.q, work.v, work.u, work.stage_a[s])
        work.counters[RESIDUALS] += 1


@kernel
def _advance(model, method, step, work):
    """Set work.q and work.v to the new state; the error estimate relative to the scale."""
    n, error, h, q, v = model.n, 0.0, step.h, step.q, step.v
    for i in range(n):
        dq, dv, eq, ev = 0.0, 0.0, 0.0, 0.0
        for s in range(len(method.b)):
            dq += method.b[s] * work.stage_v[s, i]
            dv += method.b[s] * work.stage_a[s, i]
            eq += method.error[s] * work.stage_v[s, i]
            ev += method.error[s] * work.stage_a[s, i]
        work.q[i], work.v[i] = q[i] + h * dq, v[i] + h * dv
        error += (max(abs(h * eq), h * abs(h * ev)) / model.scale[i]) ** 2
    return np.sqrt(error / n)


@kernel
def _sample(samples, done, step, work):
    """Fill the samples up to t + h by the quintic through both ends; the number now done.

    The polynomial matches position, velocity and acceleration at t (q, v, a) and at t + h (those
    in work), so its error is of sixth order in the step.
    """
    t, h, q, v, a = step
    times, out_q, out_v = samples
    while done < len(times) and times[done] <= t + h * (1 + 1e-9):
        x = min(1.0, (times[done] - t) / h)
        for i in range(len(q)):
            jump = work.q[i] - q[i] - h * v[i] - 0.5 * h * h * a[i]
            slope = h * (work.v[i] - v[i] - h * a[i])
            bend = h * h * (work.a[i] - a[i])
            c3 = 10 * jump - 4 * slope + 0.5 * bend
            c4 = -15 * jump + 7 * slope - bend
            c5 = 6 * jump - 3 * slope + 0.5 * bend
            out_q[done, i] = q[i] + x * (
                h * v[i] + x * (0.5 * h * h * a[i] + x * (c3 + x * (c4 + x * c5)))
            )
            rate = h * v[i] + x * (h * h * a[i] + x * (3 * c3 + x * (4 * c4 + x * 5 * c5)))
            out_v[done, i] = rate / h
        if x == 1.0:  # exactly the state, without rounding
            copy(work.q, out_q[done])
            copy(work.v, out_v[done])
        done += 1
    return done


@kernel
def _is_healthy(model, q, v):
    for i in range(model.n):
        if not abs(q[i]) < _HUGE * model.scale[i] or not np.isfinite(v[i]):
            return False
    return True


@kernel
def _complete(model, method, signal, t, h, work):
    """Project the new state in work, reached at t, and set its acceleration."""
    project(model, work.q, work.v)
    if method.last and method.diagonal > 0:
        copy(work.stage_a[-1], work.a)
    else:
        signals.evaluate(signal, t - _NUDGE * h, work.u)
        acceleration(model, work.q, work.v, work.u, work.a)
        work.counters[RESIDUALS] += 1


@kernel
def _restart(model, signal, step, before, work):
    """Set the acceleration anew if held inputs jump where a step begins."""
    if signal.coefficients.shape[0] == 1 or signal.coefficients.shape[1] > 1:
        return
    signals.evaluate(signal, step.t - _NUDGE * step.h, before)
    signals.evaluate(signal, step.t + _NUDGE * step.h, work.u)
    for j in range(len(before)):
        if before[j] != work.u[j]:
            acceleration(model, step.q, step.v, work.u, step.a)
            work.counters[RESIDUALS] += 1
            return


@kernel
def _longest_step(signal, t):
    """Longest step [s] from t that misses no change of the inputs.

    Held inputs may jump at the next instant; smooth ones change over several intervals.
    """
    intervals, terms = signal.coefficients.shape[0], signal.coefficients.shape[1]
    if intervals == 1:
        return np.inf
    if terms > 1:
        return _MOST_INTERVALS * signal.step
    place = (t - signal.start) / signal.step
    following = max(1.0, np.floor(place + 1e-9) + 1)
    return (following - place) * signal.step if following < intervals else np.inf


@kernel
def _step_factor(method, error, tolerance):
    """Factor on the step that would bring the error to the tolerance, within limits."""
    if error < 0:  # Newton's iteration failed
        return 0.25
    if not np.isfinite(error):
        return _SHRINK
    if error == 0:
        return _GROW
    factor = _MARGIN * (tolerance / error) ** (1.0 / (method.estimate + 1))
    return min(_GROW, max(_SHRINK, factor))


@kernel
def _rejection(error, adaptive, h, smallest):
    """Code of a failed attempt that cannot be repeated with a smaller step, else DONE."""
    if not adaptive:
        return NOT_CONVERGED if error < 0 else DONE
    if h >= smallest:
        return DONE
    if error < 0:
        return NOT_CONVERGED
    return STEP_TOO_SMALL if np.isfinite(error) else DIVERGED


@kernel
def _first_step(control, duration):
    """First step [s]; a fixed one divides the duration."""
    if control.adaptive:
        return min(control.step, duration)
    return duration / np.ceil(duration / control.step - 1e-9)


@kernel
def integrate(model, method, control, signal, work, state, samples):
    """Integrate from the first time of the samples to the last.

    Args:
        model: Data of a model.
        method, control, signal, work: `Method`, `Control`, `signals.Signal`, `Work`.
        state: Initial q and v (n,); the last state on return.
        samples: `Samples`, filled.

    Returns:
        A code out of DONE, ..., and the time [s] reached.
    """
    (q, v), times, counters, steps = state, samples.times, work.counters, work.steps
    t, end, a = times[0], times[-1], np.empty(model.n)
    wish, smallest = _first_step(control, end - t), _SMALLEST_STEP * (end - t)
    limit = _NEWTON_SHARE * control.tolerance
    before = np.empty(len(work.u))
    copy(q, samples.q[0])
    copy(v, samples.v[0])
    steps[0], steps[1] = np.inf, 0.0
    done, repeated, taken = 1, False, 0
    signals.evaluate(signal, t, work.u)
    acceleration(model, q, v, work.u, a)
    while done < len(times):
        if counters[STEPS] + counters[REJECTED] >= control.max_steps:
            return TOO_MANY_STEPS, t
        h = min(wish, _longest_step(signal, t), end - t) if control.adaptive else wish
        careful = not control.adaptive  # an adaptive step is shortened instead
        step = Step(t, h, q, v, a)
        error = -1.0  # where Newton's iteration failed
        if _solve_stages(model, method, signal, step, limit, careful, work):
            error = _advance(model, method, step, work)
        factor = _step_factor(method, error, control.tolerance) if control.adaptive else 1.0
        if error < 0 or (control.adaptive and not error <= control.tolerance):
            counters[REJECTED] += 1
            wish, repeated = h * min(factor, _MARGIN), True
            code = _rejection(error, control.adaptive, wish, smallest)
            if code != DONE:
                return code, t
            continue
        if not _is_healthy(model, work.q, work.v):
            return DIVERGED, t
        _complete(model, method, signal, t + h, h, work)
        done = _sample(samples, done, step, work)
        copy(work.q, q)
        copy(work.v, v)
        copy(work.a, a)
        taken += 1
        counters[STEPS] += 1
        steps[0], steps[1] = min(steps[0], h), max(steps[1], h)
        if control.adaptive:
            t += h
            wish = _next_step(method, h, wish, factor, repeated)
            repeated = False
        else:
            t = times[0] + taken * h  # without the rounding of a sum
        _restart(model, signal, Step(t, h, q, v, a), before, work)
    return DONE, t


@kernel
def _next_step(method, h, wish, factor, repeated):
    """Step to try after one of size h that was accepted; `wish` is what h was cut from.

    It does not grow right after a repeated step, and small growth is not worth a new matrix.
    """
    factor = min(factor, 1.0) if repeated else factor
    if h < wish and factor >= 1.0:
        return max(wish, h * factor)
    if factor < 1.0 or factor > _WORTHWHILE or method.diagonal == 0:
        return h * factor
    return h
