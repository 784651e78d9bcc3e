"""Write docs/reference from the code: the keys of robot files, and a page of every environment.

    python scripts/reference.py             # writes
    python scripts/reference.py --check     # says which page is stale, and changes nothing
    python scripts/reference.py --pictures  # draws the environments anew too, which needs OpenGL

What a key, a quantity or a term means is said in the docstrings of the records and in the tables
below; shapes, ranges, defaults and options are asked of the code.
"""

import inspect
import re
import sys
from argparse import ArgumentParser, RawDescriptionHelpFormatter
from collections.abc import Iterable, Iterator
from dataclasses import MISSING
from pathlib import Path
from types import NoneType, UnionType
from typing import Annotated, Any, Literal, Union, get_args, get_origin, get_type_hints

import gymnasium
import numpy as np

import softrobot_env  # noqa: F401  (registers the environments)
from softrobot_env.control.registry import make_policy
from softrobot_env.core.files import write_text
from softrobot_env.core.records import Entry, keys
from softrobot_env.envs.observations.table import OBSERVABLES, known_of
from softrobot_env.envs.options import REAL_OPTIONS, RESET_OPTIONS, SIMULATED_OPTIONS
from softrobot_env.envs.real import RealEnv
from softrobot_env.envs.rewards import REWARDS, GripReward
from softrobot_env.envs.simulation.grippers import KNOWN
from softrobot_env.robots.file import GRIPPER_TABLES, TABLES
from softrobot_env.tasks.gripper import SAMPLED, GripTask
from softrobot_env.tasks.spec import OPTIONS

ROOT = Path(__file__).resolve().parents[1]
REFERENCE = ROOT / "docs" / "reference"

#: What a table of a file is about, and how often it may be there.
HEADINGS = {
    "": "The robot",
    "base": "base = { ... }",
    "head": "[head]",
    "section": "[[section]]",
    "tendon": "[[tendon]]",
    "disc": "[[disc]]",
    "sensor": "[[sensor]]",
    "finger": "[[finger]]",
}
#: Defaults that files have and records do not.
FILE_DEFAULTS = {
    ("", "section"): "one at least",
    ("", "base"): "upright at the origin",
    ("section", "pieces"): "as many as `accuracy` requires",
    ("tendon", "offset_m"): "this, `radius_m` or `route_m`",
    ("tendon", "radius_m"): "this, `offset_m` or `route_m`",
    ("tendon", "end_m"): "this, `ends_at_section`, or the end of `route_m`",
    ("tendon", "ends_at_section"): "this, `end_m`, or the end of `route_m`",
    ("tendon", "group"): "number of the table, from 0",
    ("disc", "inertia_kg_m2"): "this, or `radius_m` and `thickness_m`",
    ("disc", "radius_m"): "see `inertia_kg_m2`",
    ("disc", "thickness_m"): "see `inertia_kg_m2`",
}
#: Meanings of keys where the docstring speaks of the field beside others, or of Python.
FILE_MEANINGS = {
    ("", "name"): "Name of the robot in results and messages",
    ("", "base"): "Where the robot is clamped and how it points",
    ("", "section"): "Sections of the backbone, from the base to the tip",
    ("", "stiff_azimuth_rad"): "Direction of the larger bending stiffness, from +x towards +y",
    ("", "precurvature_1_m"): "Curvature when nothing acts on the robot, towards +x and +y",
    ("base", "position_m"): "Position of the clamp in the world",
    ("base", "direction"): "Direction of the straight robot, of any length; [0, 0, -1] hangs down",
    ("base", "roll_rad"): "Turn about the robot's axis after that, from its x towards its y",
    ("head", "inertia_kg_m2"): "Moments of inertia about its centre, along x, y and z",
    ("disc", "inertia_kg_m2"): "Moments of inertia about its centre, along x, y and z",
    ("section", "outer_radius_m"): "Outer radius, or those at its base and tip, linear in between",
    ("section", "inner_radius_m"): "Inner radius, in the same way; 0 is solid",
    ("section", "youngs_modulus_Pa"): "Young's modulus",
    ("section", "poisson_ratio"): "Poisson's ratio",
    (
        "section",
        "damping_time_s",
    ): "Time mu of stiffness-proportional damping D = mu K; 0: undamped",
    ("tendon", "stiffness_N_m"): "Stiffness between drive and robot; tendons driven by length need "
    "a finite one",
    ("tendon", "speed_m_s"): "Speed at which a servo changes the length",
    ("tendon", "travel_m"): "Length pulled in by a full-scale action; unless given, what the "
    "robot's bending allows",
    ("tendon", "angle_deg"): "Turn from +x towards +y of the tendon, or the first of the names",
    ("sensor", "name"): "Unique name",
    ("sensor", "kind"): '"planar": fibre segments in series; "spatial": one fibre in, four out; '
    '"tags": markers seen by a camera',
    ("sensor", "begin_m"): "Arc length at which it begins",
    ("sensor", "end_m"): "Arc length at which it ends",
    ("sensor", "azimuth_rad"): "Direction of the first outgoing fibre, or that tags measure",
    ("sensor", "rate_Hz"): "Samples per second (T: 50)",
    ("finger", "name"): "Unique name",
    ("tendon", "name"): "A name, or a list of them: as many tendons at equal angles.",
    ("tendon", "route_m"): "Points [s, x, y], arc length and position in the cross-section, the "
    "first at s = 0: straight from one to the next.",
    ("tendon", "drive"): 'How all tendons of the robot are driven; "length" needs `stiffness_N_m`.',
}


