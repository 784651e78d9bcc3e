"""Put a scene together: backbone, tendons, and only the optional parts that are listed."""

from dataclasses import dataclass, replace

import mujoco

from softrobot_env.scene import extras
from softrobot_env.scene.appearance import add_appearance
from softrobot_env.scene.chain import Chain, add_chain, joint_kinds
from softrobot_env.scene.config import SceneConfig
from softrobot_env.scene.quadrature import HingeLayout, place_hinges
from softrobot_env.scene.springs import add_springs
from softrobot_env.scene.tendons import add_tendons
from softrobot_env.scene.timestep import SAFETY, TimestepChoice, choose_timestep, linearize


@dataclass(frozen=True)
class Scene:
    """A compiled scene.

    Attributes:
        config: What was asked for.
        layout: Where the hinges stand.
        timestep: Integrator and timestep, and why.
        model: The compiled model.
    """

    config: SceneConfig
    layout: HingeLayout
    timestep: TimestepChoice
    model: mujoco.MjModel


def build_scene(config: SceneConfig) -> Scene:
    """Build and compile a scene.

    Raises:
        ValueError: A part does not fit the robot; the message says which and why.

    Warns:
        TimestepWarning: See `scene.timestep.choose_timestep`.
    """
    spec, layout = _assemble(config)
    model = spec.compile()
    choice = _timestep(config, model)
    _apply(choice, model.opt)
    return Scene(config, layout, choice, model)


def at_timestep_of(scene: Scene, other: Scene) -> Scene:
    """The scene, from now on with the timestep of another one of the same control period.

    It stays as it is if that timestep would be near its own stability limit.
    """
    choice, wanted = scene.timestep, other.timestep
    if wanted.timestep > SAFETY * choice.stability_limit:
        return scene
    kept = replace(choice, timestep=wanted.timestep, substeps=wanted.substeps)
    _apply(kept, scene.model.opt)
    return replace(scene, timestep=kept)


def scene_xml(config: SceneConfig) -> str:
    """The scene as MJCF, ready for any MuJoCo viewer."""
    spec, _ = _assemble(config)
    _apply(_timestep(config, spec.compile()), spec.option)
    return spec.to_xml()


def _assemble(config: SceneConfig) -> tuple[mujoco.MjSpec, HingeLayout]:
    layout = place_hinges(config.robot.length, config.n_pieces, config.rule)
    spec = _empty_spec(config)
    kinds = joint_kinds(config.robot, config.bending, config.torsion)
    chain = add_chain(spec, config.robot, layout, kinds)
    add_tendons(chain, config.robot, config.actuation)
    add_springs(chain, config.robot)
    _add_parts(chain, config)
    return spec, layout


def _timestep(config: SceneConfig, model: mujoco.MjModel) -> TimestepChoice:
    return choose_timestep(
        linearize(model),
        config.control_period,
        config.timestep,
        config.integrator,
        friction=config.robot.rubs,
    )


def _apply(choice: TimestepChoice, option: mujoco.MjOption) -> None:
    option.timestep = choice.timestep
    option.integrator = getattr(mujoco.mjtIntegrator, f"mjINT_{choice.integrator.upper()}")


def _empty_spec(config: SceneConfig) -> mujoco.MjSpec:
    """Spec without contacts and MuJoCo's silent reset of a diverged state.

    Without constraints too, unless a tendon rubs: MuJoCo's dry friction is one.
    """
    spec = mujoco.MjSpec()
    spec.modelname = config.robot.name
    spec.compiler.degree = False
    spec.option.gravity = config.robot.gravity
    disable = mujoco.mjtDisableBit
    flags = disable.mjDSBL_CONTACT | disable.mjDSBL_AUTORESET
    if not config.robot.rubs:
        flags |= disable.mjDSBL_CONSTRAINT
    spec.option.disableflags = int(flags)
    return spec


def _add_parts(chain: Chain, config: SceneConfig) -> None:
    for _ in config.sensors:
        extras.add_tip_sensors(chain.spec)
    for load in config.loads:
        extras.add_load(chain, load)
    for camera in config.cameras:
        extras.add_camera(chain.spec, camera)
    for path in config.paths:
        extras.add_path(chain.spec, path)
    for marker in config.markers:
        extras.add_marker(chain.spec, marker)
    if config.appearance is not None:
        add_appearance(chain, config.robot, config.appearance)
