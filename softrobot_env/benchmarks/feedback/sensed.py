"""The rig's spatial curvature sensor in place of the camera: calibrated once, then alone."""

from collections.abc import Iterator
from contextlib import closing
from dataclasses import replace
from functools import cache

import numpy as np

from softrobot_env.benchmarks.feedback.rigs import LATE, disturbed
from softrobot_env.control.registry import make_policy
from softrobot_env.control.sensed import SensedTip
from softrobot_env.envs.rig import RigEnv
from softrobot_env.robots import RIG, WORKSPACE
from softrobot_env.robots.twin import Twin
from softrobot_env.sensing.estimation import LightModel, calibrate
from softrobot_env.tasks import Task, make_task

#: What environments show to policies and to the calibration.
OBSERVED = (
    "reference",
    "reference_velocity",
    "reference_acceleration",
    "tip_position",
    "previous_action",
    "sensors",
)

#: Postures of a calibration; control periods to move to one, and until its tip is at rest.
_POSTURES, _MOVING, _RESTING = 60, 20, 60


def rig_with_sensor(task: Task, twin: Twin, late: float = LATE) -> RigEnv:
    """An environment whose sensor reads late [s]."""
    sensors = tuple(replace(sensor, delay=late) for sensor in twin.robot.sensors)
    built = replace(twin, robot=replace(twin.robot, sensors=sensors))
    return RigEnv(task, twin=built, observe=OBSERVED)


def sensed(policy: str, twin: int, period: float) -> SensedTip:
    """A policy that reads the tip, by the calibrated sensor of a twin, every `period` [s]."""
    return SensedTip(make_policy(policy, RIG, period, tip_delay=LATE), light_model(twin), period)


@cache
def light_model(seed: int) -> LightModel:
    """The sensor of an undisturbed twin, from postures at rest that its camera sees."""
    postures = list(_visits(seed))
    readings, tips = (np.array(values) for values in zip(*postures, strict=True))
    return calibrate(readings, tips, np.ones(len(tips), dtype=bool), RIG.sensors[0])


def _visits(seed: int) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """Readings (4,) and tips (2,) [m] at rest all over the workspace, the straight pose first."""
    rng = np.random.default_rng(seed)
    task = make_task("reach", hold=300.0)
    with closing(rig_with_sensor(task, disturbed(seed, ""))) as env:
        network = make_policy("rig_nn", RIG, env.control_period)
        seen, _ = env.reset(seed=seed)
        yield seen["sensors"], seen["tip_position"][:2]
        for _ in range(_POSTURES):
            distance, turn = WORKSPACE * np.sqrt(rng.uniform()), rng.uniform(0, 2 * np.pi)
            place = distance * np.array([np.cos(turn), np.sin(turn)])
            still = dict.fromkeys(("reference_velocity", "reference_acceleration"), np.zeros(2))
            action, _ = network.predict({**seen, "reference": place, **still})
            before = seen["previous_action"]
            for k in range(1, _RESTING + 1):
                share = min(1.0, k / _MOVING)
                seen, *_ = env.step(np.float32(before + share * (action - before)))
            yield seen["sensors"], seen["tip_position"][:2]
