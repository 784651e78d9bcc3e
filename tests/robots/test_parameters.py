"""Robots: derived values, tendon redundancy, variation, shape."""

from dataclasses import replace
from math import inf, nan, pi

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.optimize import linprog
from support.routed_robots import TWO

from softrobot_env.robots import (
    ARM,
    CANTILEVER_STIFF,
    CANTILEVER_WEAK,
    RIG,
    Base,
    Disc,
    Drive,
    Finger,
    Tendon,
    centerline,
    find_gripper,
    find_robot,
)
from softrobot_env.robots.actuation import TendonMap, robot_inputs
from softrobot_env.robots.artifacts import fingerprint
from softrobot_env.robots.twin import nominal_twin
from softrobot_env.robots.variations import neutral
from softrobot_env.thesis.rig.three_tendons import ThreeTendons

NEUTRAL = neutral(robots_only=True)

# ---------------------------------------------------------------- derived values


@pytest.mark.parametrize(
    ("robot", "quantity", "printed"),
    [
        (ARM, "bending_stiffness", "0.21054"),
        (ARM, "area", "1.47262e-3"),
        (ARM, "mass", "0.7879"),
        (CANTILEVER_WEAK, "bending_stiffness", "0.26210"),
        (CANTILEVER_WEAK, "torsional_stiffness", "0.26210"),
        (CANTILEVER_WEAK, "area", "2.82743e-3"),
        (CANTILEVER_WEAK, "first_frequency", "0.6588"),
        (CANTILEVER_STIFF, "bending_stiffness", "0.82838"),
        (CANTILEVER_STIFF, "torsional_stiffness", "0.82838"),
        (CANTILEVER_STIFF, "area", "5.02655e-3"),
        (CANTILEVER_STIFF, "first_frequency", "5.4903"),
    ],
    ids=lambda v: getattr(v, "name", v),
)
def test_numbers_of_the_audit(robot, quantity, printed):
    """Every printed digit, hence half a unit in the last place."""
    mantissa, _, exponent = printed.partition("e")
    last_place = 10.0 ** (int(exponent or 0) - len(mantissa.partition(".")[2]))
    assert abs(getattr(robot, quantity) - float(printed)) <= 0.5 * last_place


@pytest.mark.parametrize("ratio", [0.0, 0.3, 0.49])
def test_torsional_stiffness_is_shear_modulus_times_polar_moment(ratio):
    robot = replace(ARM, poisson_ratio=ratio)
    shear_modulus = robot.youngs_modulus / (2 * (1 + ratio))
    polar = pi / 2 * (robot.outer_radius**4 - robot.inner_radius**4)
    assert robot.torsional_stiffness == pytest.approx(shear_modulus * polar, rel=1e-13)


def test_parameters_of_the_arm():
    """Audit sec. 2: six pieces of 1/12 m, pairs that end at pieces 2, 4, 6, on the surface."""
    assert ARM.length / ARM.pieces == pytest.approx(1 / 12)
    assert [t.end / (ARM.length / ARM.pieces) for t in ARM.tendons] == pytest.approx(
        [2, 2, 4, 4, 6, 6]
    )
    assert [t.offset for t in ARM.tendons] == [(0.025, 0.0), (-0.025, 0.0)] * 3
    assert ARM.gravity == (0, 0, 0)
    assert ARM.damping_time * ARM.youngs_modulus == pytest.approx(36.6e3)
    assert all(t.pretension == 0 and t.stiffness == inf and not t.guides for t in ARM.tendons)


# ---------------------------------------------------------------- tendon redundancy


def pretensioned(*pretensions):
    """The arm with one pretension [N] per tendon."""
    tendons = (replace(t, pretension=p) for t, p in zip(ARM.tendons, pretensions, strict=True))
    return replace(ARM, tendons=tuple(tendons))


PRETENSIONS = {"none": (0.0,) * 6, "equal in pairs": (2.5, 2.5, 0.0, 0.0, 10.0, 10.0)}
TENDON_ROBOTS = [pytest.param(pretensioned(*p), id=name) for name, p in PRETENSIONS.items()]

