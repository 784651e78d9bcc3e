"""Tendons and their drives. Tensions pull: controls and actuator forces are never negative.

Every actuator has gear -1, so that a positive force shortens its tendon; no other place knows.
"""

import math
from dataclasses import replace

import mujoco
import numpy as np
from mujoco import MjData, MjModel, MjsActuator, MjsBody, MjsTendon, mjtBias, mjtGain, mjtTrn
from numpy import ndarray

from softrobot_env.robots import Drive, RobotParams, Tendon
from softrobot_env.robots.sections import Backbone

from .chain import Chain, is_swapped, rub, seen_from_hinges, station_stiffness
from .integration import layout as places
from .quadrature import HingeLayout

_PULL = [-1.0, 0, 0, 0, 0, 0]

#: p, q and c of the lines with which an exact channel crosses a station.
_LINES = ((8 / 7, 4 / 3, 0.0), (-1 / 7, 1.0, math.sqrt(7 / 12)))

#: About how many zones in which friction along tendons sticks or slides on its own a robot has. As
#: long as a tendon slides on from where it last turned round, a tip is off by up to a quarter of
#: what it would be if all of one zone slid: of a loop's width 1.3 % (12) or 4 % (6).
_ZONES = 24
#: Least stiffness of a slack wire, over its own [1].
SOFTEST = 1e-9

_UNSEEN = [0.0, 0.0, 0.0, 0.0]


def add_tendons(chain: Chain, robot: RobotParams, actuation: str, exact: bool = False) -> None:
    """Add all tendons of the robot with one actuator each, named alike.

    Args:
        chain: The chain.
        robot: The robot.
        actuation: "tension" or "length".
        exact: Whether channels are right to second order in the strains, else to first.

    Raises:
        ValueError: A tendon ends inside a piece, or is to be driven by length although its
            stiffness is infinite.
    """
    for tendon in robot.tendons:
        if tendon.guides:
            routed = route_through_guides(chain, tendon, tendon.name)
            length = tendon.straight_length
        elif exact:
            routed, length = _route_across_hinges(chain, tendon, robot.backbone)
        else:
            routed, length = _route_along_joints(chain, tendon, robot.backbone), 0.0
        if tendon.friction:
            rub(routed, tendon.friction)
        if tendon.has_capstan_friction:
            routed.userdata = _rubbing(chain, tendon, robot)
        actuator = chain.spec.add_actuator(
            name=tendon.name,
            target=tendon.name,
            trntype=mjtTrn.mjTRN_TENDON,
            gear=_PULL,
            ctrllimited=True,
        )
        if actuation == "tension":  # that is the control [N]
            actuator.set_to_motor()
            actuator.ctrlrange = [0.0, tendon.tension_limit]
        else:
            _pull_by_length(actuator, tendon, robot.most_pulled(tendon), length)
            if not robot.drive.is_ideal:
                actuator.gainprm[1:] = drive_parameters(robot.drive, tendon)
                actuator.ctrlrange[0] = max(actuator.ctrlrange[0], -robot.drive.most_let_out)


def _route_along_joints(chain: Chain, tendon: Tendon, backbone: Backbone) -> MjsTendon:
    """Tendon in a continuous channel, whose length changes by joint angles times moment arms.

    A channel at r(s) = (x, y) has the tangent e_z + r' + kappa x r. To first order in the strains
    its length changes at a station by -(x beta + y gamma) + (x y' - y x') tau, over the length
    sqrt(1 + x'^2 + y'^2) of its tangent in the straight robot. Of second order, and left out, is
    that a tension T makes torsion stiffer by T (x^2 + y^2), a share of about (1 + nu) times
    curvature times distance.
    """
    places, slopes = _course(chain, tendon, backbone)
    fixed = chain.spec.add_tendon(name=tendon.name)
    for index, ((x, y), (dx, dy)) in enumerate(zip(places.tolist(), slopes.tolist(), strict=True)):
        tangent = math.hypot(1.0, dx, dy)
        along, across = seen_from_hinges((x / tangent, y / tangent), chain.azimuth)
        fixed.wrap_joint(f"hinge{index}", -along)
        if "side" in chain.kinds:
            fixed.wrap_joint(f"side{index}", -across)
        if "twist" in chain.kinds and (dx or dy):
            fixed.wrap_joint(f"twist{index}", (x * dy - y * dx) / tangent)
    return fixed


