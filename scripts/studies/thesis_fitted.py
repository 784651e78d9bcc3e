"""How results depend on parameters that were fitted to the thesis, for `thesis_status.md`.

Each is changed alone; all else is as the package has it. Of twins, the softness and the turned
tendons are given alone to a rig without other errors.
"""

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from scipy.optimize import brentq

from softrobot_env.beams.constant_curvature import ConstantCurvatureStatics
from softrobot_env.beams.planar_arm import make_planar_arm
from softrobot_env.control.feedforward.statics import least_norm
from softrobot_env.control.linear_quadratic import integral_gains
from softrobot_env.control.observers import linear_model
from softrobot_env.core.interfaces import Policy
from softrobot_env.evaluation import runner
from softrobot_env.evaluation.metrics import approached_metrics, step_metrics
from softrobot_env.evaluation.rollout import Rollout
from softrobot_env.robots import ARM, EQUIVALENT_RIG
from softrobot_env.robots.sensors import USUAL
from softrobot_env.robots.twin import MODULUS, TURN, nominal_twin
from softrobot_env.sensing.calibration import Range, fit
from softrobot_env.tasks import Task, make_task
from softrobot_env.tasks.trajectories import EqualForceCurve, Polyline, Step
from softrobot_env.thesis.arm import operating_points
from softrobot_env.thesis.arm.mpc import MPC
from softrobot_env.thesis.arm.mpc_settings import THESIS
from softrobot_env.thesis.tasks import equal_input
from studies import lab, rig, sensing
from studies.policies import PCC
from studies.truths.thesis_values import CONTROLLERS


@dataclass(frozen=True)
class Row(lab.Record):
    """A result with a parameter changed.

    Attributes:
        parameter: What is changed.
        change: To what; "as used" for none.
        quantity: Of the result.
        value: In SI units.
        unit: Shown.
    """

    parameter: str
    change: str
    quantity: str
    value: float | None
    unit: str


AS_USED = "as used"

# -------------------- the rig


def twin_rows() -> Iterator[Row]:
    """Errors of the inverse dynamics on the triangle of a rig that is softer, turned, or both."""
    softer = EQUIVALENT_RIG.vary(youngs_modulus=MODULUS, damping_time=1 / MODULUS)
    for change, robot in (
        ("neither", EQUIVALENT_RIG),
        ("softer", softer),
        ("turned", _turned(EQUIVALENT_RIG)),
        ("both", _turned(softer)),
    ):
        for period in (rig.SLOW, rig.FAST):
            task = make_task("triangle", period=period)
            case = runner.Case(task, "inverse_dynamics", scene={"twin": nominal_twin(robot)})
            found = approached_metrics(runner.run(case).rollout, task.trajectory)
            for name in ("mean", "max"):
                value = getattr(found, f"e_{name}_tracking")
                yield Row("twin", change, f"inverse dynamics, {period:g} s, {name}", value, "mm")


def _turned(robot: Any) -> Any:
    return replace(robot, tendons=tuple(tendon.turned(TURN) for tendon in robot.tendons))


def delay_rows() -> Iterator[Row]:
    """Largest stable proportional gain of the thesis' ratio, by the delay of the loop."""
    for late in (0.04, 0.08, 0.1, 0.12):

        def excess(gain: float, late: float = late) -> float:
            return rig.spectral_radius(gain, rig.RATIO * gain, late) - 1

        change = AS_USED if late == rig.LATE else f"{1e3 * late:g} ms"
        limit = brentq(excess, 0.01, 10.0, xtol=1e-12)
        yield Row("delay of the loop", change, "largest stable K_P", limit, "")


# -------------------- the arm


def _step_rows(parameter: str, change: str, policy: str, rollout: Rollout) -> Iterator[Row]:
    found = step_metrics(rollout.time, rollout.tip, rollout.reference[-1])
    for name, unit in (("rise_time", "ms"), ("settling_time", "s"), ("overshoot", "%")):
        quantity = f"{policy}: {name.replace('_', ' ')}"
        yield Row(parameter, change, quantity, getattr(found, name), unit)


def _run(task: Task, policy: str, own: Callable[[float], Policy] | None = None) -> Rollout:
    case = runner.Case(task, policy, plant=PCC)
    if own is None:
        return runner.run(case).rollout
    env = case.environment()
    return runner.run(case, env, own(env.control_period)).rollout


def start_rows() -> Iterator[Row]:
    """Steps of 50 mm elsewhere along the curve, and back."""
    curve, duration = EqualForceCurve(ARM.length), {"qs_nn": 25.0}
    for change, begin, end in (
        (AS_USED, 0.6, None),
        ("from a = 0.3", 0.3, None),
        ("from a = 0.9", 0.9, None),
        ("back to a = 0.6", None, 0.6),
    ):
        other = curve.parameter_at_distance(begin or end, 0.05)
        begin, end = begin or other, end or other
        ends = (tuple(curve.derivative(a, 0)) for a in (begin, end))
        task = replace(
            make_task("step"), trajectory=Step(*ends), start_input=equal_input(ARM, begin)
        )
        for policy in CONTROLLERS:
            own = replace(task, duration=duration.get(policy, task.duration))
            yield from _step_rows("start of the step", change, policy, _run(own, policy))