reduced_inputs = st.lists(st.floats(-1e3, 1e3), min_size=3, max_size=3).map(np.array)
actions = st.lists(st.floats(-1, 1), min_size=3, max_size=3).map(np.array)


@pytest.mark.parametrize("robot", TENDON_ROBOTS)
@given(reduced=reduced_inputs)
def test_tensions_are_the_smallest_that_give_the_input_and_keep_the_pretension(robot, reduced):
    tendon_map = TendonMap(robot)
    tension = tendon_map.tension(reduced)
    # Rounding only: sums of at most 1e3 N.
    np.testing.assert_allclose(tendon_map.phi @ tension, reduced, atol=1e-10)
    np.testing.assert_allclose(tendon_map.reduced(tension), reduced, atol=1e-10)
    pretension = robot.of_tendons("pretension")
    assert np.all(tension >= pretension)
    # Less tension in both tendons of a pair would let one of them fall below its pretension.
    excess = (tension - pretension).reshape(3, 2)
    np.testing.assert_array_equal(excess.min(axis=1), 0.0)


@pytest.mark.parametrize("robot", TENDON_ROBOTS)
@given(action=actions)
def test_actions_are_scaled_reduced_inputs(robot, action):
    tendon_map = TendonMap(robot)
    written = np.full(6, np.nan)
    returned = tendon_map.per_action().tension(action, written)
    assert returned is written
    expected = tendon_map.tension(action * tendon_map.input_scale)
    np.testing.assert_allclose(written, expected, rtol=1e-13, atol=1e-13)
    limits = robot.of_tendons("tension_limit")
    assert np.all(written <= limits * (1 + 1e-12))


def test_pair_formula_of_the_thesis():
    """(6.8): the upper tendon pulls a positive input, the lower one a negative."""
    tension = TendonMap(ARM).tension(np.array([3.0, -4.0, 0.0]))
    np.testing.assert_allclose(tension, [3, 0, 0, 4, 0, 0], atol=1e-14)


def pairs(robot):
    TendonMap(robot).require_pairs("a model")


UP, LOW, *REST = ARM.tendons
FIRST, *OTHERS = RIG.tendons
PLANAR = "planar tendon groups"


@pytest.mark.parametrize(
    ("model", "tendons", "reason"),
    [
        (pairs, [UP], PLANAR),
        (pairs, [UP, replace(LOW, offset=(-0.02, 0.0))], PLANAR),
        (pairs, [replace(t, offset=(0.0, t.offset[0])) for t in (UP, LOW)], PLANAR),
        (pairs, [UP, replace(LOW, tension_limit=40.0)], "opposing tendons"),
        (pairs, [UP, replace(LOW, pretension=5.0), *REST], "pair1_up, pair1_low must cancel"),
        (ThreeTendons, ARM.tendons, "need three tendons"),
        (ThreeTendons, [], "got none"),
        (ThreeTendons, [replace(FIRST, end=0.1), *OTHERS], "of one length"),
        (ThreeTendons, [replace(FIRST, offset=(-5e-3, 0.0)), *OTHERS], "do not surround"),
        (
            ThreeTendons,
            [replace(t, offset=(t.offset[0], 0.0)) for t in RIG.tendons],
            "do not surround",
        ),
    ],
)
def test_models_need_pairs_that_cancel_each_other_or_three_tendons(model, tendons, reason):
    with pytest.raises(ValueError, match=reason):
        model(replace(ARM, tendons=tuple(tendons)))


def _star(angles, radii, pretension=0.0, limit=30.0, **course):
    """A robot with one group of tendons at angles [deg] and distances [m] from the fibre."""
    one = replace(ARM.tendons[0], pretension=pretension, tension_limit=limit, **course)
    placed = (
        replace(one.turned(np.radians(a), r / 0.025), name=f"t{k}")
        for k, (a, r) in enumerate(zip(angles, radii, strict=True))
    )
    return replace(ARM, tendons=tuple(placed))


_AROUND = {
    "square": ([0, 90, 180, 270], [0.02] * 4),
    "five": ([0, 60, 130, 200, 290], [0.02, 0.018, 0.02, 0.022, 0.019]),
    "skew": ([10, 100, 230], [0.02, 0.01, 0.015]),
    "one within": ([0, 120, 240, 60], [0.02, 0.02, 0.02, 0.005]),
    "six": ([0, 60, 120, 180, 240, 300], [0.02] * 6),
}


