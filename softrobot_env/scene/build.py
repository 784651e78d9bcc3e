"""Put a scene together: backbone, tendons, and only the optional parts that are listed."""

import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial

import mujoco
import numpy as np
from mujoco import MjData, MjModel, MjOption, MjSpec, mjtIntegrator
from numpy import ndarray

from softrobot_env.core.motion import State
from softrobot_env.robots import RobotParams

from . import contacts
from .config import SceneConfig
from .kinematics import Kinematics
from .quadrature import HingeLayout
from .resolution import Discretization, discretization, resolved
from .simulation import Inputs, SceneMotion, simulate
from .spec import build_chain, refuse_unfelt
from .statics import checked_controls, equilibrium, finite, settle, with_gravity
from .tangent import StaticForces
from .timestep import (
    EXTRAPOLATION,
    SAFETY,
    LinearChain,
    Pace,
    TimestepChoice,
    TimestepWarning,
    bent_beam,
    choose_timestep,
    extrapolation,
    linearize,
)


class CompiledModel:
    """What scenes of one robot and of several have in common.

    Attributes:
        model: The compiled model.
    """

    model: MjModel

    @property
    def n_inputs(self) -> int:
        """Number of inputs."""
        return self.model.nu

    @property
    def input_names(self) -> tuple[str, ...]:
        """Names of the inputs: tensions [N] (or lengths pulled in [m]), then loads' amplitudes.

        Of several robots with their prefixes, such as "finger1/upper_front"; motions of mounts are
        none.
        """
        return tuple(self.model.actuator(k).name for k in range(self.n_inputs))

    def start(self) -> State:
        """The straight pose at rest."""
        return State(self.model.qpos0.copy(), np.zeros(self.model.nv))

    def contacts(
        self, state: State | None = None, u: ndarray | None = None
    ) -> tuple[contacts.Touch, ...]:
        """What touches in a state under inputs u (n_inputs,), with its forces.

        Args:
            state: Positions and velocities; the straight pose at rest unless given.
            u: Zero unless given.
        """
        q, v = self.start() if state is None else state
        data = MjData(self.model)
        data.qpos[:] = finite("state.q", q, (self.model.nq,))
        data.qvel[:] = finite("state.v", v, (self.model.nv,))
        data.ctrl[:] = 0 if u is None else checked_controls(self.model, u)
        mujoco.mj_forward(self.model, data)
        return contacts.touches(self.model, data)


