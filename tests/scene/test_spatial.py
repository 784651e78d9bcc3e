"""Chains that bend in space: symmetry, helices, twist, frequencies, tendons and follower loads."""

from dataclasses import replace

import mujoco
import numpy as np
import pytest
from support.postures import posed

from softrobot_env.robots import ARM, CANTILEVER_WEAK, Tendon
from softrobot_env.robots.loads import Load
from softrobot_env.scene.build import build_scene, scene_xml
from softrobot_env.scene.chain import joint_angles, posture
from softrobot_env.scene.config import Appearance, SceneConfig, TipSensors, visible
from softrobot_env.scene.quadrature import RULES
from softrobot_env.scene.statics import EquilibriumError, equilibrium
from softrobot_env.scene.timestep import linearize
from studies.truths.analytic import arc_tip, rayleigh_frequency

ROBOT = replace(CANTILEVER_WEAK, gravity=(0.0, 0.0, 0.0))
INCOMPRESSIBLE = replace(ROBOT, poisson_ratio=0.5)
LENGTH, EI = ROBOT.length, ROBOT.bending_stiffness
WEIGHT = ROBOT.mass_per_length * 9.81

#: A chain that twists, without springs between its pieces.
TWISTING = {"bending": "spatial", "torsion": True, "rule": "balanced2"}

#: Robot and options of every kind of spatial chain.
KINDS = {
    "universal": (ROBOT, {"bending": "spatial"}),
    "ball": (ROBOT, TWISTING),
    "three_hinges": (INCOMPRESSIBLE, TWISTING),
}

#: Without springs between the pieces, which tests/scene/test_coupling.py is for.
SIMPLE_RULES = [rule for rule in RULES if rule != "coupled2"]


def scene(kind, robot=None, **options):
    default, bending = KINDS[kind]
    return build_scene(SceneConfig(robot or default, **bending | options))


def turned(vector, azimuth):
    """(3,) rotated about +z."""
    c, s = np.cos(azimuth), np.sin(azimuth)
    return np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]]) @ vector


def joint_angles_of(built):
    return joint_angles(built.model, built.model.qpos0)


def loaded(kind, *, pieces=6, load_steps=1, **load):
    """Scene and its data in equilibrium under a load on the tip."""
    built = scene(kind, pieces=pieces, loads=(Load("load", LENGTH, **load),))
    return built, posed(built.model, equilibrium(built.model, np.ones(1), load_steps=load_steps))


def tip(kind, **options):
    return loaded(kind, **options)[1].site("tip").xpos.copy()


# --- the compiled chain -----------------------------------------------------------------------


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("rule", SIMPLE_RULES)
def test_joints_have_the_beams_compliance_about_every_axis(kind, rule):
    built = scene(kind, rule=rule)
    linear, robot = linearize(built.model), KINDS[kind][0]
    # About each axis the joints are springs in series: unit moments on all of them.
    k = joint_angles_of(built).shape[1]
    axes = np.eye(k)
    truth = [EI, EI, robot.torsional_stiffness]
    for axis, stiffness in zip(axes, truth, strict=False):
        turn = 1e-9 * built.layout.weights[:, None] * axis
        move = np.zeros(built.model.nv)
        q = posture(built.model, turn)
        mujoco.mj_differentiatePos(built.model, move, 1.0, built.model.qpos0, q)
        energy = move @ linear.stiffness @ move
        assert energy == pytest.approx(1e-18 * LENGTH * stiffness, rel=1e-6)
        np.testing.assert_allclose(
            linear.damping @ move, robot.damping_time * linear.stiffness @ move, rtol=1e-12
        )


