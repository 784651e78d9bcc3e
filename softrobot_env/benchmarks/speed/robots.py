"""What robots of all kinds cost, singly and in batches, against their bare simulations.

A batch is driven by tensions or servos, and everything of it that can be observed is measured. Bare
is the advance of as many simulations on as many threads, in the same motion.
"""

from collections.abc import Callable
from dataclasses import replace
from time import perf_counter

import numpy as np

from softrobot_env.benchmarks.speed.rows import Row, step_row
from softrobot_env.envs.observations.table import Measured
from softrobot_env.envs.simulation.batch import BatchSimulation
from softrobot_env.envs.simulation.mujoco_plant import MujocoPlant
from softrobot_env.robots import EXAMPLES, LENGTH_SCALE, SERVO_SPEED, find_robot
from softrobot_env.scene.config import SceneConfig
from softrobot_env.scene.registry import SCENES, scene_of
from softrobot_env.scene.servos import Servos

WHAT = "robots"

#: Numbers of robots in a batch; the first ones are quick.
COUNTS = (1, 16, 256)

#: Control periods of the motion, share of the tensions' limits, and time [s] spent on a row.
_PERIODS, _SHARE, _BUDGET = 10, 0.2, 2.0


def _scenes() -> dict[str, SceneConfig]:
    """Arm, rig, the examples, and a rod of 60 degrees of freedom that bends and twists."""
    examples = {name: scene_of(find_robot(name)) for name in EXAMPLES}
    rod = examples["silicone_rod"]
    rod = replace(rod, robot=replace(rod.robot, name="rod_60", pieces=10), torsion=True)
    return {name: SCENES[name] for name in ("arm", "rig")} | examples | {"rod_60": rod}


def run(quick: bool) -> list[Row]:
    """A row for each robot and number of robots."""
    budget = _BUDGET / 10 if quick else _BUDGET
    return [
        _row(name, _plant(config), count, budget)
        for name, config in _scenes().items()
        for count in (COUNTS[:2] if quick else COUNTS)
    ]


def _plant(config: SceneConfig) -> MujocoPlant:
    names = ("control_period", "pieces", "actuation", "bending", "torsion")
    return MujocoPlant(config.robot, **{name: getattr(config, name) for name in names})


def _row(name: str, plant: MujocoPlant, count: int, budget: float) -> Row:
    bare = _Driven(plant, count)
    measured = _Driven(plant, count, bare.simulation.threads)
    steps = bare.simulation.advance, _measuring(measured)
    times: list[list[float]] = []
    begin = perf_counter()
    while len(times) < 3 or perf_counter() - begin < budget:
        pairs = zip((bare, measured), steps, strict=True)
        times.append([driven.time(step) for driven, step in pairs])
    raw, seconds = np.min(times, axis=0).tolist()
    threads = bare.simulation.threads
    row = step_row(WHAT, name, seconds, raw, count=count, threads=threads)
    return replace(row, dof=plant.nominal.model.nv)


class _Driven:
    """A batch that is reset to rest and then driven to one place."""

    def __init__(self, plant: MujocoPlant, count: int, threads: int = 0) -> None:
        tendons = plant.robot.tendons
        self.simulation = simulation = BatchSimulation(plant.nominal, count, threads)
        shares = np.random.default_rng(0).uniform(0, 1, (count, len(tendons)))
        self.plant, self.servos, self.inputs = plant, None, simulation.ctrl
        if plant.config.actuation == "length":
            none = np.zeros(len(tendons))
            self.servos = Servos(SERVO_SPEED, none, none, count)
            simulation.drive_by(self.servos)
            self.inputs, self.wanted = self.servos.command, LENGTH_SCALE / 3 * shares
        else:
            limits = np.array([tendon.tension_limit for tendon in tendons])
            self.wanted = _SHARE * limits * shares
        self._start = np.zeros_like(simulation.qpos), np.zeros_like(simulation.ctrl)
        self._everyone = np.arange(count)

    def time(self, step: Callable[[], np.ndarray]) -> float:
        """Mean time [s] of a control period of the motion; a step says who diverged.

        Raises:
            RuntimeError: One has diverged.
        """
        if self.servos is not None:
            self.servos.start(0.0)
        self.simulation.reset(self._everyone, *self._start)
        self.inputs[:] = self.wanted
        begin = perf_counter()
        for _ in range(_PERIODS):
            failed = step()
        spent = perf_counter() - begin
        if failed.any():
            raise RuntimeError(f"robot {self.plant.robot.name!r} diverged while it was timed")
        return spent / _PERIODS


def _measuring(driven: _Driven) -> Callable[[], np.ndarray]:
    """A control period of a batch with all that is measured of it."""
    readout = driven.plant.readout(driven.simulation, driven.servos)
    reads = [getattr(readout, name) for name in Measured.__annotations__]
    inputs, wanted, simulation = driven.inputs, driven.wanted, driven.simulation

    def step() -> np.ndarray:
        inputs[:] = wanted
        failed = simulation.advance()
        readout.update()
        for read in reads:
            read()
        return failed

    return step
