"""The scene of a gripper: its fingers, its palm and what it grips."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import lcm

from softrobot_env.core.registry import Registry
from softrobot_env.robots.gripper import Gripper
from softrobot_env.robots.parameters import Pieces
from softrobot_env.scene.assembly import Assembly, Member
from softrobot_env.scene.config import Appearance, Camera, SceneConfig
from softrobot_env.scene.objects import Box, Contacts, Object

#: Name of the palm among objects.
PALM = "palm"

#: How fingers touch. They bend in planes of their own, and do not meet.
CONTACTS = Contacts(friction=0.8, between_robots=False)


@dataclass(frozen=True)
class Resolution:
    """How finely a gripper is simulated.

    Attributes:
        name: Key in `FINENESS`.
        pieces: Of a finger, over those of its robot; as many as a robot with contacts has if None.
        longer: Timestep over the rule's for contacts [1].
        contacts: How fingers touch.
    """

    name: str
    pieces: int | None
    longer: float
    contacts: Contacts

    def pieces_of(self, gripper: Gripper) -> int | None:
        """Pieces of each finger; None by the rule."""
        if self.pieces is None:
            return None
        return self.pieces * lcm(*(finger.robot.pieces for finger in gripper.fingers))


#: By the rule; and as quick as keeps bends within those of fingers' sensors, on average.
FINENESS = Registry(
    "fineness",
    {
        "rule": Resolution("rule", None, 1.0, CONTACTS),
        "quick": Resolution("quick", 2, 16.0, replace(CONTACTS, stopping=5.0, sideways=30.0)),
    },
)

#: Hinges of fingers: one in the middle of a piece, which with many pieces is enough.
RULE = "midpoint"

_PALM_RGBA = (0.35, 0.37, 0.4, 1.0)


def gripper_scene(
    gripper: Gripper,
    objects: Sequence[Object] = (),
    *,
    contacts: Contacts = CONTACTS,
    control_period: float = 0.02,
    pieces: Pieces | None = None,
    timestep: float | None = None,
    rule: str = RULE,
    felt_along: bool = False,
    appearance: Appearance | None = None,
    cameras: tuple[Camera, ...] = (),
) -> Assembly:
    """A gripper and what it grips; `build_assembly` builds it.

    Args:
        gripper: The gripper.
        objects: What it touches, beside its palm.
        contacts: How they touch.
        control_period, timestep: [s].
        pieces, rule: Of each finger; as a robot with contacts unless given.
        felt_along: Whether the force of each link on the last object is reported, too.
        appearance: Of the fingers; nothing is to be seen of them without.
        cameras: That look at it.
    """
    members = tuple(
        Member(
            finger.name,
            SceneConfig(
                finger.robot,
                pieces=pieces,
                rule=rule,
                control_period=control_period,
                timestep=timestep,
                appearance=appearance,
            ),
            finger.base,
        )
        for finger in gripper.fingers
    )
    return Assembly(
        gripper.name,
        members,
        gravity=gripper.gravity,
        contacts=contacts,
        objects=(*_palm(gripper), *objects),
        cameras=cameras,
        surroundings=bool(cameras),
        felt=objects[-1].name if objects else None,
        felt_along=felt_along,
    )


def _palm(gripper: Gripper) -> tuple[Object, ...]:
    if gripper.palm is None:
        return ()
    place = (0.0, 0.0, -gripper.palm[2] / 2)
    return (Box(name=PALM, size=gripper.palm, position=place, rgba=_PALM_RGBA),)
