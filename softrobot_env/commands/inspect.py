"""`softrobot inspect`: what a scene contains, what it leaves out, and what a step costs."""

from argparse import Namespace
from dataclasses import replace
from math import isinf
from pathlib import Path

import mujoco
import numpy as np
from numpy import ndarray
from rich.table import Table

from softrobot_env.core.equilibrium import EquilibriumError
from softrobot_env.envs.tracking import TrackingEnv
from softrobot_env.evaluation.runner import Case, simulated
from softrobot_env.rendering.tables import Column, make_table, named_values
from softrobot_env.rendering.workspace import draw_workspace, picture_of
from softrobot_env.robots import RobotParams, entry_of, find_robot
from softrobot_env.robots.actuation import robot_inputs, with_balance
from softrobot_env.robots.twin import Twin
from softrobot_env.scene.build import Scene, build_scene
from softrobot_env.scene.inverse import sample_of, workspace_of
from softrobot_env.scene.registry import scene_of
from softrobot_env.scene.resolution import STRAINED

from .arguments import scene_options
from .cases import Setup, one_task
from .output import check_free, say

EXAMPLE = """softrobot inspect --task swing
  softrobot inspect --task triangle --twin 0
  softrobot inspect --robot my.toml --workspace"""

#: Step of an action [1] whose effect on the tip is printed, and share of the largest change of a
#: command above which a tendon counts as pulled.
_MOVED, _PULLED = 0.1, 1e-6

#: Parts that a scene may leave out: description -> whether this model has it.
_OPTIONAL = {
    "contacts": lambda m: not m.opt.disableflags & mujoco.mjtDisableBit.mjDSBL_CONTACT,
    "constraint solver": lambda m: not m.opt.disableflags & mujoco.mjtDisableBit.mjDSBL_CONSTRAINT,
    "MuJoCo's silent reset of a diverged state": lambda m: (
        not m.opt.disableflags & mujoco.mjtDisableBit.mjDSBL_AUTORESET
    ),
    "geoms (nothing is visible)": lambda m: m.ngeom > 0,
    "cameras and lights": lambda m: m.ncam + m.nlight > 0,
    "markers": lambda m: m.nmocap > 0,
    "sensors": lambda m: m.nsensor > 0,
    "gravity": lambda m: bool(m.opt.gravity.any()),
}


ARGUMENTS = """
    <task>
    <robot> its own scene unless --task is given; default: the task's
    --workspace  with --robot: draw the rest positions of its tip
    --out DIR (out/inspect)  of the picture
    <overwrite>
    <twin>
    <scene>
"""


def run(args: Namespace) -> int:
    """Run the command."""
    if args.robot is not None and args.task is None:
        return _inspect_robot(args)
    if args.workspace:
        raise ValueError("--workspace goes with --robot only, without --task")
    return _inspect_task(args)


def _inspect_robot(args: Namespace) -> int:
    """Print the scene of a robot without a task."""
    if args.twin is not None or args.option or args.step_width:
        raise ValueError("--option, --step-width and --twin go with a --task only")
    config = replace(scene_of(find_robot(args.robot)), **scene_options(args))
    if args.workspace:
        check_free(picture_of(config.robot, args.out), overwrite=args.overwrite)
    own = {"bending": f"{config.bending}, {'twists' if config.torsion else 'without torsion'}"}
    title = f"Robot {config.robot.name}"
    _print(build_scene(config), title, [] if config.torsion else ["torsion"], own)
    if args.workspace:
        _show_workspace(config.robot, args.out)
    return 0


def _show_workspace(robot: RobotParams, folder: Path) -> None:
    """Draw the workspace and return rows with its size."""
    picture = draw_workspace(robot, folder)
    sample, ground = sample_of(robot), workspace_of(robot).ground
    low, high = 1e3 * sample.tips.min(axis=0), 1e3 * sample.tips.max(axis=0)
    spans = (f"{n} {a:.0f} to {b:.0f}" for n, a, b in zip("xyz", low, high, strict=True))
    line = "its tip only moves on a line"
    if ground.radius:
        line = (
            f"{1e3 * ground.length:.3g} mm along and {1e3 * ground.radius:.3g} mm to all sides of "
            f"({', '.join(f'{1e3 * x:.0f}' for x in ground.middle)}) mm"
        )
    rows = {
        "tips at rest": f"{', '.join(spans)} mm",
        "sample": f"{len(sample.tips)} equilibria, {sample.left_out} actions left out: without a "
        "stable one, or beyond the drives' travel",
        "ground of tasks": line,
        "picture": str(picture),
    }
    say(named_values(f"Workspace of {robot.name}", rows))


