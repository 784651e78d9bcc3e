"""Runs of a scene with contacts, and how far they are from refined ones."""

import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from time import perf_counter

import numpy as np

from softrobot_env.benchmarks.contacts.cases import CASES, Case
from softrobot_env.benchmarks.contacts.rows import ACCURATE_SHARE, Cell
from softrobot_env.benchmarks.verdicts import Verdict, verdict_of, with_warning
from softrobot_env.robots import RobotParams
from softrobot_env.scene.assembly import AssembledScene
from softrobot_env.scene.build import Scene
from softrobot_env.scene.chain import SEPARATOR, TIP_SITE
from softrobot_env.scene.contacts import material_stiffness, tune
from softrobot_env.scene.simulation import Simulation
from softrobot_env.scene.timestep import TimestepWarning

#: Timesteps of the refined runs, as parts of the rule's, and the least impedance of their contacts.
_REFINED, _LEAST_IMPEDANCE = (8, 16), 0.02

#: What is judged.
Touching = Scene | AssembledScene

#: A truth is good enough if it is known to this share of what is accurate, or of the error.
_CLEAR = 0.25


@dataclass(frozen=True)
class Run:
    """A run of a scene.

    Attributes:
        timestep: [s].
        places: (periods, k, 3) [m] of the tip and the free objects; None if it failed.
        why: Why it failed, or was refused.
        warning: What a `TimestepWarning` said.
        wall_time: [s].
        most_touches: Most contacts at the end of a control period.
    """

    timestep: float
    places: np.ndarray | None = None
    why: str | None = None
    warning: str | None = None
    wall_time: float | None = None
    most_touches: int | None = None


def judged(name: str, ratio: float, friction: float, steps: Sequence[int]) -> list[Cell]:
    """Cells of a scene with a stiffness and friction, one for each timestep over the rule's."""
    case = CASES[name]()
    stiffness = ratio * _softest(case.robot)
    build = partial(case.build, stiffness, friction)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", TimestepWarning)
        rule = build().timestep.timestep
        coarse, truth = (_refined(case, build(rule / parts)) for parts in _REFINED)
    cells = []
    for multiple in steps:
        own = _own_run(case, build, None if multiple == 1 else multiple * rule)
        known = _distance(coarse, truth)
        error = None if own.places is None else _distance(own.places, truth)
        cells.append(
            Cell(
                scene=name,
                stiffness_ratio=ratio,
                stiffness=stiffness,
                friction=friction,
                steps_ratio=multiple,
                timestep=multiple * rule,
                verdict=_verdict(own, error, known, case.robot.length),
                why=own.why,
                warning=own.warning,
                error=error,
                error_share=None if error is None else error / case.robot.length,
                uncertainty=known,
                wall_time=own.wall_time,
                duration=case.duration,
                most_touches=own.most_touches,
            )
        )
    return cells


def _softest(robot: RobotParams) -> float:
    """Stiffness [N/m2] of the skin of a robot's softest material."""
    return min(material_stiffness(section) for section in robot.backbone.sections)


def _own_run(case: Case, build: Callable[..., Touching], timestep: float | None) -> Run:
    """As a user would run it."""

    def build_and_run() -> Run:
        try:
            scene = build(timestep)
        except ValueError as error:
            return Run(timestep or 0.0, why=str(error))
        return _run(case, scene)

    ran, warning = with_warning(build_and_run)
    return replace(ran, warning=warning)


def _refined(case: Case, scene: Touching) -> np.ndarray | None:
    tune(scene.model, scene.pairs, scene.timestep.timestep, _LEAST_IMPEDANCE)
    return _run(case, scene).places


def _run(case: Case, scene: Touching) -> Run:
    """Places of a run, whose contacts are counted when the time is no longer taken."""
    simulation, choice = Simulation(scene), scene.timestep
    simulation.reset(scene.model.qpos0, case.inputs(0.0))
    model, data = scene.model, simulation.data
    names = [thing.name for thing in case.objects if thing.is_free]
    sites = [model.site(k).name for k in range(model.nsite)]
    tips = [name for name in sites if name.rpartition(SEPARATOR)[2] == TIP_SITE]
    seen = [*(data.site(n).xpos for n in tips), *(data.body(n).xpos for n in names)]
    places, touches = [], 0
    begin = perf_counter()
    for number in range(round(case.duration / scene.config.control_period)):
        simulation.ctrl[:] = case.inputs(number * scene.config.control_period)
        if not simulation.advance():
            return Run(choice.timestep, why=simulation.failure())
        places.append(np.array(seen))
        touches = max(touches, int(simulation.data.ncon))
    took = perf_counter() - begin
    return Run(choice.timestep, np.array(places), wall_time=took, most_touches=touches)


def _distance(one: np.ndarray | None, other: np.ndarray | None) -> float | None:
    """Largest distance [m] between two runs at any instant; None if one of them failed."""
    if one is None or other is None:
        return None
    return float(np.linalg.norm(one - other, axis=-1).max())


def _verdict(own: Run, error: float | None, known: float | None, length: float) -> Verdict:
    asked = ACCURATE_SHARE * length
    if error is not None and (known is None or known > _CLEAR * max(asked, error)):
        error = None
    return verdict_of(error, asked, length, failure=own.why, warning=own.warning)
