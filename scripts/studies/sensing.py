"""Curvature sensors as chapter 4 of the thesis judges them, and a better estimate of the tip.

The planar sensor, three of them in a finger, and the spatial one in the rig.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy import ndarray
from scipy.interpolate import LinearNDInterpolator

from softrobot_env.control.gripper import LIFTED
from softrobot_env.envs.simulation.grippers import shares
from softrobot_env.evaluation.models.runs import unwarned
from softrobot_env.learned.network import Dataset, Network
from softrobot_env.learned.training import train_regularised
from softrobot_env.rendering import figures
from softrobot_env.robots import RIG, WORKSPACE, Sensor
from softrobot_env.robots.sensors import USUAL
from softrobot_env.robots.twin import CAMERA_NOISE, rig3d_twin
from softrobot_env.scene.assembly import FINENESS, build_assembly, felt_by, gripper_scene
from softrobot_env.scene.build import build_scene
from softrobot_env.scene.chain import station_strain
from softrobot_env.scene.contacts import links_of
from softrobot_env.scene.registry import RIG_PIECES, scene_of
from softrobot_env.scene.simulation import Simulation
from softrobot_env.scene.statics import equilibrium
from softrobot_env.sensing.array import SensorArray
from softrobot_env.sensing.calibration import AngleErrors, Calibration, Range, fit
from softrobot_env.sensing.estimation import BendFilter, calibrate
from softrobot_env.sensing.optics import POLYNOMIAL, SPAN, STRAIGHT
from studies.gripper import GRIPPER, things
from studies.lab import Column, Record, Study, for_pictures, quantity, table, verdict

#: Whether a number of the model was chosen so that the row comes out; it follows from the thesis'
#: polynomial of order 5, which the model has; it tests the model with numbers chosen elsewhere; or
#: it stands on a finger or on sizes of imperfections that were assumed.
Kind = Literal["fitted", "implied", "check", "assumed"]


@dataclass(frozen=True)
class Row(Record):
    """A quantity.

    Attributes:
        figure: Of the thesis, or "" beyond it.
        quantity: What it is.
        value: In SI; angles in degrees where `unit` says so.
        unit: Of value and thesis.
        kind: See `Kind`.
        thesis: The printed number, None where there is none.
        goal: Upper bound, None where there is none.
        note: What to know about it.
        curves: What the figure shows, by name.
    """

    figure: str
    quantity: str
    value: float = quantity("", ".3g", "here")
    unit: str
    kind: Kind
    thesis: float | None = quantity("", ".3g", default=None)
    goal: float | None = quantity("", ".3g", default=None)
    note: str = ""
    curves: dict[str, Any] | None = for_pictures()

    @property
    def met(self) -> bool | None:
        """Whether it is within its goal; None without one."""
        return None if self.goal is None else self.value <= self.goal


# -------------------- the planar sensor between two servos (thesis sec. 4.1.2)
#
# Its three fibres are given their angles as by the servos: the middle one is straight.

_LENGTH = 0.03
PLANAR = Sensor(
    "planar", "planar", 0.0, _LENGTH, segments=3, hysteresis=USUAL["hysteresis"], specimen=1
)

#: Of what pictures show: samples and time [s] of beginnings, and points of a cloud.
_EARLY, _SHOWN, _CLOUD = 1000, 60.0, 6000

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


def planar_rows(quick: bool = False) -> list[Row]:
    """Rows of Figs. 4.6 to 4.11 and Tabs. 4.1 and 4.2."""
    return [*_constant(quick), *_noise(quick), *_other_rows(quick)]


def read(sensor: Sensor, angles: ndarray, rate: float, seed: int = 0) -> ndarray:
    """Readings (n,) of three fibres at angles (n, 2) [rad], from straight on, at a rate [Hz]."""
    third = sensor.end / 3
    strain = np.zeros((len(angles), 3, 3))
    strain[:, 0, 0], strain[:, 2, 0] = (2 * angles / third).T
    sensors = [replace(sensor, rate=rate)]
    return readings(sensors, np.arange(4) * third, 1 / rate, seed, strain)[:, 0]


def readings(
    sensors: Sequence[Sensor],
    edges: ndarray,
    period: float,
    seed: int,
    strain: ndarray,
    touch: ndarray | None = None,
) -> ndarray:
    """Readings (n, fibres) of sensors that were straight before.

    Args:
        sensors: The sensors.
        edges: (cells + 1,) [m].
        period: [s] from one shape to the next.
        seed: Of the noise.
        strain: (n, cells, 3) [1/m], see `sensing.shape`.
        touch: (n, sensors) [N], if any.
    """
    array = SensorArray(sensors, edges, period)
    array.start(np.array([0]), [sensors], [seed], np.zeros((1, *strain.shape[1:])))
    out = np.empty((len(strain), array.size))
    for k, row in enumerate(out):
        array.look(strain[k : k + 1], touch=None if touch is None else touch[k : k + 1])
        row[:] = array.reading[0]
    return out


def _deg_row(figure: str, quantity: str, radians: float, kind: Kind, **others: Any) -> Row:
    return Row(figure, quantity, float(np.degrees(radians)), "deg", kind, **others)


def _constant(quick: bool) -> list[Row]:
    time = np.arange(int((5 if quick else _PERIODS) * _PERIOD * _RATE)) / _RATE
    each = np.radians(15) * (1 - np.cos(2 * np.pi * time / _PERIOD))
    light = read(PLANAR, np.stack([each, each], axis=1), _RATE)
    relative, total, at = Range.of(light).relative(light), 2 * each, np.linspace(0, 100, 101)
    training, test = (slice(int(_PERIOD * _RATE)), slice(int(_PERIOD * _RATE), None))
    out, fits = [], {}
    for order, printed in PRINTED.items():
        found = fit(relative[training], total[training], order)
        out += _errors(order, AngleErrors.of(found(relative[test]) - total[test]))
        fits[order] = np.degrees(found(at))
        there = fits[order] - np.polynomial.Polynomial(printed)(at)
        what, rms = f"order {order}: RMS from the thesis' polynomial", np.sqrt(np.mean(there**2))
        out.append(Row("Tab. 4.1", what, float(rms), "deg", "implied", note=_coefficients(found)))
    curves: dict[str, Any] = {
        "time": time[:_EARLY],
        "angle": np.degrees(total[:_EARLY]),
        "current": relative[:_EARLY],
        "cloud": (relative[::10], np.degrees(total[::10])),
        "fits": fits,
    }
    return [replace(out[0], curves=curves), *out[1:]]


def _coefficients(found: np.polynomial.Polynomial) -> str:
    """In degrees by percent, b_0 and on."""
    values = np.degrees(found.convert().coef)
    return ", ".join(f"{value:.3g}" for value in values)


def _errors(order: int, errors: AngleErrors) -> list[Row]:
    names, out = ("mean error", "standard deviation", "largest error"), []
    for name, value, thesis in zip(names, errors, _ERRORS.get(order, (None,) * 3), strict=True):
        first = name == "mean error"
        if thesis is not None or first:
            kind = "implied" if order < 5 else "fitted" if first else "check"
            note = "by the hysteresis" if order == 5 and first else ""
            what = f"order {order}: {name}"
            out.append(_deg_row("Figs. 4.6, 4.7", what, value, kind, thesis=thesis, note=note))
    return out


def _noise(quick: bool) -> list[Row]:
    count = int((60 if quick else 600) * _RATE)
    light = read(PLANAR, np.zeros((count, 2)), _RATE)
    lsb = light.std() * STRAIGHT["planar"]
    slope = np.polynomial.Polynomial(POLYNOMIAL).deriv()(100.0)
    angle = abs(slope) * 100 * lsb / SPAN
    return [
        Row("4.1.2", "noise of a straight sensor", lsb, "LSB", "fitted", 1.4),
        Row("4.1.2", "the same as an angle", angle, "deg", "fitted", 0.09),
    ]


def _other_rows(quick: bool) -> list[Row]:
    rate = _SLOW_RATE if quick else _RATE
    time = np.arange(int(_LASTS * rate)) / rate
    waves = [1 - np.cos(2 * np.pi * time / period) for period in (_PERIOD_1, _PERIOD_2)]
    angles = np.radians(15) * np.stack(waves, axis=1)
    light = read(PLANAR, angles, rate)
    relative, total = Range.of(light).relative(light), angles.sum(axis=1)
    gap = np.abs(angles[:, 0] - angles[:, 1])
    found = fit(relative[gap <= _NEARLY], total[gap <= _NEARLY], 5)
    error = np.abs(np.degrees(found(relative) - total))
    early, some = time < _SHOWN, slice(None, None, max(1, len(time) // _CLOUD))
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
    between = np.sqrt(np.mean((np.polynomial.Polynomial(POLYNOMIAL)(at) - printed) ** 2))
    small, large = error[gap <= np.radians(10)], error[gap > np.radians(20)]
    rms = float(np.sqrt(np.mean((np.degrees(found(at)) - printed) ** 2)))
    share, least = 100 * float(np.mean(small < 2)), float(np.degrees(gap[error > 10].min()))
    both = f"the thesis' two differ by {between:.2f}; {_coefficients(found)}"
    where = "Figs. 4.8 to 4.11"
    alike, apart = "to 10 degrees difference", "beyond 20 degrees difference"
    rows = [
        Row(where, f"mean error {alike}", float(small.mean()), "deg", "check", note=_MOSTLY),
        Row(where, f"share below 2 degrees, {alike}", share, "%", "fitted", note=_MUCH),
        Row(where, f"largest error {alike}", float(small.max()), "deg", "check"),
        Row(where, f"largest error {apart}", float(large.max()), "deg", "fitted", note=_ABOVE),
        Row(where, _LEAST, least, "deg", "check", note="thesis: more than 20"),
        Row("Tab. 4.2", "RMS from the thesis' polynomial", rms, "deg", "check", note=both),
    ]
    return [replace(rows[0], goal=2.0, curves=curves), *rows[1:]]


_LEAST = "least difference with an error of 10 degrees"
_MOSTLY = 'thesis: "mostly below 2"'
_MUCH, _ABOVE = 'by the dark level; thesis: "mostly"', "by the dark level; thesis: above 10"


# -------------------- three planar sensors in a finger, in simulated grips (thesis sec. 4.1.3)
#
# One finger closes on clamped things, slowly; what its sensors and tags read is calibrated on the
# smallest cylinder and judged on the others, as in the thesis.

_ROBOT = GRIPPER.fingers[1].robot
_CLOSING, _HELD = 2.0, 1.0  # s of closing, as long for opening, and between

#: Pieces and timestep [s] of the finger: 0.2 degrees off the rule's (`benchmark gripper`).
_PIECES, _TIMESTEP = 12, 5e-4

#: [s], in which the finger is lifted before a grip.
_LIFTING = 1.0

#: [N], tensions that enclose each thing, see `benchmark gripper`; and that of fingertip grips.
_ENCLOSE = {"94 mm": 12.0, "60 mm": 20.0, "48 mm": 26.0, "oval": 38.0}
_TIP = 38.0

#: What the sensors are calibrated on.
_SMALL = "48 mm"


@dataclass(frozen=True)
class _Grip:
    """A finger that closes and opens, one row each control period.

    Attributes:
        strain: (n, cells, 3) [1/m], see `sensing.shape`.
        touch: (n, sensors) [N].
        edges: (cells + 1,) [m].
        tension: (n,) [N].
    """

    strain: ndarray
    touch: ndarray
    edges: ndarray
    tension: ndarray


def _gripped(name: str, tension: float) -> _Grip:
    """The middle finger grips a thing alone, which is clamped."""
    alone, thing = replace(GRIPPER, fingers=GRIPPER.fingers[1:2]), things()[name][0]
    fine = {"contacts": FINENESS["quick"].contacts, "pieces": _PIECES, "timestep": _TIMESTEP}
    own = {"control_period": 1 / _RATE, "felt_along": True}
    with unwarned():
        built = build_assembly(gripper_scene(alone, (thing,), **fine, **own))
    (part,) = built.parts.values()
    links = links_of(built.model)
    first = np.array([built.model.sensor(felt_by(geom)).adr[0] for geom in links])
    rise = (1 - np.cos(np.pi * np.arange(1, _CLOSING * _RATE + 1) / (_CLOSING * _RATE))) / 2
    rise = np.concatenate([rise, np.ones(int(_HELD * _RATE)), rise[::-1]])
    pull = LIFTED + (tension - LIFTED) * rise
    simulation, postures, forces = Simulation(built), [], []
    simulation.reset(built.model.qpos0, np.full(built.n_inputs, LIFTED))
    for _ in range(int(_LIFTING * _RATE)):
        simulation.advance()
    for level in pull:
        simulation.ctrl[:] = level
        if not simulation.advance():
            raise RuntimeError(simulation.failure())
        postures.append(part.posture(simulation.posture).copy())
        felt = simulation.data.sensordata[first[:, None] + np.arange(3)]
        forces.append(np.linalg.norm(felt, axis=1))
    own, layout = part.scene.model, part.scene.layout
    return _Grip(
        station_strain(own, layout, np.stack(postures)),
        np.stack(forces) @ shares(np.array(list(links.values())), _ROBOT.sensors),
        np.concatenate([[0.0], np.cumsum(layout.weights)]),
        pull,
    )


def _finger_read(grip: _Grip, specimen: int) -> tuple[ndarray, ndarray]:
    """Light (n, 3) and turns seen by tags (n, 3) [rad] of a specimen in a grip."""
    sensors = tuple(sensor.with_imperfections(1.0, specimen) for sensor in _ROBOT.sensors)
    out = readings(sensors, grip.edges, 1 / _RATE, specimen, grip.strain, grip.touch)
    return out[:, :3], out[:, 3:].reshape(len(out), 3, -1).sum(axis=2)


def finger_rows(quick: bool = False) -> list[Row]:
    """Rows of Figs. 4.15 to 4.18, of three fingers; quickly of one that grips the smallest."""
    things_ = (_SMALL,) if quick else tuple(_ENCLOSE)
    grips = {f"enclosing {name}": _gripped(name, _ENCLOSE[name]) for name in things_}
    grips |= {f"fingertip {name}": _gripped(name, _TIP) for name in things_ if name != "oval"}
    found = [_judge_finger(specimen, grips) for specimen in ((1,) if quick else (1, 2, 3))]
    pooled = {key: np.concatenate([one[key].ravel() for one, _ in found]) for key in found[0][0]}
    enclosing = [k for k in pooled if k.startswith("enclosing")]
    tip = [k for k in pooled if k.startswith("fingertip")]

    def row(figure: str, quantity: str, value: float, thesis: float | None) -> Row:
        note = "no shear, no pressed section here" if "tip" in quantity else ""
        note = "bends by 93 degrees, calibrated to 60" if "oval" in quantity else note
        return _deg_row(figure, quantity, value, "assumed", thesis=thesis, note=note)

    out = []
    for name, keys, mean, deviation, figure in (
        ("enclosing", enclosing, 2.5, 1.8, "Fig. 4.16"),
        ("enclosing, round", [k for k in enclosing if "oval" not in k], None, None, "Fig. 4.16"),
        ("fingertip", tip, 4.4, 4.7, "Fig. 4.17"),
    ):
        errors = AngleErrors.of(np.concatenate([pooled[k] for k in keys]))
        out.append(row(figure, f"{name}: mean error of a sensor", errors.mean, mean))
        out.append(row(figure, f"{name}: standard deviation", errors.deviation, deviation))
    for key in enclosing:
        largest = 10 if "oval" in key else 6
        out.append(row("Fig. 4.16", f"{key}: largest error", np.abs(pooled[key]).max(), largest))
    shown = found[0][1]
    series = {name: pair[:2] for name, pair in shown["series"].items()}
    out[0] = replace(out[0], curves=shown | {"series": series})
    worst, shapes = _reconstructed(shown)
    what = "48 mm: largest error of the tip, of the shape by three sensors"
    note = "the thesis has a picture"
    return [*out, Row("Fig. 4.18", what, worst, "mm", "assumed", note=note, curves=shapes)]


def _judge_finger(specimen: int, grips: dict[str, _Grip]) -> tuple[dict[str, ndarray], dict]:
    """Errors (n, 3) [rad] of sensors by the grip, and what is drawn."""
    whole = grips[f"fingertip {_SMALL}"]
    light, turns = _finger_read(whole, specimen)
    known = Calibration.fitted(light, turns)
    span = known.high - known.low
    at = known.low + np.linspace(0, 1, 101)[:, None] * span
    curves = {
        "relative": 100 * (light - known.low) / span,
        "turns": np.degrees(turns),
        "at_tip": whole.tension > _ENCLOSE[_SMALL],
        "fits": np.degrees(known(at)),
    }
    series = {}
    for name, grip in grips.items():
        light, turns = _finger_read(grip, specimen)
        series[name] = known(light), turns, grip
    errors = {name: seen - turns for name, (seen, turns, _) in series.items()}
    return errors, curves | {"series": series}


def _chain(kappa: ndarray, size: ndarray) -> ndarray:
    """Points (n + 1, 2) [m] of arcs of some curvatures (n,) and lengths (n,) [m]."""
    turn = np.concatenate([[0.0], np.cumsum(kappa * size)])
    middle = (turn[:-1] + turn[1:]) / 2
    chord = size * np.sinc(kappa * size / 2 / np.pi)
    steps = np.stack([np.sin(middle), np.cos(middle)], axis=1) * chord[:, None]
    return np.concatenate([np.zeros((1, 2)), np.cumsum(steps, axis=0)])


def _reconstructed(curves: dict) -> tuple[float, dict]:
    """Largest error [mm] of the tip, and shapes at some instants, of an enclosing 48 mm grip."""
    seen, _, grip = curves["series"][f"enclosing {_SMALL}"]
    fine, size = 10, np.diff(grip.edges)
    part = _ROBOT.length / seen.shape[1]
    shapes, worst = [], 0.0
    closed = int(_CLOSING * _RATE)
    for k in range(len(seen)):
        pieces = np.full(fine * seen.shape[1], part / fine)
        estimate = _chain(np.repeat(seen[k] / part, fine), pieces)
        true = _chain(grip.strain[k, :, 0], size)
        worst = max(worst, float(np.linalg.norm(estimate[-1] - true[-1])))
        if k <= closed and k % (closed // 4) == 0:
            shapes.append((1e3 * estimate, 1e3 * true))
    return 1e3 * worst, {"shapes": shapes}


# -------------------- the spatial sensor in the rig (thesis sec. 4.2.2)
#
# Five rigs as built (`twin.rig3d_twin`), each with its own specimen of the sensor, go to 350 points
# spread evenly over the workspace and rest there; 70 % of them train. Then each follows a slow
# circle of 120 mm four times. Hysteresis, drift and warming up are on.

SPECIMENS, QUICK_SPECIMENS = (1, 2, 3, 4, 5), (1, 2)

#: Points of the thesis, share that trains, and hidden layers.
_POINTS, _TRAINING, _HIDDEN = 350, 0.7, (15, 15)

_RADIUS, _LAPS, _PER_LAP = 0.120, 4, 60
_MOST = 0.03  # m, that tendons are pulled in
_NO_DRIFT = 1e-6  # 1
_PAUSE = 5.0  # s from one point to the next

#: Goal [m] of the better estimate.
GOAL = 1.5e-3

#: Noise of each sample, as the audit says; and larger imperfections, the last to come to the
#: thesis' 4.6 mm.
_FLICKER, _SCALES = 0.015, (1.0, 2.0, 3.0)


class _Visit(NamedTuple):
    """Postures of a rig at rest, points first, then the straight pose and the circles."""

    tips: ndarray  # (n, 2) [m]
    shapes: ndarray  # (n, cells, 3) [1/m]
    edges: ndarray
    sensor: Sensor


@dataclass(frozen=True)
class _Found:
    """Squared errors [m2] of tips by what estimates them, and what is drawn."""

    squares: dict[str, ndarray]
    curves: dict


@cache
def _visit(specimen: int) -> _Visit:
    robot = rig3d_twin(specimen).robot
    scene = build_scene(replace(scene_of(robot), pieces=RIG_PIECES, control_period=0.02))
    rng = np.random.default_rng(specimen + 100)

    def rest(lengths: ndarray) -> tuple[ndarray, ndarray]:
        q = equilibrium(scene.model, lengths)
        return scene.tip(q)[:2], station_strain(scene.model, scene.layout, q[None])[0]

    inputs = _lengths(*np.meshgrid(np.linspace(0, _MOST, 13), np.linspace(0, 2 * np.pi, 37)[:-1]))
    found = LinearNDInterpolator([rest(lengths)[0] for lengths in inputs], inputs)
    way = [(WORKSPACE * np.sqrt(rng.uniform()), rng.uniform(0, 2 * np.pi)) for _ in range(_POINTS)]
    circle = [(_RADIUS, 2 * np.pi * k / _PER_LAP) for k in range(_PER_LAP)] * _LAPS
    every = [
        rest(np.zeros(3) if r == 0 else found(r * np.cos(a), r * np.sin(a)))
        for r, a in [*way, (0.0, 0.0), *circle]
    ]
    tips, shapes = map(np.array, zip(*every, strict=True))
    edges = np.append(0.0, np.cumsum(scene.layout.weights))
    return _Visit(tips, shapes, edges, robot.sensors[0])


def _lengths(most: ndarray, azimuth: ndarray) -> ndarray:
    """Lengths (n, 3) [m] pulled in towards azimuths [rad], the largest of each `most`."""
    towards = np.cos(azimuth.ravel()[:, None] - 2 * np.pi / 3 * np.arange(3))
    lengths = most.ravel()[:, None] * towards / towards.max(axis=1, keepdims=True)
    return np.unique(lengths.round(12), axis=0)


def _judge_spatial(specimen: int, sensor: Sensor, bent: float) -> _Found:
    """Errors of network and model on one specimen; light is not linear by a share `bent` [1]."""
    visit, rng = _visit(specimen), np.random.default_rng(specimen)
    seed, tips = sensor.specimen, visit.tips
    light = readings([sensor], visit.edges, _PAUSE, seed, visit.shapes)
    light *= 1 - bent * light / np.e
    seen = tips[:_POINTS] + CAMERA_NOISE * rng.standard_normal((_POINTS, 2))
    known = np.zeros(_POINTS, dtype=bool)
    known[rng.permutation(_POINTS)[: round(_TRAINING * _POINTS)]] = True
    parts = {"test": np.append(~known, np.zeros(len(tips) - _POINTS, dtype=bool))}
    parts["circle"] = np.arange(len(tips)) > _POINTS
    network = _network(Dataset(light[:_POINTS][known], seen[known]), rng)
    model = calibrate(light[:_POINTS], seen, known, RIG.sensors[0])
    estimates = {"network": network(light), "model": _followed(BendFilter(model), light)}
    if sensor.flicker == USUAL["flicker"] and not bent:
        without = {
            "model without play": BendFilter(replace(model, lag=0.0)),
            "model without drift": BendFilter(model, _NO_DRIFT),
        }
        estimates |= {name: _followed(one, light) for name, one in without.items()}
    squares = {
        f"{name} {part}": ((estimate - tips)[which] ** 2).sum(axis=1)
        for name, estimate in estimates.items()
        for part, which in parts.items()
    }
    return _Found(squares, {"readings": light, "tips": tips, **estimates})


def _followed(tracker: BendFilter, readings: ndarray) -> ndarray:
    """Tips (n, 2) [m] by readings (n, 4) in turn."""
    return tracker.model.tip(np.array([tracker.update(reading, _PAUSE) for reading in readings]))


def _network(samples: Dataset, rng: np.random.Generator) -> Network:
    return train_regularised(samples.new_network(_HIDDEN, rng), samples, 200).network


#: Name -> scale of the usual imperfections, noise of each sample, light that is not linear [1].
_CASES = {
    "usual": (1.0, USUAL["flicker"], 0.0),
    **{f"x {s:g}, {100 * s * _FLICKER:g} % noise": (s, s * _FLICKER, 0.0) for s in _SCALES},
    "usual, light not linear by 5 %": (1.0, USUAL["flicker"], 0.05),
}


def spatial_rows(quick: bool = False) -> list[Row]:
    """Rows of Figs. 4.22 and 4.23, and of the estimate by the model."""
    specimens = QUICK_SPECIMENS if quick else SPECIMENS
    out = []
    for name in list(_CASES)[: 2 if quick else None]:
        scale, flicker, bent = _CASES[name]
        found = []
        for specimen in specimens:
            sensor = RIG.sensors[0].with_imperfections(scale, specimen)
            found.append(_judge_spatial(specimen, replace(sensor, flicker=flicker), bent))
        out += _tip_rows(name, found)
        if len(out) == len(found[0].squares):  # of the first case
            out[0] = replace(out[0], curves=found[0].curves)
    return out


def _tip_rows(case: str, found: list[_Found]) -> list[Row]:
    printed = {"network test": ("Fig. 4.22", 4.6), "network circle": ("Fig. 4.23", 7.0)}
    out = []
    for what in found[0].squares:
        each = [1e3 * float(np.sqrt(one.squares[what].mean())) for one in found]
        figure, thesis = printed.get(what, ("", None))
        goal = None if "without" in what else thesis or 1e3 * GOAL
        fitted = _CASES[case][0] == _SCALES[-1] and what == "network test"
        name = f"{what}, RMS of {len(found)} specimens: {case}"
        rms, kind = float(np.sqrt(np.mean(np.square(each)))), "fitted" if fitted else "assumed"
        note = f"{min(each):.2f} to {max(each):.2f}"
        out.append(Row(figure, name, rms, "mm", kind, thesis=thesis, goal=goal, note=note))
    return out


# -------------------- the study

#: Samples of the four laps.
_CIRCLE = slice(-240, None)

_LEGEND = {"framealpha": 0.9, "edgecolor": "none", "fontsize": 8}

#: Orders of polynomials -> colour.
_ORDERS = {1: figures.BLUE, 3: figures.GREEN, 5: figures.VERMILLION}


def pictures(rows: Sequence[Row]) -> dict[str, figures.Figure]:
    """The planar sensor, the finger and the spatial sensor."""
    drawn = {row.figure: row.curves for row in rows if row.curves is not None}
    share = next(row for row in rows if row.quantity.startswith("share below 2 degrees"))
    shape = next(row for row in rows if row.figure == "Fig. 4.18")
    alike = f"{share.value:.0f} % of the errors are below 2 degrees where both halves bend alike "
    finger = f"On a bar of 48 mm the shape by {drawn['Fig. 4.16']['fits'].shape[1]} sensors has "
    finger += f"the tip {shape.value:.2g} {shape.unit} off at most"
    planar = drawn["Figs. 4.6, 4.7"], drawn["Figs. 4.8 to 4.11"]
    return {
        "{}": _planar_picture(*planar, f"{alike}(to 10 degrees)"),
        "{}_finger": _finger_picture(drawn["Fig. 4.16"], drawn["Fig. 4.18"], finger),
        "{}_spatial": _spatial_picture(drawn["Fig. 4.22"]),
    }


def _planar_picture(constant: dict, other: dict, message: str) -> figures.Figure:
    figure, axes = figures.new_figure(3, 2, (9.0, 10.0))
    figures.add_title(figure, message, "Planar curvature sensor between two servos")
    axis = axes[0, 0]
    axis.plot(constant["time"], constant["angle"], color=figures.BLUE)
    axis.plot(constant["time"], constant["current"], color=figures.VERMILLION)
    axis.set(xlabel="time [s]", ylabel="angle [deg], current [%]", title="as Fig. 4.6")
    axis.legend(["angle", "current"], **_LEGEND)
    axis = axes[0, 1]
    axis.plot(*constant["cloud"], ".", color="0.8", markersize=3)
    at = np.linspace(0, 100, 101)
    for order, colour in _ORDERS.items():
        axis.plot(at, constant["fits"][order], color=colour, label=f"order {order}")
        printed = np.polynomial.Polynomial(PRINTED[order])(at)
        axis.plot(at[::10], printed[::10], "*", color=colour, markersize=7)
    axis.set(xlabel="relative current [%]", ylabel="total angle [deg]")
    axis.set_title("as Fig. 4.7: polynomials")
    axis.legend(**_LEGEND, title="stars: thesis", title_fontsize=8)
    _other(*axes.flat[2:], other)
    return figure


def _other(
    first: figures.Axes, seen: figures.Axes, off: figures.Axes, last: figures.Axes, other: dict
) -> None:
    """As Figs. 4.8 to 4.11."""
    angles, current, error = other["cloud"]
    first.plot(other["time"], other["angles"][:, 0], color=figures.BLUE)
    first.plot(other["time"], other["angles"][:, 1], color=figures.GREEN)
    first.plot(other["time"], other["current"], color=figures.VERMILLION)
    first.set(xlabel="time [s]", ylabel="angles [deg], current [%]", title="as Fig. 4.8")
    first.legend(["angle 1", "angle 2", "current"], **_LEGEND)
    for axis, values, title in (
        (seen, current, "as Fig. 4.9: relative current [%]"),
        (off, error, "as Fig. 4.10: error [deg]"),
    ):
        cloud = axis.scatter(*angles.T, c=values, cmap="viridis", s=5, linewidths=0)
        axis.figure.colorbar(cloud, ax=axis)
        axis.set(xlabel="angle 1 [deg]", ylabel="angle 2 [deg]", title=title)
    last.plot(other["time"], other["estimate"], color=figures.VERMILLION)
    last.plot(other["time"], other["angle"], **figures.REFERENCE)
    last.set(xlabel="time [s]", ylabel="total angle [deg]", title="as Fig. 4.11")
    last.legend(["sensor", "reference"], **_LEGEND)


def _finger_picture(grips: dict, shape: dict, message: str) -> figures.Figure:
    series = grips["series"]
    shown = [name for name in series if name != "fingertip 60 mm"]
    figure, axes = figures.new_figure(3, 3, (9.6, 9.4))
    figures.add_title(figure, message, "Planar sensors in a finger of the gripper, simulated grips")
    axis, at = axes[0, 0], np.linspace(0, 100, 101)
    for k in range(3):
        for tip, marker in ((False, "."), (True, "x")):
            which = grips["at_tip"] == tip
            points = grips["relative"][which, k][::4], grips["turns"][which, k][::4]
            axis.plot(*points, marker, color=figures.COLOURS[k], markersize=3)
        axis.plot(at, grips["fits"][:, k], color=figures.COLOURS[k])
    axis.set(xlabel="relative current [%]", ylabel="turn [deg]")
    axis.set_title("as Fig. 4.15 (x: fingertip)")
    for axis, name in zip(axes.flat[1:7], shown, strict=False):
        seen, turns = series[name]
        time = np.arange(len(seen)) / 50
        for k in range(3):
            axis.plot(time, np.degrees(seen[:, k]), color=figures.COLOURS[k])
            axis.plot(time, np.degrees(turns[:, k]), **figures.REFERENCE)
        axis.set(xlabel="time [s]", ylabel="turn [deg]", title=name)
    axis = axes[2, 1]
    for estimate, true in shape["shapes"]:
        axis.plot(*estimate.T, color=figures.COLOURS[3])
        axis.plot(*true.T, **figures.REFERENCE)
    axis.set(aspect="equal", xlabel="x [mm]", ylabel="y [mm]", title="as Fig. 4.18: 48 mm")
    names = *(f"sensor {k + 1}" for k in range(3)), "shape by sensors"
    entries = [figures.entry(n, color=c) for n, c in zip(names, figures.COLOURS, strict=False)]
    true = figures.entry(**figures.REFERENCE | {"label": "tags; true shape"})
    figures.add_legend(figure, [*entries, true])
    return figure


def _spatial_picture(found: dict) -> figures.Figure:
    figure, axes = figures.new_figure(1, 3, (10.5, 4.4))
    sizes = []
    for name in ("network", "model"):
        off = found[name][_CIRCLE] - found["tips"][_CIRCLE]
        sizes.append(f"{1e3 * np.sqrt(np.mean(np.sum(off**2, axis=1))):.2g} mm by the {name}")
    message = f"On four laps the sensor tells the tip with an rms error of {' and '.join(sizes)}"
    figures.add_title(figure, message, "Spatial curvature sensor in the rig, one specimen")
    for k in range(4):
        axes[0, 0].plot(found["readings"][:60, k], ".", color=figures.COLOURS[k])
    axes[0, 0].set(xlabel="posture", ylabel="light over straight [1]", title="as Fig. 4.22")
    for axis, name in ((axes[0, 1], "network"), (axes[0, 2], "model")):
        axis.plot(*(1e3 * found[name][_CIRCLE]).T, color=figures.SKY, linewidth=2)
        axis.plot(*(1e3 * found["tips"][_CIRCLE]).T, **figures.REFERENCE)
        axis.set(aspect="equal", xlabel="x [mm]", ylabel="y [mm]", title=f"tip by the {name}")
    entries = [
        figures.entry(f"fibre {k + 1}", color=figures.COLOURS[k], marker=".", linestyle="")
        for k in range(4)
    ]
    entries.append(figures.entry("sensor, four laps", color=figures.SKY))
    entries.append(figures.entry(**figures.REFERENCE | {"label": "true tip"}))
    figures.add_legend(figure, entries)
    return figure


def _sensor(row: Row) -> int:
    """Planar, of the finger, or spatial."""
    finger = row.figure in ("Fig. 4.16", "Fig. 4.17", "Fig. 4.18")
    return 1 if finger else 2 if "specimens" in row.quantity else 0


_TITLES = (
    "Planar sensor between servos",
    "Three planar sensors in a finger",
    "Spatial sensor in the rig",
)
_CAPTION = (
    "fitted: a number of the model was chosen by it; implied: by the thesis' polynomial of "
    "order 5, which the model has; assumed: on a finger and sizes of imperfections that "
    "are; check: none of these"
)
_MET = Column("met", lambda row: "" if row.met is None else verdict(row.met), ">")


def measure(case: tuple[str, bool]) -> list[Row]:
    """Rows of a sensor, quickly of shorter series and fewer specimens."""
    sensor, quick = case
    return {"planar": planar_rows, "finger": finger_rows, "spatial": spatial_rows}[sensor](quick)


STUDY = Study(
    kinds=(Row,),
    cases=lambda quick: [(sensor, quick) for sensor in ("planar", "finger", "spatial")],
    measure=measure,
    label=lambda case: f"{case[0]} sensors",
    tables=[
        table(
            title,
            *("figure", "quantity", "value", "thesis", "goal", "unit", _MET, "kind", "note"),
            where=lambda row, k=k: _sensor(row) == k,
            caption=_CAPTION,
        )
        for k, title in enumerate(_TITLES)
    ],
    plots={"{}": pictures},
    alone=True,
)
