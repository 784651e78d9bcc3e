"""The test rig as a chain, held to an exact column with a heavy head and to analytic formulas."""

from dataclasses import replace

import mujoco
import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import brentq
from support.rig_column import HEAD, LEVER, Column, G, L, posed, scene, tip_at

from softrobot_env.beams.ancf import ANCF
from softrobot_env.beams.cosserat import CosseratRod
from softrobot_env.beams.pcc import PCC
from softrobot_env.beams.registry import BeamPlant
from softrobot_env.robots import ARM, CANTILEVER_WEAK, RIG
from softrobot_env.scene.build import build_scene
from softrobot_env.scene.chain import joint_angles, mean_curvature, posture
from softrobot_env.scene.config import SceneConfig, TipSensors
from softrobot_env.scene.statics import equilibrium
from softrobot_env.scene.timestep import linearize
from softrobot_env.thesis.rig.spatial_piece import SUBPIECES


def test_the_column_with_one_shape_is_the_audits_rig():
    """The thesis' one piece; 4 % off as its subpieces are not the uniform beam and the head."""
    free, held = Column(1, False), Column(1, True)
    assert free.elastic[0, 0] == pytest.approx(0.1017, rel=1e-3)
    assert free.stiffness[0, 0] == pytest.approx(0.0438, rel=0.05)
    assert free.mass[0, 0] == pytest.approx(8.41e-4, rel=0.01)
    assert free.frequencies()[0] == pytest.approx(7.21, rel=0.03)
    assert held.frequencies()[0] == pytest.approx(10.25, rel=0.02)
    assert held.damping_ratio() == pytest.approx(0.22, rel=0.02)


# --- the compiled chain --------------------------------------------------------------------------


def test_mass_and_inertia_are_those_of_cylinder_and_head():
    built = scene()
    first = built.layout.stations[0]
    moving, mass = L - first, RIG.mass_per_length * (L - first)
    data = posed(built.model, built.model.qpos0)
    centre = (mass * (L + first) / 2 + HEAD.mass * (L + HEAD.centre)) / (mass + HEAD.mass)
    assert np.sum(built.model.body_mass) == pytest.approx(mass + HEAD.mass, rel=1e-12)
    np.testing.assert_allclose(data.subtree_com[1], [0, 0, centre], atol=1e-12)
    lever = L + HEAD.centre - first
    whole = (
        mass * (moving**2 / 3 + RIG.outer_radius**2 / 4)
        + HEAD.mass * lever**2
        + np.array(HEAD.inertia[:2])
    )
    np.testing.assert_allclose(np.diag(linearize(built.model).mass)[:2], whole, rtol=1e-12)


def test_tip_is_the_output_point_of_the_head():
    data = posed(scene(sensors=(TipSensors(),)).model, np.zeros(16))
    np.testing.assert_allclose(data.site("tip").xpos, [0, 0, 0.202], atol=1e-15)
    np.testing.assert_allclose(data.sensordata[:3], [0, 0, 0.202], atol=1e-15)


def about_straight(built):
    """Mass and stiffness matrices of the upright chain, gravity and tendons included."""
    model = built.model
    data = mujoco.MjData(model)

    def force(q):
        data.qpos[:] = q
        mujoco.mj_forward(model, data)
        return data.qfrc_passive + data.qfrc_actuator - data.qfrc_bias

    moves = 1e-6 * np.eye(model.nv)
    columns = [force(-x) - force(x) for x in moves]
    return linearize(model).mass, np.stack(columns, axis=1) / 2e-6


@pytest.mark.parametrize(("actuation", "held"), [("tension", False), ("length", True)])
def test_frequencies_converge_to_the_columns(actuation, held):
    truth, errors = Column(8, held).frequencies()[:2], []
    for pieces in (4, 8):
        mass, stiffness = about_straight(scene(pieces=pieces, actuation=actuation))
        squares = np.sort(np.linalg.eigvals(np.linalg.solve(mass, stiffness)).real)
        found = np.sqrt(squares[:4])  # each mode in both planes
        np.testing.assert_allclose(found[::2], found[1::2], rtol=1e-6)
        errors.append(np.abs(found[::2] / truth - 1))
    assert np.all(errors[0] < 0.01)
    np.testing.assert_allclose(np.log2(errors[0] / errors[1]), 2, atol=0.2)


