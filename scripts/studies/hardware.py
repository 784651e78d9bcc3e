"""Every kind of real hardware, emulated and in real time: the same policy as in simulation.

A board drives a twin of the rig, motors drive the trunk of `examples/motor_trunk.toml`: nine of
them, as two wind each tendon of its first section. Whoever talks to them is what talks to real
ones, and what motors do is noted by their emulator at every millisecond.
"""

from collections.abc import Sequence
from contextlib import closing
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from rich.table import Table

from softrobot_env.commands.robot.soak import soak_task, soak_virtual
from softrobot_env.commands.robot.virtual import FIRMWARE
from softrobot_env.control.registry import make_policy
from softrobot_env.evaluation.run import play
from softrobot_env.evaluation.runner import simulated
from softrobot_env.hardware.registry import HARDWARE
from softrobot_env.rendering.tables import Column, make_table
from softrobot_env.robots import RobotParams, default_robot, find_robot
from studies.lab import Record, Study, grid, quantity, table, verdict

TRUNK = Path(__file__).parents[2] / "examples" / "motor_trunk.toml"

_SECONDS, _QUICK = 60.0, 1.0
_FIRST_OF_SECOND = 11  # number of the first motor that is added


@dataclass(frozen=True, kw_only=True)
class Row(Record):
    """A kind of hardware.

    Attributes:
        hardware: Its name.
        motors: That move the tendons.
        seconds: [s] of the run.
        unsafe: Instants of a millisecond at which an output was out of range, or too fast.
        missed_share: Of the steps [1].
        round_trip_p99: [s] from a set-point to its answer, the slowest of a hundred.
        e_mean, e_mean_simulated: [m], mean distance of the tip to its reference.
        e_mean_difference: [m], between these, without sign.
        failure: Why the run ended too early.
    """

    hardware: str
    motors: int
    seconds: float = quantity("s", "g")
    unsafe: int = quantity("", "d")
    missed_share: float = quantity("%", ".2f", "missed")
    round_trip_p99: float = quantity("ms", ".1f", "trip, 99 %")
    e_mean: float = quantity("mm", ".2f", "mean error")
    e_mean_simulated: float = quantity("mm", ".2f", "simulated")
    e_mean_difference: float = quantity("mm", ".2f", "difference")
    failure: str | None = None


def robot_of(kind: str) -> RobotParams:
    """The robot that a kind of hardware drives here."""
    if kind == FIRMWARE:
        return default_robot(on_a_line=True)
    robot = find_robot(str(TRUNK))
    motors = robot.hardware["motor"]
    firsts = (motor for motor in motors if motor["tendon"].startswith("a"))
    second = [motor | {"id": k} for k, motor in enumerate(firsts, _FIRST_OF_SECOND)]
    return replace(robot, hardware=robot.hardware | {"kind": kind, "motor": [*motors, *second]})


def measure(case: dict) -> Row:
    """Run a robot on emulated hardware, and simulated."""
    kind, seconds = case["hardware"], case["seconds"]
    robot, twin = robot_of(kind), 0 if kind == FIRMWARE else None
    real = soak_virtual(kind, robot, twin, seconds)
    task, policy = soak_task(robot, seconds)
    period = real["control_period"]
    with closing(simulated(task, twin, control_period=period)) as env:
        errors = [moment.info["error"] for moment in play(env, make_policy(policy, robot, period))]
    mean = float(np.mean(errors[: real["steps"]]))  # as far as the real one came
    return Row(
        hardware=kind,
        motors=3 if kind == FIRMWARE else len(robot.hardware["motor"]),
        seconds=seconds,
        unsafe=real["unsafe_outputs"],
        missed_share=real["missed_steps"] / max(1, real["steps"]),
        round_trip_p99=real["round_trip_p99"],
        e_mean=real["e_mean"],
        e_mean_simulated=mean,
        e_mean_difference=abs(real["e_mean"] - mean),
        failure=real["failure"],
    )


def goals(rows: Sequence[Row]) -> Table:
    """What was asked for, the worst of all kinds, and whether that is met."""
    worst = {
        "outputs out of range or too fast": (max(row.unsafe for row in rows), 0),
        "share of missed steps [%]": (1e2 * max(row.missed_share for row in rows), 0.1),
        "difference to the simulation [mm]": (1e3 * max(r.e_mean_difference for r in rows), 1.0),
        "runs that ended too early": (sum(row.failure is not None for row in rows), 0),
    }
    columns = (
        Column("of all kinds", lambda name: name),
        Column("worst", lambda name: worst[name][0], ".3g"),
        Column("at most", lambda name: worst[name][1], "g"),
        Column("met", lambda name: verdict(worst[name][0] <= worst[name][1])),
    )
    return make_table("Goals", columns, worst)


def _emulated() -> tuple[str, ...]:
    return tuple(n for n, kind in HARDWARE.registered().items() if n == FIRMWARE or kind.device)


STUDY = Study(
    kinds=(Row,),
    cases=grid(hardware=_emulated(), seconds=(_SECONDS,)),
    quick={"seconds": (_QUICK,)},
    measure=measure,
    tables=[
        table(
            "Hardware, emulated",
            "hardware",
            "motors",
            "seconds",
            "unsafe",
            "missed_share",
            "round_trip_p99",
            "e_mean",
            "e_mean_simulated",
            "e_mean_difference",
        ),
        goals,
    ],
    note="A board drives a twin of the rig, motors the trunk of examples/motor_trunk.toml.",
    alone=True,
)
