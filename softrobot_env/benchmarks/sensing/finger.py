"""Three planar sensors in a finger of the gripper (thesis sec. 4.1.3), in simulated grips.

One finger closes on clamped things, slowly; what its sensors and tags read is calibrated on the
smallest cylinder and judged on the others, as in the thesis.
"""

import warnings
from dataclasses import dataclass, replace

import numpy as np

from softrobot_env.benchmarks.gripper.grips import GRIPPER, things
from softrobot_env.benchmarks.sensing.rows import Row
from softrobot_env.control.gripper.calibration import LIFTED
from softrobot_env.envs.simulation.finger_sensors import shares
from softrobot_env.robots import Sensor
from softrobot_env.scene.assembly import build_assembly, felt_by
from softrobot_env.scene.chain import station_strain
from softrobot_env.scene.contacts import links_of
from softrobot_env.scene.gripper import FINENESS, gripper_scene
from softrobot_env.scene.simulation import Simulation
from softrobot_env.scene.timestep import TimestepWarning
from softrobot_env.sensing.bank import SensorArray
from softrobot_env.sensing.calibration import AngleErrors, Calibration

_ROBOT = GRIPPER.fingers[1].robot
_RATE, _CLOSING, _HELD = 50.0, 2.0, 1.0  # Hz; s of closing, as long for opening, and between

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

    strain: np.ndarray
    touch: np.ndarray
    edges: np.ndarray
    tension: np.ndarray


def _gripped(name: str, tension: float) -> _Grip:
    """The middle finger grips a thing alone, which is clamped."""
    fine = FINENESS["quick"]
    scene = gripper_scene(
        replace(GRIPPER, fingers=GRIPPER.fingers[1:2]),
        (things()[name][0],),
        contacts=fine.contacts,
        pieces=_PIECES,
        timestep=_TIMESTEP,
        control_period=1 / _RATE,
        felt_along=True,
    )
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", TimestepWarning)
        built = build_assembly(scene)
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


@dataclass(frozen=True)
class _Finger:
    """Sensors and tags of a specimen."""

    bank: SensorArray
    sensors: tuple[Sensor, ...]
    seed: int

    @classmethod
    def built(cls, specimen: int, edges: np.ndarray) -> "_Finger":
        sensors = tuple(sensor.with_imperfections(1.0, specimen) for sensor in _ROBOT.sensors)
        return cls(SensorArray(sensors, edges, 1 / _RATE), sensors, specimen)

    def read(self, grip: _Grip) -> tuple[np.ndarray, np.ndarray]:
        """Light (n, 3) and turns seen by tags (n, 3) [rad] in a grip."""
        still = np.zeros((1, *grip.strain.shape[1:]))
        self.bank.start(np.array([0]), [self.sensors], [self.seed], still)
        out = np.empty((len(grip.strain), self.bank.size))
        for k, shape in enumerate(grip.strain):
            self.bank.look(shape[None], touch=grip.touch[k : k + 1])
            out[k] = self.bank.reading[0]
        return out[:, :3], out[:, 3:].reshape(len(out), 3, -1).sum(axis=2)


def rows(quick: bool = False) -> list[Row]:
    """Rows of Figs. 4.15 to 4.18, of one finger, or of three where not quick."""
    specimens = (1,) if quick else (1, 2, 3)
    grips = {f"enclosing {name}": _gripped(name, pull) for name, pull in _ENCLOSE.items()}
    grips |= {f"fingertip {name}": _gripped(name, _TIP) for name in _ENCLOSE if name != "oval"}
    found = [_judge(specimen, grips) for specimen in specimens]
    pooled = {key: np.concatenate([one[key].ravel() for one, _ in found]) for key in found[0][0]}
    enclosing = [k for k in pooled if k.startswith("enclosing")]
    tip = [k for k in pooled if k.startswith("fingertip")]
    out = []
    for name, keys, mean, deviation, figure in (
        ("enclosing", enclosing, 2.5, 1.8, "Fig. 4.16"),
        ("enclosing, round", [k for k in enclosing if "oval" not in k], None, None, "Fig. 4.16"),
        ("fingertip", tip, 4.4, 4.7, "Fig. 4.17"),
    ):
        errors = AngleErrors.of(np.concatenate([pooled[k] for k in keys]))
        out += [
            _row(figure, f"{name}: mean error of a sensor", errors.mean, mean),
            _row(figure, f"{name}: standard deviation", errors.deviation, deviation),
        ]
    for key, largest in zip(enclosing, (6, 6, 6, 10), strict=True):
        out.append(_row("Fig. 4.16", f"{key}: largest error", np.abs(pooled[key]).max(), largest))
    series = {name: pair[:2] for name, pair in found[0][1]["series"].items()}
    out[0] = Row(**vars(out[0]) | {"curves": found[0][1] | {"series": series}})
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


def _row(figure: str, quantity: str, value: float, thesis: float | None) -> Row:
    note = "no shear, no pressed section here" if "tip" in quantity else ""
    note = "bends by 93 degrees, calibrated to 60" if "oval" in quantity else note
    value = float(np.degrees(value))
    return Row(figure, quantity, value, "deg", "assumed", thesis, note=note)


def _judge(specimen: int, grips: dict[str, _Grip]) -> tuple[dict[str, np.ndarray], dict]:
    """Errors (n, 3) [rad] of sensors by the grip, and what is drawn."""
    whole = grips[f"fingertip {_SMALL}"]
    finger = _Finger.built(specimen, whole.edges)
    light, turns = finger.read(whole)
    known = Calibration.fitted(light, turns)
    span = known.high - known.low
    at = known.low + np.linspace(0, 1, 101)[:, None] * span
    curves = {
        "relative": 100 * (light - known.low) / span,
        "turns": np.degrees(turns),
        "at_tip": whole.tension > _ENCLOSE[_SMALL],
        "fits": np.degrees(known(at)),
    }
    errors, series = {}, {}
    for name, grip in grips.items():
        light, turns = finger.read(grip)
        seen = known(light)
        errors[name] = seen - turns
        series[name] = seen, turns, grip
    return errors, curves | {"series": series}


def _chain(kappa: np.ndarray, size: np.ndarray) -> np.ndarray:
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