def test_frequency_is_that_of_pcc_with_many_pieces():
    """Another model, where the subpieces of the thesis replace beam and head: 1 % apart."""
    model = PCC(RIG, 6, axes="spatial", inertia=SUBPIECES)
    rest = np.zeros(model.n)
    step = 1e-4
    columns = [
        model.residual(step * e, rest, rest) - model.residual(-step * e, rest, rest)
        for e in np.eye(model.n)
    ]
    stiffness = np.stack(columns, axis=1) / (2 * step)
    mass = model.control_affine(rest, rest).mass
    squares = np.linalg.eigvals(np.linalg.solve(mass, stiffness)).real
    chain = np.linalg.eigvals(np.linalg.solve(*about_straight(scene(actuation="tension")))).real
    assert np.sqrt(np.min(chain)) == pytest.approx(np.sqrt(np.min(squares)), rel=0.015)


def test_damping_is_the_columns():
    built = scene(pieces=8)
    mass, stiffness = about_straight(built)
    lower = -np.linalg.solve(mass, np.hstack((stiffness, linearize(built.model).damping)))
    roots = np.linalg.eigvals(np.vstack((np.eye(32, 64, 32), lower)))
    first = roots[np.argmin(np.abs(roots))]
    truth = Column(8, True).damping_ratio()
    assert -first.real / abs(first) == pytest.approx(truth, rel=5e-3)


# --- bent far ------------------------------------------------------------------------------------


def bent_column(moment):
    """Distance [m] of the output from the axis under a moment of the tendons, by the elastica."""

    def down(end):
        def slopes(s, x):
            weight = G * (HEAD.mass + RIG.mass_per_length * (L - s))
            angle, turn, _ = x
            return turn, -weight * np.sin(angle) / RIG.bending_stiffness, np.sin(angle)

        turn = (moment + HEAD.mass * G * HEAD.centre * np.sin(end)) / RIG.bending_stiffness
        return solve_ivp(slopes, (L, 0), (end, turn, 0.0), rtol=1e-9, atol=1e-11).y[:, -1]

    end = brentq(lambda angle: down(angle)[0], 0.0, 3.0)
    return HEAD.output * np.sin(end) - down(end)[2]


@pytest.mark.parametrize("distance", [0.09, 0.12])
def test_tension_for_a_deflection_is_the_elasticas(distance):
    moment = brentq(lambda m: bent_column(m) - distance, 1e-3, 0.08, xtol=1e-9)
    tension = [0.5 + moment / LEVER, 0.5, 0.5]
    errors = []
    for pieces in (4, 8):
        found = tip_at(scene(pieces=pieces, actuation="tension"), tension, load_steps=4)
        np.testing.assert_allclose(found[1], 0, atol=1e-12)
        errors.append(abs(found[0] - distance))
    assert errors[0] < 1e-3
    assert np.log2(errors[0] / errors[1]) == pytest.approx(2, abs=0.4)


def test_slack_tendons_do_not_push():
    built = scene()
    data = mujoco.MjData(built.model)
    data.ctrl[:] = [0.02, -0.03, 0.0]
    least, most = np.inf, 0.0
    for _ in range(2000):
        mujoco.mj_step(built.model, data)
        least, most = min(least, data.actuator_force.min()), max(most, data.actuator_force.max())
    assert least == 0
    assert data.actuator_force[1] == 0
    assert 1 < most < RIG.tendons[0].tension_limit
    assert data.site("tip").xpos[0] > 0.05


def test_tension_ends_at_the_limit():
    weak = replace(RIG, tendons=tuple(replace(t, tension_limit=3.0) for t in RIG.tendons))
    built = scene(weak)
    data = mujoco.MjData(built.model)
    data.ctrl[:] = [0.03, 0.0, 0.0]
    mujoco.mj_step(built.model, data, 500)
    np.testing.assert_allclose(data.actuator_force[0], 3.0, rtol=1e-12)


