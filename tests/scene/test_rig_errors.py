"""Errors of manufacturing of the test rig's chain, held to pure bending and to an exact column."""

from dataclasses import replace

import mujoco
import numpy as np
import pytest
from support.rig_column import LEVER, Column, L, scene, tip_at

from softrobot_env.robots import RIG
from softrobot_env.scene.build import build_scene
from softrobot_env.scene.chain import joint_angles, mean_curvature, posture
from softrobot_env.scene.config import SceneConfig
from softrobot_env.scene.statics import equilibrium
from softrobot_env.scene.timestep import linearize

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
