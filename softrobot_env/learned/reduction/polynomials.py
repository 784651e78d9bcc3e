"""Monomials of several variables, and what they are coefficients of, as machine code.

Each monomial is one of lower degree times a variable: one product each, and one more per variable
for the gradient.
"""

from dataclasses import dataclass
from functools import cached_property
from itertools import combinations_with_replacement
from typing import NamedTuple

import numba
import numpy as np
from numpy import ndarray

_kernel = numba.njit(cache=True, error_model="numpy", fastmath={"contract", "nsz"})


class Motion(NamedTuple):
    """How a state x (n,) moves under an input u (m,), for the kernels.

    Attributes:
        parents: (terms,) the monomial of lower degree, -1 for one.
        factors: (terms,) the variable out of (x, u) that it is multiplied by; -1: the monomial 1.
        coefficients: (n, terms); of dx/dt, or of the next x.
        scale: (n + m,), what x and u are divided by.
        period: [s] of a sample.
        substeps: Runge-Kutta steps in a sample; 0: the polynomials give the next x.
    """

    parents: ndarray
    factors: ndarray
    coefficients: ndarray
    scale: ndarray
    period: float
    substeps: int


@dataclass(frozen=True)
class Monomials:
    """Monomials by rising degree.

    Attributes:
        powers: (terms, variables).
    """

    powers: ndarray

    @staticmethod
    def of(
        states: int,
        inputs: int,
        order: int,
        input_order: int = 0,
        mixed: bool = False,
        constant: bool = False,
    ) -> "Monomials":
        """Those of states up to `order` and of inputs up to `input_order`.

        Args:
            states, inputs: Numbers of variables, states first.
            order, input_order: Largest degrees.
            mixed: Whether there are products of states and inputs, up to the larger degree.
            constant: Whether there is the monomial 1.
        """
        rows = []
        for degree in range(0 if constant else 1, max(order, input_order) + 1):
            for chosen in combinations_with_replacement(range(states + inputs), degree):
                powers = np.bincount(np.array(chosen, int), minlength=states + inputs)
                by_states, by_inputs = powers[:states].sum(), powers[states:].sum()
                pure = not (by_states and by_inputs)
                if by_states <= order and by_inputs <= input_order and (mixed or pure):
                    rows.append(powers)
        return Monomials(np.array(rows, np.int64).reshape(len(rows), states + inputs))

    @cached_property
    def chain(self) -> tuple[ndarray, ndarray]:
        """Parents and factors, see `Motion`."""
        place = {tuple(powers): row for row, powers in enumerate(self.powers.tolist())}
        parents, factors = [], []
        for powers in self.powers:
            if not powers.any():
                parents.append(-1)
                factors.append(-1)
                continue
            factor = int(np.flatnonzero(powers)[-1])
            lower = powers.copy()
            lower[factor] -= 1
            parents.append(place[tuple(lower.tolist())] if lower.any() else -1)
            factors.append(factor)
        return np.array(parents, np.int64), np.array(factors, np.int64)

    @np.errstate(over="ignore", invalid="ignore")  # of models that diverge while they are fitted
    def __call__(self, values: ndarray) -> ndarray:
        """Monomials (..., terms) of values (..., variables)."""
        out = np.ones((*values.shape[:-1], len(self.powers)))
        for j, (parent, factor) in enumerate(zip(*self.chain, strict=True)):
            if factor >= 0:
                lower = out[..., parent] if parent >= 0 else 1.0
                out[..., j] = lower * values[..., factor]
        return out

    def gradient(self, values: ndarray) -> ndarray:
        """Of the monomials at values (rows, variables): (rows, terms, variables)."""
        terms, (rows, variables) = self(values), values.shape
        out = np.zeros((rows, len(self.powers), variables))
        for j, (parent, factor) in enumerate(zip(*self.chain, strict=True)):
            if factor < 0:
                continue
            if parent >= 0:
                out[:, j] = out[:, parent] * values[:, factor, None]
            out[:, j, factor] += terms[:, parent] if parent >= 0 else 1.0
        return out


@_kernel
def _rate(motion, x, u, terms, out):
    """The polynomials' value (n,), and the monomials (terms,)."""
    n = len(x)
    out[:] = 0.0
    for j in range(len(motion.parents)):
        lower = 1.0 if motion.parents[j] < 0 else terms[motion.parents[j]]
        k = motion.factors[j]
        if k < 0:
            terms[j] = 1.0
        else:
            terms[j] = lower * (x[k] if k < n else u[k - n]) / motion.scale[k]
        for i in range(n):
            out[i] += motion.coefficients[i, j] * terms[j]


