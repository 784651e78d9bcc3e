"""The scene of a gripper: its fingers, its palm and what it grips."""

from collections.abc import Sequence

from softrobot_env.robots.gripper import Gripper
from softrobot_env.robots.parameters import Pieces
from softrobot_env.scene.assembly import Assembly, Member
from softrobot_env.scene.config import Appearance, Camera, SceneConfig
from softrobot_env.scene.objects import Box, Contacts, Object

#: Name of the palm among objects.
PALM = "palm"

#: How fingers touch. They bend in planes of their own, and do not meet.
CONTACTS = Contacts(friction=0.8, between_robots=False)

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
    )


def _palm(gripper: Gripper) -> tuple[Object, ...]:
    if gripper.palm is None:
        return ()
    place = (0.0, 0.0, -gripper.palm[2] / 2)
    return (Box(name=PALM, size=gripper.palm, position=place, rgba=_PALM_RGBA),)
