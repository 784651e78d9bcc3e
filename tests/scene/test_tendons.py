"""Tendons and their drives against geometry and closed forms."""

from dataclasses import replace

import mujoco
import numpy as np
import pytest
from support.derivatives import differences
from support.postures import posed, station_turns
from support.routed_robots import ROD

from softrobot_env.robots import ARM, Tendon
from softrobot_env.scene.build import build_scene
from softrobot_env.scene.chain import posture
from softrobot_env.scene.config import SceneConfig
from softrobot_env.scene.statics import equilibrium

RADIUS, LENGTH = 0.025, 0.5
STIFFNESS, PRETENSION = 900.0, 2.0


def pair(guides=(), **options):
    """The arm with one pair of tendons along its whole length."""
    return replace(
        ARM,
        tendons=tuple(
            Tendon(name, (side * RADIUS, 0.0), LENGTH, 0, 80.0, guides=guides, **options)
            for name, side in (("up", 1), ("low", -1))
        ),
    )


def evenly(spans):
    """Guides that cut the robot into equal spans."""
    return tuple(LENGTH * np.arange(1, spans) / spans)


def elastic(guides=()):
    return pair(guides, stiffness=STIFFNESS, pretension=PRETENSION)


def guide_path(scene, q, offset, stations):
    """Length [m] of the path through points at an offset (towards x) from the chain."""
    points = scene.positions(q, stations, np.tile([offset, 0.0], (len(stations), 1)))
    return np.linalg.norm(np.diff(points, axis=0), axis=1).sum()


@pytest.mark.parametrize("guides", [(), evenly(5)], ids=["channel", "guides"])
@pytest.mark.parametrize(("asked", "force"), [(-30.0, 0.0), (200.0, 80.0)])
def test_tendons_never_push_nor_pull_beyond_their_limit(guides, asked, force):
    model = build_scene(SceneConfig(pair(guides))).model
    data = posed(model, np.full(model.nq, 0.02))
    data.ctrl[:] = asked
    mujoco.mj_forward(model, data)
    np.testing.assert_array_equal(data.actuator_force, force)
    assert force or not data.qfrc_actuator.any()


def channel_length(robot, layout, turns):
    """[m] of the one channel, the sum of |w (e_z + r') + turn x r| for turns (n, 3) [rad]."""
    place, slope = robot.tendons[0].course(layout.stations)
    r, lead = np.pad(place, ((0, 0), (0, 1))), np.pad(slope, ((0, 0), (0, 1)), constant_values=1.0)
    way = layout.weights[:, None] * lead + np.cross(turns, r)
    return np.linalg.norm(way, axis=1).sum()


@pytest.mark.parametrize(
    ("towards", "order"),
    [((0.4, -0.7, 0.5), 3), ((0.0, 0.0, 1.0), 3), ((0.7, 0.0, 0.0), 4), ((0.0, 0.7, 0.0), 4)],
)
@pytest.mark.parametrize("turns", [0.0, 1.5])
def test_lengths_of_exact_channels_are_those_of_the_bent_and_twisted_channel(turns, towards, order):
    tendon = Tendon("t", (0.006, 0.004), 0.4, 0, 20.0, turns=turns)
    robot = replace(ROD, tendons=(tendon,))
    built = build_scene(SceneConfig(robot, bending="spatial", torsion=True, channels="exact"))
    errors = []
    for size in (0.08, 0.04):
        q = posture(built.model, np.tile(size * np.array(towards), (len(built.layout.stations), 1)))
        truth = channel_length(robot, built.layout, station_turns(built.model, q))
        assert abs(truth - tendon.straight_length) > 1e-6
        errors.append(built.tendon_length(q)[0] - truth)
    straight = channel_length(robot, built.layout, np.zeros((len(built.layout.stations), 3)))
    rest = tendon.straight_length - straight  # the quadrature's error
    near, far = (abs(error - rest) for error in errors[::-1])
    assert near < far * 0.5**order * 1.3 + 1e-15