def _inspect_task(args: Namespace) -> int:
    """Print the scene of a task."""
    setup, scene = Setup(args), scene_options(args)
    task = one_task(args, setup.robot)
    twin = setup.twins(task.robot)[0]
    setup.check([Case(task, "hold", twin=twin, scene=scene)])
    env = simulated(task, twin, **scene)
    left_out = [] if env.twin is None else _errors_left_out(env.twin)
    own = _as_built(env) | _action(env)
    seen = ", ".join(f"{k} {v.shape[0]}" for k, v in env.observation_space.items())
    title = f"Task {task.label}, robot {env.scene.config.robot.name}"
    _print(env.scene, title, left_out, {"observation": seen, **own})
    return 0


def _print(scene: Scene, title: str, left_out: list[str], own: dict[str, str]) -> None:
    """Print the common rows of a scene, what else a robot leaves out, and its own rows."""
    model = scene.model
    tendons = len(scene.config.robot.tendons)
    left_out = [*(name for name, has in _OPTIONAL.items() if not has(model)), *left_out]
    rows = {
        "DOFs": f"{model.nv} hinges in {scene.layout.pieces} pieces, "
        f"rule {scene.config.hinge_rule}",
        "bodies": f"{model.nbody - 1} links",
        "tendons, actuators": f"{tendons}, {model.nu} ({scene.config.actuation})",
        **_holding(scene.config.robot),
        "sensors": ", ".join(model.sensor(i).name for i in range(model.nsensor)) or "none",
        "left out": "; ".join(left_out),
        **_moves(scene),
        **_resting(scene),
        **_timing(scene),
        **own,
    }
    say(named_values(title, rows))
    say(_tendons(scene.config.robot))


def _holding(robot: RobotParams) -> dict[str, str]:
    """Dry friction of the backbone, where it has any."""
    held = [f"{section.bending_friction:.3g}" for section in robot.backbone.sections]
    return {"friction of the backbone": f"{', '.join(held)} N m"} if robot.holds else {}


def _resting(scene: Scene) -> dict[str, str]:
    """How far the chain at rest is from the beam."""
    found, config = scene.discretization, scene.config
    wanted, length = config.wanted_accuracy, config.robot.length
    where = f"at rest under {found.inputs} inputs all over their range"
    where += f", at {found.lost} of which it has no equilibrium" if found.lost else ""
    beyond = "warning: " if found.error > wanted or found.lost else ""
    visible = "warning: " if found.left_out > STRAINED * length else ""
    return {
        "error in space": f"{beyond}{1e3 * wanted:.3g} mm requested, {1e3 * found.error:.2g} mm "
        + where,
        "stretch and shear": f"{visible}neglected, would move the tip by "
        f"{1e3 * found.left_out:.2g} mm, {100 * found.left_out / length:.2g} % of its length",
    }


def _moves(scene: Scene) -> dict[str, str]:
    """Where each action alone moves the tip at rest, and which tendons it pulls more."""
    robot = scene.config.robot
    if not robot.tendons:
        return {}
    inputs, rows = robot_inputs(with_balance(robot)), {}

    def at(action: ndarray) -> tuple[ndarray, ndarray]:
        commands = inputs.command(inputs.from_actions(action))
        controls = np.zeros(scene.n_inputs)
        controls[: len(commands)] = commands
        return commands, scene.tip(scene.equilibrium(controls)) @ robot.clamp.axes

    try:
        slack, rest = at(np.zeros(inputs.n_inputs))
        for number, action in enumerate(_MOVED * np.eye(inputs.n_inputs)):
            commands, tip = at(action)
            pulled = [
                tendon.name
                for tendon, more in zip(robot.tendons, commands - slack, strict=True)
                if more > _PULLED * np.abs(commands - slack).max()
            ]
            x, y, z = 1e3 * (tip - rest)
            rows[f"tip by action[{number}] + {_MOVED}"] = (
                f"({x:+z.2f}, {y:+z.2f}, {z:+z.2f}) mm in the base's axes, pulls "
                f"{', '.join(pulled) or 'less'}"
            )
    except EquilibriumError as error:
        return {"tip by actions": f"not known at rest: {error}"}
    return rows