def _route_across_hinges(
    chain: Chain, tendon: Tendon, backbone: Backbone
) -> tuple[MjsTendon, float]:
    """Tendon in a continuous channel, right to second order in the strains, and its length [m].

    The channel beside a station, which stands for w of beam and turns by theta, is d = w (e_z + r')
    in the straight robot and d + theta x r when it bends and twists. A line from the link below, at
    m - b / 2 from the hinges, to the link above, at m + b / 2, becomes

        b + theta x m + theta x (theta x b) / 8,

    seen from halfway: with m = r and b = d that is the channel, but for |theta x d|^2 / (8 |d|) by
    which bends make it too short, and of third order it is too short as well. Two lines together,
    m = p r + c b and b = q d, have all terms of second order and those of bends of third order if

        sum p = 1,  sum p^2 / q = 1,  sum q (c^2 - 1 / 4) = 0,  sum p (c^2 / 2 + 1 / 24) = 0,

    but for a product of bend and twist that changes its sign with c, as it does from station to
    station. What a link carries keeps its length: pulleys leave it out.
    """
    spatial, length, above = chain.spec.add_tendon(name=tendon.name), 0.0, 0.0
    spatial.rgba = _UNSEEN
    for index, (place, slope) in enumerate(zip(*_course(chain, tendon, backbone), strict=True)):
        hinge = chain.layout.stations[index] - above
        along = chain.layout.weights[index] * np.append(slope, 1.0)
        side = -1 if is_swapped(index) else 1
        for number, (share, stretch, shift) in enumerate(_LINES):
            if index or number:
                spatial.wrap_pulley(1.0)
            line = stretch * along
            middle = share * np.append(place, 0.0) + side * shift * line
            name = f"{tendon.name}_station{index}_{number}"
            below = middle - line / 2 + [0, 0, hinge]
            _thread(spatial, chain.bodies[index], f"{name}_below", below)
            _thread(spatial, chain.bodies[index + 1], f"{name}_above", middle + line / 2)
            length += float(np.linalg.norm(line))
        above = chain.layout.stations[index]
    return spatial, length


