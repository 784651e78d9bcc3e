"""Three planar sensors in a finger of the gripper (thesis sec. 4.1.3), on shapes of grips.

No gripper is simulated: an enclosing grip lies on the object and a fingertip grip has its bend at
the tip. How they are approached, and how far, is assumed; see `_enclosing` and `_tip`.
"""

from dataclasses import dataclass

import numpy as np

from softrobot_env.benchmarks.sensing.rows import Row
from softrobot_env.robots import Sensor
from softrobot_env.sensing.bank import Bank
from softrobot_env.sensing.calibration import AngleErrors, Range, fit

#: [m], of the finger, of a sensor, and of the neutral fibre from the object (S).
_LENGTH, _PART, _FIBRE = 0.09, 0.03, 0.003

_CELLS = 90
_RATE, _STAGE = 50.0, 4.0  # Hz, s of closing, going over to the tip, opening
_DECAY, _SHARE = 0.015, 0.6  # m and 1 of a fingertip grip: its bend over that of an enclosing one
_CONTACT = 1.0  # N on a closed finger's sensors, 3 N at the tip

#: Diameter [m] of cylinders, and semi-axes [m] of the oval, that are gripped.
_CYLINDERS, _OVAL = (0.094, 0.060, 0.048), (0.020, 0.013)