# ---------------------------------------------------------------- tables
def table(head: str, lines: Iterable[Iterable[str]]) -> str:
    """A table in Markdown; bars in cells are kept."""
    names = head.split(" | ")
    rows = [names, ["---"] * len(names), *lines]
    return "\n".join("| " + " | ".join(c.replace("|", "\\|") for c in row) + " |" for row in rows)


def attributes(kind: type) -> dict[str, str]:
    """What a docstring says of its attributes, by name."""
    text = inspect.getdoc(kind).partition("Attributes:\n")[2].partition("\n\n")[0]
    found = {}
    for names, said in re.findall(r"^    (\w+(?:, \w+)*): (.*(?:\n     .*)*)", text, re.M):
        found |= dict.fromkeys(names.split(", "), re.sub(r"\s+", " ", said).rstrip("."))
    return found


def meanings(kind: type) -> dict[str, str]:
    """The same without shapes and units at the beginning, which have columns of their own."""
    found = {}
    for name, said in attributes(kind).items():
        plain = re.sub(r"^(\(\d,\) )?(\[[^\]]*\](,|(?= )|$) ?)?", "", said) or name
        found[name] = plain[0].upper() + plain[1:]
    return found


def kind_of(hint: Any) -> str:
    """The type of a value in a file."""
    if get_origin(hint) is Annotated:
        return kind_of(get_args(hint)[0])
    if get_origin(hint) in (Union, UnionType):
        return " or ".join(dict.fromkeys(kind_of(h) for h in get_args(hint) if h is not NoneType))
    if get_origin(hint) is tuple:
        first, *others = get_args(hint)
        many = "" if Ellipsis in others else f"{1 + len(others)} "
        plural = re.sub("^(list|whole number|number|table|text)", r"\1s", kind_of(first))
        return f"list of {many}{plural}"
    if get_origin(hint) is Literal:
        return "text"
    return {float: "number", int: "whole number", str: "text", bool: "true or false"}.get(
        hint, "table"
    )


def allowed(entry: Entry) -> str:
    """What a key may hold beyond its type."""
    text = re.sub(r"^None or ", "", entry.rule.allowed)
    text = re.sub(r"a tuple(?: of \d+)?, each (?:entry )?", "each ", text)
    text = re.sub(r"each each |^a whole number,? |^a text$|^a finite number$", "", text)
    return "" if entry.kind else text


