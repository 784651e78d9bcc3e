"""Calibration of a robot's curvature sensors: postures at rest all over its workspace."""

from collections.abc import Iterator
from contextlib import closing
from dataclasses import replace
from typing import Any

import gymnasium
import numpy as np
from numpy import ndarray

from softrobot_env.core.artifacts import write_arrays
from softrobot_env.core.interfaces import ProgressCallback, quiet
from softrobot_env.envs.tracking import TrackingEnv
from softrobot_env.evaluation.runner import simulated
from softrobot_env.robots import RobotParams, entry_of
from softrobot_env.robots.actuation import robot_inputs
from softrobot_env.robots.artifacts import fingerprint
from softrobot_env.robots.twin import Twin, twin_of
from softrobot_env.scene.chain import station_strain
from softrobot_env.scene.inverse import sample_of, workspace_of
from softrobot_env.scene.linearised import linearised
from softrobot_env.sensing.array import felt_bends
from softrobot_env.sensing.estimation import BEND_PER_PLACE
from softrobot_env.sensing.reconstruction import TIP, Reconstruction, reconstruct, reported
from softrobot_env.tasks.trajectories import quintic_step

from .references import generic_task
from .request import Metrics, Quantity, TrainingRequest

#: Postures for each quantity that sensors tell, and of a quick run.
_POSTURES, _FEW = 60, 20

#: Periods of the slowest mode to move to a posture, so smoothly that the robot swings little
#: beyond, as what lags behind in sensors follows the way; time constants of the mode until it rests
#: there; the shortest and longest such times [s].
_PERIODS, _DECAYS, _SHORTEST, _LONGEST = 2.0, 4.0, 0.4, 6.0

#: Readings and pictures that are averaged at rest.
_LOOKS = 5

#: [m], what `estimation.calibrate` takes places within.
_REACH = 0.2

#: Largest error of the tip, over the reach, of sensors that are said to tell it.
_BLIND = 0.05


def calibrated(
    robot: RobotParams,
    seed: int,
    twin: Twin | int | None = None,
    postures: int | None = None,
    show: ProgressCallback = quiet,
) -> Reconstruction:
    """Calibrate the sensors of a robot as built, whose tip, and curvatures if any, are measured.

    Args:
        robot: As designed; what it has of imperfections in its file is what is simulated.
        seed: Of the postures and of noise.
        twin: Of a robot driven by length, the one as built; or the seed of the rig's.
        postures: Number of postures; enough for these sensors unless given.
        show: Shows the progress.

    Raises:
        ValueError: The robot carries no sensors, or they do not tell where its tip is.
    """
    if not robot.sensors:
        raise ValueError(f"robot {robot.name!r} carries no sensors that could be calibrated")
    postures = _POSTURES * reported(robot.sensors) if postures is None else postures
    passed = sum(_pace(robot))
    with closing(_environment(robot, twin, (postures + 2) * passed)) as env:
        rows = []
        count = len(sample_of(robot).inputs)
        which = np.random.default_rng(seed).choice(count, postures, replace=postures > count)
        for row in _visits(env, robot, seed, which):
            rows.append(row)
            show("postures", len(rows), postures + 1)
        readings, tips, curvatures = (np.array(values) for values in zip(*rows, strict=True))
        axes = env.unwrapped.axes
    seen = {TIP: tips} | ({"curvature": curvatures} if curvatures.size else {})
    places = _places(robot, tips, axes, which)
    known = reconstruct(robot, readings, seen, range(3)[axes], places, passed)
    error = known.maps[TIP].error
    if not error < _BLIND * robot.reach:
        raise ValueError(
            f"the sensors of robot {robot.name!r} do not tell where its tip is: postures that were "
            f"not used are off by {1e3 * error:.3g} mm. Sensors must tell bends of all sections to "
            "all sides: spatial ones or tags"
        )
    return known


def _environment(robot: RobotParams, twin: Twin | int | None, lasts: float) -> gymnasium.Env:
    """The robot on a task of so many seconds, with what is looked at."""
    task = replace(generic_task("reach", robot, hold=100.0), duration=lasts)
    observe = ("tip_position", "previous_action", "sensors")
    own = {} if twin is None else {"twin": twin_of(robot, twin)}
    if entry_of(robot).axes is not None:
        return simulated(task, observe=observe, **own)
    with closing(TrackingEnv(task, observe="all")) as env:
        curved = "curvature" in env.observation_space.spaces
    return TrackingEnv(task, observe=(*observe, *(["curvature"] if curved else [])), **own)


