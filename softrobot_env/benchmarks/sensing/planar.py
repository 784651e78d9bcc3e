"""The planar sensor between two servos (thesis sec. 4.1.2): constant and other curvature, noise.

Its three fibres are told their angles as the servos do: the middle one is straight.
"""

from dataclasses import replace
from typing import Any

import numpy as np

from softrobot_env.benchmarks.sensing.rows import Kind, Row
from softrobot_env.robots import Sensor
from softrobot_env.robots.sensors import USUAL
from softrobot_env.sensing.bank import SensorArray
from softrobot_env.sensing.calibration import AngleErrors, Range, fit
from softrobot_env.sensing.optics import POLYNOMIAL, SPAN, STRAIGHT

_LENGTH = 0.03
_SENSOR = Sensor(
    "planar", "planar", 0.0, _LENGTH, segments=3, hysteresis=USUAL["hysteresis"], specimen=1
)

#: Of what pictures show: samples and time [s] of beginnings, and points of a cloud.
_EARLY, _SHOWN, _POINTS = 1000, 60.0, 6000

#: Coefficients of Tab. 4.1, b_0 and on, by order.
PRINTED = {
    1: (58.8, -0.571),
    2: (58.5, -0.542, -2.9e-4),
    3: (60.1, -0.860, 8.45e-3, -5.9e-5),
    4: (59.8, -0.774, 3.93e-3, 1.48e-5, -3.74e-7),
    5: POLYNOMIAL,
}

#: Tab. 4.2, of order 5.
PRINTED_OTHER = (60.0, -0.711, 9.2e-3, -1.92e-4, 2.14e-6, -1.05e-8)

#: Errors [degrees] in the thesis, by order: mean, standard deviation, largest.
_ERRORS = {1: (1.19, 0.71, 3.3), 5: (0.34, 0.29, 1.7)}

_RATE, _SLOW_RATE = 50.0, 10.0  # Hz
_PERIOD, _PERIODS = 10.0, 25
_PERIOD_1, _PERIOD_2, _LASTS = 7.1, 97.7, 1800.0
_NEARLY = np.radians(1.0)


def rows(quick: bool = False) -> list[Row]:
    """Rows of Figs. 4.6 to 4.11 and Tabs. 4.1 and 4.2."""
    return [*_constant(quick), *_noise(quick), *_other(quick)]


def read(sensor: Sensor, angles: np.ndarray, rate: float, seed: int = 0) -> np.ndarray:
    """Readings (n,) of three fibres at angles (n, 2) [rad], from straight on, at a rate [Hz]."""
    third = sensor.end / 3
    bank = SensorArray([replace(sensor, rate=rate)], np.arange(4) * third, 1 / rate)
    strain = np.zeros((len(angles), 1, 3, 3))
    strain[:, 0, 0, 0], strain[:, 0, 2, 0] = (2 * angles / third).T
    bank.start(np.array([0]), [[sensor]], [seed], np.zeros((1, 3, 3)))
    out = np.empty(len(angles))
    for k, shape in enumerate(strain):
        bank.look(shape)
        out[k] = bank.reading[0, 0]
    return out


def _constant(quick: bool) -> list[Row]:
    periods = 5 if quick else _PERIODS
    time = np.arange(int(periods * _PERIOD * _RATE)) / _RATE
    each = np.radians(15) * (1 - np.cos(2 * np.pi * time / _PERIOD))
    light = read(_SENSOR, np.stack([each, each], axis=1), _RATE)
    relative = Range.of(light).relative(light)
    training = slice(0, int(_PERIOD * _RATE))
    total, out = 2 * each, []
    test = slice(training.stop, None)
    curves: dict[str, Any] = {
        "time": time[:_EARLY],
        "angle": np.degrees(total[:_EARLY]),
        "current": relative[:_EARLY],
        "cloud": (relative[::10], np.degrees(total[::10])),
        "fits": {},
    }
    for order, printed in PRINTED.items():
        found = fit(relative[training], total[training], order)
        errors = AngleErrors.of(found(relative[test]) - total[test])
        out += _errors(order, errors)
        at = np.linspace(0, 100, 101)
        there = np.degrees(found(at)) - np.polynomial.Polynomial(printed)(at)
        out.append(
            Row(
                "Tab. 4.1",
                f"order {order}: RMS from the thesis' polynomial",
                float(np.sqrt(np.mean(there**2))),
                "deg",
                "implied",
                note=_coefficients(found),
            )
        )
        curves["fits"][order] = np.degrees(found(at))
    out[0] = replace(out[0], curves=curves)
    return out


