"""LU decomposition of band matrices, with partial pivoting (Golub and van Loan, sec. 4.3).

LAPACK's solver cannot be called from cached kernels. A matrix (n, n) with k diagonals to either
side of the main one is stored by rows, element (i, j) at [i, j - i + k] of an array
(n, 3 k + 1); the last k columns take the fill-in of the exchanged rows.
"""

import numpy as np
from numpy import ndarray

from softrobot_env.compile.kernels import kernel


@kernel
def factor(matrix, k, pivot):
    """Replace the matrix by its factors and set pivot (n,) int; False if it is singular."""
    n = matrix.shape[0]
    for j in range(n):
        low, high = min(n, j + k + 1), min(n, j + 2 * k + 1)
        best = j
        for i in range(j + 1, low):
            if abs(matrix[i, j - i + k]) > abs(matrix[best, j - best + k]):
                best = i
        pivot[j] = best
        if not abs(matrix[best, j - best + k]) > 0.0:  # also for nan
            return False
        if best != j:
            for c in range(j, high):
                here, there = c - j + k, c - best + k
                matrix[j, here], matrix[best, there] = matrix[best, there], matrix[j, here]
        for i in range(j + 1, low):
            ratio = matrix[i, j - i + k] / matrix[j, k]
            matrix[i, j - i + k] = ratio
            if ratio != 0.0:
                for c in range(j + 1, high):
                    matrix[i, c - i + k] -= ratio * matrix[j, c - j + k]
    return True


@kernel
def solve(matrix, k, pivot, x):
    """Solve in place for a right-hand side x (n,), given the factors."""
    n = matrix.shape[0]
    for j in range(n):
        if pivot[j] != j:
            x[j], x[pivot[j]] = x[pivot[j]], x[j]
        for i in range(j + 1, min(n, j + k + 1)):
            x[i] -= matrix[i, j - i + k] * x[j]
    for i in range(n - 1, -1, -1):
        total = x[i]
        for j in range(i + 1, min(n, i + 2 * k + 1)):
            total -= matrix[i, j - i + k] * x[j]
        x[i] = total / matrix[i, k]


def dense(matrix: ndarray) -> ndarray:
    """The matrices (..., n, n) that those laid out by rows (..., n, 3 k + 1) stand for."""
    *more, n, columns = matrix.shape
    k = (columns - 1) // 3
    out = np.zeros((*more, n, n))
    for off in range(-k, k + 1):
        rows = np.arange(max(0, -off), min(n, n - off))
        out[..., rows, rows + off] = matrix[..., rows, off + k]
    return out