def _visits(
    env: gymnasium.Env, robot: RobotParams, seed: int, chosen: ndarray
) -> Iterator[tuple[ndarray, ndarray, ndarray]]:
    """Readings, tips and curvatures at rest, the straight pose first."""
    sample, inputs = sample_of(robot), robot_inputs(robot)
    actions = inputs.to_actions(sample.inputs)
    period = env.unwrapped.control_period
    moving, resting = (max(_LOOKS, round(time / period)) for time in _pace(robot))
    observation, _ = env.reset(seed=seed)
    yield _looked([observation])
    before = observation["previous_action"]
    for which in chosen:
        looks: list[dict[str, ndarray]] = []
        for k in range(1, moving + resting + 1):
            action = before + quintic_step(min(1.0, k / moving))[1] * (actions[which] - before)
            observation, *_, info = env.step(np.float32(action))
            if "failure" in info:
                raise ValueError(f"the robot cannot be calibrated: {info['failure']}")
            if k > moving + resting - _LOOKS:
                looks.append(observation)
        yield _looked(looks)
        before = observation["previous_action"]


def _looked(looks: list[dict[str, ndarray]]) -> tuple[ndarray, ndarray, ndarray]:
    """Mean readings, tip and curvatures."""
    means = {name: np.mean([look[name] for look in looks], axis=0) for name in looks[0]}
    return means["sensors"], means["tip_position"], means.get("curvature", np.empty(0))


def _pace(robot: RobotParams) -> tuple[float, float]:
    """Times [s] to move to a posture, and to come to rest there."""
    space = workspace_of(robot)
    slowest = float(linearised(space.inverse, space.ground.inputs).frequencies[0])
    damping = min(section.damping_time for section in robot.backbone.sections)
    rate = damping * (2 * np.pi * slowest) ** 2 / 2
    times = np.clip([_PERIODS / slowest, _DECAYS / max(rate, 1e-9)], _SHORTEST, _LONGEST)
    return float(times[0]), float(times[1])


def _places(robot: RobotParams, tips: ndarray, axes: slice, chosen: ndarray) -> list[ndarray]:
    """What bends (n, 2) grow with about, of each sensor; see `reconstruct`.

    Where one sensor tells all, the tip across the robot's axis; where there are more, what each
    should feel of the robot as designed.
    """
    if len(robot.sensors) == 1:
        space = np.zeros((len(tips), 3))
        space[:, axes] = tips - tips[0]
        return [_REACH / robot.reach * (space @ robot.clamp.axes)[:, :2]]
    space = workspace_of(robot)
    first = space.inverse.posture(space.ground.inputs)
    postures = np.concatenate([first[None], sample_of(robot).postures[chosen]])
    scene = space.scene
    strain = station_strain(scene.model, scene.layout, postures)
    bends = felt_bends(robot.sensors, np.append(0.0, np.cumsum(scene.layout.weights)), strain)
    return [own.mean(axis=1) / BEND_PER_PLACE if own.size else own for own in bends]


def run(request: TrainingRequest, show: ProgressCallback) -> Metrics:
    """Calibrate as requested and write the file."""
    settings: dict[str, Any] = dict(request.settings)
    postures = (_FEW if "quick" in settings else _POSTURES) * reported(request.robot.sensors)
    twin = settings.get("twin", entry_of(request.robot).twin)
    known = calibrated(request.robot, request.seed, twin, postures, show)
    about = {} if twin is None else {"twin": twin}
    about |= fingerprint(request.robot) | {"seed": request.seed}
    write_arrays(request.path, known.arrays() | about)
    units = {"tip_position": "mm", "curvature": "1/m"}
    found: Metrics = [("postures", str(postures))]
    for name, own in known.maps.items():
        error = Quantity(float(own.error), ".3g", units[name])
        found.append((f"{name}: RMS of postures left out", error))
        found.append((f"{name}: terms", str(len(own.powers))))
    return found