def corner_rows() -> Iterator[Row]:
    """Largest errors on an L with other corners."""
    statics, used = ConstantCurvatureStatics(ARM), make_task("lshape")
    for change, corners in (
        (AS_USED, None),
        ("begins 10 mm farther out", ((0.25, 0.42), (0.25, 0.30), (0.35, 0.30))),
        ("of 100 mm legs", ((0.24, 0.41), (0.24, 0.31), (0.34, 0.31))),
    ):
        task = used
        if corners is not None:
            start = least_norm(statics, np.array(corners[0]), np.array(used.start_input))
            path = Polyline(tuple((x, 0.0, z) for x, z in corners), (0.0, 5.0, 10.0))
            task = replace(used, trajectory=path, start_input=tuple(start.inputs))
        for policy in CONTROLLERS:
            error = float(_run(task, policy).error.max())
            yield Row("corners of the L", change, f"{policy}: largest error", error, "mm")


def lqi_rows() -> Iterator[Row]:
    """The step of 50 mm with other weights on the integrated error."""
    arm, task = make_planar_arm(ARM), make_task("step")
    yield from _step_rows("weight of LQI", AS_USED, "lqi", _run(task, "lqi"))
    for factor in (0.25, 4.0):
        weight = factor * operating_points.ERROR_WEIGHT

        def design(curvature: np.ndarray, weight: float = weight) -> np.ndarray:
            a, b, c = linear_model(arm, curvature).state_space()
            return integral_gains((a, b), c, operating_points.LQI_INPUT_WEIGHT, weight).ravel()

        with TemporaryDirectory() as folder:
            path = Path(folder) / "lqi.npz"
            operating_points.save_gains(path, ARM, operating_points.build_gains(ARM, design))
            case = runner.Case(task, "lqi", plant=PCC, given={"gains": path})
            rollout = runner.run(case).rollout
        yield from _step_rows("weight of LQI", f"x {factor:g}", "lqi", rollout)


def mpc_rows() -> Iterator[Row]:
    """The step of 50 mm with other weights and another integrator of the prediction."""
    for change, settings in (
        (AS_USED, THESIS),
        ("weight of errors x 0.25", replace(THESIS, error=THESIS.error / 4)),
        ("weight of errors x 4", replace(THESIS, error=4 * THESIS.error)),
        ("weight of inputs x 100", replace(THESIS, effort=100 * THESIS.effort)),
        ("accurate to second order", replace(THESIS, integrator="sdirk2")),
    ):
        rollout = _run(make_task("step"), "mpc", partial(MPC, ARM, settings=settings))
        yield from _step_rows("settings of MPC", change, "mpc", rollout)


# -------------------- the planar sensor


def hysteresis_rows() -> Iterator[Row]:
    """Mean error of order five with a smaller and a larger hysteresis."""
    time = np.arange(1250) / 50.0
    each = np.radians(15) * (1 - np.cos(2 * np.pi * time / 10.0))
    for factor in (0.5, 1.0, 2.0):
        sensor = replace(sensing.PLANAR, hysteresis=factor * USUAL["hysteresis"])
        light = sensing.read(sensor, np.stack([each, each], axis=1), 50.0)
        relative, total = Range.of(light).relative(light), 2 * each
        found = fit(relative[:500], total[:500], 5)
        error = float(np.degrees(np.abs(found(relative[500:]) - total[500:]).mean()))
        change = AS_USED if factor == 1 else f"x {factor:g}"
        yield Row("hysteresis", change, "mean error, order 5", error, "deg")


# -------------------- the study

_PARTS = (twin_rows, delay_rows, start_rows, corner_rows, lqi_rows, mpc_rows, hysteresis_rows)
_QUICK = (delay_rows, mpc_rows, hysteresis_rows)


def jobs(quick: bool) -> Iterable[lab.Job]:
    """All parameters; quickly those whose results take no gains and no rig."""
    for part in _QUICK if quick else _PARTS:
        yield part.__name__, lambda part=part: [*part()]


STUDY = lab.Study(
    kinds=(Row,),
    jobs=jobs,
    tables=[
        lab.table(
            "Results with one parameter changed that was fitted to the thesis",
            *("parameter", "change", "quantity"),
            lab.Column("value", lambda row: lab.number(row.value, ".3g", row.unit, "never"), ">"),
            "unit",
        )
    ],
    note="The arm is the PCC model, steps are of 50 mm. A twin here is a rig without any error but "
    "those named: softer by a tenth, tendons turned by seven degrees.",
)
