"""`softrobot robot-file` and `softrobot export`: robots as TOML files, and as MJCF."""

from argparse import Namespace

from softrobot_env.core.files import file_name, write_text
from softrobot_env.core.records import placed
from softrobot_env.robots import find_robot, read_robot
from softrobot_env.scene.build import build_scene, scene_xml
from softrobot_env.scene.config import attachable, visible
from softrobot_env.scene.registry import SCENES, scene_of

from .arguments import command
from .output import check_free, say

EXAMPLE = "softrobot robot-file check my.toml"


def _check(args: Namespace) -> int:
    """Read a file, build its scene and say what it is."""
    robot = read_robot(args.file)
    with placed(args.file):
        config = scene_of(robot)
        model = build_scene(config).model
    text = (
        f"{args.file}: OK: robot {robot.name}, {robot.length:g} m in "
        f"{len(robot.backbone.sections)} section(s), {len(robot.tendons)} tendon(s) driven by "
        f"{robot.drive.kind}, {len(robot.discs)} disc(s), "
        f"{len(robot.sensors)} sensor(s), {config.bending}, {model.nv} DOFs"
    )
    say(text, soft_wrap=True, highlight=False, markup=False)
    return 0


#: The commands of `softrobot robot-file`.
COMMANDS = {
    "check": (
        command(EXAMPLE, "file FILE  a robot file", _check),
        "check a robot file, and say what is wrong with it",
    )
}


def _export(args: Namespace) -> int:
    """Write scenes as MJCF: robots to attach, and views of them where they are mounted."""
    scenes = SCENES
    if args.robot is not None:
        scene = scene_of(find_robot(args.robot))
        scenes = {scene.robot.name: scene, f"{scene.robot.name}_view": visible(scene)}
    paths = {name: args.out / file_name(f"{name}.xml") for name in scenes}
    check_free(*paths.values(), overwrite=args.overwrite)
    for name, config in scenes.items():
        path = paths[name]
        if config.appearance is None:
            config, purpose = attachable(config), "in the axes of its base, to attach to a model"
        else:
            purpose = "where it is mounted, with lights and a wall, to look at"
        write_text(path, scene_xml(config))
        if config.actuation == "length" and not config.robot.drive.is_ideal:
            purpose += (
                "; without what MuJoCo has no word for: the loop, force and friction of servos, "
                "layers on their spools and the seating of wires"
            )
        say(f"Wrote {path}: {purpose}", soft_wrap=True, highlight=False, markup=False)
    return 0


#: `softrobot export`.
EXPORT = command(
    """softrobot export --out assets --overwrite
  softrobot export --robot my.toml --out out""",
    """
    --out DIR (out/assets)
    <overwrite>
    <robot> default: all registered scenes
    """,
    _export,
)