def _coefficients(found: np.polynomial.Polynomial) -> str:
    """In degrees by percent, b_0 and on."""
    values = np.degrees(found.convert().coef)
    return ", ".join(f"{value:.3g}" for value in values)


def _errors(order: int, errors: AngleErrors) -> list[Row]:
    names = ("mean error", "standard deviation", "largest error")
    printed = _ERRORS.get(order, (None,) * 3)
    return [
        Row(
            "Figs. 4.6, 4.7",
            f"order {order}: {name}",
            float(np.degrees(value)),
            "deg",
            _kind(order, name),
            thesis=thesis,
            note="by the hysteresis" if (order, name) == (5, "mean error") else "",
        )
        for name, value, thesis in zip(names, errors, printed, strict=True)
        if thesis is not None or name == "mean error"
    ]


def _kind(order: int, name: str) -> Kind:
    if order < 5:
        return "implied"
    return "fitted" if name == "mean error" else "check"


def _noise(quick: bool) -> list[Row]:
    count = int((60 if quick else 600) * _RATE)
    light = read(_SENSOR, np.zeros((count, 2)), _RATE)
    lsb = light.std() * STRAIGHT["planar"]
    slope = np.polynomial.Polynomial(POLYNOMIAL).deriv()(100.0)
    angle = abs(slope) * 100 * lsb / SPAN
    return [
        Row("4.1.2", "noise of a straight sensor", lsb, "LSB", "fitted", 1.4),
        Row("4.1.2", "the same as an angle", angle, "deg", "fitted", 0.09),
    ]


def _other(quick: bool) -> list[Row]:
    rate = _SLOW_RATE if quick else _RATE
    time = np.arange(int(_LASTS * rate)) / rate
    waves = [1 - np.cos(2 * np.pi * time / period) for period in (_PERIOD_1, _PERIOD_2)]
    angles = np.radians(15) * np.stack(waves, axis=1)
    light = read(_SENSOR, angles, rate)
    relative, total = Range.of(light).relative(light), angles.sum(axis=1)
    gap = np.abs(angles[:, 0] - angles[:, 1])
    near = gap <= _NEARLY
    found = fit(relative[near], total[near], 5)
    error = np.abs(np.degrees(found(relative) - total))
    early, some = time < _SHOWN, slice(None, None, max(1, len(time) // _POINTS))
    curves = {
        "time": time[early],
        "angles": np.degrees(angles[early]),
        "current": relative[early],
        "angle": np.degrees(total[early]),
        "estimate": np.degrees(found(relative[early])),
        "cloud": (np.degrees(angles[some]), relative[some], error[some]),
    }
    at = np.linspace(0, 100, 101)
    printed = np.polynomial.Polynomial(PRINTED_OTHER)(at)
    apart = np.degrees(found(at)) - printed
    between = np.sqrt(np.mean((np.polynomial.Polynomial(POLYNOMIAL)(at) - printed) ** 2))
    small, large = gap <= np.radians(10), gap > np.radians(20)
    share, high = float(np.mean(error[small] < 2)), float(error[large].max())
    where = "Figs. 4.8 to 4.11"
    return [
        Row(
            where,
            "mean error to 10 degrees difference",
            float(error[small].mean()),
            "deg",
            "check",
            note='thesis: "mostly below 2"',
            goal=2.0,
            curves=curves,
        ),
        Row(
            where,
            "share below 2 degrees, to 10 degrees difference",
            100 * share,
            "%",
            "fitted",
            note='by the dark level; thesis: "mostly"',
        ),
        Row(
            where,
            "largest error to 10 degrees difference",
            float(error[small].max()),
            "deg",
            "check",
        ),
        Row(
            where,
            "largest error beyond 20 degrees difference",
            high,
            "deg",
            "fitted",
            note="by the dark level; thesis: above 10",
        ),
        Row(
            where,
            "least difference with an error of 10 degrees",
            float(np.degrees(gap[error > 10].min())),
            "deg",
            "check",
            note="thesis: more than 20",
        ),
        Row(
            "Tab. 4.2",
            "RMS from the thesis' polynomial",
            float(np.sqrt(np.mean(apart**2))),
            "deg",
            "check",
            note=f"the thesis' two differ by {between:.2f}; {_coefficients(found)}",
        ),
    ]
