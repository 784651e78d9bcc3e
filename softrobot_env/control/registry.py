"""Policies by name. A policy's own imports are loaded when it is built."""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from functools import partial
from importlib.util import find_spec
from inspect import signature
from pathlib import Path
from typing import Any
from warnings import warn

import gymnasium
import numpy as np
from numpy import ndarray

from softrobot_env.core.interfaces import Observation, Policy
from softrobot_env.core.records import Positive, check_argument
from softrobot_env.core.registry import (
    VARIANTS,
    OutsideError,
    Registry,
    is_path,
    load,
    load_given,
    outside,
    served,
)
from softrobot_env.robots import ENTRIES, RobotParams, default_robot, find_robot

from .base import MEASURED
from .reduced.environment import is_reduced_model, ssm_environment


class Acting:
    """A policy made from an object with `act(observation)`, which returns no state.

    The object may keep its own state between calls: it serves one environment.

    Attributes:
        name: Name of its class.
        requires: Observables that it is shown, if it declares them; else all.
    """

    def __init__(self, acting: Any) -> None:
        self.name, self._act = type(acting).__name__, acting.act
        if hasattr(acting, "requires"):
            self.requires = tuple(acting.requires)

    def predict(
        self,
        observation: Observation,
        state: Any = None,
        episode_start: ndarray | None = None,
        deterministic: bool = True,
    ) -> tuple[ndarray, Any]:
        """See `softrobot_env.core.interfaces.Policy`."""
        return np.asarray(self._act(observation)), state


class Model:
    """A model whose `observation_space` declares its observables, as in stable-baselines3.

    Attributes:
        requires: These observables.
        predict: Method of the model, see `softrobot_env.core.interfaces.Policy`.
    """

    def __init__(self, model: Any) -> None:
        self.predict = model.predict
        self.requires = tuple(model.observation_space.spaces)


def is_policy(made: Any) -> bool:
    """Whether an object has `predict` or `act`."""
    return any(callable(getattr(made, name, None)) for name in ("predict", "act"))


def no_policy(made: Any) -> str:
    """Message for an object that is not a policy."""
    return (
        "a policy has predict(observation, state, episode_start, deterministic) or "
        f"act(observation), and {type(made).__name__!r} has neither"
    )


def as_policy(made: Any, name: str) -> Policy:
    """An object as a policy.

    Raises:
        ValueError: It has neither `predict` nor `act`, or reads a vector of unknown contents.
    """
    if not is_policy(made):
        raise OutsideError(f"policy {name!r}: {no_policy(made)}")
    if not callable(getattr(made, "predict", None)):
        return Acting(made)
    known = getattr(made, "observation_space", None)
    if not hasattr(made, "requires") and len(getattr(known, "shape", None) or ()) == 1:
        raise ValueError(
            f"policy {name!r} reads one vector of {known.shape[0]} entries and does not tell of "
            "what: write it by `training.artifacts.save_vector_policy`, and give that file"
        )
    if hasattr(made, "requires") or not hasattr(known, "spaces"):
        return made
    return Model(made)


#: Ending of the files of trained networks.
NETWORK = ".npz"

#: What policies may measure: the full state; or only tip and curvatures, with an observer; or
#: readings of curvature sensors only, with their calibration and the observer.
SENSORS = "sensors"
FEEDBACKS = ("state", "output", SENSORS)


