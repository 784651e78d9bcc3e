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