def default(entry: Entry) -> str:
    """The default of a key, as a file would have it."""
    value = entry.default
    if value is MISSING:
        return "needed"
    if value is None or value == ():
        return "none"
    if isinstance(value, str):
        return f'`"{value}"`'
    value = entry.unit.written(value) if entry.unit else value
    return f"`{list(value)}`" if isinstance(value, tuple) else f"`{value:.4g}`"


def key_table(name: str, kinds: tuple[type, ...]) -> str:
    """The keys of a table of a file."""
    lines = []
    for kind in kinds:
        said, hints = meanings(kind), get_type_hints(kind, include_extras=True)
        for key, entry in keys(kind).items():
            lines.append(
                (
                    f"`{key}`",
                    kind_of(hints[entry.name]),
                    entry.unit.name if entry.unit else "",
                    FILE_DEFAULTS.get((name, key)) or default(entry),
                    allowed(entry),
                    FILE_MEANINGS.get((name, key)) or said[entry.name],
                )
            )
    return table("key | type | unit | default | range | meaning", lines)


def robot_file() -> str:
    """The page of the keys of robots' and grippers' files."""
    parts = [
        "# Keys of a robot file",
        "A robot is a TOML file ([how to write one](../howto/own_robot.md)); `softrobot robot-file "
        "check my.toml` names what is wrong in it. Every key, with its unit in its name:",
    ]
    for name, kinds in TABLES.items():
        parts += [f"## {HEADINGS[name]}", key_table(name, kinds)]
    parts += [
        "(T) marks a value printed in the thesis, (I) one inferred from it, (S) an assumption.",
        "# Keys of a gripper file",
        "A gripper is a file of its own, which names a robot file for each finger "
        "([gripper](../howto/gripper.md)).",
    ]
    for name, kinds in GRIPPER_TABLES.items():
        title = "The gripper" if not name else HEADINGS[name]
        parts += [f"## {title}", key_table(name, kinds)]
    return page(parts, "the records of `softrobot_env.robots`")


def page(parts: list[str], source: str) -> str:
    """A page, which says where it comes from."""
    note = f"<!-- Written by scripts/reference.py from {source}; do not edit. -->"
    return "\n\n".join([*parts[:1], note, *parts[1:]]) + "\n"


# ---------------------------------------------------------------- environments
#: What the environments are about.
ABOUT = {
    "SoftRobot/ArmStep-v0": "The target of the planar arm's tip jumps.",
    "SoftRobot/ArmSwing-v0": "The planar arm's tip follows an arc through nearly its whole "
    "workspace, then rests.",
    "SoftRobot/ArmLShape-v0": "The planar arm's tip follows two straight legs with a corner.",
    "SoftRobot/ArmCircle-v0": "The planar arm's tip follows a circle.",
    "SoftRobot/ArmFigureEight-v0": "The planar arm's tip follows a figure eight.",
    "SoftRobot/ArmRandom-v0": "The planar arm's tip follows a smooth random path, a new one in "
    "every episode unless `seed` is given.",
    "SoftRobot/RigTriangle-v0": "The tip of the spatial test rig follows a triangle.",
    "SoftRobot/RigCircle-v0": "The tip of the spatial test rig follows a circle.",
    "SoftRobot/RigReach-v0": "The tip of the spatial test rig goes to random target points, new "
    "ones in every episode unless `seed` is given.",
    "SoftRobot/Real-v0": "A real robot whose file says its hardware, or a virtual one.",
    "SoftRobot/RealRig-v0": "The real test rig, or a virtual one, over a serial line.",
    "SoftRobot/Track-v0": "The tip of any robot follows a path in its workspace. Here with "
    '`robot="hanging_trunk"`; shapes and bounds follow from the robot.',
    "SoftRobot/GripperEnclose-v0": "Three fingers enclose a clamped round bar.",
    "SoftRobot/GripperHold-v0": "Three fingers grasp a free round bar and hold it under a pull and "
    "shaking.",
}
#: What a page shows an environment with.
SHOWN = {"SoftRobot/Track-v0": {"robot": "hanging_trunk"}}