@pytest.mark.parametrize("kind", KINDS)
def test_links_have_the_inertia_of_a_cylinder_about_all_axes(kind):
    built = scene(kind)
    first = built.layout.stations[0]
    moving, mass = LENGTH - first, ROBOT.mass_per_length * (LENGTH - first)
    matrix = linearize(built.model).mass
    # Turned as a whole about its first joint, the straight chain is one cylinder.
    radius = ROBOT.outer_radius
    lateral = mass * (moving**2 / 3 + radius**2 / 4)
    # rho I about x and y, 2 rho I about z, times the length.
    truth = [lateral, lateral, 2 * ROBOT.density * ROBOT.second_moment * moving]
    for axis in range(joint_angles_of(built).shape[1]):
        turn = np.zeros(joint_angles_of(built).shape)
        turn[0, axis] = 1e-6
        move = np.zeros(built.model.nv)
        mujoco.mj_differentiatePos(
            built.model, move, 1e-6, built.model.qpos0, posture(built.model, turn)
        )
        assert move @ matrix @ move == pytest.approx(truth[axis], rel=1e-6)


@pytest.mark.parametrize("kind", KINDS)
def test_angles_are_signed_as_documented(kind):
    built = scene(kind)
    n, k = joint_angles_of(built).shape
    bent = {}
    for column in range(k):
        angles = np.zeros((n, k))
        angles[:, column] = 0.05
        bent[column] = posed(built.model, posture(built.model, angles))
    assert bent[0].site("tip").xpos[0] > 0.05
    assert bent[1].site("tip").xpos[1] > 0.05
    np.testing.assert_allclose(bent[0].site("tip").xpos[1], 0, atol=1e-15)
    np.testing.assert_allclose(bent[1].site("tip").xpos[0], 0, atol=1e-15)
    if k == 3:  # +x of the tip turns towards +y
        assert bent[2].site("tip").xmat.reshape(3, 3)[1, 0] == pytest.approx(np.sin(0.05 * n))


@pytest.mark.parametrize("kind", KINDS)
def test_posture_and_joint_angles_are_inverse(kind):
    built = scene(kind)
    angles = np.random.default_rng(0).uniform(-0.5, 0.5, joint_angles_of(built).shape)
    np.testing.assert_allclose(
        joint_angles(built.model, posture(built.model, angles)), angles, atol=1e-14
    )


def test_planar_angles_are_the_posture():
    model = build_scene(SceneConfig(ARM)).model
    q = np.linspace(-0.1, 0.3, model.nq)
    np.testing.assert_array_equal(joint_angles(model, q), q[:, None])
    np.testing.assert_array_equal(posture(model, q[:, None]), q)


# --- statics ----------------------------------------------------------------------------------


def azimuth_error(kind, pieces):
    """Largest distance [m] between turned-back tips under a lateral force in several azimuths."""
    force = np.array([4.0, 0.0, 0.0])
    straight = tip(kind, pieces=pieces, force=force)
    return max(
        np.linalg.norm(turned(tip(kind, pieces=pieces, force=turned(force, a)), -a) - straight)
        for a in np.radians([30, 45, 90])
    )


def test_ball_joints_bend_alike_in_all_azimuths():
    assert azimuth_error("ball", 3) < 1e-9


@pytest.mark.parametrize("kind", ["universal", "three_hinges"])
def test_hinges_bend_alike_in_all_azimuths_to_fourth_order(kind):
    coarse, fine = azimuth_error(kind, 3), azimuth_error(kind, 6)
    # Of the deflection of 0.35 m, theta^2 / 12 would be missing without `scene.springs`, with
    # theta = 2 rad / 6 stations between the axes.
    assert coarse < 0.05 * 0.35 * (2 / 6) ** 2 / 12
    assert np.log2(coarse / fine) == pytest.approx(4, abs=0.2)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("azimuth", [0.0, 90.0])
def test_in_a_plane_it_is_the_planar_chain(kind, azimuth):
    load = {"force": (3.0, 0.0, -1.0), "moment": (0.0, 0.1, 0.0)}
    planar = build_scene(SceneConfig(ROBOT, loads=(Load("load", LENGTH, **load),))).model
    truth = posed(planar, equilibrium(planar, np.ones(1))).site("tip").xpos
    angle = np.radians(azimuth)
    found = tip(kind, **{name: turned(vector, angle) for name, vector in load.items()})
    np.testing.assert_allclose(found, turned(truth, angle), atol=1e-9)