@dataclass(frozen=True)
class Scene(CompiledModel, Kinematics):
    """A compiled scene.

    Attributes:
        config: What was asked for.
        layout: Where the hinges stand.
        timestep: Integrator and timestep, and why.
        model: The compiled model.
        pairs: What can touch, and how stiff it is.
    """

    config: SceneConfig
    layout: HingeLayout
    timestep: TimestepChoice
    model: MjModel
    pairs: tuple[contacts.Pair, ...] = ()

    @property
    def scene(self) -> "Scene":
        """Itself, as parts of assemblies have theirs."""
        return self

    @property
    def discretization(self) -> Discretization:
        """How far its chain at rest is from the beam, without contacts; `scene.resolution`."""
        return discretization(self.config)

    @property
    def name(self) -> str:
        """The robot's."""
        return self.config.robot.name

    def equilibrium(
        self,
        u: ndarray | None = None,
        guess: ndarray | None = None,
        load_steps: int = 1,
        check_stability: bool | str = True,
        *,
        gravity: ndarray | None = None,
        by_servos: bool = False,
    ) -> ndarray:
        """Posture (nq,) in equilibrium under constant inputs u (n_inputs,), zero unless given.

        As `scene.statics.equilibrium`, which tells of the arguments and errors. Inputs may be what
        servos are commanded, `by_servos`, else they are where their horns are. With contacts it is
        where `scene.statics` finds rest; `load_steps` and the kind of stability have no meaning
        there, and as friction holds a robot in many places there must be none.
        """
        u = np.zeros(self.n_inputs) if u is None else u
        gravity = self.checked_gravity(gravity)
        if self.config.contacts is not None:
            return self._settled(u, guess, gravity)
        forces = None
        if by_servos:
            forces = StaticForces(with_gravity(self.model, gravity), by_servos=True)
        return equilibrium(self.model, u, guess, load_steps, check_stability, gravity, forces)

    def _settled(self, u: ndarray, guess: ndarray | None, gravity: ndarray | None) -> ndarray:
        """Posture (nq,) in which a scene with contacts comes to rest."""
        rubbing = [x.name for x in (self.config.contacts, *self.config.objects) if x.friction]
        if rubbing or self.config.robot.has_friction:
            raise ValueError(
                "friction holds a robot in many places: an equilibrium with contacts needs "
                f"friction 0 (of {', '.join(rubbing) or 'tendons and backbone'}), or use `simulate`"
            )
        model = with_gravity(self.model, gravity)
        start = model.qpos0 if guess is None else finite("the guess", guess, (model.nq,))
        controls, period = checked_controls(model, u), self.timestep.first_period
        return settle(model, self.config.robot, period, controls, start)

    def simulate(
        self,
        duration: float,
        u: Inputs = None,
        start: State | None = None,
        *,
        samples: ndarray | float | None = None,
        gravity: ndarray | None = None,
    ) -> SceneMotion:
        """Simulate a motion in the steps that environments take.

        As `scene.simulation.simulate`, which tells of the arguments and errors.
        """
        gravity = self.checked_gravity(gravity)
        return simulate(self, duration, u, start, samples=samples, gravity=gravity)

    def checked_gravity(self, gravity: ndarray | None) -> ndarray | None:
        """A gravity (3,) [m/s2] that the chain feels, or None.

        Raises:
            ValueError: It does not, or it is not finite.
        """
        if gravity is not None:
            gravity = finite("gravity", gravity, (3,))
            refuse_unfelt(self.config, gravity)
        return gravity


def build_scene(config: SceneConfig) -> Scene:
    """Build and compile a scene.

    Raises:
        ValueError: A part does not fit the robot; the message says which and why.

    Warns:
        TimestepWarning: See `scene.timestep.choose_timestep`.
    """
    config = resolved(config)
    spec, layout, pairs = _assemble(config)
    model, choice = compile_spec(spec, pairs, partial(_mujocos, config, pairs))
    if is_extrapolated(config):
        choice = _extrapolated(config, config.robot)
    elif config.actuation == "length" and not config.robot.drive.is_ideal:
        raise ValueError(
            f"robot {config.robot.name!r}: servos with a gain, spools that wind layers and wires "
            "that seat need our own integrator, which advances scenes without contacts and without "
            "bending_friction (leave out `integrator`, or the drive's keys)"
        )
    return Scene(config, layout, choice, model, tuple(pairs))


def is_extrapolated(config: SceneConfig) -> bool:
    """Whether our own integrator advances the scene: where no other is asked for or needed."""
    free = config.contacts is None and not config.robot.holds
    return free and config.integrator in (None, EXTRAPOLATION)


def _extrapolated(config: SceneConfig, robot: RobotParams) -> TimestepChoice:
    """How the scene with a robot, or a variation of it, is integrated by our own integrator."""
    winding = config.actuation == "length"
    return extrapolation(
        robot, config.control_period, config.wanted_accuracy, config.timestep, winding=winding
    )


def choice_of(scene: Scene, variation: dict[str, float]) -> TimestepChoice:
    """How a variation of a scene's robot is integrated, by values as `RobotParams.vary` takes them.

    Our own integrator looks after its error. MuJoCo's keep the scene's timestep: were it chosen
    anew, variations would differ by its error too.
    """
    if not is_extrapolated(scene.config):
        return scene.timestep
    return _extrapolated(scene.config, scene.config.robot.vary(**variation))


def paces_of(scene: Scene) -> Callable[[Mapping[str, ndarray]], Pace | None]:
    """Function from values (k,) of variations to the paces (k,) of their `TimestepChoice`.

    All else of their choices is the scene's. MuJoCo's integrators have none, None.
    """
    if not is_extrapolated(scene.config):
        return lambda variation: None
    beam = bent_beam(scene.config.robot, scene.config.actuation == "length")
    return lambda variation: beam.pace(variation, scene.config.control_period)