@pytest.mark.parametrize("name", _AROUND)
def test_tensions_of_any_group_are_the_least_by_linear_programming(name):
    """And continuous, within the limits at full scale, of which one is met."""
    robot = _star(*_AROUND[name])
    tendon_map = TendonMap(robot)
    rng = np.random.default_rng(0)
    for reduced in rng.normal(0, 5, (40, 2)):
        tension = tendon_map.tension(reduced)
        np.testing.assert_allclose(tendon_map.reduced(tension), reduced, atol=1e-12)
        best = linprog(np.ones(len(tension)), A_eq=tendon_map.phi, b_eq=reduced)
        assert tension.sum() == pytest.approx(best.fun, rel=1e-9)
        assert tension.min() >= 0
    turn = np.linspace(0, 2 * np.pi, 20001)
    around = tendon_map.tension(np.stack([np.cos(turn), np.sin(turn)], axis=1))
    assert np.abs(np.diff(around, axis=0)).max() < 2e-3
    side = np.linspace(-1, 1, 2001)
    corners = [(s, e) for s in side for e in (-1, 1)] + [(e, s) for s in side for e in (-1, 1)]
    assert tendon_map.per_action().tension(np.array(corners)).max() == pytest.approx(30.0, rel=1e-3)


def test_three_tendons_are_a_special_case():
    """Also with pretension, and wound about the fibre."""
    robot = _star([0, 120, 240], [0.02] * 3, pretension=2.0)
    reduced = np.random.default_rng(1).normal(0, 4, (50, 2))
    expected = ThreeTendons(robot).tension(reduced)
    np.testing.assert_allclose(TendonMap(robot).tension(reduced), expected, atol=1e-12)
    wound = _star([0, 120, 240], [0.02] * 3, pretension=2.0, turns=0.7)
    np.testing.assert_allclose(TendonMap(wound).tension(reduced), expected, atol=1e-12)


@pytest.mark.parametrize(
    "robot",
    [
        _star([0, 40, 80], [0.02] * 3, pretension=1.0),
        _star([30], [0.02], pretension=1.0),
        replace(
            ARM,
            tendons=(
                replace(ARM.tendons[0], pretension=1.0, tension_limit=30.0),
                replace(ARM.tendons[1], pretension=1.0, tension_limit=30.0, turns=0.5),
            ),
        ),
    ],
    ids=["one side", "one tendon", "unlike routes"],
)
def test_tendons_that_do_not_oppose_each_other_are_driven_one_by_one(robot):
    """From the pretension at action -1 to the limit at 1."""
    tendon_map = TendonMap(robot)
    n = len(robot.tendons)
    assert tendon_map.n_inputs == n and not tendon_map.opposed.any()
    tension = np.linspace(1.0, 30.0, 7)[:, None] * np.ones(n)
    reduced = tendon_map.reduced(tension)
    np.testing.assert_allclose(tendon_map.tension(reduced), tension, atol=1e-12)
    action = (reduced - tendon_map.input_centre) / tendon_map.input_scale
    np.testing.assert_allclose(action[[0, -1]], [[-1.0] * n, [1.0] * n], atol=1e-12)
    np.testing.assert_allclose(tendon_map.per_action().tension(action), tension, atol=1e-12)


def test_lengths_are_their_own_inputs():
    inputs = robot_inputs(RIG)
    np.testing.assert_array_equal(inputs.input_scale, 0.03)
    action = np.array([0.5, -1.0, 0.0])
    np.testing.assert_allclose(inputs.per_action().command(action), 0.03 * action)
    rod = robot_inputs(find_robot("silicone_rod"))  # its file says no travel: half a turn
    np.testing.assert_allclose(rod.input_scale, np.pi * 0.01)