def helix_tip(moment, bending_stiffness):
    """Tip (3,) of a rod with GJ = EI under a constant world moment (3,).

    The curvature vector R^T m / EI turns the frame by R' = [m / EI] R: the tangent rotates about
    the fixed moment by |m| s / EI, and its integral is a helix about it.
    """
    rate = np.linalg.norm(moment) / bending_stiffness
    axis, start = moment / np.linalg.norm(moment), np.array([0.0, 0.0, 1.0])
    along, across = axis * (axis @ start), start - axis * (axis @ start)
    phase = rate * LENGTH
    return (
        along * LENGTH
        + across * np.sin(phase) / rate
        + np.cross(axis, start) * (1 - np.cos(phase)) / rate
    )


MOMENT = np.array([0.5, 0.9, 1.2])


def test_world_moment_makes_the_exact_discrete_helix():
    """Every ball joint turns by m w / EI about the fixed moment: polygon on a helix, any rule."""
    built, data = loaded("ball", moment=MOMENT, load_steps=4)
    turn = MOMENT / EI
    knots = np.concatenate(([0.0], built.layout.stations, [LENGTH]))
    position, angle = np.zeros(3), 0.0
    axis, size = turn / np.linalg.norm(turn), np.linalg.norm(turn)
    for index, step in enumerate(np.diff(knots)):
        if index:
            angle += size * built.layout.weights[index - 1]
        tangent = np.zeros(3)
        mujoco.mju_rotVecQuat(
            tangent,
            np.array([0.0, 0.0, 1.0]),
            np.concatenate(([np.cos(angle / 2)], np.sin(angle / 2) * axis)),
        )
        position += step * tangent
    np.testing.assert_allclose(data.site("tip").xpos, position, atol=1e-9)


def test_world_moment_converges_to_the_helix():
    truth = helix_tip(MOMENT, EI)
    errors = [
        np.linalg.norm(tip("ball", pieces=n, moment=MOMENT, load_steps=4) - truth) for n in (6, 12)
    ]
    assert errors[1] < 0.2e-3
    assert np.log2(errors[0] / errors[1]) == pytest.approx(2, abs=0.15)


def test_three_hinges_converge_to_the_helix():
    """With Poisson's ratio barely off zero the rod is the same, its joints are three hinges."""
    robot = replace(ROBOT, poisson_ratio=1e-9)
    truth, errors = helix_tip(MOMENT, EI), []
    for pieces in (3, 6, 12):
        load = Load("load", LENGTH, moment=tuple(MOMENT))
        model = scene("three_hinges", robot, pieces=pieces, loads=(load,)).model
        q = equilibrium(model, np.ones(1), load_steps=4)
        errors.append(np.linalg.norm(posed(model, q).site("tip").xpos - truth))
    np.testing.assert_allclose(np.log2(np.array(errors[:-1]) / errors[1:]), 2, atol=0.25)


@pytest.mark.parametrize("kind", ["ball", "three_hinges"])
def test_end_torque_twists_by_its_length_over_gj(kind):
    built, data = loaded(kind, moment=(0.0, 0.0, 0.05))
    twist = 0.05 * LENGTH / KINDS[kind][0].torsional_stiffness
    angles = joint_angles(built.model, data.qpos)
    assert angles[:, 2].sum() == pytest.approx(twist, rel=1e-9)
    np.testing.assert_allclose(angles[:, :2], 0, atol=1e-12)
    frame = data.site("tip").xmat.reshape(3, 3)
    assert np.arctan2(frame[1, 0], frame[0, 0]) == pytest.approx(twist, rel=1e-9)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("load_steps", [1, 5])
def test_gravity_sideways_is_gravity_in_the_plane(kind, load_steps):
    planar = build_scene(SceneConfig(CANTILEVER_WEAK)).model
    truth = posed(planar, equilibrium(planar, np.zeros(0))).site("tip").xpos
    robot = replace(KINDS[kind][0], gravity=(0.0, -9.81, 0.0))
    model = scene(kind, robot).model
    found = posed(model, equilibrium(model, np.zeros(0), load_steps=load_steps))
    np.testing.assert_allclose(found.site("tip").xpos, turned(truth, np.pi / 2), atol=1e-9)
    np.testing.assert_array_equal(model.opt.gravity, robot.gravity)