OBSERVED = {
    "tip_position": "tip, as measured",
    "tip_velocity": "its velocity",
    "curvature": "mean curvature of each piece; in space about both axes, and torsion if it twists",
    "curvature_rate": "its rate",
    "tendon_tension": "tensions applied",
    "tendon_length": "of tendons: length inside the robot, or pulled in where servos drive them",
    "reference": "target of the tip",
    "reference_velocity": "its velocity",
    "reference_acceleration": "its acceleration",
    "reference_preview": "targets after each of the times `preview`",
    "sensors": "readings of the robot's curvature sensors",
    "previous_action": "inputs in force, as a share of full scale",
    "contact": "size of each finger's force on the bar",
}
INFO = {
    "time": ("s", "of the episode"),
    "error": ("m", "distance of the tip from its target"),
    "tendon_tension": ("N", "tensions applied"),
    "tendon_length": ("m", "lengths of tendons, or pulled in by servos"),
    "integration_error": ("m", "estimated error of the motion in time, since the reset"),
    "discretization_error": ("m", "estimated error of the chain at rest"),
    "success": ("", "of the grip, at the end of the episode"),
    "bar_position": ("m", "middle of the bar"),
}
ENDS = (
    "`truncated` when the duration is over; `terminated` when the simulation diverges{more}. "
    '`info["failure"]` then says what happened, and the observation is the last valid one.'
)
TRACKING_ENDS = (
    ", a piece bends more sharply than its inner side allows, or the tip moves faster than is "
    "physically possible for its material"
)


LEARNING = (
    'With `observe_as="vector"`, `reward="log"` and `act_as="change"` are the defaults '
    "([learning libraries](../../howto/learning_libraries.md)); your own terms: "
    "[own rewards](../../howto/environments.md#your-own-reward-and-observation)."
)


def units(name: str) -> str:
    """Unit of an observable."""
    return {"contact": "N"}.get(name) or OBSERVABLES[name].unit


def bound(low: np.ndarray, high: np.ndarray) -> str:
    """Bounds of a box, or the range of them."""
    return f"{low.min():.3g} to {high.max():.3g}"


def boxes(spaces: gymnasium.spaces.Dict) -> Iterator[tuple[str, ...]]:
    """Rows of a dict of observations."""
    for name, box in spaces.items():
        yield f"`{name}`", str(box.shape), units(name), bound(box.low, box.high), OBSERVED[name]


def reward_rows(reward: Any) -> Iterator[tuple[str, str]]:
    """Terms of a reward with its own weights."""
    if hasattr(reward, "grip"):
        yield "`reward_grip`", f"{reward.grip:g} exp(-e), e the error"
    else:
        scales = 1e3 * reward.coarse_scale, 1e3 * reward.fine_scale
        yield "`reward_tracking`", f"{reward.tracking:g} exp(-e / {scales[0]:g} mm), e the error"
        yield "`reward_precision`", f"{reward.precision:g} exp(-e / {scales[1]:g} mm)"
    yield "`reward_effort`", f"-{reward.effort:g} mean(a²), a the inputs over full scale"
    yield "`reward_smoothness`", f"-{reward.smoothness:g} mean(Δa²), Δa their change in a step"
    yield "`reward_failure`", f"{reward.failure:g} in a step that fails, where the others are 0"


def task_options(env: Any) -> list[tuple[str, str]]:
    """Options of the environment's task with their defaults."""
    maker = env.current_task.maker if hasattr(env, "current_task") else None
    found = inspect.signature(maker).parameters.values() if maker else ()
    return [
        (f"`{one.name}`", "none" if one.default is None else f"`{one.default}`")
        for one in found
        if one.default is not inspect.Parameter.empty and one.name in OPTIONS
    ]