def vary_scene(scene: Scene, variation: dict[str, float]) -> Scene:
    """The scene of a varied robot, integrated as `choice_of` says.

    Where MuJoCo's timestep would be near its own stability limit it is chosen anew.
    """
    varied = build_scene(replace(scene.config, robot=scene.config.robot.vary(**variation)))
    choice, own = choice_of(scene, variation), varied.timestep
    same = own.integrator == choice.integrator
    if choice.integrator == EXTRAPOLATION or (
        same and choice.timestep > SAFETY * own.stability_limit
    ):
        return varied
    apply_choice(choice, varied.model.opt)
    contacts.tune(varied.model, varied.pairs, choice.timestep)
    return replace(varied, timestep=choice)


def scene_xml(config: SceneConfig) -> str:
    """The scene as MJCF, ready for any MuJoCo viewer."""
    config = resolved(config)
    spec, _, pairs = _assemble(config)
    return spec_xml(spec, pairs, partial(_mujocos, config, pairs))


def compile_spec(
    spec: MjSpec, pairs: Sequence[contacts.Pair], choose: Callable[[MjModel], TimestepChoice]
) -> tuple[MjModel, TimestepChoice]:
    """The model of a spec, with the integrator and timestep that a function chooses for it.

    What can touch is as stiff as the timestep allows.
    """
    model = spec.compile()
    choice = choose(model)
    apply_choice(choice, model.opt)
    if pairs:
        contacts.warn_of_solver(model)
    softest = contacts.tune(model, pairs, choice.timestep) if pairs else 1
    if softest != 1:
        remark = f"; contacts down to {softest:.2g} times the material's stiffness"
        choice = replace(choice, reason=choice.reason + remark)
    return model, choice


def spec_xml(
    spec: MjSpec, pairs: Sequence[contacts.Pair], choose: Callable[[MjModel], TimestepChoice]
) -> str:
    """The model of `compile_spec` as MJCF."""
    model, choice = compile_spec(spec, pairs, choose)
    apply_choice(choice, spec.option)
    contacts.write(spec, model, pairs)
    return spec.to_xml()


def _assemble(config: SceneConfig) -> tuple[MjSpec, HingeLayout, list[contacts.Pair]]:
    """Skin and objects come last, so that the robot's bodies and DOFs keep their numbers."""
    chain, pairs = build_chain(config), []
    if config.contacts is not None:
        surfaces = contacts.add_skin(chain, config.robot, config.contacts)
        pairs = contacts.connect(chain.spec, surfaces, config.objects, config.contacts)
    return chain.spec, chain.layout, pairs


def _mujocos(config: SceneConfig, pairs: Sequence[contacts.Pair], model: MjModel) -> TimestepChoice:
    """What MuJoCo's own steps of the model take: those of viewers, and of whoever steps it."""
    longest = None if config.contacts is None else contacts.longest_step(model, pairs)
    return choose_for([config], linearize(model), longest, is_extrapolated(config))


def choose_for(
    configs: Sequence[SceneConfig], chain: LinearChain, longest: float | None, extrapolated: bool
) -> TimestepChoice:
    """What MuJoCo's own steps of the robots of some scenes take together.

    Args:
        configs: Scenes of the same control period, timestep and integrator.
        chain: All of them in one model, linearised.
        longest: [s], timestep that resolves the contacts; None without any.
        extrapolated: Whether our own integrator advances them, so that nobody need be warned.
    """
    first = configs[0]
    with warnings.catch_warnings():
        if extrapolated:
            warnings.simplefilter("ignore", TimestepWarning)
        return choose_timestep(
            chain,
            first.control_period,
            first.timestep,
            None if first.integrator == EXTRAPOLATION else first.integrator,
            friction=any(config.robot.has_friction for config in configs),
            contacts=longest,
            links=max(config.n_hinges for config in configs),
        )


def apply_choice(choice: TimestepChoice, option: MjOption) -> None:
    """Let an option have MuJoCo's integrator and timestep of a choice."""
    option.timestep = choice.timestep
    option.integrator = getattr(mjtIntegrator, f"mjINT_{choice.integrator.upper()}")