def _timing(scene: Scene) -> dict[str, str]:
    """Integrator and timestep, and the errors in a demanding motion."""
    from softrobot_env.scene.integration.probe import probe  # compiled code takes time to load

    choice, found = scene.timestep, probe(scene)
    limit = "none" if isinf(choice.stability_limit) else f"{1e3 * choice.stability_limit:.4g} ms"
    wanted = "" if choice.accuracy is None else f"{1e3 * choice.accuracy:.3g} mm requested, "
    return {
        "integrator": choice.integrator,
        "timestep": f"at most {1e3 * choice.timestep:.4g} ms, {choice.substeps} or more per "
        "control period"
        if choice.accuracy
        else f"{1e3 * choice.timestep:.4g} ms, {choice.substeps} per control period",
        "timestep rule": choice.reason,
        "first mode": f"{1 / choice.first_period:.3f} Hz",
        "stability limit": f"{limit} (linearised)",
        "error in time": f"{wanted}{1e3 * found.error:.2g} mm in random steps of all drives over "
        f"half of their range, {found.duration:.3g} s long",
        "cost per control period": f"{1e6 * found.cost:.1f} µs in that motion, "
        f"{scene.config.control_period / found.cost:.0f} x real time, "
        f"{found.evaluations:.1f} force evaluations",
    }


def _tendons(robot: RobotParams) -> Table:
    """One row per tendon, with friction where there is any."""
    columns = [
        Column("name"),
        Column("offset mm", lambda t: f"({1e3 * t.offset[0]:.3g}, {1e3 * t.offset[1]:.3g})"),
        Column("end mm", "end", ".1f", "mm"),
        Column("routing", lambda t: f"{len(t.guides)} guides" if t.guides else "channel"),
        Column("pretension\nto limit N", lambda t: f"{t.pretension:g} to {t.tension_limit:g}"),
        Column("stiffness", lambda t: "inextensible" if isinf(s := t.stiffness) else f"{s:g} N/m"),
    ]
    if any(tendon.friction for tendon in robot.tendons):
        columns.append(Column("friction\nN", "friction", ".3g"))
    return make_table("Tendons", columns, robot.tendons)


def _errors_left_out(twin: Twin) -> list[str]:
    """Errors that a twin can have but this one does not, and those that no rig's scene has."""
    errors = {
        "servo offsets": any(twin.servo_offset),
        "backlash": any(twin.backlash),
        "tendon friction": any(tendon.friction for tendon in twin.robot.tendons),
        "precurvature": any(twin.robot.precurvature),
        "uneven stiffness": twin.robot.anisotropy > 0,
        "camera noise": twin.camera_noise > 0,
        "camera delay": twin.camera_delay > 0,
        "torsion": False,
    }
    return [name for name, there in errors.items() if not there]


def _as_built(env: TrackingEnv) -> dict[str, str]:
    """Rows for a robot driven by length: its servos and camera, and which rig it is."""
    twin = env.twin
    if twin is None:
        return {}
    speed = "any speed" if isinf(twin.servo_speed) else f"{1e3 * twin.servo_speed:.0f} mm/s"
    rows = {
        "servos": f"{speed}, offsets {_millimetres(twin.servo_offset)}, "
        f"backlash {_millimetres(twin.backlash)}",
        "camera": f"noise {1e3 * twin.camera_noise:g} mm, delay {1e3 * twin.camera_delay:.3g} ms",
    }
    if entry_of(env.task.robot).twin is None:
        return rows
    which = {
        "rig": "ideal" if twin.seed is None else f"twin {twin.seed}",
        "bending stiffness": _stiffness(twin.robot, env.task.robot),
    }
    return which | rows


def _action(env: TrackingEnv) -> dict[str, str]:
    """The row of the action."""
    scale = env.input_scale
    if env.twin is None:
        return {"action": f"{len(scale)} inputs, full scale {scale.tolist()} N"}
    scales = ", ".join(f"{1e3 * s:g}" for s in dict.fromkeys(scale.tolist()))
    return {"action": f"{len(scale)} lengths to pull in, full scale {scales} mm"}


def _stiffness(robot: RobotParams, nominal: RobotParams) -> str:
    share = robot.bending_stiffness / nominal.bending_stiffness
    return f"{1e3 * robot.bending_stiffness:.3g} mN m2, {share:.3f} of what policies know"


def _millimetres(lengths: tuple[float, ...]) -> str:
    return f"({', '.join(f'{1e3 * length:.3g}' for length in lengths)}) mm"
