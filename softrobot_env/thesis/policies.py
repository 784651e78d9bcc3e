"""Policies of the thesis' arm and rig by name; what they import is loaded when they are made."""

from softrobot_env.control.registry import EVERY_POLICY, PolicySpec
from softrobot_env.core.registry import VARIANTS
from softrobot_env.robots import RobotParams
from softrobot_env.training.registry import register_training

from .rig.three_tendons import is_rig
from .robots import RIG

_ARM, _RIG = "softrobot_env.thesis.arm", "softrobot_env.thesis.rig"
_IS_ARM, _IS_PLANAR_ARM = f"{_ARM}.timing:is_arm", f"{_ARM}.timing:is_planar_arm"
_IS_RIG = f"{_RIG}.three_tendons:is_rig"
_LAW, _PLAN = f"{_ARM}.policies:make_lq_preview", f"{_ARM}.policies:make_mpc"
_QS = {"control_period": 0.01, "preview": (0.2,)}
_LQ, _MPC = f"{_ARM}.timing:LQ_ENVIRONMENT", f"{_ARM}.mpc_settings:PREVIEW_ENVIRONMENT"


def _no_rig(robot: RobotParams) -> str | None:
    """What a robot lacks that laws of the rig cannot drive."""
    if is_rig(robot):
        return None
    return (
        "it needs a head and three elastic tendons round it, as the rig has; take "
        "'inverse_dynamics', 'hybrid' or 'feedforward_pi'"
    )


_CALIBRATED = {"model": "calibrated", "ahead": True, "backlash": True}

#: Policies of the spatial test rig. They take as option `identified` the parameters of one rig;
#: without it, they take those that are shipped, of twin 0.
RIG_POLICIES: dict[str, PolicySpec] = {
    name: PolicySpec(f"{_RIG}.policies:{make}", options, robots=_no_rig)
    for name, make, options in (
        ("rig_nn", "make_hybrid", {"model": "none"}),
        ("rig_nn_p", "make_network_feedback", {"integral": 0.0}),
        ("rig_nn_pi", "make_network_feedback", {}),
        ("inverse_dynamics", "make_inverse", {}),
        ("inverse_dynamics_ahead", "make_inverse", {"ahead": True}),
        ("hybrid", "make_hybrid", {}),
        ("hybrid_ahead", "make_hybrid", {"ahead": True}),
        ("hybrid_flexible", "make_hybrid", {"model": "several pieces", "ahead": True}),
        ("hybrid_calibrated", "make_hybrid", _CALIBRATED),
        ("hybrid_feedback", "make_hybrid", _CALIBRATED | {"feedback": True}),
    )
}

#: Name -> the robots of a closed form, and its policy.
_VARIANTS = {
    "qs_nn": (_IS_ARM, PolicySpec(f"{_ARM}.qs_nn:make_network", {}, _QS)),
    "lqi": (_IS_ARM, PolicySpec(f"{_ARM}.policies:make_lqi", {}, f"{_ARM}.timing:LQI_ENVIRONMENT")),
    "lq_preview": (_IS_ARM, PolicySpec(_LAW, {}, _LQ)),
    "lq_adaptive": (_IS_ARM, PolicySpec(_LAW, {"adaptive": True}, _LQ)),
    "mpc": (_IS_PLANAR_ARM, PolicySpec(_PLAN, {}, {"control_period": 0.01}, "daqp")),
    "mpc_preview": (_IS_PLANAR_ARM, PolicySpec(_PLAN, {"preview": True}, _MPC, "daqp")),
    "inverse_dynamics": (_IS_RIG, RIG_POLICIES["inverse_dynamics"]),
    "hybrid": (_IS_RIG, RIG_POLICIES["hybrid"]),
}

#: Name -> the robots of a closed form, and what trains its policy.
_TRAININGS = {
    "qs_nn": (f"{_ARM}.training:is_the_arm", f"{_ARM}.training:train_network"),
    "lqi": (_IS_ARM, f"{_ARM}.training:train_lqi"),
    "lq_preview": (_IS_ARM, f"{_ARM}.training:train_lq_preview"),
    "mpc": (_IS_PLANAR_ARM, f"{_ARM}.training:train_nothing"),
    "mpc_preview": (_IS_PLANAR_ARM, f"{_ARM}.training:train_nothing"),
}


def register() -> None:
    """Register policies and trainings of the rig, and the closed forms."""
    for name, spec in RIG_POLICIES.items():
        if name not in EVERY_POLICY.registered():
            EVERY_POLICY.register(name, spec)
    VARIANTS.register("visits", _IS_RIG, f"{_RIG}.parameters:VISITING")
    for name, (fits, train) in _TRAININGS.items():
        VARIANTS.register(f"training {name}", fits, train)
    register_training("rig_nn", f"{_RIG}.parameters:train", RIG, options=("twin",))
    for name, (fits, spec) in _VARIANTS.items():
        VARIANTS.register(f"policy {name}", fits, spec)