def environment(env_id: str) -> str:
    """The page of an environment that is simulated."""
    chosen = SHOWN.get(env_id, {})
    made = gymnasium.make(env_id, **chosen)
    env, grips = made.unwrapped, "Gripper" in env_id
    _, info = made.reset(seed=0)
    vector = gymnasium.make(env_id, observe_as="vector", **chosen)
    more = [f', {name}="{value}"' for name, value in chosen.items()]
    seen = KNOWN if grips else known_of(env.task.robot)
    reward = GripReward() if grips else REWARDS["tracking"](env.task.robot)
    hidden = [f"`{name}`" for name in seen if name not in env.observation_space.spaces]
    ends = TRACKING_ENDS
    if grips:
        ends = ", or the bar is lost" if env.task.free else ""
    facts = [
        ("robot", f"`{env.gripper.name if grips else env.task.robot.name}`"),
        ("task", f"`{env.task.name}`"),
        ("control period", f"{1e3 * env.control_period:g} ms (`control_period=`)"),
        ("episode", f"{env.task.duration:g} s"),
        ("actions", f"`Box(-1, 1, {made.action_space.shape}, float32)`: {action(env, grips)}"),
        ("vector", f'{vector.observation_space.shape[0]} entries with `observe_as="vector"`'),
    ]
    parts = [
        f"# {env_id.removeprefix('SoftRobot/')}",
        ABOUT[env_id],
        f"![{env_id}](../../pictures/environments/{short(env_id)}.png)",
        f'```python\nimport gymnasium\n\nimport softrobot_env\n\nenv = gymnasium.make("{env_id}"'
        f"{''.join(more)})\n```",
        table("property | value", facts),
        "## Observations",
        "A dict of float64 arrays:",
        table("key | shape | unit | bounds | meaning", boxes(env.observation_space)),
        f'On request, by `observe=(...)` or `observe="all"`: {", ".join(hidden)}.',
        "## Reward",
        "The sum of these terms, which are also in `info`:",
        table("term | value", reward_rows(reward)),
        "" if grips else LEARNING,
        "## End of an episode",
        ENDS.format(more=ends),
        "## info",
        table("key | shape | unit | meaning", info_rows(info, grips)),
        "With `randomization=`, `info` also has `variation_...` for what was sampled, and with "
        "sensor noise the true `tip_position`."
        if not grips
        else "",
        "## Options of reset",
        table("option | unit | in place of the sample", grip_options())
        if grips
        else table("option | meaning", reset_options(SIMULATED_OPTIONS)),
    ]
    if options := task_options(env):
        parts += [
            "## Options of the task",
            "Keyword arguments of `gymnasium.make`, in SI units:",
            table("option | default", options),
        ]
    for one in (made, vector):
        one.close()
    return page([part for part in parts if part], "the environment itself")


def short(env_id: str) -> str:
    """Name of an environment in files."""
    return env_id.removeprefix("SoftRobot/").removesuffix("-v0")


def action(env: Any, grips: bool) -> str:
    """What an action stands for."""
    if grips:
        return "the tension of each tendon, from none at -1 to its limit at 1"
    if env.task.robot.drive.kind == "length":
        return f"lengths to pull in, full scale {scales(env)} mm"
    return f"tensions of opposing tendons, full scale {scales(env)} N"


def scales(env: Any) -> str:
    """Full scale of an action, for people."""
    factor = 1e3 if env.task.robot.drive.kind == "length" else 1.0
    return ", ".join(dict.fromkeys(f"{factor * x:.3g}" for x in env.input_scale))


def info_rows(info: dict[str, Any], grips: bool) -> Iterator[tuple[str, ...]]:
    """Rows of what `info` holds beside the terms of the reward."""
    known = INFO | grip_info() if grips else INFO
    for name, value in info.items():
        if not name.startswith("reward_"):
            unit, text = known[name]
            yield f"`{name}`", str(np.shape(value)), unit, text


def grip_info() -> dict[str, tuple[str, str]]:
    """Unit and meaning of what a gripper reports otherwise than a robot, by name."""
    said, plain = attributes(GripTask), meanings(GripTask)
    unit = {name: re.match(r"\[([^\]]*)\]|", said[name])[1] or "" for name in SAMPLED}
    found = {name: (unit[name], f"sampled: {plain[name]}") for name in SAMPLED}
    return found | {"error": ("1", "error of the grip over what counts as success")}