def test_equilibria_follow_the_branch_from_straight():
    """Compressed at twice its buckling load, the rod yields to the side it is pushed to.

    The truth is the planar chain, loaded in steps by hand.
    """
    planar = build_scene(SceneConfig(ROBOT, loads=(Load("load", LENGTH, force=(0.3, 0, -5.0)),)))
    q = None
    for share in np.arange(1, 41) / 40:
        q = equilibrium(planar.model, np.array([share]), q)
    truth = posed(planar.model, q).site("tip").xpos
    assert truth[0] > 0.3
    direction = np.radians(25)
    force = turned(np.array([0.3, 0.0, -5.0]), direction)
    for steps in (1, 10):
        np.testing.assert_allclose(
            tip("ball", force=force, load_steps=steps), turned(truth, direction), atol=1e-9
        )
    # Newton's method at once ends on the other side, where the rod would not stay in space.
    model = loaded("ball", force=(-force[0], -force[1], -5.0))[0].model
    other = equilibrium(model, np.ones(1))
    built = scene("ball", pieces=6, loads=(Load("load", LENGTH, force=force),))
    with pytest.raises(EquilibriumError, match="check_stability=False"):
        equilibrium(built.model, np.ones(1), guess=other)


@pytest.mark.parametrize("load_steps", [0, -1, 1.5])
def test_load_steps_are_whole_and_positive(load_steps):
    with pytest.raises(ValueError, match="whole number, at least one"):
        equilibrium(scene("ball").model, np.zeros(0), load_steps=load_steps)


# --- follower loads ---------------------------------------------------------------------------


def test_a_planar_follower_force_keeps_its_angle_to_the_tip():
    """EI y'' balances it: the equilibrium is the dead load's turned along with the tip."""
    load = Load("load", LENGTH, force=(0.8, 0.0, -0.5), follows=True)
    follower = build_scene(SceneConfig(ROBOT, loads=(load,))).model
    data = posed(follower, equilibrium(follower, np.ones(1)))
    force = data.site("tip").xmat.reshape(3, 3) @ load.force
    assert np.linalg.norm(force - load.force) > 0.3  # it did turn
    dead = Load("load", LENGTH, force=tuple(force))
    model = build_scene(SceneConfig(ROBOT, loads=(dead,))).model
    found = posed(model, equilibrium(model, np.ones(1), guess=data.qpos)).qpos
    np.testing.assert_allclose(found, data.qpos, atol=1e-9)


@pytest.mark.parametrize("kind", KINDS)
def test_a_spatial_follower_turns_with_the_cross_section(kind):
    # Without torsion no moment about z is taken, which the turned moment has.
    moment = (0.0, 0.0, 0.0) if kind == "universal" else (0.05, 0.0, 0.02)
    load = Load("load", LENGTH, force=(0.8, 0.6, -0.5), moment=moment, follows=True)
    model = scene(kind, loads=(load,)).model
    data = posed(model, equilibrium(model, np.ones(1)))
    frame = data.site("tip").xmat.reshape(3, 3)
    dead = Load("load", LENGTH, force=tuple(frame @ load.force), moment=tuple(frame @ load.moment))
    model = scene(kind, loads=(dead,)).model
    found = equilibrium(model, np.ones(1), guess=data.qpos)
    np.testing.assert_allclose(found, data.qpos, atol=1e-9)


def test_a_follower_moment_in_the_plane_is_a_dead_one():
    """A moment about y does not notice the turn; the arc of constant curvature is known."""
    for follows in (False, True):
        load = Load("load", LENGTH, moment=(0.0, 0.4, 0.0), follows=follows)
        model = build_scene(SceneConfig(ROBOT, pieces=24, rule="chord2", loads=(load,))).model
        found = posed(model, equilibrium(model, np.ones(1))).site("tip").xpos
        np.testing.assert_allclose(found[[0, 2]], arc_tip(LENGTH, 0.4 / EI), atol=1e-7)


