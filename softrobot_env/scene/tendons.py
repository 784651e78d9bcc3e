"""Tendons and their drives. Tensions pull: controls and actuator forces are never negative.

Every actuator has gear -1, so that a positive force shortens its tendon; no other place knows.
"""

import math

import mujoco
import numpy as np

from softrobot_env.robots import RobotParams, Tendon
from softrobot_env.scene.chain import Chain, seen_from_hinges

_PULL = [-1.0, 0, 0, 0, 0, 0]

#: MuJoCo's friction is a soft constraint: with its default impedance a tendon creeps while it
#: should stick.
FRICTION_IMPEDANCE = (0.9999, 0.9999, 0.001, 0.5, 2.0)
FRICTION_REFERENCE = (0.004, 1.0)  # time constant [s], damping ratio [1]


def add_tendons(chain: Chain, robot: RobotParams, actuation: str) -> None:
    """Add all tendons of the robot with one actuator each, named alike.

    Raises:
        ValueError: A tendon ends inside a piece, or is to be driven by length although its
            stiffness is infinite.
    """
    for tendon in robot.tendons:
        if tendon.guides:
            routed = route_through_guides(chain, tendon, tendon.name)
        else:
            routed = _route_through_channel(chain, tendon)
        if tendon.friction:
            _rub(routed, tendon.friction)
        if actuation == "tension":
            _pull_by_tension(chain.spec, tendon)
        else:
            _pull_by_length(chain.spec, tendon, robot.most_pulled(tendon))


def _rub(routed: mujoco.MjsTendon, friction: float) -> None:
    """Dry friction [N] against changes of the tendon's length, whatever its tension.

    It acts on slack tendons too, and can push there.
    """
    routed.frictionloss = friction
    routed.solimp_friction = FRICTION_IMPEDANCE
    routed.solref_friction = FRICTION_REFERENCE


def _route_through_channel(chain: Chain, tendon: Tendon) -> mujoco.MjsTendon:
    """Tendon in a continuous channel, whose length changes by joint angles times lever arms.

    A channel at r(s) = (x, y) has the tangent e_z + r' + kappa x r. To first order in the strains
    its length changes at a station by -(x beta + y gamma) + (x y' - y x') tau, over the length
    sqrt(1 + x'^2 + y'^2) of its tangent in the straight robot. Of second order, and left out, is
    that a tension T makes torsion stiffer by T (x^2 + y^2), a share of about (1 + nu) times
    curvature times distance.
    """
    _check_end(chain, tendon)
    fixed = chain.spec.add_tendon(name=tendon.name)
    for index, (*place, twist) in enumerate(_lever_arms(chain, tendon)):
        along, across = seen_from_hinges(place, chain.azimuth)
        fixed.wrap_joint(f"hinge{index}", -along)
        if "side" in chain.kinds:
            fixed.wrap_joint(f"side{index}", -across)
        if "twist" in chain.kinds and twist:
            fixed.wrap_joint(f"twist{index}", twist)
    return fixed


def _lever_arms(chain: Chain, tendon: Tendon) -> list[list[float]]:
    """[m]: x, y and x y' - y x' at the stations, over the length of the tangent."""
    stations = chain.layout.stations
    count = int(np.searchsorted(stations, tendon.end))
    if tendon.is_straight:
        return [[*tendon.offset, 0.0]] * count
    (x, y), (dx, dy) = (values.T for values in tendon.course(stations[:count]))
    return (np.stack([x, y, x * dy - y * dx]) / np.sqrt(1 + dx**2 + dy**2)).T.tolist()


def _check_end(chain: Chain, tendon: Tendon) -> None:
    edges = chain.layout.edges
    off = np.abs(edges - tendon.end)
    if off.min() > 1e-9 * chain.length / chain.layout.pieces:
        nearest = edges[off.argmin()]
        raise ValueError(
            f"tendon {tendon.name!r} ends inside a piece: choose the number of pieces so that "
            f"{tendon.end:g} m is a multiple of their length (the nearest ends at {nearest:g} m), "
            "or end a section there"
        )


def route_through_guides(chain: Chain, tendon: Tendon, name: str) -> mujoco.MjsTendon:
    """Add a straight-line tendon from the base through its guides to its end."""
    spatial = chain.spec.add_tendon(name=name)
    places = tendon.at(np.array(tendon.stations)).tolist()
    for index, (station, place) in enumerate(zip(tendon.stations, places, strict=True)):
        body, height = chain.locate(station)
        site = body.add_site(name=f"{name}_guide{index}", pos=[*place, height], size=[1e-3, 0, 0])
        spatial.wrap_site(site.name)
    return spatial


def straight_length(tendon: Tendon) -> float:
    """Length [m] MuJoCo reports in the straight pose (a channel counts from zero)."""
    return tendon.straight_length if tendon.guides else 0.0


def full_length(robot: RobotParams) -> np.ndarray:
    """(n_tendons,) [m] inside the straight robot, less those that MuJoCo tells."""
    return np.array([t.straight_length - straight_length(t) for t in robot.tendons])


def _add_actuator(spec: mujoco.MjSpec, tendon: Tendon) -> mujoco.MjsActuator:
    return spec.add_actuator(
        name=tendon.name,
        target=tendon.name,
        trntype=mujoco.mjtTrn.mjTRN_TENDON,
        gear=_PULL,
        ctrllimited=True,
    )


def _pull_by_tension(spec: mujoco.MjSpec, tendon: Tendon) -> None:
    """Control = tension [N]."""
    actuator = _add_actuator(spec, tendon)
    actuator.set_to_motor()
    actuator.ctrlrange = [0.0, tendon.tension_limit]


def _pull_by_length(spec: mujoco.MjSpec, tendon: Tendon, most: float) -> None:
    """Control = pulled-in length s [m]: F = F_pre + c (s - s_geo) between 0 and
    the tension limit, (2.91) to (2.99).

    s_geo = straight length - length is the part of the pull that the bending robot follows;
    under gear -1 MuJoCo's actuator length is minus the tendon length. Controls are at most `most`
    [m] to either side.
    """
    if math.isinf(tendon.stiffness):
        raise ValueError(f"tendon {tendon.name!r} needs a finite stiffness to be driven by length")
    actuator = _add_actuator(spec, tendon)
    stiffness = tendon.stiffness
    actuator.gaintype = mujoco.mjtGain.mjGAIN_FIXED
    actuator.gainprm[0] = stiffness
    actuator.biastype = mujoco.mjtBias.mjBIAS_AFFINE
    actuator.biasprm[0] = tendon.pretension - stiffness * straight_length(tendon)
    actuator.biasprm[1] = -stiffness
    actuator.forcelimited = True
    actuator.forcerange = [0.0, tendon.tension_limit]
    actuator.ctrlrange = [-most, most]
