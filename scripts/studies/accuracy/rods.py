"""MuJoCo's own rods beside ours: slender rods at rest under loads on their tips, and falling.

Ours are the chain as environments have it and PCC, MuJoCo's the discrete elastic rod of its flexes
and the cable that MuJoCo 3 had (`mujoco_rods`). All bend and twist alone. Truths: Kirchhoff's rod,
from the tip (`truths.spatial_rod`) or by shooting (`truths.analytic`), and a falling rod by Ritz'
method (`truths.falling_rod`).

    python -m studies.accuracy.rods    # in scripts: measures these rows of the report alone

The cable needs an older MuJoCo, `pip install --no-deps --target DIR "mujoco<4"`, in the folder that
the environment variable SOFTROBOT_MUJOCO3 names; without it a note stands in place of its rows.
"""

import json
import os
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import asdict, replace
from functools import partial
from math import cos, pi, sin
from pathlib import Path
from typing import Any

import numpy as np
from numpy import ndarray

from softrobot_env.core.equilibrium import EquilibriumError
from softrobot_env.evaluation.models.runs import Limit, best_of, silent_warnings, unwarned
from softrobot_env.robots import RobotParams
from softrobot_env.robots.loads import Load
from softrobot_env.scene.config import TWISTING_RULE, TipSensors
from studies.accuracy import cases, mujoco_rods
from studies.accuracy.space import ROBOTS, SpatialCase, cases_of
from studies.beams import chain_scene
from studies.lab import Job
from studies.truths.analytic import section
from studies.truths.falling_rod import falling_tips
from studies.truths.spatial_rod import followed_rod

FLEX, CABLE = mujoco_rods.MODELS
CHAIN = f"mujoco_chain/{TWISTING_RULE}"

#: Joints, edges or pieces, coarse to fine.
SIZES = (6, 12, 24)

#: Name of a case at rest -> heading.
HEADINGS = {"sag": "sag", "force": "force", "arc": "half circle", "helix": "helix", "pull": "pull"}

#: Steps to rest, in the rod's time scale: longer ones of the flex let its edges stretch more.
SHARES = {FLEX: 0.1, CABLE: 0.5}

#: [s] of motions, and tolerances of PCC.
TIMESTEPS, TOLERANCES = (5e-3, 2e-3, 1e-3, 5e-4), (1e-2, 1e-3, 1e-4)

#: [s], damping of the rods that fall: high as of plastics, and low.
_DAMPING = {"tpu": 1e-2, "steel": 1e-3}

#: Azimuth [rad] of all planes, in no direction of the hinges; gravity [m/s2].
_OBLIQUE, _G = 0.5, 9.81

#: Instants of a motion.
_PERIOD, _SAMPLES = 0.01, 300

#: Timesteps [s] tried, longest first, of MuJoCo's rods that move under a load that follows.
LADDER = (5e-3, 2e-3, 1e-3, 5e-4, 2e-4, 1e-4, 5e-5)

_OLDER = "SOFTROBOT_MUJOCO3"
_NO_CABLE = (
    "MuJoCo 4.0 has no cable any more: its rows need the folder of an older MuJoCo in "
    f"{_OLDER} (see studies.accuracy.rods)"
)


def case_name(case: str, robot: RobotParams) -> str:
    """Name of a case of a rod in the report."""
    return f"rod_{case}_{robot.name}"


MOTIONS = {
    case_name("falls", robot): (
        f"{robot.name.upper()} rod falls, damped by {1e3 * _DAMPING[robot.name]:g} ms"
    )
    for robot in ROBOTS
}


# ---------------------------------------------------------------- cases


def rests(robot: RobotParams) -> dict[str, SpatialCase]:
    """Rods at rest with their exact tips.

    sag: under weight from aside and below. force: a dead one across, 5 EI / L^2. arc: a moment
    that bends to a half circle. helix: a moment with parts across and along, which follows. pull: a
    straight tendon that ends on a disc and pulls along its axis: 5 EI / L^2 down along the tip,
    on a lever of 0.3 L.
    """
    size = section(robot, None).bending / robot.length
    across = np.array([-sin(_OBLIQUE), cos(_OBLIQUE), 0.0])
    pull = (0.0, 0.0, -5 * size / robot.length)
    return {
        "sag": cases_of("sag_45deg", robot, cases.BENDING)[0],
        "force": cases_of("force_dead", robot, cases.BENDING)[0],
        "arc": _followed(robot, moment=tuple(pi * size * across)),
        "helix": cases_of("helix_follower", robot, cases.BENDING)[0],
        "pull": _followed(robot, force=pull, moment=tuple(1.5 * size * across)),
    }


def _followed(robot: RobotParams, **wrench: tuple) -> SpatialCase:
    load = Load("load", robot.length, follows=True, **wrench)
    places = np.array([0.0, robot.length])
    tip = followed_rod(robot.length, section(robot, None), (load,), places).tip
    return SpatialCase(robot, (load,), tip)


