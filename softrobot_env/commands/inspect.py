"""`softrobot inspect`: what a scene contains, what it leaves out, and what a step costs."""

import argparse
from math import isinf

import mujoco
from rich.console import Console
from rich.table import Table

from softrobot_env.benchmarks.timing import step_cost
from softrobot_env.commands.arguments import add_scene, add_task, scene_options
from softrobot_env.envs.tracking import TrackingEnv
from softrobot_env.robots import RobotParams, Tendon
from softrobot_env.scene.build import Scene
from softrobot_env.tasks import make_task

EXAMPLE = "softrobot inspect --task swing"

#: What a scene may leave out: description -> whether this model has it.
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


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of the command."""
    add_task(parser)
    add_scene(parser)


def run(args: argparse.Namespace) -> int:
    """Run the command."""
    env = TrackingEnv(make_task(args.task, args.step_width), **scene_options(args))
    console = Console()
    console.print(_overview(env))
    console.print(_tendons(env.task.robot))
    return 0


def _overview(env: TrackingEnv) -> Table:
    scene, model = env.scene, env.model
    out = Table(show_header=False, title=f"Task {env.task.label}, robot {env.task.robot.name}")
    rows = {
        "DOFs": f"{model.nv} hinges in {scene.layout.pieces} pieces, rule {scene.config.rule}",
        "bodies": f"{model.nbody - 1} links",
        "tendons, actuators": f"{model.ntendon}, {model.nu} ({scene.config.actuation})",
        "sensors": ", ".join(model.sensor(i).name for i in range(model.nsensor)) or "none",
        "left out": "; ".join(name for name, has in _OPTIONAL.items() if not has(model)),
        **_timing(scene),
        "observation": ", ".join(f"{k} {v.shape[0]}" for k, v in env.observation_space.items()),
        "action": f"{env.action_space.shape[0]} inputs, full scale {env.input_scale.tolist()} N",
    }
    for name, text in rows.items():
        out.add_row(name, text)
    return out


def _timing(scene: Scene) -> dict[str, str]:
    choice = scene.timestep
    cost = step_cost(scene.model)
    per_control = cost * choice.substeps
    return {
        "integrator": choice.integrator,
        "timestep": f"{1e3 * choice.timestep:.4g} ms, {choice.substeps} per control period",
        "timestep rule": choice.reason,
        "first mode": f"{1 / choice.first_period:.3f} Hz",
        "stability limit": f"{1e3 * choice.stability_limit:.4g} ms (linearised)",
        "cost per step": f"{1e6 * cost:.1f} us",
        "cost per control period": (
            f"{1e6 * per_control:.1f} us, {scene.config.control_period / per_control:.0f} x "
            "real time"
        ),
    }


def _tendons(robot: RobotParams) -> Table:
    out = Table(header_style="bold", title="Tendons")
    for heading in ("name", "offset mm", "end mm", "routing", "limit N", "stiffness"):
        out.add_column(heading)
    for tendon in robot.tendons:
        out.add_row(
            tendon.name,
            f"({1e3 * tendon.offset[0]:g}, {1e3 * tendon.offset[1]:g})",
            f"{1e3 * tendon.end:.1f}",
            _routing(tendon),
            f"{tendon.tension_limit:g}",
            "inextensible" if isinf(tendon.stiffness) else f"{tendon.stiffness:g} N/m",
        )
    return out


def _routing(tendon: Tendon) -> str:
    return f"{len(tendon.guides)} guides" if tendon.guides else "continuous channel"
