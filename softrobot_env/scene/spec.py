"""A robot in a spec of its own, before it is compiled, with the parts that are listed."""

from collections.abc import Sequence

from mujoco import MjSpec, mjtDisableBit

from softrobot_env.robots.loads import refuse_out_of_plane, refuse_torsion, seen_from_base

from . import appearance
from .chain import Chain, add_chain, joint_kinds
from .config import SceneConfig
from .springs import add_springs, couple_pieces
from .tendons import add_tendons


def build_chain(config: SceneConfig) -> Chain:
    """The robot of a scene in a spec of its own, with all parts but contacts.

    Raises:
        ValueError: As `build_scene`.
    """
    refuse_unfelt(config, config.robot.gravity)
    layout, robot = config.layout, config.robot
    spec = empty_spec(robot.name, robot.gravity, friction=robot.has_friction)
    kinds = joint_kinds(robot, config.bending, config.torsion, layout.coupled)
    chain = add_chain(spec, robot, layout, kinds)
    add_tendons(chain, robot, config.actuation, config.exact_channels)
    add_springs(chain, robot, config.exact_channels)
    if layout.coupled:
        couple_pieces(chain, robot, [load.station for load in config.loads])
    for _ in config.sensors:
        appearance.add_tip_sensors(spec)
    for load in config.loads:
        appearance.add_load(chain, load)
    for camera in config.cameras:
        appearance.add_camera(spec, camera)
    for path in config.paths:
        appearance.add_path(spec, path)
    for marker in config.markers:
        appearance.add_marker(spec, marker)
    if config.appearance is not None:
        appearance.add_appearance(chain, robot, config.appearance)
    return chain


def refuse_unfelt(config: SceneConfig, gravity: Sequence[float]) -> None:
    """Refuse loads, gravity and tendons in directions in which the chain does not move."""
    robot = config.robot
    loads = seen_from_base(robot, config.loads)
    if config.bending == "planar":
        model, other = "a chain with bending='planar'", "bending='spatial'"
        refuse_out_of_plane(model, other, loads, robot.seen(tuple(gravity)))
        refuse_torsion(model, other, (), robot.tendons)
    elif not config.torsion:
        refuse_torsion("a chain with torsion=False", "torsion=True", loads, robot.tendons)


def empty_spec(name: str, gravity: Sequence[float], *, friction: bool) -> MjSpec:
    """Spec without contacts and MuJoCo's silent reset of a diverged state.

    Without constraints too, unless something rubs: MuJoCo's dry friction is one.
    """
    spec = MjSpec()
    spec.modelname = name
    spec.compiler.degree = False
    spec.option.gravity = gravity
    flags = mjtDisableBit.mjDSBL_CONTACT | mjtDisableBit.mjDSBL_AUTORESET
    if not friction:
        flags |= mjtDisableBit.mjDSBL_CONSTRAINT
    spec.option.disableflags = int(flags)
    return spec