def test_an_axial_follower_force_acts_along_the_tips_tangent():
    load = Load("load", LENGTH, force=(0.0, 0.0, 3.0), follows=True)
    model = scene("ball", loads=(load,)).model
    data = mujoco.MjData(model)
    data.ctrl[:] = 1.0
    data.qpos[:] = posture(model, np.tile([0.05, 0.02, 0.01], (model.nv // 3, 1)))
    mujoco.mj_forward(model, data)
    # The work on a small motion is force x tangent . displacement.
    jacobian = np.zeros((3, model.nv))
    mujoco.mj_jacSite(model, data, jacobian, None, model.site("load_point").id)
    tangent = data.site("tip").xmat.reshape(3, 3)[:, 2]
    np.testing.assert_allclose(data.qfrc_actuator, 3.0 * tangent @ jacobian, atol=1e-12)


# --- tendons ----------------------------------------------------------------------------------


def trio(guides=(), robot=ROBOT, **options):
    """Three tendons at 120 degrees along the whole robot."""
    azimuths = np.radians([0, 120, 240])
    return replace(
        robot,
        tendons=tuple(
            Tendon(
                f"t{i}",
                (0.02 * np.cos(a), 0.02 * np.sin(a)),
                LENGTH,
                0,
                80.0,
                guides=guides,
                **options,
            )
            for i, a in enumerate(azimuths)
        ),
    )


GUIDES = tuple(LENGTH * np.arange(1, 12) / 12)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("guides", [(), GUIDES], ids=["channels", "guides"])
def test_equal_tensions_keep_it_straight(kind, guides):
    model = scene(kind, trio(guides, KINDS[kind][0])).model
    np.testing.assert_allclose(
        posed(model, equilibrium(model, np.full(3, 8.0))).site("tip").xpos,
        [0, 0, LENGTH],
        atol=1e-12,
    )


@pytest.mark.parametrize("torsion", [False, True])
@pytest.mark.parametrize("azimuth", [0, 35, 90, 160])
def test_one_tendon_bends_towards_its_azimuth(azimuth, torsion):
    """Constant curvature F r / EI in the tendon's plane, and no twist of two stations together."""
    direction = np.array([np.cos(np.radians(azimuth)), np.sin(np.radians(azimuth))])
    robot = replace(ROBOT, tendons=(Tendon("t", tuple(0.02 * direction), LENGTH, 0, 80.0),))
    options = {"rule": "balanced2", "bending": "spatial", "torsion": torsion}
    built = build_scene(SceneConfig(robot, pieces=12, **options))
    q = equilibrium(built.model, np.array([20.0]))
    curvature = joint_angles(built.model, q) / built.layout.weights[:, None]
    expected = 20.0 * 0.02 / EI * np.append(direction, [0.0] * torsion)
    truth = np.tile(expected[:2], (24, 1))
    np.testing.assert_allclose(curvature[:, :2], truth, rtol=2e-4, atol=1e-12)
    np.testing.assert_allclose(curvature[:, 2:].reshape(12, -1).sum(axis=1), 0, atol=1e-12)
    found = posed(built.model, q).site("tip").xpos
    x, z = arc_tip(LENGTH, 20.0 * 0.02 / EI)
    # The chords' error of balanced2, and theta^2 / 24 of `scene.springs`, of 0.05 rad each.
    np.testing.assert_allclose(found, [*(x * direction), z], atol=2e-4 * LENGTH)


@pytest.mark.parametrize("torsion", [False, True])
def test_channel_length_follows_both_angles(torsion):
    robot = trio()
    built = build_scene(SceneConfig(robot, bending="spatial", torsion=torsion))
    angles = np.random.default_rng(1).uniform(-0.1, 0.1, joint_angles_of(built).shape)
    data = posed(built.model, posture(built.model, angles))
    offsets = np.array([t.offset for t in robot.tendons])
    np.testing.assert_allclose(
        data.ten_length[:3], -offsets @ angles[:, :2].sum(axis=0), atol=1e-15
    )


def test_many_guides_are_a_channel():
    """In space as in the plane, the excess falls with the square of the number of spans."""
    tips = {}
    for spans in (3, 6, 12, None):
        guides = tuple(LENGTH * np.arange(1, spans) / spans) if spans else ()
        model = scene("universal", trio(guides), pieces=12).model
        q = equilibrium(model, np.array([15.0, 6.0, 0.0]))
        tips[spans] = posed(model, q).site("tip").xpos.copy()
    errors = [np.linalg.norm(tips[s] - tips[None]) for s in (3, 6, 12)]
    np.testing.assert_allclose(np.log2(np.array(errors[:-1]) / errors[1:]), 2, atol=0.3)


def test_length_driven_trio_holds_its_pretension():
    robot = trio(stiffness=900.0, pretension=2.0)
    model = scene("universal", robot, actuation="length").model
    data = posed(model, equilibrium(model, np.zeros(3)))
    np.testing.assert_allclose(data.actuator_force, 2.0)
    np.testing.assert_allclose(data.qpos, 0, atol=1e-12)


def test_a_planar_chain_takes_the_lateral_offset_of_a_tendon_as_it_did():
    """Only the offset in the bending plane has a lever arm there."""
    robot = replace(ROBOT, tendons=(Tendon("t", (0.02, 0.015), LENGTH, 0, 80.0),))
    model = build_scene(SceneConfig(robot)).model
    assert model.tendon_num[0] == model.nq
    np.testing.assert_array_equal(model.wrap_prm, -0.02)


# --- dynamics ---------------------------------------------------------------------------------


@pytest.mark.parametrize("kind", KINDS)
def test_bending_frequencies_come_in_equal_pairs_of_the_beams(kind):
    found = linearize(scene(kind).model).frequencies() / (2 * np.pi)
    rotary = ROBOT.density * ROBOT.second_moment
    truth = rayleigh_frequency(LENGTH, EI, ROBOT.mass_per_length, rotary)
    np.testing.assert_allclose(found[0], found[1], rtol=1e-9)
    # 5 x 0.0067 / 36 of balanced2 in 6 pieces, see test_scene_dynamics.
    assert found[0] == pytest.approx(truth, rel=1.1e-3)


@pytest.mark.parametrize("kind", ["ball", "three_hinges"])
def test_torsional_frequency_is_the_rods(kind):
    """sqrt(GJ / (rho 2 I)) / (4 L), the quarter wave of a rod clamped at one end."""
    robot = KINDS[kind][0]
    inertia = 2 * robot.density * robot.second_moment
    truth = np.sqrt(robot.torsional_stiffness / inertia) / (4 * LENGTH)
    errors = []
    for pieces in (6, 12):
        built = scene(kind, pieces=pieces)
        linear, n = linearize(built.model), len(built.layout.stations)
        # In the straight pose torsion is uncoupled: take its block alone.
        twist = np.zeros((n, built.model.nv))
        for row, move in enumerate(twist):
            angles = np.zeros((n, 3))
            angles[row, 2] = 1e-3
            q = posture(built.model, angles)
            mujoco.mj_differentiatePos(built.model, move, 1e-3, built.model.qpos0, q)
        mass, stiffness = (twist @ m @ twist.T for m in (linear.mass, linear.stiffness))
        first = np.sqrt(np.linalg.eigvals(np.linalg.solve(mass, stiffness)).real.min())
        errors.append(abs(first / (2 * np.pi) / truth - 1))
    assert errors[0] < 2e-3
    assert np.log2(errors[0] / errors[1]) == pytest.approx(2, abs=0.1)


@pytest.mark.parametrize("kind", KINDS)
def test_rk4_keeps_the_energy_of_a_swing_in_space(kind):
    robot = replace(KINDS[kind][0], damping_time=0.0, gravity=(0.0, 0.0, 9.81))
    drifts = []
    for timestep in (1e-3, 5e-4):
        options = {"integrator": "RK4", "timestep": timestep, "control_period": 1e-2}
        model = scene(kind, robot, pieces=2, rule="midpoint", **options).model
        model.opt.enableflags |= int(mujoco.mjtEnableBit.mjENBL_ENERGY)
        data = mujoco.MjData(model)
        columns = model.nv // 2
        data.qpos[:] = posture(model, np.array([[0.4, 0.2, 0.1], [0.1, -0.3, 0.1]])[:, :columns])
        mujoco.mj_forward(model, data)
        start = data.energy.sum()
        energies = []
        for _ in range(round(2.0 / timestep)):
            mujoco.mj_step(model, data)
            energies.append(data.energy.copy())
        energies = np.array(energies)
        assert np.ptp(energies[:, 1]) > 0.02  # J of kinetic energy come and go
        mujoco.mj_forward(model, data)
        drifts.append(abs(data.energy.sum() - start) / energies[:, 1].max())
    assert drifts[1] < 1e-5
    assert drifts[1] < drifts[0] / 8


def test_a_swing_in_a_plane_is_the_planar_chains():
    """The same motion in azimuth 0, and in 63 degrees on ball joints."""
    options = {"pieces": 3, "timestep": 1e-3, "integrator": "RK4"}
    planar = build_scene(SceneConfig(ROBOT, **options)).model
    bend = np.linspace(0.05, 0.2, 6)
    truth = swing_tips(planar, bend)
    azimuth = np.radians(63.0)
    for kind, angle in (("universal", 0.0), ("ball", azimuth)):
        model = scene(kind, **options).model
        angles = np.outer(bend, [np.cos(angle), np.sin(angle), 0.0][: model.nv // 6])
        found = swing_tips(model, posture(model, angles))
        np.testing.assert_allclose(found, [turned(x, angle) for x in truth], atol=1e-10)
    assert np.ptp(truth[:, 0]) > 0.1


def swing_tips(model, q):
    """Tips (k, 3) [m] during a swing from rest."""
    data = mujoco.MjData(model)
    data.qpos[:] = q
    tips = []
    for _ in range(20):
        mujoco.mj_step(model, data, 25)
        mujoco.mj_kinematics(model, data)
        tips.append(data.site("tip").xpos.copy())
    return np.array(tips)


# --- what reads a scene -----------------------------------------------------------------------


@pytest.mark.parametrize("kind", KINDS)
def test_exported_scene_is_the_same_model(kind):
    robot, options = KINDS[kind]
    config = SceneConfig(
        trio(GUIDES, robot), sensors=(TipSensors(),), appearance=Appearance(), **options
    )
    model, again = build_scene(config).model, mujoco.MjModel.from_xml_string(scene_xml(config))
    assert (again.nq, again.nv, again.nu) == (model.nq, model.nv, model.nu)
    for field in ("jnt_type", "jnt_axis", "jnt_stiffness", "dof_damping", "body_inertia"):
        np.testing.assert_allclose(
            getattr(again, field), getattr(model, field), rtol=2e-5, atol=1e-9
        )


@pytest.mark.parametrize("kind", KINDS)
def test_visible_scene_has_the_same_dynamics_and_room_behind_it(kind):
    robot, options = KINDS[kind]
    bare = SceneConfig(trio(robot=robot), **options)
    plain, seen = build_scene(bare).model, build_scene(visible(bare)).model
    np.testing.assert_array_equal(linearize(seen).mass, linearize(plain).mass)
    assert seen.nskin == 1
    wall = np.flatnonzero(seen.geom_type == mujoco.mjtGeom.mjGEOM_PLANE)
    # A robot bent towards +y by a quarter turn stays in front of the wall.
    assert seen.geom_pos[wall[0], 1] > robot.length


def test_timestep_rule_bounds_a_spatial_chain():
    for kind in KINDS:
        spatial, planar = scene(kind).timestep, build_scene(SceneConfig(ROBOT)).timestep
        assert spatial.first_period == pytest.approx(planar.first_period, rel=1e-9)
        assert spatial.stability_limit <= planar.stability_limit * (1 + 1e-9)
        assert spatial.timestep <= spatial.stability_limit / 2


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"bending": "sideways"}, "bending must be one of 'planar', 'spatial'"),
        ({"torsion": True}, "bending='spatial'"),
    ],
)
def test_bad_options_name_what_is_allowed(options, message):
    with pytest.raises(ValueError, match=message):
        SceneConfig(ARM, **options)
