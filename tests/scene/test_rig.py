"""The test rig as a chain, held to an exact column with a heavy head and to analytic formulas."""

from dataclasses import replace
from functools import partial

import mujoco
import numpy as np
import pytest
from scipy.linalg import eigvals
from support.derivatives import differences
from support.postures import driving_force, posed

from softrobot_env.robots import RIG
from softrobot_env.scene.build import build_scene
from softrobot_env.scene.chain import joint_angles, mean_curvature, posture
from softrobot_env.scene.config import SceneConfig
from softrobot_env.scene.statics import equilibrium
from softrobot_env.scene.timestep import linearize
from studies.truths.rig_column import column_tip
from studies.truths.rig_ritz_rod import RigRod

L, HEAD = RIG.length, RIG.head
LEVER = 5.5e-3


def scene(robot=RIG, *, pieces=4, actuation="length", **options):
    config = SceneConfig(
        robot, pieces=pieces, actuation=actuation, bending="spatial", control_period=0.02, **options
    )
    return build_scene(config)


# --- the compiled chain --------------------------------------------------------------------------


def test_mass_and_inertia_are_those_of_cylinder_and_head():
    built = scene()
    first = built.layout.stations[0]
    moving, mass = L - first, RIG.mass_per_length * (L - first)
    data = posed(built.model, built.model.qpos0)
    centre = (mass * (L + first) / 2 + HEAD.mass * (L + HEAD.centre)) / (mass + HEAD.mass)
    assert np.sum(built.model.body_mass) == pytest.approx(mass + HEAD.mass, rel=1e-12)
    np.testing.assert_allclose(data.subtree_com[1], [0, 0, centre], atol=1e-12)
    distance = L + HEAD.centre - first
    whole = (
        mass * (moving**2 / 3 + RIG.outer_radius**2 / 4)
        + HEAD.mass * distance**2
        + np.array(HEAD.inertia[:2])
    )
    np.testing.assert_allclose(np.diag(linearize(built.model).mass)[:2], whole, rtol=1e-12)


#: With tendons that hold nothing.
LOOSE = replace(RIG, tendons=tuple(replace(t, stiffness=1e-9) for t in RIG.tendons))
#: Coordinates of the exact rod, upright.
UPRIGHT = np.zeros(12)


@pytest.mark.parametrize(("actuation", "robot"), [("tension", LOOSE), ("length", RIG)])
def test_frequencies_converge_to_the_columns(actuation, robot):
    rod, errors = RigRod(robot), []
    slope = differences(lambda q: rod.acceleration(q, UPRIGHT, np.zeros(3)), UPRIGHT, 1e-4)
    truth = np.sqrt(np.sort(-eigvals(slope).real)[:4:2])
    for pieces in (4, 8):
        model = scene(pieces=pieces, actuation=actuation).model
        mass, rest = linearize(model).mass, np.zeros(model.nv)
        stiffness = -differences(partial(driving_force, model), rest, 1e-6)
        found = np.sqrt(eigvals(stiffness, mass).real)
        found.sort()  # each mode in both planes
        np.testing.assert_allclose(found[:4:2], found[1:4:2], rtol=1e-6)
        errors.append(np.abs(found[:4:2] / truth - 1))
    assert np.all(errors[0] < 0.01)
    np.testing.assert_allclose(np.log2(errors[0] / errors[1]), 2, atol=0.2)


# --- bent far ------------------------------------------------------------------------------------


def test_lengths_bend_it_far_as_the_elastica():
    """To 105 mm aside, with the exact shape of a column under its weight and a heavy head."""
    pulled = np.array([0.012, -0.004, 0.002])
    truth, errors = column_tip(RIG, pulled, None), []
    for pieces in (4, 8):
        built = scene(pieces=pieces)
        found = built.tip(built.equilibrium(pulled, load_steps=4))
        errors.append(np.linalg.norm(found - truth))
    assert np.hypot(*truth[:2]) > 0.1
    assert errors[0] < 1e-3
    assert np.log2(errors[0] / errors[1]) == pytest.approx(2, abs=0.1)


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
    rod = RigRod(RIG)
    stiffness = -differences(
        lambda q: rod.static_force(q, np.zeros(3), rod.shape(q)), UPRIGHT, 1e-4
    )
    moment = 4 * LEVER * 0.3 * rod.shape(UPRIGHT).turns[-1, :, 1]
    truth = differences(rod.tip, UPRIGHT, 1e-4)[0] @ np.linalg.solve(stiffness, moment)
    assert loop_width(0.3) == pytest.approx(truth, rel=0.05)