@dataclass(frozen=True)
class PolicySpec:
    """How to build a policy, and the environment it is meant for.

    Attributes:
        make: Its factory(nominal robot, control period [s], **options), or its path, or a finished
            policy.
        options: Keyword arguments of the factory.
        environment: Keyword arguments of the environment (`control_period`, `preview`) that differ
            from the defaults; or a function of the robot, or the path of either. None: the
            attribute `environment` of the factory.
        package: Package of the extra `mpc` that it needs, or None.
        robots: Function that returns what a robot lacks for this policy, or None if it fits. Our
            own policies check this in their factories.
    """

    make: Any
    options: dict[str, Any] = field(default_factory=dict)
    environment: dict[str, Any] | Callable[[RobotParams], dict[str, Any]] | str | None = field(
        default_factory=dict
    )
    package: str | None = None
    robots: Callable[[RobotParams], str | None] | None = None

    def loaded(self) -> Any:
        """The factory, or the policy."""
        return load(self.make) if isinstance(self.make, str) else self.make

    def takes(self, option: str) -> bool:
        """Whether the factory has a keyword argument of this name."""
        made = self.loaded()
        return callable(made) and option in signature(made).parameters

    def delay_options(self, camera_delay: float | None, delay: float = 0.0) -> dict[str, Any]:
        """The delays that the factory takes as arguments.

        Args:
            camera_delay: [s], of a camera, None without one; passed as `tip_delay`. The delay of
                the actions, by which the tip is seen later too, is added to it unless the factory
                takes that delay itself.
            delay: [s] of actions, passed as `action_delay`.
        """
        asked = {"action_delay": delay} if delay and self.takes("action_delay") else {}
        if not self.takes("tip_delay"):
            return asked
        late = camera_delay
        if late is None:
            late = signature(self.loaded()).parameters["tip_delay"].default
        return asked | {"tip_delay": late if asked else late + delay}

    @property
    def sees_late(self) -> bool:
        """Whether the policy accounts for the delay of the measured tip."""
        return self.takes("tip_delay") or self.takes("action_delay")


_FEEDFORWARD = "softrobot_env.control.feedforward"
_SCHEDULED = "softrobot_env.control.scheduled"
_LQI_TIMES, _LQ_TIMES = f"{_SCHEDULED}.timing:lqi", f"{_SCHEDULED}.timing:lq_preview"
_LQ_PREVIEW = f"{_SCHEDULED}.lq_preview:LQPreview"
_MPC_TIMES = f"{_SCHEDULED}.mpc:preview_environment"
_REDUCED = "softrobot_env.control.reduced.policy:ReducedPlanner"
_SSM = "softrobot_env.control.reduced.environment:ssm_environment"
_LEARNED = "softrobot_env.control.learned.neural:NeuralPolicy"


def _learned_environment(
    policy: str, robot: RobotParams, weights: Path | None = None
) -> dict[str, Any]:
    """What a trained network needs of an environment."""
    needed = load("softrobot_env.control.learned.neural:learned_environment")
    return needed(policy, robot, weights)


#: Policies for any robot.
POLICIES: dict[str, PolicySpec] = {
    "hold": PolicySpec("softrobot_env.control.base:Hold"),
    "feedforward": PolicySpec(f"{_FEEDFORWARD}.law:Feedforward"),
    "feedforward_pi": PolicySpec(f"{_FEEDFORWARD}.law:FeedforwardPI"),
    "static": PolicySpec(f"{_FEEDFORWARD}.law:Feedforward", {"closed": False}),
    "chain_dynamics": PolicySpec(f"{_FEEDFORWARD}.dynamics:InverseDynamics"),
    "chain_dynamics_pi": PolicySpec(f"{_FEEDFORWARD}.dynamics:InverseDynamicsPI"),
    "qs_nn": PolicySpec(
        f"{_FEEDFORWARD}.law:make_network", {}, {"control_period": 0.01, "preview": (0.2,)}
    ),
    "lqi": PolicySpec(f"{_SCHEDULED}.lqi:LQI", {}, _LQI_TIMES),
    "lq_preview": PolicySpec(_LQ_PREVIEW, {}, _LQ_TIMES),
    "lq_adaptive": PolicySpec(_LQ_PREVIEW, {"adaptive": True}, _LQ_TIMES),
    "mpc": PolicySpec(f"{_SCHEDULED}.mpc:WithoutPreview", {}, _LQI_TIMES, "daqp"),
    "mpc_preview": PolicySpec(f"{_SCHEDULED}.mpc:ScheduledMPC", {}, _MPC_TIMES, "daqp"),
    **{
        name: PolicySpec(_LEARNED, {"policy": name}, partial(_learned_environment, name))
        for name in ("imitation", "ppo", "sac", "ppo_randomized", "sac_randomized")
    },
}

#: Policies for any robot that comparisons include only on request.
INVERSE_POLICIES: dict[str, PolicySpec] = {
    "inverse_dynamics": PolicySpec(f"{_FEEDFORWARD}.dynamics:InverseDynamics"),
    "hybrid": PolicySpec(f"{_FEEDFORWARD}.dynamics:make_hybrid"),
}

