"""Sizes of errors (t, k, 3) [m] of k simulated markers; NaN where a coordinate is not known."""

import numpy as np
from numpy import ndarray


def mean_known(error: ndarray) -> ndarray:
    """Mean (k, 3) of errors over the rows where they are known; NaN without any."""
    known = ~np.isnan(error)
    count = known.sum(axis=0)
    total = np.where(known, error, 0.0).sum(axis=0)
    return np.where(count > 0, total / np.maximum(count, 1), np.nan)


def centred(error: ndarray) -> ndarray:
    """Errors less the mean of each marker."""
    return error - mean_known(error)


def distances(error: ndarray) -> ndarray:
    """(t, k) [m] over the coordinates that are known; NaN without any."""
    sizes = np.sqrt(np.nansum(error**2, axis=-1))
    return np.where(np.isnan(error).all(axis=-1), np.nan, sizes)


def size(error: ndarray) -> float:
    """RMS [m] of the distances that are known; zero without any."""
    known = ~np.isnan(error).all(axis=-1)
    return float(np.sqrt(np.nansum(error**2) / max(known.sum(), 1)))