# --- who does not take the rig -------------------------------------------------------------------


def test_beam_models_refuse_a_head_and_uneven_bending():
    for build in (PCC, lambda robot: CosseratRod(robot, 4), lambda robot: ANCF(robot, 4)):
        with pytest.raises(ValueError, match="'rig' has a head"):
            build(RIG)
    with pytest.raises(ValueError, match="has a head"):
        PCC(RIG, inertia="distributed")
    assert PCC(RIG, inertia=SUBPIECES).n == 2
    with pytest.raises(ValueError, match="has a head, which plant 'ancf'"):
        BeamPlant("ancf")(replace(ARM, head=HEAD))
    for uneven in ({"anisotropy": 0.1}, {"precurvature": (0.1, 0.0)}):
        with pytest.raises(ValueError, match="no anisotropy and no precurvature"):
            PCC(replace(RIG, **uneven), inertia=SUBPIECES)


@pytest.mark.parametrize("uneven", [{"anisotropy": 0.1}, {"precurvature": (0.0, 0.1)}])
def test_planar_chains_refuse_to_leave_their_plane(uneven):
    with pytest.raises(ValueError, match="bending='spatial'"):
        build_scene(SceneConfig(replace(ARM, **uneven)))


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("anisotropy", -0.1),
        ("anisotropy", 2.0),
        ("anisotropy", np.nan),
        ("stiff_azimuth", np.inf),
        ("precurvature", (80.0, 0.0)),
        ("precurvature", (np.nan, 0.0)),
    ],
)
def test_bad_errors_of_manufacturing_are_named(field, value):
    with pytest.raises(ValueError, match=field):
        replace(RIG, **{field: value})


def test_mean_curvature_needs_fitting_pieces():
    built = scene()
    with pytest.raises(ValueError, match="multiple of 3 pieces"):
        mean_curvature(built.model, built.layout, 3)
    twisting = build_scene(
        SceneConfig(CANTILEVER_WEAK, rule="gauss2", bending="spatial", torsion=True)
    )
    with pytest.raises(ValueError, match="a chain of hinges"):
        mean_curvature(twisting.model, twisting.layout, 6)


# ---------------------------------------------------------------- errors of manufacturing


WEIGHTLESS = replace(RIG, gravity=(0.0, 0.0, 0.0))


@pytest.mark.parametrize("azimuth", [0.0, 0.7, 2.5])
def test_anisotropy_is_stiff_towards_its_azimuth(azimuth):
    """Tendons pull in the principal directions; the rule is exact for pure bending."""
    rough = replace(WEIGHTLESS, anisotropy=0.4, stiff_azimuth=azimuth)
    for turn, factor in ((0.0, 1.2), (np.pi / 2, 0.8)):
        c, s = LEVER * np.cos(azimuth + turn), LEVER * np.sin(azimuth + turn)
        tendon = replace(RIG.tendons[0], offset=(c, s), pretension=0.0)
        built = scene(replace(rough, tendons=(tendon,)), actuation="tension")
        angles = joint_angles(built.model, equilibrium(built.model, np.array([3.0])))
        bend = 3.0 * LEVER / (factor * RIG.bending_stiffness)
        wanted = bend * np.array([np.cos(azimuth + turn), np.sin(azimuth + turn)])
        curvature = mean_curvature(built.model, built.layout, 1) @ posture(built.model, angles)
        np.testing.assert_allclose(curvature, wanted, rtol=1e-10, atol=1e-12)
        np.testing.assert_allclose(angles.sum(axis=0), wanted * L, rtol=1e-10, atol=1e-12)
        joints = linearize(built.model)
        np.testing.assert_allclose(
            np.diag(joints.damping), RIG.damping_time * np.diag(joints.stiffness), rtol=1e-12
        )