#: Plans on a model of a robot's motion, learned by `softrobot train ssm`; one for the rig is
#: shipped.
REDUCED_POLICIES: dict[str, PolicySpec] = {
    name: PolicySpec(_REDUCED, {"constrained": package is not None}, _SSM, package)
    for name, package in (("ssm_mpc", "daqp"), ("ssm_lq", None))
}


def installed_policies() -> list[str]:
    """Names of the policies of `POLICIES` whose packages are installed."""
    packages = {name: spec.package for name, spec in POLICIES.items()}
    return [name for name, p in packages.items() if p is None or find_spec(p) is not None]


def home_robot(name: str) -> RobotParams:
    """The named robot that a policy was made for; for all others the default robot."""
    made_for = (entry.robot for entry in ENTRIES.values() if name in entry.policies)
    return next(made_for, None) or default_robot()


#: Every policy by name, those of other packages as well.
EVERY_POLICY: Registry[PolicySpec] = Registry(
    "policy", POLICIES | INVERSE_POLICIES | REDUCED_POLICIES
)

__getattr__ = served(__name__)


def register_policy(
    name: str,
    make: Any,
    robots: Iterable[str | RobotParams] | Callable[[RobotParams], str | None] | None = None,
    *,
    replace: bool = False,
    environment: Mapping[str, Any] | None = None,
    **options: Any,
) -> None:
    """Add a policy.

    Args:
        name: Its name.
        make: A class or function (nominal robot, control period [s], **options), its path
            "package.module:name" or "file.py:name", or a finished policy. The policy must have
            `predict(observation, state, episode_start, deterministic)`, as models of
            stable-baselines3 have, or `act(observation)`, which returns the action.
        robots: Which robots it can drive: their names or the robots themselves; or a function that
            returns what a robot lacks, None if it fits. By default any.
        replace: Whether it may replace another policy of this name.
        environment: Arguments of the environment that it needs (`control_period`, `preview`); by
            default those in the attribute `environment` of `make`.
        **options: Keyword arguments of the factory.

    Raises:
        ValueError: The name is taken, or the path is not valid.
        TypeError: `make` does not make a policy.
    """
    if isinstance(make, str) and not is_path(make):
        raise ValueError(f"policy {name!r}: {make!r} is not 'package.module:name'")
    if not isinstance(make, str) and not callable(make) and not is_policy(make):
        raise TypeError(f"policy {name!r}: {no_policy(make)}")
    fits = robots if robots is None or callable(robots) else _one_of(tuple(robots))
    spec = PolicySpec(
        make, options, None if environment is None else dict(environment), robots=fits
    )
    EVERY_POLICY.register(name, spec, replace)


def _one_of(robots: tuple[str | RobotParams, ...]) -> Callable[[RobotParams], str | None]:
    names = [robot if isinstance(robot, str) else robot.name for robot in robots]
    return lambda robot: None if robot.name in names else f"it drives {', '.join(names)} only"


def find_policy(which: str, robot: RobotParams | None = None) -> PolicySpec:
    """The policy of a name, or your own as `package.module:name`, `file.py:name` or `file.npz`.

    An npz file holds a trained network, or a model of `softrobot train ssm`, which `ssm_mpc` then
    uses. For a given robot this returns the variant that fits it, where the policy has variants.

    Raises:
        ValueError: Unknown name (the message lists the known ones), no such object or file, or it
            does not make a policy.
    """
    if which.endswith(NETWORK):
        return _network_file(Path(which))
    if not is_path(which):
        spec = EVERY_POLICY.find(which)
        return spec if robot is None else VARIANTS.find(f"policy {which}", robot) or spec
    found = load_given("policy", which)
    if not callable(found) and not is_policy(found):
        raise OutsideError(f"policy {which!r}: {no_policy(found)}")
    return PolicySpec(found, environment=None)


