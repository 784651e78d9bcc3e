"""Put a scene together: backbone, tendons, and only the optional parts that are listed."""

import warnings
from dataclasses import dataclass, replace

import mujoco

from softrobot_env.scene import extras
from softrobot_env.scene.appearance import add_appearance
from softrobot_env.scene.chain import Chain, add_chain, joint_kinds
from softrobot_env.scene.config import SceneConfig
from softrobot_env.scene.quadrature import HingeLayout, place_hinges
from softrobot_env.scene.tendons import add_tendons
from softrobot_env.scene.timestep import (
    EXTRAPOLATION,
    SAFETY,
    TimestepChoice,
    TimestepWarning,
    choose_timestep,
    extrapolation,
    linearize,
)


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
    choice = _mujocos(config, model)
    _apply(choice, model.opt)
    if is_extrapolated(config):
        choice = _extrapolated(config)
    return Scene(config, layout, choice, model)


def is_extrapolated(config: SceneConfig) -> bool:
    """Whether our own integrator advances the scene: where no other is asked for."""
    return config.integrator in (None, EXTRAPOLATION)


def _extrapolated(config: SceneConfig) -> TimestepChoice:
    winding = config.actuation == "length"
    return extrapolation(
        config.robot,
        config.control_period,
        config.wanted_accuracy,
        config.timestep,
        winding=winding,
    )


def choice_of(scene: Scene, variation: dict[str, float]) -> TimestepChoice:
    """How a variation of a scene's robot is integrated, by values as `RobotParams.vary` takes them.

    Our own integrator looks after its error. MuJoCo's keep the scene's timestep: were it chosen
    anew, variations would differ by its error too.
    """
    config = replace(scene.config, robot=scene.config.robot.vary(**variation))
    return _extrapolated(config) if is_extrapolated(config) else scene.timestep


def vary_scene(scene: Scene, variation: dict[str, float]) -> Scene:
    """The scene of a varied robot, integrated as `choice_of` says.

    Where MuJoCo's timestep would be near its own stability limit it is chosen anew.
    """
    varied = build_scene(replace(scene.config, robot=scene.config.robot.vary(**variation)))
    choice = choice_of(scene, variation)
    if choice.integrator == EXTRAPOLATION or _near_its_limit(varied, choice):
        return varied
    _apply(choice, varied.model.opt)
    return replace(varied, timestep=choice)


def _near_its_limit(scene: Scene, choice: TimestepChoice) -> bool:
    own = scene.timestep
    return own.integrator == choice.integrator and choice.timestep > SAFETY * own.stability_limit


def scene_xml(config: SceneConfig) -> str:
    """The scene as MJCF, ready for any MuJoCo viewer."""
    spec, _ = _assemble(config)
    _apply(_mujocos(config, spec.compile()), spec.option)
    return spec.to_xml()


def _assemble(config: SceneConfig) -> tuple[mujoco.MjSpec, HingeLayout]:
    layout = place_hinges(config.robot.length, config.n_pieces, config.rule)
    spec = _empty_spec(config)
    kinds = joint_kinds(config.robot, config.bending, config.torsion)
    chain = add_chain(spec, config.robot, layout, kinds)
    add_tendons(chain, config.robot, config.actuation)
    _add_parts(chain, config)
    return spec, layout


def _mujocos(config: SceneConfig, model: mujoco.MjModel) -> TimestepChoice:
    """What MuJoCo's own steps of the model take: those of viewers, and of whoever steps it."""
    with warnings.catch_warnings():
        if is_extrapolated(config):
            warnings.simplefilter("ignore", TimestepWarning)
        return choose_timestep(
            linearize(model),
            config.control_period,
            config.timestep,
            None if config.integrator == EXTRAPOLATION else config.integrator,
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
