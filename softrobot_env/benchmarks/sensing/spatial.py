"""The spatial sensor in the rig (thesis sec. 4.2.2): tip by the network, and by the light's model.

Five rigs as built (`twin.rig3d_twin`), each with its own specimen of the sensor, go to 350 points
spread evenly over the workspace and rest there; 70 % of them train. Then each follows a slow circle
of 120 mm four times. Hysteresis, drift and warming up are on.
"""

from dataclasses import dataclass, replace
from functools import cache
from typing import NamedTuple

import numpy as np
from scipy.interpolate import LinearNDInterpolator

from softrobot_env.benchmarks.sensing.rows import Row
from softrobot_env.core.jobs import Progress
from softrobot_env.learned import bayesian
from softrobot_env.learned.network import Dataset, Network
from softrobot_env.robots import RIG, WORKSPACE, Sensor
from softrobot_env.robots.sensors import USUAL
from softrobot_env.robots.twin import CAMERA_NOISE, rig3d_twin
from softrobot_env.scene.build import build_scene
from softrobot_env.scene.chain import station_strain
from softrobot_env.scene.registry import RIG_PIECES, scene_of
from softrobot_env.scene.statics import equilibrium
from softrobot_env.sensing.bank import SensorArray
from softrobot_env.sensing.estimation import BendFilter, calibrate

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

    tips: np.ndarray  # (n, 2) [m]
    shapes: np.ndarray  # (n, cells, 3) [1/m]
    edges: np.ndarray
    sensor: Sensor


@dataclass(frozen=True)
class _Found:
    """Squared errors [m2] of tips by what estimates them, and what is drawn."""

    squares: dict[str, np.ndarray]
    curves: dict


@cache
def _visit(specimen: int) -> _Visit:
    robot = rig3d_twin(specimen).robot
    scene = build_scene(replace(scene_of(robot), pieces=RIG_PIECES, control_period=0.02))
    rng = np.random.default_rng(specimen + 100)

    def rest(lengths: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
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


def _lengths(most: np.ndarray, azimuth: np.ndarray) -> np.ndarray:
    """Lengths (n, 3) [m] pulled in towards azimuths [rad], the largest of each `most`."""
    towards = np.cos(azimuth.ravel()[:, None] - 2 * np.pi / 3 * np.arange(3))
    lengths = most.ravel()[:, None] * towards / towards.max(axis=1, keepdims=True)
    return np.unique(lengths.round(12), axis=0)


def _readings(visit: _Visit, sensor: Sensor, bent: float = 0.0) -> np.ndarray:
    """Readings (n, 4) at all postures; `bent` is how much a phototransistor is not linear [1]."""
    bank = SensorArray([sensor], visit.edges, _PAUSE)
    still = np.zeros_like(visit.shapes[:1])
    bank.start(np.array([0]), [[sensor]], [sensor.specimen], still)
    out = np.empty((len(visit.shapes), sensor.size))
    for shape, row in zip(visit.shapes, out, strict=True):
        bank.look(shape[None])
        row[:] = bank.reading[0]
    return out * (1 - bent * out / np.e)


def _judge(specimen: int, sensor: Sensor, bent: float) -> _Found:
    """Errors of network and model on one specimen."""
    visit, rng = _visit(specimen), np.random.default_rng(specimen)
    readings, tips = _readings(visit, sensor, bent), visit.tips
    seen = tips[:_POINTS] + CAMERA_NOISE * rng.standard_normal((_POINTS, 2))
    known = np.zeros(_POINTS, dtype=bool)
    known[rng.permutation(_POINTS)[: round(_TRAINING * _POINTS)]] = True
    parts = {"test": np.append(~known, np.zeros(len(tips) - _POINTS, dtype=bool))}
    parts["circle"] = np.arange(len(tips)) > _POINTS
    network = _network(Dataset(readings[:_POINTS][known], seen[known]), rng)
    model = calibrate(readings[:_POINTS], seen, known, RIG.sensors[0])
    estimates = {"network": network(readings), "model": _followed(BendFilter(model), readings)}
    if sensor.flicker == USUAL["flicker"] and not bent:
        without = {
            "model without play": BendFilter(replace(model, lag=0.0)),
            "model without drift": BendFilter(model, _NO_DRIFT),
        }
        estimates |= {name: _followed(one, readings) for name, one in without.items()}
    squares = {
        f"{name} {part}": ((estimate - tips)[which] ** 2).sum(axis=1)
        for name, estimate in estimates.items()
        for part, which in parts.items()
    }
    return _Found(squares, {"readings": readings, "tips": tips, **estimates})


def _followed(tracker: BendFilter, readings: np.ndarray) -> np.ndarray:
    """Tips (n, 2) [m] by readings (n, 4) in turn."""
    return np.array([tracker.update(reading, _PAUSE) for reading in readings])


def _network(samples: Dataset, rng: np.random.Generator) -> Network:
    return bayesian.train(samples.new_network(_HIDDEN, rng), samples, 200).network


class _Case(NamedTuple):
    """Imperfections: a scale of the usual ones, noise of each sample, light that is not linear."""

    name: str
    scale: float
    flicker: float
    bent: float = 0.0


def _cases() -> list[_Case]:
    own = USUAL["flicker"]
    scaled = (_Case(f"x {s:g}, {100 * s * _FLICKER:g} % noise", s, s * _FLICKER) for s in _SCALES)
    bent = _Case("usual, light not linear by 5 %", 1.0, own, 0.05)
    return [_Case("usual", 1.0, own), *scaled, bent]


def rows(quick: bool = False, progress: Progress | None = None) -> list[Row]:
    """Rows of Figs. 4.22 and 4.23, and of the estimate by the model."""
    specimens = QUICK_SPECIMENS if quick else SPECIMENS
    cases, out = _cases()[: 2 if quick else None], []
    for number, case in enumerate(cases):
        if progress is not None:
            progress(f"spatial: {case.name}", number, len(cases))
        found = []
        for specimen in specimens:
            sensor = RIG.sensors[0].with_imperfections(case.scale, specimen)
            erring = replace(sensor, flicker=case.flicker)
            found.append(_judge(specimen, erring, case.bent))
        out += _rows(case, found)
        if number == 0:
            out[0] = replace(out[0], curves=found[0].curves)
    return out


def _rows(case: _Case, found: list[_Found]) -> list[Row]:
    goals = {"network test": 4.6, "network circle": 7.0}
    where = {"network test": "Fig. 4.22", "network circle": "Fig. 4.23"}
    out = []
    for what in found[0].squares:
        each = [1e3 * float(np.sqrt(one.squares[what].mean())) for one in found]
        out.append(
            Row(
                where.get(what, ""),
                f"{what}, RMS of {len(found)} specimens: {case.name}",
                float(np.sqrt(np.mean(np.square(each)))),
                "mm",
                "fitted" if case.scale == _SCALES[-1] and what == "network test" else "assumed",
                thesis=goals.get(what),
                goal=None if "without" in what else goals.get(what, 1e3 * GOAL),
                note=f"{min(each):.2f} to {max(each):.2f}",
            )
        )
    return out