@pytest.mark.parametrize("name", ["arm", "planar_finger", "hanging_trunk", "rig"])
def test_commands_are_the_same_in_an_array_that_is_given(name):
    inputs = robot_inputs(find_robot(name)).per_action()
    actions = np.random.default_rng(0).uniform(-1, 1, (20, inputs.n_inputs))
    for action in (actions, *actions):
        expected = inputs.command(action)
        given = np.full_like(expected, nan)  # what was there does not matter
        assert inputs.command(action, given) is given
        np.testing.assert_array_equal(given, expected)


def test_robot_without_tendons_has_no_inputs():
    tendon_map = TendonMap(CANTILEVER_WEAK)
    assert tendon_map.n_inputs == 0
    assert tendon_map.tension(np.zeros(0)).shape == (0,)


# ---------------------------------------------------------------- variation


@pytest.mark.parametrize(
    "name", [n for n in NEUTRAL if not n.startswith(("tendon", "servo", "friction"))]
)
@pytest.mark.parametrize("factor", [0.5, 1, np.float64(1.5)])
def test_vary_scales_one_parameter(name, factor):
    varied = ARM.vary(**{name: factor})
    assert getattr(varied, name) == pytest.approx(factor * getattr(ARM, name), rel=1e-15)
    assert replace(varied, **{name: getattr(ARM, name)}) == ARM


def test_vary_adds_friction_to_all_tendons():
    rubbing = replace(ARM, tendons=(replace(ARM.tendons[0], friction=1.0), *ARM.tendons[1:]))
    varied = rubbing.vary(tendon_friction=0.5)
    assert [t.friction for t in varied.tendons] == [1.5, 0.5, 0.5, 0.5, 0.5, 0.5]
    assert replace(varied, tendons=rubbing.tendons) == rubbing
    assert ARM.vary(tendon_friction=0.5).vary(tendon_radius=0.8).tendons[0].friction == 0.5


def test_neutral_values_change_nothing():
    assert ARM.vary(**NEUTRAL) == ARM


@pytest.mark.parametrize("factor", [-1.0, nan, inf, -inf, True, False, "stiff"])
@pytest.mark.parametrize("name", NEUTRAL)
def test_vary_refuses_bad_factors(name, factor):
    with pytest.raises(ValueError):
        ARM.vary(**{name: factor})


# ---------------------------------------------------------------- validation, look-up


TENDON = Tendon("t", (0.01, 0.0), end=0.3, group=0, tension_limit=10.0, guides=(0.1, 0.2))
FREE = replace(TENDON, guides=())
DISC = Disc(0.1, 0.1, (1e-5, 1e-5, 1e-5))
TWIN = nominal_twin(RIG)


