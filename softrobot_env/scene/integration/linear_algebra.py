"""Small dense systems, compiled."""

from softrobot_env.compile.native import jit


@jit
def dot(a, b):
    """Scalar product of (n,) and (n,)."""
    total = 0.0
    for i in range(a.size):
        total += a[i] * b[i]
    return total


@jit
def factorize(matrix, n):
    """Factors L' D L of (n, n), of which the lower half is given, in its place, from the last row.

    L has ones on its diagonal, where the inverse of D is kept.
    """
    for i in range(n - 1, -1, -1):
        inverse = 1 / matrix[i, i]
        for j in range(i):
            share = matrix[i, j] * inverse
            for k in range(j + 1):
                matrix[j, k] -= share * matrix[i, k]
        for k in range(i):
            matrix[i, k] *= inverse
        matrix[i, i] = inverse


@jit
def substitute(factor, x, n):
    """x (n,) becomes the solution, by the factors of `factorize`."""
    for i in range(n - 1, -1, -1):
        for k in range(i):
            x[k] -= factor[i, k] * x[i]
    for i in range(n):
        rest = x[i] * factor[i, i]
        for k in range(i):
            rest -= factor[i, k] * x[k]
        x[i] = rest


@jit
def solve(matrix, x, n):
    """x (n,) becomes the solution for a matrix (n, n), which is lost; 0 where it is singular."""
    for i in range(n):
        best = i
        for k in range(i + 1, n):
            if abs(matrix[k, i]) > abs(matrix[best, i]):
                best = k
        if best != i:
            x[i], x[best] = x[best], x[i]
            for j in range(n):
                matrix[i, j], matrix[best, j] = matrix[best, j], matrix[i, j]
        if matrix[i, i] == 0:
            continue
        for k in range(i + 1, n):
            share = matrix[k, i] / matrix[i, i]
            if share != 0:
                for j in range(i + 1, n):
                    matrix[k, j] -= share * matrix[i, j]
                x[k] -= share * x[i]
    for i in range(n - 1, -1, -1):
        rest = x[i]
        for j in range(i + 1, n):
            rest -= matrix[i, j] * x[j]
        x[i] = rest / matrix[i, i] if matrix[i, i] != 0 else 0.0