def falling(
    robot: RobotParams, gravity: tuple = (_G * cos(_OBLIQUE), _G * sin(_OBLIQUE), 0.0)
) -> RobotParams:
    """The rod that is let go while straight, in gravity across it."""
    return replace(robot, gravity=gravity, damping_time=_DAMPING[robot.name])


def falling_truth(robot: RobotParams, terms: int = 6) -> Limit:
    """Tips (301, 3) [m] of a falling rod, by that many polynomials."""
    down, along = falling_tips(robot, _G, _PERIOD * np.arange(_SAMPLES + 1), terms).T
    tips = np.stack([cos(_OBLIQUE) * down, sin(_OBLIQUE) * down, along], axis=1)
    return Limit(tips, 0.0, "inextensible rod by Ritz' method")


# ---------------------------------------------------------------- MuJoCo's rods


def plain(robot: RobotParams, load: Load | None = None) -> mujoco_rods.Rod:
    """A robot, a solid rod, with a load on its tip, as numbers."""
    about = "length", "youngs_modulus", "poisson_ratio", "density", "damping_time"
    own: dict[str, Any] = {name: getattr(robot, name) for name in about}
    if load is not None:
        own |= {"force": load.force, "moment": load.moment, "follows": load.follows}
    return mujoco_rods.Rod(radius=robot.outer_radius, gravity=robot.gravity, **own)


def ask(requests: list[dict]) -> list[dict]:
    """Answers to requests about one model, see `mujoco_rods.answer`; none where it is absent."""
    if requests[0]["model"] == FLEX:
        with silent_warnings():
            return [mujoco_rods.answer(request) for request in requests]
    if _OLDER not in os.environ:
        return []
    older = {**os.environ, "PYTHONPATH": os.environ[_OLDER]}
    command = [sys.executable, mujoco_rods.__file__]
    given = {"input": json.dumps(requests), "env": older, "text": True}
    return json.loads(subprocess.run(command, **given, stdout=subprocess.PIPE, check=True).stdout)


def _their_rows(model: str, case: str, truth: Limit, requests: list[dict]) -> list[cases.Row]:
    found, wanted = [], [{"model": model, **request} for request in requests]
    answers = ask(wanted)
    if not answers:
        return [cases.Row("note", case, model, reference=_NO_CABLE)]
    for request, answer in zip(wanted, answers, strict=True):
        n = request["n"]
        steps = {"timestep": answer["timestep"], "integrator": answer["integrator"]}
        by = replace(truth, text=f"{truth.text}; by MuJoCo {answer['version']}")
        if "failure" in answer:
            text = f"MuJoCo {answer['version']}: {answer['failure']}"
            found.append(cases.Row("note", case, model, n, reference=text, **steps))
        elif "share" in request:
            tip, took = np.array(answer["tips"]), answer["wall_time"]
            found.append(_rest_row(case, model, n, by, tip, took, **steps))
        else:
            tips, took = np.array(answer["tips"]), answer["wall_time"]
            settings = cases.Settings(model, n, **steps)
            found.append(cases.motion_row(case, cases.BENDING, by, settings, tips, took))
    return found


def pulled_rows(robot: RobotParams) -> list[cases.Row]:
    """The longest timestep with which MuJoCo's rods bear the load "pull" in motion, as notes."""
    case, found, label = rests(robot)["pull"], [], case_name("pull", robot)
    rod = asdict(plain(falling(robot, (0.0, 0.0, 0.0)), case.loads[0]))
    for model in (FLEX, CABLE):
        about = {"model": model, "rod": rod, "n": 12, "repeats": 1, "period": _PERIOD}
        answers = ask([{**about, "samples": 50, "timestep": h} for h in LADDER])
        holding = [answer["timestep"] for answer in answers if "tips" in answer]
        text = "with none of these timesteps" if not holding else f"from {1e3 * holding[0]:g} ms on"
        text = f"moves without divergence {text}, of {1e3 * LADDER[0]:g} to {1e3 * LADDER[-1]:g}"
        row = cases.Row("note", label, model, 12, reference=f"{text} ms", timestep=None)
        if answers:
            found.append(replace(row, timestep=max(holding, default=None)))
    return found


def _rest_row(
    case: str, model: str, n: int, truth: Limit, tip: ndarray, took: float, **others: Any
) -> cases.Row:
    return cases.static_row(case, model, n, cases.BENDING, truth, tip, wall_time=took, **others)


# ---------------------------------------------------------------- rows


def jobs(quick: bool = False) -> Iterator[Job]:
    """A job for each rod at rest, and for each that falls."""
    for robot in ROBOTS[: 1 if quick else None]:
        for name, case in rests(robot).items():
            yield f"{robot.name} rod, {name}", partial(rest_rows, name, case, quick)
        yield f"{robot.name} rod falls", partial(falling_rows, robot, quick)
        if not quick:
            yield f"{robot.name} rod, pulled in motion", partial(pulled_rows, robot)


