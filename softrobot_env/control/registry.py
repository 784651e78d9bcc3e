"""Policies by name. What a policy imports is loaded when it is built."""

from dataclasses import dataclass, field
from importlib.util import find_spec
from inspect import signature
from typing import TYPE_CHECKING, Any

from softrobot_env.fields import Positive, check_argument
from softrobot_env.registries import Registry, load
from softrobot_env.robots import RobotParams

if TYPE_CHECKING:
    from softrobot_env.control.base import Controller

#: What policies may measure: the full state, or tip and curvatures alone, with an observer.
FEEDBACKS = ("state", "output")


@dataclass(frozen=True)
class PolicySpec:
    """How to build a policy, and the environment it is meant for.

    Attributes:
        make: Path of its factory(nominal robot, control period [s], **options).
        options: Keyword arguments of the factory.
        environment: Keyword arguments of the environment (`control_period`, `preview`) where the
            policy needs others than the defaults; or their path.
        package: Package of the extra `mpc` that it needs, or None.
    """

    make: str
    options: dict[str, Any] = field(default_factory=dict)
    environment: dict[str, Any] | str = field(default_factory=dict)
    package: str | None = None

    def takes(self, option: str) -> bool:
        """Whether the factory has a keyword argument of this name."""
        return option in signature(load(self.make)).parameters


#: Policies of planar robots.
POLICIES: dict[str, PolicySpec] = {
    "hold": PolicySpec("softrobot_env.control.base:Hold"),
    "static": PolicySpec("softrobot_env.control.statics:StaticFeedforward"),
    "feedforward": PolicySpec("softrobot_env.control.arm.feedforward:Feedforward"),
    "feedforward_pi": PolicySpec("softrobot_env.control.arm.feedforward:FeedforwardPI"),
    "qs_nn": PolicySpec(
        "softrobot_env.control.arm.qs_nn:QuasiStaticNetwork",
        environment={"control_period": 0.01, "preview": (0.2,)},
    ),
    "lqi": PolicySpec("softrobot_env.control.arm.lqi:LQI", environment={"control_period": 0.001}),
    "lq_preview": PolicySpec(
        "softrobot_env.control.arm.lq_preview:LQPreview",
        environment="softrobot_env.control.arm.lq_preview:ENVIRONMENT",
    ),
    "lq_adaptive": PolicySpec(
        "softrobot_env.control.arm.lq_preview:LQPreview",
        {"adaptive": True},
        environment="softrobot_env.control.arm.lq_preview:ENVIRONMENT",
    ),
    "mpc": PolicySpec(
        "softrobot_env.control.mpc.controller:MPC",
        environment={"control_period": 0.01},
        package="daqp",
    ),
    "mpc_preview": PolicySpec(
        "softrobot_env.control.mpc.controller:make_preview",
        environment="softrobot_env.control.mpc.controller:PREVIEW_ENVIRONMENT",
        package="daqp",
    ),
    **{
        name: PolicySpec(
            "softrobot_env.control.arm.neural:NeuralPolicy",
            {"weights": f"{name}.npz"},
            environment="softrobot_env.control.arm.neural:ENVIRONMENT",
        )
        for name in ("imitation", "ppo", "sac", "ppo_randomized", "sac_randomized")
    },
}

#: Policies of the spatial test rig, whose environments have other observations and actions. All
#: but the inverse dynamics take as option `learnt` the identified parameters of one rig; without
#: it, they take those that are shipped, of twin 0.
RIG_POLICIES: dict[str, PolicySpec] = {
    name: PolicySpec(f"softrobot_env.control.rig.feedforward:{make}", options)
    for name, make, options in (
        ("rig_nn", "make_hybrid", {"model": "none"}),
        ("inverse_dynamics", "make_inverse", {}),
        ("inverse_dynamics_ahead", "make_inverse", {"ahead": True}),
        ("hybrid", "make_hybrid", {}),
        ("hybrid_ahead", "make_hybrid", {"ahead": True}),
        ("hybrid_flexible", "make_hybrid", {"model": "several pieces", "ahead": True}),
        (
            "hybrid_calibrated",
            "make_hybrid",
            {"model": "calibrated", "ahead": True, "backlash": True},
        ),
    )
}


def installed_policies() -> list[str]:
    """Names of the policies of `POLICIES` whose packages are installed."""
    packages = {name: spec.package for name, spec in POLICIES.items()}
    return [name for name, p in packages.items() if p is None or find_spec(p) is not None]


def _find(name: str) -> PolicySpec:
    return Registry("policy", POLICIES | RIG_POLICIES).find(name)


def make_policy(
    name: str,
    robot: RobotParams,
    control_period: float,
    feedback: str = FEEDBACKS[0],
    **options: Any,
) -> "Controller":
    """Build a policy by name.

    Args:
        name: One of `POLICIES` or `RIG_POLICIES`.
        robot: The nominal robot, which the policy may know.
        control_period: [s] between calls of `predict`.
        feedback: One of `FEEDBACKS`. Policies that use curvature rates get them from an observer
            under "output"; the others are the same under both.
        **options: Of the policy's factory, besides those of its name.

    Raises:
        ValueError: Unknown name; the message lists the known ones. Or a robot or control period
            that the policy cannot work with.
    """
    spec = _find(name)
    if feedback not in FEEDBACKS:
        raise ValueError(f"unknown feedback {feedback!r}; choose from {', '.join(FEEDBACKS)}")
    check_argument("robot", robot, RobotParams)
    check_argument("control_period", control_period, Positive)
    policy = load(spec.make)(robot, control_period, **(spec.options | options))
    if feedback == "state" or "curvature_rate" not in policy.requires:
        return policy
    from softrobot_env.control.arm.observer import OutputFeedback

    return OutputFeedback(policy, robot, control_period)


def policy_environment(name: str) -> dict[str, Any]:
    """Keyword arguments that an environment for this policy needs; none if any will do.

    `gymnasium.make("SoftRobot/ArmSwing-v0", **policy_environment("lqi"))` suits the policy.

    Raises:
        ValueError: Unknown name; the message lists the known ones.
    """
    needed = _find(name).environment
    return dict(load(needed) if isinstance(needed, str) else needed)
