"""Which law stands behind the names of policies that the thesis has for its rig."""

from pathlib import Path

from softrobot_env.control.feedforward.feedback import ReferenceFeedback
from softrobot_env.core.interfaces import Policy
from softrobot_env.core.registry import Registry
from softrobot_env.robots import CAMERA_PERIOD, EQUIVALENT, RobotParams

from .feedforward import RigFeedforward
from .inverse import OnePiece, SeveralPieces
from .parameters import IdentifiedParameters, turned

#: [m], how far beyond its points feedback may ask a network: the tip stays nearer.
_SHIFTED = 0.04

#: Name of a model -> how it is made, of the nominal rig and what is known of one.
_MODELS = Registry(
    "model",
    {
        "one piece": lambda robot, known: OnePiece(robot),
        "several pieces": lambda robot, known: SeveralPieces(turned(robot, EQUIVALENT, 0.0)),
        "calibrated": lambda robot, known: SeveralPieces(known.believed(robot)),
        "none": lambda robot, known: None,
    },
)


def make_inverse(robot: RobotParams, control_period: float, ahead: bool = False) -> Policy:
    """Inverse dynamics of a rig in one piece, in closed form.

    Args:
        robot: Nominal rig.
        control_period: [s] between calls.
        ahead: See `RigFeedforward`.
    """
    return RigFeedforward(robot, control_period, model=OnePiece(robot), ahead=ahead)


def make_hybrid(
    robot: RobotParams,
    control_period: float,
    identified: IdentifiedParameters | str | Path | None = None,
    model: str = "one piece",
    ahead: bool = False,
    backlash: bool = False,
    feedback: bool = False,
    tip_delay: float = CAMERA_PERIOD,
) -> Policy:
    """Statics of a network and the dynamic part of a model.

    Args:
        robot: Nominal rig.
        control_period: [s] between calls.
        identified: Identified parameters, or their file; those shipped, of twin 0, unless given.
        model: "one piece" of the nominal rig; "several pieces" of a rig that stands as that one
            does; "calibrated", several pieces of the rig as identified; or "none".
        ahead: See `RigFeedforward`.
        backlash: Whether to make up for the servos' delay and the backlash identified.
        feedback: Whether to feed the tip back by the chain of the rig as identified.
        tip_delay: [s], how late feedback sees the tip; unless given, by a frame of the camera.

    Raises:
        ValueError: Parameters of another robot, or another model.
        FileNotFoundError: No such file.
    """
    known = _identified(robot, identified)
    return RigFeedforward(
        robot,
        control_period,
        known,
        _MODELS.find(model)(robot, known),
        ahead,
        known.backlash if backlash else None,
        known.believed(robot) if feedback else None,
        tip_delay,
    )


def make_network_feedback(
    robot: RobotParams,
    control_period: float,
    identified: IdentifiedParameters | str | Path | None = None,
    proportional: float = 0.2,
    integral: float = 1.0,
    tip_delay: float = CAMERA_PERIOD,
) -> Policy:
    """Feedback of the tip around the statics of a network, by default with the thesis' gains.

    Args:
        robot, control_period, identified, tip_delay: As of `make_hybrid`.
        proportional: K_P [1].
        integral: K_I [1/s].

    Raises:
        ValueError, FileNotFoundError: As there.
    """
    network = RigFeedforward(robot, control_period, _identified(robot, identified), margin=_SHIFTED)
    return ReferenceFeedback(network, control_period, proportional, integral, tip_delay)


def _identified(
    robot: RobotParams, identified: IdentifiedParameters | str | Path | None
) -> IdentifiedParameters:
    """Identified parameters of a rig, or those of a file, or those shipped."""
    if isinstance(identified, IdentifiedParameters):
        return identified
    return IdentifiedParameters.load(robot, identified)
