"""Which law stands behind the names of policies that the thesis has for its rig.

Laws are loaded where they are made: those of networks do without compiled code.
"""

from pathlib import Path

from softrobot_env.core.interfaces import Policy
from softrobot_env.robots import CAMERA_PERIOD, RobotParams
from softrobot_env.robots.artifacts import find_artifact
from softrobot_env.thesis.rig.parameters import IdentifiedParameters
from softrobot_env.thesis.rig.three_tendons import is_rig

#: [m], how far beyond its points feedback may ask a network: the tip stays nearer.
_SHIFTED = 0.04


def make_inverse(robot: RobotParams, control_period: float, ahead: bool = False) -> Policy:
    """Inverse dynamics: of a rig in one piece, in closed form, of other robots by their chain.

    Args:
        robot: Nominal robot.
        control_period: [s] between calls.
        ahead: Of a rig, see `RigFeedforward`; a chain's law always looks ahead.

    Raises:
        ValueError: The robot has no tendons, or is no rig that the law looks ahead for.
    """
    from softrobot_env.control.feedforward.dynamics import InverseDynamics
    from softrobot_env.thesis.rig.feedforward import OnePiece, RigFeedforward

    if is_rig(robot):
        return RigFeedforward(robot, control_period, model=OnePiece(robot), ahead=ahead)
    _refuse_ahead(robot, ahead)
    return InverseDynamics(robot, control_period)


def make_hybrid(
    robot: RobotParams,
    control_period: float,
    learnt: IdentifiedParameters | str | Path | None = None,
    model: str = "one piece",
    ahead: bool = False,
    backlash: bool = False,
    feedback: bool = False,
    tip_delay: float = CAMERA_PERIOD,
) -> Policy:
    """Statics of a network and the dynamic part of a model.

    Args:
        robot: Nominal robot.
        control_period: [s] between calls.
        learnt: Identified parameters of a rig, or their file; of another robot the file of its
            network. Found unless given: of the rig the one shipped, of twin 0.
        model: Of a rig: "one piece" of the nominal one; "several pieces" of a rig that stands as
            that one does; "calibrated", several pieces of the rig as identified; or "none".
        ahead: Of a rig, see `RigFeedforward`.
        backlash: Of a rig, whether to make up for the servos' delay and the backlash identified.
        feedback: Of a rig, whether to feed the tip back by the chain of the rig as identified.
        tip_delay: [s], how late feedback sees the tip; unless given, by a frame of the camera.

    Raises:
        ValueError: No network of this robot, another model, or one that only a rig has.
        FileNotFoundError: No such file.
    """
    from softrobot_env.control.feedforward.dynamics import InverseDynamics
    from softrobot_env.thesis.rig import feedforward as rig

    if is_rig(robot):
        own = model, ahead, backlash, feedback, tip_delay
        return rig.make_hybrid(robot, control_period, _identified(robot, learnt), *own)
    if model != "one piece" or backlash or feedback:
        raise ValueError(
            f"robot {robot.name!r} has no identified model in pieces: it needs a head and three "
            "elastic tendons round it, as the rig has; take 'hybrid'"
        )
    _refuse_ahead(robot, ahead)
    if isinstance(learnt, IdentifiedParameters):
        raise ValueError(f"robot {robot.name!r} takes a network of its statics, not of a rig")
    weights = find_artifact(robot, "qs_nn") if learnt is None else learnt
    return InverseDynamics(robot, control_period, weights=weights)


def make_network_feedback(
    robot: RobotParams,
    control_period: float,
    learnt: IdentifiedParameters | str | Path | None = None,
    proportional: float = 0.2,
    integral: float = 1.0,
    tip_delay: float = CAMERA_PERIOD,
) -> Policy:
    """Feedback of the tip around the statics of a network, by default with the thesis' gains.

    Args:
        robot, control_period, learnt, tip_delay: As of `make_hybrid`.
        proportional: K_P [1].
        integral: K_I [1/s].

    Raises:
        ValueError, FileNotFoundError: As there.
    """
    from softrobot_env.control.feedforward.feedback import ReferenceFeedback
    from softrobot_env.thesis.rig.feedforward import RigFeedforward

    if not is_rig(robot):
        raise ValueError(
            f"robot {robot.name!r} is no rig with identified parameters: take 'feedforward_pi'"
        )
    known = _identified(robot, learnt)
    network = RigFeedforward(robot, control_period, known, margin=_SHIFTED)
    return ReferenceFeedback(network, control_period, proportional, integral, tip_delay)


def _identified(
    robot: RobotParams, learnt: IdentifiedParameters | str | Path | None
) -> IdentifiedParameters:
    """Identified parameters of a rig, or those of a file, or those shipped."""
    if isinstance(learnt, IdentifiedParameters):
        return learnt
    return IdentifiedParameters.load(robot, learnt)


def _refuse_ahead(robot: RobotParams, ahead: bool) -> None:
    if ahead:
        raise ValueError(
            f"robot {robot.name!r} is no rig, whose law looks ahead on demand: take "
            "'inverse_dynamics' or 'hybrid', which always do"
        )