def _network_file(path: Path) -> PolicySpec:
    """The policy of a trained network's file, which declares its inputs, or of a learned model."""
    if not path.is_file():
        raise ValueError(f"no policy at {path}")
    weights = path.resolve()
    if is_reduced_model(path):
        needed = partial(ssm_environment, weights=weights)
        return PolicySpec(_REDUCED, {"weights": weights}, environment=needed, package="daqp")
    needed = partial(_learned_environment, path.stem, weights=weights)
    return PolicySpec(_LEARNED, {"policy": path.stem, "weights": weights}, needed)


def policy_name(which: str) -> str:
    """The name of a policy in reports: its own, the one in its module or file, or its file's."""
    return Path(which).stem if which.endswith(NETWORK) else which.rpartition(":")[2]


def fitting_policies(robot: RobotParams, control_period: float = 0.01) -> dict[str, str | None]:
    """For each installed policy by name, why it cannot drive a robot; None if it can."""
    ready = [name for name in EVERY_POLICY if name not in POLICIES or name in installed_policies()]
    return {name: incompatibility(name, robot, control_period) for name in ready}


def incompatibility(
    which: str, robot: RobotParams, control_period: float = 0.01, delay: float = 0.0
) -> str | None:
    """Why a policy cannot drive a robot, or compensate for a delay [s]; None if it can.

    Raises:
        ValueError: See `find_policy`.
        OutsideError: The object at a path is not a policy, or fails.
    """
    period = policy_environment(which, robot).get("control_period", control_period)
    try:
        policy = _made(which, find_policy(which, robot), robot, period, {})
    except ValueError as error:
        if is_path(which) and isinstance(error, OutsideError):
            raise
        return str(error)
    if not delay:
        return None
    from .delayed import unpredicted

    return unpredicted(policy, robot)


def misfit(which: str, robot: RobotParams, control_period: float = 0.01) -> str | None:
    """The former name of `incompatibility`; it warns."""
    warn("control.registry.misfit is incompatibility now", DeprecationWarning, stacklevel=2)
    return incompatibility(which, robot, control_period)


def make_policy(
    name: str,
    robot: RobotParams | gymnasium.Env,
    control_period: float | None = None,
    feedback: str = FEEDBACKS[0],
    sensors: str | Path | None = None,
    delay: float = 0.0,
    **options: Any,
) -> Policy:
    """Build a policy by name, and warm it up for a robot at rest.

    It decides a few times, so that it has compiled and loaded everything before control starts.

    Args:
        name: One of `EVERY_POLICY`, or your own as `package.module:name`, `file.py:name` or
            `file.npz` of a trained network.
        robot: The nominal robot, known to the policy; or an environment that has one, and perhaps a
            camera, whose delay is passed to factories that take `tip_delay`.
        control_period: [s] between calls of `predict`; by default the environment's.
        feedback: One of `FEEDBACKS`. Under "output" and "sensors", policies that use curvature
            rates get them from an observer. Under "sensors", tip and curvatures are computed from
            calibrated sensors (`sensing.reconstruction`). Policies that do not measure these are
            unchanged.
        sensors: File of that calibration; by default searched for next to the robot's file and
            among the artifacts.
        delay: [s], known delay of the actions. The policy is shown the robot and the reference
            predicted for that time (`control.delayed`): the environment needs
            `policy_environment(name, robot, delay)`, and the feedback must be the state. A factory
            that takes `tip_delay` gets the tip's delay plus this one, or this one separately if it
            also takes `action_delay`; its policy is shown the tip as measured.
        **options: Of the policy's factory, in addition to those of its name.

    Raises:
        ValueError: Unknown name; the message lists the known ones. Or a robot or control period
            that the policy cannot work with.
    """
    if feedback not in FEEDBACKS:
        raise ValueError(f"unknown feedback {feedback!r}; choose from {', '.join(FEEDBACKS)}")
    check_argument("robot", robot, RobotParams | gymnasium.Env)
    late = None
    if "learnt" in options:
        if "identified" in options:
            raise ValueError("give 'identified' alone, 'learnt' is its earlier name")
        warn("option 'learnt' of policies is 'identified' now", DeprecationWarning, stacklevel=2)
        options["identified"] = options.pop("learnt")
    if isinstance(robot, gymnasium.Env):
        own = robot.unwrapped
        _check_interface(name, own)
        control_period = own.control_period if control_period is None else control_period
        robot = own.task.robot
        late = getattr(getattr(own, "twin", None), "camera_delay", None)
        late = sensors_delay(robot) if feedback == SENSORS else late
    check_argument("control_period", control_period, Positive)
    spec = find_policy(name, robot)
    options = spec.delay_options(late, delay) | options
    policy = _warm(_made(name, spec, robot, control_period, options), robot)
    if delay:
        from .delayed import DelayCompensation

        if feedback != FEEDBACKS[0]:
            raise ValueError(f"delay: only with feedback {FEEDBACKS[0]!r}, not {feedback!r}")
        ahead = DelayCompensation(policy, robot, control_period, delay, spec.sees_late)
        policy = _warm(ahead, robot)
    if feedback != FEEDBACKS[0] and "curvature_rate" in getattr(policy, "requires", ()):
        from .observers import OutputFeedback

        policy = _warm(OutputFeedback(policy, robot, control_period), robot)
    if feedback == SENSORS and MEASURED.intersection(getattr(policy, "requires", ())):
        from .sensed import Sensed, load_reconstruction

        known = load_reconstruction(robot, sensors)
        policy = _warm(Sensed(policy, known, control_period), robot)
    return policy