def test_turned_hinges_are_the_same_robot():
    """Barely anisotropic: to second order the axes of the hinges do not matter."""
    turned = replace(RIG, anisotropy=1e-9, stiff_azimuth=0.6)
    errors = []
    for pieces in (4, 8):
        pull = [0.012, -0.004, 0.003]
        a, b = (tip_at(scene(robot, pieces=pieces), pull) for robot in (RIG, turned))
        errors.append(np.linalg.norm(a - b))
    assert 1e-9 < errors[1] < 0.3e-3
    assert np.log2(errors[0] / errors[1]) == pytest.approx(2, abs=0.3)


def test_posture_and_joint_angles_are_inverse_with_turned_hinges():
    model = scene(replace(RIG, anisotropy=0.3, stiff_azimuth=1.1)).model
    angles = np.random.default_rng(0).uniform(-0.5, 0.5, (8, 2))
    np.testing.assert_allclose(joint_angles(model, posture(model, angles)), angles, atol=1e-15)


@pytest.mark.parametrize("azimuth", [0.0, 0.8])
def test_precurvature_bends_the_unloaded_robot(azimuth):
    bent = replace(
        WEIGHTLESS,
        precurvature=(3.0, -2.0),
        anisotropy=0.2 if azimuth else 0.0,
        stiff_azimuth=azimuth,
        tendons=(),
    )
    built = build_scene(SceneConfig(bent, pieces=4, bending="spatial"))
    q = equilibrium(built.model, np.zeros(0))
    curvature = mean_curvature(built.model, built.layout, 2) @ q
    np.testing.assert_allclose(curvature, [3.0, -2.0, 3.0, -2.0], rtol=1e-10)


def test_precurvature_of_the_upright_rig_grows_as_the_columns():
    """theta' = theta_0' + M / EI: the same as the moment EI kappa on the end of a straight one."""
    kappa = 0.05
    built = scene(replace(RIG, precurvature=(kappa, 0.0)), pieces=8)
    truth = Column(8, True).tip_per_moment() * RIG.bending_stiffness * kappa
    assert tip_at(built, np.zeros(3))[0] == pytest.approx(truth, rel=0.01)


def loop_width(friction):
    """Distance [m] of the tip on the way back from that on the way up at zero pull, slowly."""
    taut = 5.0
    rough = replace(
        RIG, tendons=tuple(replace(t, friction=friction, pretension=taut) for t in RIG.tendons)
    )
    built = scene(rough)
    data = mujoco.MjData(built.model)
    middle = []
    for leg in ((0.0, -4e-3), (-4e-3, 0.0), (0.0, 4e-3), (4e-3, 0.0)):
        for pull in np.linspace(*leg, 200):
            data.ctrl[0] = pull
            mujoco.mj_step(built.model, data, 40)
        middle.append(data.site("tip").xpos[0])
    return middle[3] - middle[1]


def test_friction_makes_the_columns_hysteresis():
    """At the same lengths, up and down, the three rubbing tendons hold a moment of 2 r f each way.

    Offsets towards the pull are r, -r / 2, -r / 2, and all rub the other way on the way back.
    """
    truth = 4 * LEVER * 0.3 * Column(8, True).tip_per_moment()
    assert loop_width(0.3) == pytest.approx(truth, rel=0.05)
    assert abs(loop_width(0.0)) < 0.04 * truth  # what damping and inertia add at this speed


def test_friction_acts_on_slack_tendons():
    """Let go slowly, the slack rig stops where three tendons rub against its own stiffness."""

    def left(friction):
        robot = replace(RIG, tendons=tuple(replace(t, friction=friction) for t in RIG.tendons))
        built = scene(robot, pieces=8)
        data = mujoco.MjData(built.model)
        for slack in np.linspace(0, 2e-3, 1500):
            data.ctrl[:] = np.array([1e-3, -0.5e-3, -0.5e-3]) - slack
            mujoco.mj_step(built.model, data, 8)
        assert not data.actuator_force.any()
        return data.site("tip").xpos[0]

    truth = 2 * LEVER * 0.1 * Column(8, False).tip_per_moment()
    assert left(0.1) == pytest.approx(truth, rel=0.05)
    assert abs(left(0.0)) < 0.02 * truth
