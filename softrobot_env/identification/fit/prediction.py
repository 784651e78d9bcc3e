"""Expected errors of an identified robot in an unseen recording, and where they are known.

Rows of a block are correlated, and model errors differ between commands. So an interval is derived
from whole blocks left out of the fit, including offsets and drift between them. Variances grow with
the distance of a command from the identified ones, and are larger at the beginning of a recording,
where friction leaves the position undetermined; both parts are fitted to the blocks. A block's
scores are its errors over the expected ones, and the interval takes their quantile (split conformal
prediction, Lei et al., J. Am. Stat. Assoc. 113, 2018), wider by Student's t as the blocks are few.
Half of the expected error is from the variances of the other blocks: those of all blocks include
the block itself, and without a block that sticks for long the others expect too little.
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy import ndarray
from scipy.optimize import nnls
from scipy.spatial import KDTree
from scipy.stats import t as student_t

from softrobot_env.core.artifacts import read_arrays, write_arrays
from softrobot_env.recordings import Recording
from softrobot_env.robots import RobotParams

from ..errors import distances
from .least_squares import NORMAL_95
from .validation import fitted_without

#: Share of an unseen recording's rows that an interval should contain.
LEVEL = 0.95

#: Name of the file beside an identified robot's.
PREDICTION_FILE = "prediction.npz"

_ROUNDS = 10
_LEAST = 0.01  # of the mean square, below which no row's variance is
_SLIGHT = 0.01  # of a tendon's identified range, by which it must be left to be reported


@dataclass(frozen=True)
class Judgement:
    """A replay compared with its expected errors.

    Attributes:
        least, largest: [m], half widths of the 95 % intervals.
        held: Share of the markers within them.
        beyond: Share of the rows whose commands are farther from the identified ones than tested.
        away: Largest distance of a command, over the tested one.
        over: Tendon -> share of its identified range by which commands exceeded it.
    """

    least: float
    largest: float
    held: float
    beyond: float
    away: float
    over: dict[str, float]

    def __str__(self) -> str:
        lines = [
            f"95 % interval by the identification: {1e3 * self.least:.3g} to "
            f"{1e3 * self.largest:.3g} mm from where a marker is simulated; it holds "
            f"{self.held:.0%}"
        ]
        if self.beyond:
            lines.append(
                f"{self.beyond:.0%} of the rows leave the identified range, commanded up to "
                f"{self.away:.3g} times as far from it as was tested: their interval is a guess"
            )
        if self.over:
            more = ", ".join(f"{name} by {share:.0%}" for name, share in self.over.items())
            lines.append(f"commanded beyond the identified range: {more}")
        return "\n".join(lines)


@dataclass(frozen=True)
class Prediction:
    """Expected errors of a recording at rest.

    Attributes:
        parts: (k, 3) [m], half width of the 95 % interval of a marker's distance, as three parts
            that add up by squares: at identified commands; per distance from them; and at the
            beginning of a run, decreasing with the travel of the commands since.
        factor: (k,) by which the interval is widened because blocks are few.
        controls: (n, n_tendons) [N] or [m], the identified ones.
        scale: [N] or [m], unit of their distances: the largest standard deviation of a tendon's.
        by_length: Whether they are lengths, 0 or 1.
        tested: Largest distance of a left-out block's command from those of all others.
    """

    parts: ndarray
    factor: ndarray
    controls: ndarray
    scale: float
    by_length: int
    tested: float

    def away(self, controls: ndarray) -> ndarray:
        """(t,) distance [1] of controls (t, n_tendons) from the nearest identified ones."""
        return KDTree(self.controls / self.scale).query(controls / self.scale)[0]

    def radius(self, controls: ndarray, begins: ndarray) -> ndarray:
        """(t, k) [m], distance within which 95 % of an unseen recording's markers lie.

        Args:
            controls: (t, n_tendons).
            begins: (t,) bool, where runs begin.
        """
        since = _since(controls / self.scale, begins)
        return np.sqrt(_features(self.away(controls), since) @ self.parts.T**2)

    def judged(
        self, robot: RobotParams, recording: Recording, distance: ndarray
    ) -> "Judgement | None":
        """Whether a replay of rows at rest is as expected; None for another kind of drive.

        Args:
            robot: The identified robot.
            recording: The replayed recording.
            distance: (t, k) [m] of simulated and recorded markers; NaN where unknown.
        """
        if recording.drive(robot) != ("length" if self.by_length else "tension"):
            return None
        controls, known = recording.controls(robot), np.isfinite(distance)
        radius, away = self.radius(controls, recording.begins), self.away(controls) / self.tested
        low, high = self.controls.min(axis=0), self.controls.max(axis=0)
        over = np.maximum(low - controls, controls - high).max(axis=0)
        share = over / np.maximum(high - low, 1e-3 * self.scale)
        named = zip(robot.tendon_names, share.tolist(), strict=True)
        return Judgement(
            float(radius.min()),
            float(radius.max()),
            float(np.mean((distance <= radius)[known])) if known.any() else 0.0,
            float(np.mean(away > 1 + 1e-9)),
            float(away.max()),
            {name: part for name, part in named if part > _SLIGHT},
        )

    def save(self, path: Path) -> None:
        """Write the arrays; no code is in the file."""
        write_arrays(path, {name: np.asarray(value) for name, value in vars(self).items()})


def read_prediction(path: Path) -> Prediction:
    """The prediction in a file.

    Raises:
        ValueError: The file is damaged or not of this kind.
        OSError: It cannot be read.
    """
    arrays = read_arrays(path)
    arrays.check_finite()
    shapes = {"parts": (None, 3), "factor": (None,), "controls": (None, None)}
    shapes |= dict.fromkeys(("scale", "by_length", "tested"), ())
    arrays.check_shapes(shapes)
    if not (arrays["scale"] > 0 and arrays["tested"] > 0):
        raise ValueError(f"{path}: scale and tested must be positive")
    return Prediction(
        **{n: arrays[n] if shape else float(arrays[n]) for n, shape in shapes.items()}
    )


def predicted(controls: ndarray, by_length: bool, error: ndarray, blocks: ndarray) -> Prediction:
    """Compute intervals.

    Args:
        controls: (t, n_tendons) [N] or [m].
        by_length: Whether they are lengths.
        error: (t, k, 3) [m] of each row, with its block left out; NaN where unknown.
        blocks: (t,) number of the block.
    """
    scale = max(float(controls.std(axis=0).max()), 1e-12)
    away = np.zeros(len(controls))
    for block in np.unique(blocks) if blocks.any() else ():
        held = blocks == block
        rest = KDTree(controls[fitted_without(blocks, block)] / scale)
        away[held] = rest.query(controls[held] / scale)[0]
    edges = np.append(True, blocks[1:] != blocks[:-1])
    features = _features(away, _since(controls / scale, edges))
    found = [_interval(size, features, blocks) for size in distances(error).T]
    parts, factor = (np.array(part) for part in zip(*found, strict=True))
    tested = max(float(away.max()), 1e-12)
    controls = np.unique(controls, axis=0)
    return Prediction(parts, factor, controls, scale, int(by_length), tested)


def _since(controls: ndarray, begins: ndarray) -> ndarray:
    """(t,) travel of controls (t, n_tendons) since the run began."""
    way = np.cumsum(np.linalg.norm(np.diff(controls, axis=0, prepend=controls[:1]), axis=1))
    return way - way[np.maximum.accumulate(np.where(begins, np.arange(len(way)), 0))]


def _features(away: ndarray, since: ndarray) -> ndarray:
    """(t, 3) factors of the parts of a variance."""
    return np.stack([np.ones_like(away), away**2, np.exp(-since)], axis=1)


def _interval(distance: ndarray, features: ndarray, blocks: ndarray) -> tuple[ndarray, float]:
    """Parts (3,) of the half width of one marker, and factor for few blocks."""
    seen = np.isfinite(distance)
    if not seen.any():
        return np.zeros(3), 1.0
    distance, features, blocks = distance[seen], features[seen], blocks[seen]
    variance, scores = _variance(features, distance**2), np.empty_like(distance)
    expected = features @ variance
    for block in np.unique(blocks):
        held = blocks == block
        others = held if held.all() else ~held
        elsewhere = features[held] @ _variance(features[others], distance[others] ** 2)
        scores[held] = distance[held] / np.sqrt((expected[held] + elsewhere) / 2 + 1e-30)
    squares = distance**2 / np.maximum(expected, 1e-30)
    factor = _few(np.array([np.mean(squares[blocks == b]) for b in np.unique(blocks)]))
    return factor * float(np.quantile(scores, LEVEL)) * np.sqrt(variance), factor


def _variance(features: ndarray, squares: ndarray) -> ndarray:
    """Likeliest parts (3,) of a variance, for squares (t,) of normal numbers; not negative.

    Iteratively reweighted least squares.
    """
    expected = np.full(len(squares), max(float(squares.mean()), 1e-30))
    for _ in range(_ROUNDS):
        parts, _ = nnls(features / expected[:, None], squares / expected)
        expected = np.maximum(features @ parts, _LEAST * squares.mean() + 1e-30)
    parts[0] = max(parts[0], _LEAST * float(squares.mean()))
    return parts


def _few(means: ndarray) -> float:
    """Student's t over the normal quantile, for a mean square of blocks' mean squares (b,).

    Its degrees of freedom are Satterthwaite's (Biometrics Bulletin 2, 1946): those by which the
    mean of the blocks scatters, one at least.
    """
    count, tail = len(means), (1 + LEVEL) / 2
    if count < 2:
        return float(student_t.ppf(tail, 1)) / NORMAL_95
    scatter = float(np.var(means, ddof=1)) / count
    freedom = 2 * float(means.mean()) ** 2 / max(scatter, 1e-300)
    return float(student_t.ppf(tail, max(freedom, 1.0))) / NORMAL_95