def sensors_delay(robot: RobotParams) -> float | None:
    """Delay [s] of the slowest of a robot's sensors; None if it has none."""
    return max((sensor.delay for sensor in robot.sensors), default=None)


def _warm(policy: Policy, robot: RobotParams) -> Policy:
    """The policy, warmed up if it can be."""
    if hasattr(policy, "warm_up"):
        with outside("policy"):
            policy.warm_up(robot)
    return policy


def _check_interface(name: str, env: gymnasium.Env) -> None:
    """Raise ValueError for an environment with observations or actions unknown to policies."""
    shown, taken = getattr(env, "observe_as", "dict"), getattr(env, "act_as", "input")
    if (shown, taken) != ("dict", "input"):
        raise ValueError(
            f"policy {name!r} reads dicts and chooses inputs; this environment has "
            f"observe_as={shown!r} and act_as={taken!r}, made for learning libraries"
        )


def _made(
    name: str, spec: PolicySpec, robot: RobotParams, control_period: float, options: dict[str, Any]
) -> Policy:
    """The policy of an entry.

    Raises:
        ValueError: It cannot drive the robot, or is not a policy.
    """
    lacks = None if spec.robots is None else spec.robots(robot)
    if lacks:
        raise ValueError(f"policy {name!r} cannot drive robot {robot.name!r}: {lacks}")
    made, given = spec.loaded(), spec.options | options
    if callable(made) and (isinstance(made, type) or not is_policy(made)):
        try:
            signature(made).bind(robot, control_period, **given)
        except TypeError as error:
            raise OutsideError(
                f"policy {name!r}: what makes it must take (robot, control_period): {error}"
            ) from error
        with outside(f"policy {name!r}"):
            made = made(robot, control_period, **given)
    return as_policy(made, name)


def policy_environment(
    name: str, robot: RobotParams | str | None = None, delay: float = 0.0
) -> dict[str, Any]:
    """Keyword arguments that an environment needs for this policy; empty if the defaults suit it.

    Example: `gymnasium.make("SoftRobot/ArmSwing-v0", **policy_environment("lqi"))`.

    Args:
        name: One of `EVERY_POLICY`, or your own as `package.module:name`, `file.py:name` or
            `file.npz` of a trained network.
        robot: The robot that it drives, or its name or file; some policies decide at multiples of
            its first mode's period. By default the default robot.
        delay: [s] that the policy should compensate for, see `make_policy`.

    Raises:
        ValueError: Unknown name; the message lists the known ones.
    """
    robot = default_robot() if robot is None else find_robot(robot)
    spec = find_policy(name, robot)
    needed = spec.environment
    if needed is None:
        needed = getattr(spec.loaded(), "environment", {})
    with outside(f"policy {name!r}: its environment"):
        needed = load(needed) if isinstance(needed, str) else needed
        needed = dict(needed(robot) if callable(needed) else needed)
    if delay:
        needed["preview"] = (delay, *(delay + time for time in needed.get("preview", ())))
        needed["lead"] = delay
    return needed