@pytest.mark.parametrize(
    ("record", "changes", "message"),
    [
        (ARM, {"inner_radius": 0.025}, "inner_radius"),
        (ARM, {"length": 0.4}, "off the robot"),
        (TWO, {"youngs_modulus": 1e6}, "has sections, which say its youngs_modulus"),
        (TWO, {"length": 0.5}, "the length of its sections is 0.4 together, not 0.5"),
        (TWO, {"pieces": 5}, "the pieces of its sections is 12 together"),
        (TWO, {"sections": (1,)}, "sections.*must be a Section"),
        (TWO, {"discs": (replace(DISC, station=0.5),)}, "a disc is at 0.5 m, off the robot"),
        (TWO.sections[0], {"length": 0.0}, "section: length must be from 1e-06 to 1000 m"),
        (TWO.sections[0], {"outer_radius": (0.01, 0.0)}, "section: outer_radius"),
        (TWO.sections[0], {"inner_radius": (0.0, 0.02)}, "section: .* at base and tip"),
        (TWO.sections[0], {"poisson_ratio": 0.6}, "section: poisson_ratio"),
        (TWO.sections[0], {"pieces": 0}, "section: pieces"),
        (DISC, {"inertia": (1e-5, 1e-5, 3e-5)}, "disc: no body has a moment of inertia"),
        (DISC, {"mass": 0.0}, "disc: mass"),
        (RIG, {"anisotropy": 2.0}, "anisotropy"),
        (RIG, {"precurvature": (80.0, 0.0)}, "precurvature"),
        (Base(), {"direction": (0, 0, 0)}, "base: direction must not be zero"),
        (Drive("tension"), {"backlash": 1e-4}, "only tendons driven by length have"),
        (TWIN, {"servo_offset": (0.0,)}, "each of 3 tendons"),
        (TWIN, {"backlash": (0.0, 0.0)}, "each of 3 tendons"),
        (TWIN, {"servo_speed": 0.0}, "servo_speed"),
        (TWIN, {"servo_offset": (0.0, 0.0, 9e-3)}, "at most 0.008 m"),
        (TWIN, {"backlash": (-1e-4, 0.0, 0.0)}, "zero or more"),
        (TWIN, {"camera_delay": -0.01}, "zero or more"),
        (TWIN, {"camera_delay": inf}, "zero or more"),
        (TWIN, {"camera_noise": 0.01}, "camera_noise"),
        (find_gripper("gripper"), {"fingers": ()}, "needs a finger"),
        (find_gripper("gripper"), {"fingers": (Finger("a", RIG, Base()),)}, "driven by tension"),
        (TENDON, {"tension_limit": 0.0}, "'t'.*tension_limit must be from 1e-12"),
        (TENDON, {"pretension": -1.0}, "'t'.*pretension must be from 0"),
        (TENDON, {"pretension": 10.0}, "'t'.*pretension < tension_limit"),
        (TENDON, {"friction": -1.0}, "'t'.*friction must be from 0 to"),
        (TENDON, {"end": 0.0}, "'t'.*end must be from 1e-06"),
        (TENDON, {"guides": (0.1, 0.1)}, "'t'.*guides must increase"),
        (TENDON, {"guides": (0.5,)}, "'t'.*guides must increase"),
        (TENDON, {"guides": (0.0, 0.1)}, "'t'.*guides must increase"),
        (FREE, {"route": ((0.3, 0.0),)}, "'t': route"),
        (FREE, {"route": ((0.2, 0.0, 0.0),)}, "'t': the stations of its route must increase"),
        (FREE, {"route": ((0.1, 0, 0), (0.1, 0, 0), (0.3, 0, 0))}, "'t': the stations of its"),
        (FREE, {"route": ((0.0, 0.0, 0.0),)}, "'t': the stations of its route must increase"),
    ],
)
def test_what_cannot_be_is_refused(record, changes, message):
    with pytest.raises(ValueError, match=message):
        replace(record, **changes)


# ---------------------------------------------------------------- shape


@given(curvature=st.floats(-40, 40).filter(lambda k: abs(k) > 1e-3), points=st.integers(1, 12))
def test_constant_curvature_is_a_circular_arc(curvature, points):
    shape = centerline(ARM, np.full(6, curvature), points)
    angle = curvature * np.linspace(0, ARM.length, 6 * points + 1)
    # Centre of the circle at (1 / curvature, 0). The closed form cancels near the straight
    # pose: 1e-16 / 1e-3.
    expected = np.stack([1 - np.cos(angle), 0 * angle, np.sin(angle)], axis=1) / curvature
    np.testing.assert_allclose(shape, expected, atol=1e-12)


@pytest.mark.parametrize("curvature", [0.0, 1e-300, 1e-12, -1e-9])
def test_straight_limit(curvature):
    shape = centerline(ARM, np.full(6, curvature))
    np.testing.assert_allclose(shape[:, 2], np.linspace(0, 0.5, 61), atol=1e-15)
    # Parabola: x = k s^2 / 2.
    np.testing.assert_allclose(shape[:, 0], curvature * shape[:, 2] ** 2 / 2, atol=1e-20)


def test_two_pieces_by_hand():
    """A quarter circle to +x, then one back: the tip points along +z again."""
    curvature = pi / ARM.length  # each half turns by 90 degrees
    shape = centerline(ARM, np.array([curvature, -curvature]), 1)
    radius = ARM.length / pi
    expected = [[0, 0, 0], [radius, 0, radius], [2 * radius, 0, 2 * radius]]
    np.testing.assert_allclose(shape, expected, atol=1e-15)


