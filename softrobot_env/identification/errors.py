"""Sizes of errors (t, k, 3) [m] of k simulated markers; NaN where a coordinate is unknown."""

import numpy as np
from numpy import ndarray


def mean_known(error: ndarray) -> ndarray:
    """Mean (k, 3) of the known errors; NaN without any."""
    known = ~np.isnan(error)
    count = known.sum(axis=0)
    total = np.where(known, error, 0.0).sum(axis=0)
    return np.where(count > 0, total / np.maximum(count, 1), np.nan)


def centred(error: ndarray) -> ndarray:
    """Errors minus the mean of each marker."""
    return error - mean_known(error)


def distances(error: ndarray) -> ndarray:
    """(t, k) [m] over the known coordinates; NaN without any."""
    sizes = np.sqrt(np.nansum(error**2, axis=-1))
    return np.where(np.isnan(error).all(axis=-1), np.nan, sizes)


def size(error: ndarray) -> float:
    """RMS [m] of the known distances; zero without any."""
    known = ~np.isnan(error).all(axis=-1)
    return float(np.sqrt(np.nansum(error**2) / max(known.sum(), 1)))
