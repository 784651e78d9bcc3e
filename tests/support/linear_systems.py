"""Motion of linear systems, step by step."""

import numpy as np
from numpy import ndarray

#: Of nothing, over 400 steps.
FREE = np.zeros((400, 1))


def states(step: ndarray, start: ndarray, pushes: ndarray = FREE) -> ndarray:
    """States (k, n) before each of k steps of x -> step x + push, of pushes (k, n)."""
    x, found = start, []
    for push in pushes:
        found.append(x)
        x = step @ x + push
    return np.array(found)