def test_friction_of_the_backbone_leaves_other_robots_as_they_were():
    assert not ARM.holds and fingerprint(ARM) == fingerprint(replace(ARM, bending_friction=None))
    holds = replace(ARM, bending_friction=1e-3)
    assert holds.holds and holds.has_friction and fingerprint(holds) != fingerprint(ARM)
    again = holds.with_sections(*holds.backbone.sections)
    assert again == holds
    assert ARM.with_sections(*ARM.backbone.sections) == ARM


# ---------------------------------------------------------------- three tendons
#: Tendons with errors of azimuth [degrees] and radius [m], as on a real robot.
ROUGH = replace(
    RIG,
    tendons=tuple(
        replace(t, offset=(r * np.cos(np.radians(a)), r * np.sin(np.radians(a))), pretension=p)
        for t, a, r, p in zip(
            RIG.tendons, (7.0, 124.0, 231.0), (5.5e-3, 5.2e-3, 5.9e-3), (0.5, 0.2, 0.8), strict=True
        )
    ),
)
EXACT_AND_ROUGH = pytest.mark.parametrize("robot", [RIG, ROUGH], ids=["exact", "rough"])


def directions(count=721):
    """Reduced inputs (count, 2) [N] in all quadrants and on all axes."""
    angle = np.linspace(0, 2 * np.pi, count)
    return 3 * np.column_stack([np.cos(angle), np.sin(angle)])


@EXACT_AND_ROUGH
def test_tensions_invert_the_projection_in_all_quadrants(robot):
    tendons, reduced = ThreeTendons(robot), directions()
    for tension in (tendons.tension(reduced), tendons.tension(reduced, total=30.0)):
        np.testing.assert_allclose(tension @ tendons.phi.T, reduced, atol=1e-14)
        assert np.all(tension - tendons.pretension >= -1e-14)


def test_tensions_are_the_audits_at_120_degrees():
    tendons, reduced = ThreeTendons(RIG), directions()
    azimuth = 2 * np.pi / 3 * np.arange(3)
    pull = (
        2
        / 3
        * (np.outer(reduced[:, 0], np.cos(azimuth)) + np.outer(reduced[:, 1], np.sin(azimuth)))
    )
    least = pull - pull.min(axis=1, keepdims=True) + 0.5
    np.testing.assert_allclose(tendons.tension(reduced), least, atol=1e-14)
    np.testing.assert_allclose(tendons.tension(reduced, total=12.0), 4 + pull, atol=1e-14)


def test_constant_sum_keeps_the_sum_of_lengths():
    """Audit: the sum of the lengths is then constant, whatever the bending."""
    tendons, reduced = ThreeTendons(RIG), directions()
    curvature = 5 * reduced[::-1]
    tension = tendons.tension(reduced, total=12.0)
    np.testing.assert_allclose(tension.sum(axis=1), 12.0)
    total = tendons.pulled(tension, curvature).sum(axis=1)
    np.testing.assert_allclose(total, (12.0 - 1.5) / 980.0)


def test_a_sum_too_small_is_refused_with_the_least_one():
    tendons = ThreeTendons(RIG)
    with pytest.raises(ValueError, match=r"leaves a tendon .* give at least 7\.5 N"):
        tendons.tension(np.array([[-3.0, 0.0], [2.0, 0.0]]), total=5.0)
    assert tendons.tension(np.array([-3.0, 0.0]), total=7.5).sum() == pytest.approx(7.5)


@EXACT_AND_ROUGH
def test_lengths_stretch_the_tendons_by_their_tensions(robot):
    tendons, curvature = ThreeTendons(robot), 7 * directions()
    tension = tendons.tension(directions()[::-1])
    pulled = tendons.pulled(tension, curvature)
    stretch = pulled - tendons.geometric(curvature)
    np.testing.assert_allclose(
        tendons.pretension + tendons.stiffness * stretch, tension, atol=1e-12
    )


@EXACT_AND_ROUGH
def test_channels_shorten_on_the_inner_side(robot):
    """A channel at the offset p runs on an arc of radius 1 / kappa - p."""
    tendons, bend = ThreeTendons(robot), 6.0
    expected = [
        robot.length - (1 / bend - t.offset[1]) * bend * robot.length for t in robot.tendons
    ]
    np.testing.assert_allclose(tendons.geometric(np.array([0.0, bend])), expected, atol=1e-15)