def rest_rows(name: str, case: SpatialCase, quick: bool = False) -> list[cases.Row]:
    """Errors and times of all models at rest in a case."""
    found, label = [], case_name(name, case.robot)
    truth, repeats = Limit(case.tip, 0.0, "exact rod"), 2 if quick else 10
    sizes = SIZES[: 2 if quick else None]
    for n in sizes:
        options = {"loads": case.loads, "bending": "spatial", "torsion": True}
        chain = chain_scene(case.robot, TWISTING_RULE, n, **options)
        pcc = cases.DISTRIBUTED.build(case.robot, n, case.loads, "torsion")
        for model, beam in ((CHAIN, chain), (cases.DISTRIBUTED.name, pcc)):
            inputs = np.ones(len(case.loads))
            solve = partial(beam.equilibrium, inputs, load_steps=5, check_stability=False)
            try:
                solve()  # compiles
                took, q = best_of(solve, repeats)
            except EquilibriumError as error:
                found.append(cases.Row("note", label, model, n, reference=str(error)))
                continue
            found.append(_rest_row(label, model, n, truth, beam.tip(q), took))
    rod = asdict(plain(case.robot, next(iter(case.loads), None)))
    for model, share in SHARES.items():
        about = {"rod": rod, "repeats": repeats, "share": share}
        requests = [{**about, "n": n} for n in sizes]
        found += _their_rows(model, label, truth, requests)
    return found


def chain_motion(
    robot: RobotParams, n: int, timestep: float | None, integrator: str = "implicitfast"
) -> cases.ChainMotion:
    """A falling rod of the MuJoCo chain with n joints."""
    options = {"bending": "spatial", "torsion": True, "sensors": (TipSensors(),)}
    steps = {"control_period": _PERIOD, "timestep": timestep, "integrator": integrator}
    with unwarned():  # some timesteps are beyond the stability limit on purpose
        scene = chain_scene(robot, TWISTING_RULE, n, **options, **steps)
    return cases.ChainMotion(scene, lambda times: np.zeros((len(times), scene.model.nu)))


def falling_rows(robot: RobotParams, quick: bool = False) -> list[cases.Row]:
    """Errors and times of all models of a falling rod."""
    robot, label = falling(robot), case_name("falls", robot)
    truth, repeats = falling_truth(robot, 4 if quick else 6), 2 if quick else 5
    sizes, found = SIZES[: 2 if quick else None], []
    timesteps = TIMESTEPS[: 2 if quick else None]
    for n in sizes:
        beam = cases.DISTRIBUTED.build(robot, n, (), "torsion")
        rod = cases.BeamMotion(cases.DISTRIBUTED.name, n, beam, np.empty(0), beam.tip, _PERIOD)
        replace(rod, tolerance=TOLERANCES[0])()  # compiles
        runs: list[cases.TimedMotion] = [replace(rod, tolerance=t) for t in TOLERANCES]
        runs += [chain_motion(robot, n, timestep) for timestep in timesteps]
        for run in runs:
            try:
                found.append(cases.timed_row(label, cases.BENDING, truth, run, repeats))
            except RuntimeError as error:
                about = {"integrator": run.settings.integrator, "timestep": run.settings.timestep}
                found.append(cases.Row("note", label, CHAIN, n, reference=str(error), **about))
        found.append(_environment_row(label, robot, n, truth, repeats))
    about = {"rod": asdict(plain(robot)), "repeats": repeats, "samples": _SAMPLES}
    requests = [
        {**about, "n": n, "timestep": h, "period": _PERIOD} for n in sizes for h in timesteps
    ]
    for model in (FLEX, CABLE):
        found += _their_rows(model, label, truth, requests)
    return found


def _environment_row(
    case: str, robot: RobotParams, n: int, truth: Limit, repeats: int
) -> cases.Row:
    """The chain in the steps that environments take, whose error they hold."""
    scene = chain_scene(
        robot, TWISTING_RULE, n, bending="spatial", torsion=True, control_period=_PERIOD
    )
    run = partial(scene.simulate, cases.DURATION, samples=_PERIOD)
    run()  # compiles
    took, motion = best_of(run, repeats)
    settings = cases.Settings(CHAIN, n, scene.timestep.timestep, scene.timestep.integrator)
    tips = scene.tip(motion.q)
    return cases.motion_row(case, cases.BENDING, truth, settings, tips, took)


def main() -> None:
    """Measure these rows of the committed report; all others and its head stay as they are."""
    path = Path(__file__).parents[3] / "docs" / "results" / "accuracy" / "report.json"
    head, _, rest = path.read_text(encoding="utf-8").partition('"rows": [\n')
    others = [row for row in rest.splitlines() if '"case": "rod_' not in row and row[:1] == "{"]
    lines = [row.rstrip(",") for row in others]
    for label, job in jobs():
        print(label, flush=True)
        lines += [json.dumps(row.row()) for row in job()]
    path.write_text(head + '"rows": [\n' + ",\n".join(lines) + "\n]}\n", encoding="utf-8")
    print("tables and pictures: softrobot benchmark accuracy --redraw --out docs/results")


if __name__ == "__main__":
    main()