def grip_options() -> list[tuple[str, ...]]:
    """Options of a gripper's reset."""
    known = grip_info()
    return [(f"`{name}`", known[name][0], meanings(GripTask)[name]) for name in SAMPLED]


def reset_options(names: Iterable[str]) -> list[tuple[str, str]]:
    """Options of a reset."""
    return [(f"`{name}`", RESET_OPTIONS[name].text) for name in names]


def real(env_id: str) -> str:
    """The page of a real robot, of which nothing can be asked without one."""
    _, mark, said = inspect.getdoc(RealEnv).partition("What differs")
    if not mark:
        raise ValueError("the docstring of RealEnv has no part that begins with 'What differs'")
    said = mark + said.partition("Attributes:")[0]
    parts = [
        f"# {env_id.partition('/')[2]}",
        ABOUT[env_id],
        "Actions, observations, rewards and tasks are those of "
        + (
            "[RigTriangle](RigTriangle.md); [the real rig](../../howto/hardware.md)"
            if "RealRig" in env_id
            else "[Track](Track.md) for a robot driven by length; [motors](../../howto/motors.md)"
        )
        + " says how to start it, also without hardware.",
        said.strip(),
        "## Options of reset",
        table("option | meaning", reset_options(REAL_OPTIONS)),
    ]
    return page(parts, "the docstring of `RealEnv`")


def overview() -> str:
    """The page that lists the environments."""
    lines = [
        (f"[`{env_id}`](environments/{short(env_id)}.md)", text) for env_id, text in ABOUT.items()
    ]
    names = "\n".join(f"environments/{short(env_id)}" for env_id in ABOUT)
    parts = [
        "# All environments",
        "Spaces, reward, end of an episode and `info` of each id. [Environments](../howto/"
        "environments.md) says how to use them, `softrobot_env.envs.config.EnvConfig` has all "
        "options.",
        table("id | task", lines),
        f"```{{toctree}}\n:hidden:\n\n{names}\n```",
    ]
    return page(parts, "the registered environments")


def pages() -> dict[Path, str]:
    """Every page and its text."""
    made = {"robot_file.md": robot_file(), "environments.md": overview()}
    for env_id in ABOUT:
        text = real(env_id) if "Real" in env_id else environment(env_id)
        made[f"environments/{short(env_id)}.md"] = text
    return {REFERENCE / name: text for name, text in made.items()}


def draw() -> None:
    """Draw every environment a second after its start, driven by `static`; grippers close."""
    import imageio.v3

    folder = ROOT / "docs" / "pictures" / "environments"
    folder.mkdir(parents=True, exist_ok=True)
    for env_id in ABOUT:
        if "Real" in env_id:
            continue
        options = SHOWN.get(env_id, {}) | {"render_mode": "rgb_array", "width": 320, "height": 240}
        env = gymnasium.make(env_id, **options)
        seen, _ = env.reset(seed=0)
        policy = None if "Gripper" in env_id else make_policy("static", env)
        state, over = None, False
        while not over:
            if policy is None:
                action = np.zeros(env.action_space.shape, np.float32)
            else:
                action, state = policy.predict(seen, state)
            seen, _, terminated, truncated, info = env.step(action)
            over = terminated or truncated or info["time"] >= 1.0
        imageio.v3.imwrite(folder / f"{short(env_id)}.png", env.render())
        env.close()


def main() -> int:
    """Write or check the pages; 1 where one is stale under `--check`."""
    parser = ArgumentParser(description=__doc__, formatter_class=RawDescriptionHelpFormatter)
    parser.add_argument("--check", action="store_true", help="change nothing")
    parser.add_argument("--pictures", action="store_true", help="draw the environments anew")
    args = parser.parse_args()
    if args.pictures:
        draw()
    stale = 0
    for path, text in pages().items():
        if not path.is_file() or path.read_text(encoding="utf-8") != text:
            stale += 1
            print(f"{path.relative_to(ROOT)} is stale")
            if not args.check:
                write_text(path, text)
    return int(bool(stale) and args.check)


if __name__ == "__main__":
    sys.exit(main())