@dataclass(frozen=True)
class _Finger:
    """Sensors and tags, and what the calibration has found of each sensor."""

    bank: Bank
    sensors: tuple[Sensor, ...]
    seed: int

    @classmethod
    def built(cls, specimen: int) -> "_Finger":
        ends = np.arange(4) * _PART
        fibres = [
            Sensor(f"fibre{k + 1}", "planar", ends[k], ends[k + 1]).erring(1.0, specimen)
            for k in range(3)
        ]
        sensors = (*fibres, Sensor("tags", "tags", 0.0, _LENGTH, segments=6))
        bank = Bank(sensors, np.linspace(0, _LENGTH, _CELLS + 1), 1 / _RATE)
        return cls(bank, sensors, specimen)

    def read(self, kappa: np.ndarray, touch: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Light (n, 3) and turns seen by tags (n, 3) [rad] at curvatures (n, cells) [1/m]."""
        strain = np.zeros((*kappa.shape, 3))
        strain[..., 0] = kappa
        still = np.zeros((1, _CELLS, 3))
        self.bank.start(np.array([0]), [self.sensors], [self.seed], still)
        out = np.empty((len(kappa), 9))
        for k, shape in enumerate(strain):
            self.bank.look(shape[None], touch=touch[k : k + 1])
            out[k] = self.bank.reading[0]
        return out[:, :3], out[:, 3:].reshape(-1, 3, 2).sum(axis=2)


def _middles() -> np.ndarray:
    return (np.arange(_CELLS) + 0.5) * _LENGTH / _CELLS


def _enclosing(what: float | tuple[float, float]) -> np.ndarray:
    """Curvature (cells,) [1/m] of a finger that lies on a cylinder or on the oval's flat side."""
    s = _middles()
    if not isinstance(what, tuple):
        return np.full(len(s), 1 / (what / 2 + _FIBRE))
    # An ellipse's curvature is a b / g^3, g = |(a cos t, b sin t)'|; a fibre beside it is longer.
    a, b = what
    t = np.linspace(0, 2 * np.pi, 4001)
    g = np.hypot(a * np.sin(t), b * np.cos(t))
    kappa = a * b / g**3
    along = np.concatenate([[0.0], np.cumsum(((g * (1 + _FIBRE * kappa))[1:]) * np.diff(t))])
    return np.interp(s + along[-1] / 8, along, kappa / (1 + _FIBRE * kappa), period=along[-1])


def _tip(closed: np.ndarray) -> np.ndarray:
    """Curvature (cells,) [1/m] after the bend has gone to the tip."""
    profile = np.exp((_middles() - _LENGTH) / _DECAY)
    return _SHARE * closed.mean() * profile / profile.mean()


def _series(
    closed: np.ndarray, kind: str, closings: int = 1
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Curvatures (n, cells), contact (n, 4) [N] and whether at the tip (n,), of a grip."""
    part = (1 - np.cos(np.linspace(0, np.pi, int(_STAGE * _RATE)))) / 2
    none, one = np.zeros_like(part), np.ones_like(part)
    if kind == "enclosing":
        close, over = np.concatenate([part, one, 1 - part]), np.zeros(3 * len(part))
    else:
        close = np.concatenate([part, one, one, one, 1 - part])
        over = np.concatenate([none, part, one, 1 - part, none])
    close, over = np.tile(close, closings), np.tile(over, closings)
    kappa = close[:, None] * ((1 - over)[:, None] * closed + over[:, None] * _tip(closed))
    held = _CONTACT * np.clip((close - 0.9) / 0.1, 0, 1)
    touch = held[:, None] * (1 + over[:, None] * [-1.0, -0.5, 2.0, -1.0])
    return kappa, touch, over > 0


def rows(quick: bool = False) -> list[Row]:
    """Rows of Figs. 4.15 to 4.18, of one finger, or of three where not quick."""
    specimens = (1,) if quick else (1, 2, 3)
    found = [_judge(specimen) for specimen in specimens]
    pooled = {key: np.concatenate([one[key].ravel() for one, _ in found]) for key in found[0][0]}
    enclosing = [k for k in pooled if k.startswith("enclosing")]
    tip = [k for k in pooled if k.startswith("fingertip")]
    out = []
    for keys, mean, deviation, figure in (
        (enclosing, 2.5, 1.8, "Fig. 4.16"),
        (tip, 4.4, 4.7, "Fig. 4.17"),
    ):
        errors = AngleErrors.of(np.concatenate([pooled[k] for k in keys]))
        name = keys[0].split()[0]
        out += [
            _row(figure, f"{name}: mean error of a sensor", errors.mean, mean),
            _row(figure, f"{name}: standard deviation", errors.deviation, deviation),
        ]
    for key, largest in zip(enclosing, (6, 6, 6, 10), strict=True):
        out.append(_row("Fig. 4.16", f"{key}: largest error", np.abs(pooled[key]).max(), largest))
    out[0] = Row(**vars(out[0]) | {"curves": found[0][1]})
    worst, curves = _reconstructed(found[0][1])
    out.append(
        Row(
            "Fig. 4.18",
            "48 mm: largest error of the tip, of the shape by three sensors",
            worst,
            "mm",
            "assumed",
            note="the thesis has a picture",
            curves=curves,
        )
    )
    return out


def _row(figure: str, quantity: str, value: float, thesis: float) -> Row:
    note = "no shear, no pressed section here" if "tip" in quantity else ""
    note = "bends beyond the calibration" if "oval" in quantity else note
    value = float(np.degrees(value))
    return Row(figure, quantity, value, "deg", "assumed", thesis, note=note)


def _judge(specimen: int) -> tuple[dict[str, np.ndarray], dict]:
    """Errors (n, 3) [rad] of sensors by the grip, and what is drawn."""
    finger = _Finger.built(specimen)
    closed = _enclosing(_CYLINDERS[-1])
    kappa, touch, at_tip = _series(closed, "fingertip")
    light, turns = finger.read(kappa, touch)
    ranges = [Range.of(x) for x in light.T]
    relative = np.stack([r.relative(x) for r, x in zip(ranges, light.T, strict=True)], axis=1)
    fits = [fit(i, a, 5) for i, a in zip(relative.T, turns.T, strict=True)]
    curves = {"relative": relative, "turns": np.degrees(turns), "at_tip": at_tip, "fits": fits}
    errors, series = {}, {}
    for what in (*_CYLINDERS, _OVAL):
        name = "oval" if isinstance(what, tuple) else f"{1e3 * what:g} mm"
        for kind in ("enclosing", "fingertip")[: 1 if name == "oval" else 2]:
            kappa, touch, _ = _series(_enclosing(what), kind)
            light, turns = finger.read(kappa, touch)
            scaled = [r.relative(x) for r, x in zip(ranges, light.T, strict=True)]
            seen = np.stack([f(x) for f, x in zip(fits, scaled, strict=True)], axis=1)
            errors[f"{kind} {name}"] = seen - turns
            series[f"{kind} {name}"] = seen, turns, kappa
    return errors, curves | {"series": series}


def _chain(kappa: np.ndarray, size: float) -> np.ndarray:
    """Points (n + 1, 2) [m] of arcs of some curvatures (n,) and one length [m]."""
    turn = np.concatenate([[0.0], np.cumsum(kappa * size)])
    middle = (turn[:-1] + turn[1:]) / 2
    chord = size * np.sinc(kappa * size / 2 / np.pi)
    steps = np.stack([np.sin(middle), np.cos(middle)], axis=1) * chord[:, None]
    return np.concatenate([np.zeros((1, 2)), np.cumsum(steps, axis=0)])


def _reconstructed(curves: dict) -> tuple[float, dict]:
    """Largest error [mm] of the tip, and shapes at some instants, of an enclosing 48 mm grip."""
    seen, _, kappa = curves["series"]["enclosing 48 mm"]
    fine, size = 10, _LENGTH / _CELLS
    shapes, worst = [], 0.0
    for k in range(len(seen)):
        estimate = _chain(np.repeat(seen[k] / _PART, fine), _PART / fine)
        true = _chain(kappa[k], size)
        worst = max(worst, float(np.linalg.norm(estimate[-1] - true[-1])))
        if k % 50 == 0 and k <= len(seen) // 3:
            shapes.append((1e3 * estimate, 1e3 * true))
    return 1e3 * worst, {"shapes": shapes}
