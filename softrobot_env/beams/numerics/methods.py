"""Time integration methods as coefficient sets."""

from math import sqrt
from typing import NamedTuple

import numpy as np

from softrobot_env.beams.numerics.compilation import structure
from softrobot_env.core.registry import Registry


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

    a: np.ndarray
    b: np.ndarray
    c: np.ndarray
    error: np.ndarray
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