@pytest.mark.parametrize("bending", ["planar", "spatial"])
@pytest.mark.parametrize("spans", [2, 3, 8])
def test_guided_length_is_the_path_through_the_guides(spans, bending):
    scene = build_scene(SceneConfig(pair(evenly(spans)), bending=bending))
    q = np.random.default_rng(spans).uniform(-0.3, 0.3, scene.model.nq)
    stations = (0.0, *evenly(spans), LENGTH)
    paths = [guide_path(scene, q, offset, stations) for offset in (RADIUS, -RADIUS)]
    np.testing.assert_allclose(scene.tendon_length(q), paths, rtol=1e-12)


def moment_arms(spans, turn=1.5):
    """-d(length) / d(turn) [m] of both tendons while the robot bends evenly by `turn` [rad]."""
    scene = build_scene(SceneConfig(pair(evenly(spans)), pieces=48))
    model, shape = scene.model, scene.layout.weights / LENGTH
    lengths = differences(lambda x: posed(model, x * shape).ten_length, np.array([turn]), 1e-4)
    return -lengths[:, 0]


@pytest.mark.parametrize("spans", [4, 8, 16])
def test_moment_arm_is_that_of_straight_spans_along_an_arc(spans):
    """A span over an arc of length l and turn t is 2 (l/t - r) sin(t/2) long."""
    length, turn = LENGTH / spans, 1.5 / spans
    offset = np.array([RADIUS, -RADIUS])
    truth = 2 * length / turn**2 * np.sin(turn / 2) - (length / turn - offset) * np.cos(turn / 2)
    # The leading part beyond the offset is l t / 12 (and - r t^2 / 8). The chain has 96 hinges, at
    # least 6 a span: an error of order 1/36 in that part.
    excess = length * turn / 12
    np.testing.assert_allclose(moment_arms(spans), truth, atol=excess / 36)
    np.testing.assert_allclose(truth.mean(), excess, rtol=turn**2)


def bend(robot, pull):
    """Total turn [rad], tendon forces (2,) [N] and the scene in equilibrium at pulled lengths."""
    scene = build_scene(SceneConfig(robot, actuation="length"))
    q = equilibrium(scene.model, np.array(pull))
    data = mujoco.MjData(scene.model)
    data.qpos[:], data.ctrl[:] = q, pull
    mujoco.mj_forward(scene.model, data)
    return q, data.actuator_force.copy(), scene


ROBOT_STIFFNESS = ARM.bending_stiffness / LENGTH


@pytest.mark.parametrize("guides", [(), evenly(6)], ids=["channel", "guides"])
@pytest.mark.parametrize(
    "pull",
    [(0.004, 0.001), (0.01, -0.04), (0.006, -0.002), (0.012, -0.03), (0.0, 0.0), (0.25, -0.14)],
)
def test_length_drive_obeys_its_law(guides, pull):
    """F = F_pre + c (s - what a path is shorter by), in [0, 80]; EI t / L = r (F1 - F2)."""
    q, force, scene = bend(elastic(guides), pull)
    offsets = np.array([RADIUS, -RADIUS])
    paths = LENGTH - offsets * q.sum()
    if guides:
        stations = (0.0, *guides, LENGTH)
        paths = np.array([guide_path(scene, q, x, stations) for x in offsets])
    else:
        assert q.sum() == pytest.approx(offsets @ force / ROBOT_STIFFNESS, rel=1e-9, abs=1e-12)
    stretch = np.array(pull) - (LENGTH - paths)
    expected = np.clip(PRETENSION + STIFFNESS * stretch, 0, 80)
    np.testing.assert_allclose(force, expected, rtol=1e-9, atol=1e-12)
    assert force[0] > 0 and (force[1] == 0) == (pull[1] < -0.02)
    assert (force[0] == 80) == (pull[0] > 0.1)


def test_length_drive_reaches_full_tension_at_the_tightest_bend():
    """The control range covers the fold-free bend L / R at full tension, and no more."""
    scene = build_scene(SceneConfig(elastic(), actuation="length"))
    reach = LENGTH / ARM.outer_radius * RADIUS + 80.0 / STIFFNESS
    np.testing.assert_allclose(scene.model.actuator_ctrlrange, [[-reach, reach]] * 2)


def test_a_guided_tendon_may_end_inside_a_piece():
    """Straight spans need no pieces, as channels do."""
    guided = replace(ARM, tendons=(replace(ARM.tendons[0], end=0.2, guides=(0.1,)),))
    assert build_scene(SceneConfig(guided)).model.ntendon == 1