def _rubbing(chain: Chain, tendon: Tendon, robot: RobotParams) -> list[float]:
    """Where a tendon rubs, as `scene.integration.layout` has it.

    A path turns at a station by the change of its slope over what the station stands for, of a
    route with via-points with their kinks, and by its detour there.
    """
    layout = chain.layout
    count = int(np.searchsorted(layout.stations, tendon.end))
    shares = sum(other.end for other in robot.tendons if other.has_capstan_friction) / tendon.end
    most = min(count // (1 if shares == 1 else 2), round(_ZONES / shares))
    zones = max(1, min(most, len(tendon.guides) + 1) if tendon.guides else most)
    feed = tendon.feed_line.exponent if tendon.feed_line else 0.0
    out = [tendon.friction_coefficient, feed, float(zones)]
    if tendon.guides:
        return [*out, 0.0]
    ends = np.append(0.0, np.cumsum(layout.weights[:count]))
    slopes, place = tendon.slope(ends), tendon.at(layout.stations[:count])
    parts = layout.weights[:count, None]
    stations = np.hstack([place, slopes[:-1], slopes[1:], parts, _detours(tendon, ends)[:, None]])
    return [*out, count, *stations.ravel()]


def _detours(tendon: Tendon, ends: ndarray) -> ndarray:
    """How much more (n,) [rad] a channel turns between ends (n + 1,) [m] than there and there.

    In the straight robot; by sums over ever more parts, and what they tend to.
    """
    sums = []
    for parts in (1, 32, 64):
        s = ends[:-1, None] + np.diff(ends)[:, None] * np.linspace(0.0, 1.0, parts + 1)
        slopes = tendon.slope(s)
        ways = np.concatenate([slopes, np.ones((*s.shape, 1))], axis=2)
        sine = np.linalg.norm(np.cross(ways[:, 1:], ways[:, :-1]), axis=2)
        sums.append(np.arctan2(sine, (ways[:, 1:] * ways[:, :-1]).sum(axis=2)).sum(axis=1))
    return (4 * sums[2] - sums[1]) / 3 - sums[0]


def _thread(spatial: MjsTendon, body: MjsBody, name: str, place: ndarray, group: int = 4) -> None:
    """Let a tendon run on through a site of a body."""
    spatial.wrap_site(body.add_site(name=name, pos=place, size=[1e-3, 0, 0], group=group).name)


def _course(chain: Chain, tendon: Tendon, backbone: Backbone) -> tuple[ndarray, ndarray]:
    """Places (x, y) [m] of a channel at the stations up to its end, and their slopes, (n, 2) each.

    Of a route with via-points, whose slope jumps, those of the stations' shares of it, by how much
    each place bends.
    """
    _check_end(chain, tendon)
    layout = chain.layout
    stations = layout.stations[: np.searchsorted(layout.stations, tendon.end)]
    if tendon.is_straight or len(tendon.knots) == 2:
        return tendon.course(stations)
    cuts = np.union1d(layout.edges[layout.edges < tendon.end], tendon.knots[:, 0])
    s, weight = (x.ravel() for x in tendon.fine(cuts))
    bending, _ = station_stiffness(backbone, layout)
    shares = _shares(layout, s)[:, : len(stations)].T * weight / backbone.bending(s)
    shares *= (bending / layout.weights)[: len(stations), None]
    return tendon.wound(stations, *(shares @ x for x in replace(tendon, turns=0.0).course(s)))


def _shares(layout: HingeLayout, s: ndarray) -> ndarray:
    """Shares (k, stations) [1] of the stations of its piece in a place at arc lengths (k,) [m].

    A curvature that is a polynomial through its values at them is interpolated by them.
    """
    own = layout.piece == np.searchsorted(layout.edges[1:-1], s)[:, None]
    shares = own.astype(float)
    for k, station in enumerate(layout.stations):
        others = np.flatnonzero((layout.piece == layout.piece[k]) & (layout.stations != station))
        for other in layout.stations[others]:
            shares[:, k] *= (s - other) / (station - other)
    return shares


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


def route_through_guides(chain: Chain, tendon: Tendon, name: str) -> MjsTendon:
    """Add a straight-line tendon from the base through its guides to its end."""
    spatial = chain.spec.add_tendon(name=name)
    places = tendon.at(np.array(tendon.stations)).tolist()
    for index, (station, place) in enumerate(zip(tendon.stations, places, strict=True)):
        body, height = chain.locate(station)
        _thread(spatial, body, f"{name}_guide{index}", [*place, height], group=0)
    return spatial


def full_length(robot: RobotParams, model: MjModel) -> ndarray:
    """(n_tendons,) [m] inside the straight robot, less those that MuJoCo tells."""
    inside = robot.of_tendons("straight_length")
    return inside - model.tendon_length0[: len(inside)]


def _pull_by_length(actuator: MjsActuator, tendon: Tendon, most: float, straight: float) -> None:
    """Control = pulled-in length s [m]: F = F_pre + c (s - s_geo) between 0 and
    the tension limit, (2.91) to (2.99).

    s_geo = straight length - length is the part of the pull that the bending robot follows;
    under gear -1 MuJoCo's actuator length is minus the tendon length, which it takes for `straight`
    [m] in the straight pose. Controls are at most `most` [m] to either side.
    """
    if math.isinf(tendon.stiffness):
        raise ValueError(f"tendon {tendon.name!r} needs a finite stiffness to be driven by length")
    stiffness = tendon.stiffness
    actuator.gaintype, actuator.biastype = mjtGain.mjGAIN_FIXED, mjtBias.mjBIAS_AFFINE
    actuator.gainprm[0] = stiffness
    actuator.biasprm[:2] = tendon.pretension - stiffness * straight, -stiffness
    actuator.forcelimited = True
    actuator.forcerange = [0.0, tendon.tension_limit]
    actuator.ctrlrange = [-most, most]


def drive_parameters(drive: Drive, tendon: Tendon) -> ndarray:
    """(9,) what a servo and its wire have beside a stiffness, see `scene.integration.motors`.

    MuJoCo leaves these places of an actuator's `gainprm` unread.
    """
    stretch = tendon.pretension / tendon.stiffness
    seated = stretch
    if drive.seating:
        seated = drive.seating * float(_seated(2 * stretch / drive.seating))
    limit = min(drive.force_limit, places.HUGE_FORCE)
    wire = drive.seating, seated - stretch
    motor = drive.velocity_gain, drive.reflected_mass, drive.gear_friction, drive.encoder_step
    return np.array([*wire, drive.gain or 0.0, limit, drive.layers, *motor])


class Wires:
    """Wires of a robot on spools whose horns stay: lengths and tensions (n_tendons,)."""

    def __init__(self, robot: RobotParams) -> None:
        self._stiffness, self._pretension = map(robot.of_tendons, ("stiffness", "pretension"))
        self._seating, self._layers = robot.drive.seating, robot.drive.layers

    def tension(self, pulled: ndarray, shortened: ndarray) -> ndarray:
        """Tensions [N], negative if slack, of horns [m], of tendons that robots shorten [m]."""
        more = pulled + self._layers * pulled**2 - shortened
        if not self._seating:
            return self._pretension + self._stiffness * more
        stretch = self.stretch(self._pretension) + more
        toe = np.clip(stretch, 0.0, self._seating)
        taut = np.maximum(stretch - self._seating, 0.0)
        return self._stiffness * (np.minimum(stretch, 0.0) + toe**2 / (2 * self._seating) + taut)

    def pulled(self, tension: ndarray, shortened: ndarray) -> ndarray:
        """Where horns [m] are under tensions [N]."""
        length = shortened + self.stretch(tension, self._pretension)
        return 2 * length / (1 + np.sqrt(1 + 4 * self._layers * length))

    def stretch(self, tension: ndarray, less: ndarray | float = 0.0) -> ndarray:
        """Stretch [m] by tensions [N], less that by others."""
        if not self._seating:
            return (tension - less) / self._stiffness
        one, other = (2 * x / self._stiffness / self._seating for x in (tension, less))
        return self._seating * (_seated(one) - _seated(other))

    def stiffness(self, tension: ndarray) -> ndarray:
        """[N/m] under tensions [N]; of a slack one a little."""
        if not self._seating:
            return self._stiffness
        share = 2 * tension / self._stiffness / self._seating
        return self._stiffness * np.clip(np.sqrt(np.maximum(share, 0.0)), SOFTEST, 1.0)


def _seated(share: ndarray | float) -> ndarray:
    """Stretch over the seating of a tension over that at half of it."""
    return np.where(np.less(share, 1), np.sqrt(share), (np.asarray(share) + 1) / 2)


def is_ideal(model: MjModel) -> bool:
    """Whether MuJoCo's own law of an actuator is that of all servos and wires of a model."""
    by_length = model.actuator_biasprm[:, 1] < 0
    return not model.actuator_gainprm[by_length, 1:].any()


def set_coefficient(model: MjModel, coefficient: float) -> None:
    """Give all tendons of a model that rub along their way another friction coefficient [1]."""
    rubbing = model.tendon_user[:, places.ZONES] > 0
    model.tendon_user[rubbing, places.COEFFICIENT] = coefficient


def actuator_arms(model: MjModel, data: MjData) -> ndarray:
    """Moment arms (nu, nv) of actuators, of a state whose transmission is known."""
    out = np.zeros((model.nu, model.nv))
    rows = data.moment_rownnz, data.moment_rowadr, data.moment_colind
    if model.nu:
        mujoco.mju_sparse2dense(out, data.actuator_moment, *rows)
    return out


def tendon_arms(model: MjModel, data: MjData) -> ndarray:
    """Moment arms (ntendon, nv) of tendons, of a state whose tendons are known."""
    out = np.zeros((model.ntendon, model.nv))
    rows = model.ten_J_rownnz, model.ten_J_rowadr, model.ten_J_colind
    if model.ntendon:
        mujoco.mju_sparse2dense(out, data.ten_J, *rows)
    return out
