"""Reasons, as codes that kernels return, why an action is not the one wanted."""

from typing import NamedTuple

import numpy as np

FINE, SATURATED, UNREACHABLE, OUTSIDE, NOT_FINITE, NOT_COMPUTED = range(6)

#: What the codes mean, for people.
REASONS = {
    FINE: None,
    SATURATED: "tension limit reached",
    UNREACHABLE: "reference out of reach",
    OUTSIDE: "outside the gain table",
    NOT_FINITE: "observation not finite",
    NOT_COMPUTED: "computation not finite",
}


class Memory(NamedTuple):
    """State of a policy whose work is done in a kernel.

    Attributes:
        values: (k,), what the kernel remembers.
        code: Key of `REASONS`.
    """

    values: np.ndarray
    code: int

    @property
    def status(self) -> str | None:
        """Why the action is not the one wanted, or None."""
        return REASONS[self.code]


class Said(NamedTuple):
    """State of a policy that remembers nothing: what is to be said of its last action.

    Attributes:
        status: Why the action is not the one wanted, or None.
    """

    status: str | None