@_kernel
def add_gradient(motion, x, u, terms, slopes, out, gradient):
    """Add the polynomials' value (k,) to out, and set the gradient (k, n + m) by (x, u).

    Room is in terms (terms,), which are set to the monomials, and slopes (terms, n + m).
    """
    n, both = len(x), len(x) + len(u)
    gradient[:] = 0.0
    for j in range(len(motion.parents)):
        parent, k = motion.parents[j], motion.factors[j]
        lower = 1.0 if parent < 0 else terms[parent]
        value = 1.0
        if k >= 0:
            value = (x[k] if k < n else u[k - n]) / motion.scale[k]
        terms[j] = lower * value
        for i in range(both):
            slopes[j, i] = 0.0 if parent < 0 else slopes[parent, i] * value
        if k >= 0:
            slopes[j, k] += lower / motion.scale[k]
        for i in range(len(out)):
            c = motion.coefficients[i, j]
            out[i] += c * terms[j]
            for v in range(both):
                gradient[i, v] += c * slopes[j, v]


@_kernel
def advance(motion, x, u, terms):
    """Move x (n,) on by a sample, under an input u (m,) that is held."""
    if motion.substeps == 0:
        new = np.empty(len(x))
        _rate(motion, x, u, terms, new)
        x[:] = new
        return
    h = motion.period / motion.substeps
    one, two = np.empty(len(x)), np.empty(len(x))
    three, four = np.empty(len(x)), np.empty(len(x))
    for _ in range(motion.substeps):
        _rate(motion, x, u, terms, one)
        _rate(motion, x + h / 2 * one, u, terms, two)
        _rate(motion, x + h / 2 * two, u, terms, three)
        _rate(motion, x + h * three, u, terms, four)
        x += h / 6 * (one + 2 * two + 2 * three + four)


@_kernel
def roll(motion, starts, inputs, out):
    """States out (b, t, n) at the samples, from starts (b, n) under inputs (b, t, m)."""
    terms = np.empty(len(motion.parents))
    for one in range(len(starts)):
        x = starts[one].copy()
        for t in range(inputs.shape[1]):
            out[one, t] = x
            if t + 1 < inputs.shape[1]:
                advance(motion, x, inputs[one, t], terms)


@_kernel
def linearise(motion, x, u, transition, effect):
    """Move x (n,) on by a sample and tell how the result changes with x (n, n) and u (n, m)."""
    n, m, count = len(x), len(u), len(motion.parents)
    terms, slopes = np.empty(count), np.empty((count, n + m))
    value, gradient = np.zeros(n), np.empty((n, n + m))
    if motion.substeps == 0:
        add_gradient(motion, x, u, terms, slopes, value, gradient)
        x[:] = value
        transition[:] = gradient[:, :n]
        effect[:] = gradient[:, n:]
        return
    h = motion.period / motion.substeps
    whole = np.zeros((n, n + m))  # change of x with (x, u) since the sample began
    whole[:, :n] = np.eye(n)
    nodes, weights = (0.0, 0.5, 0.5, 1.0), (1.0, 2.0, 2.0, 1.0)
    for _ in range(motion.substeps):
        slope, moved = np.zeros(n), np.zeros(n)
        slope_change, moved_change = np.zeros((n, n + m)), np.zeros((n, n + m))
        for stage in range(4):
            at = x + h * nodes[stage] * slope
            at_change = whole + h * nodes[stage] * slope_change
            value[:] = 0.0
            add_gradient(motion, at, u, terms, slopes, value, gradient)
            slope = value.copy()
            slope_change = gradient[:, :n].copy() @ at_change
            slope_change[:, n:] += gradient[:, n:]
            moved += weights[stage] / 6 * slope
            moved_change += weights[stage] / 6 * slope_change
        x += h * moved
        whole += h * moved_change
    transition[:] = whole[:, :n]
    effect[:] = whole[:, n:]


@_kernel
def sensitivities(motion, start, inputs, states, by_start, by_coefficients):
    """States (t, n) with their changes by start (t, n, n) and by coefficients (t, n, n, terms).

    Of a motion whose polynomials give the next x, or of one Runge-Kutta step a sample, whose slope
    by the coefficients is taken at its middle (an approximation of a Gauss-Newton matrix, not of
    the motion).
    """
    n, m, count = len(start), inputs.shape[1], len(motion.parents)
    terms, slopes = np.empty(count), np.empty((count, n + m))
    value, gradient = np.empty(n), np.empty((n, n + m))
    transition, effect = np.empty((n, n)), np.empty((n, m))
    x = start.copy()
    states[0] = x
    by_start[0] = np.eye(n)
    by_coefficients[0] = 0.0
    for t in range(len(inputs) - 1):
        before = x.copy()
        linearise(motion, x, inputs[t], transition, effect)
        factor = 1.0
        if motion.substeps > 0:
            before = (before + x) / 2
            factor = motion.period
        add_gradient(motion, before, inputs[t], terms, slopes, value, gradient)
        states[t + 1] = x
        by_start[t + 1] = transition @ by_start[t]
        for i in range(n):
            for k in range(n):
                for j in range(count):
                    total = 0.0
                    for v in range(n):
                        total += transition[i, v] * by_coefficients[t, v, k, j]
                    by_coefficients[t + 1, i, k, j] = total
            for j in range(count):
                by_coefficients[t + 1, i, i, j] += factor * terms[j]
