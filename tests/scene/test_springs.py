"""Springs between the hinges of a station: they store what a share of beam does, in all directions.

The truth is the energy of the rotation vector, and the chain on ball joints, which has it exactly.
"""

from dataclasses import replace

import mujoco
import numpy as np
import pytest
from support.chains import LENGTH, ROBOT, TWISTING
from support.derivatives import differences

from softrobot_env.robots import Tendon
from softrobot_env.scene.build import build_scene
from softrobot_env.scene.config import SceneConfig
from softrobot_env.scene.tangent import StaticForces

CHANNEL = (Tendon("t", (0.02, 0.0), LENGTH, 0, 80.0),)


def turn_of(model, q, station):
    """Rotation vector (3,) of a station's link against the one below."""
    data = mujoco.MjData(model)
    data.qpos[:] = q
    mujoco.mj_kinematics(model, data)
    below, above = (data.body(f"link{k}").xmat.reshape(3, 3) for k in (station - 1, station))
    quaternion, turn = np.zeros(4), np.zeros(3)
    mujoco.mju_mat2Quat(quaternion, (below.T @ above).ravel())
    mujoco.mju_quat2Vel(turn, quaternion, 1.0)
    return turn


def tilt_of(model, q, station):
    """(3,) along the turn that tilts a station's axis, as long as its angle."""
    turn = turn_of(model, q, station)
    quaternion, axis = np.zeros(4), np.zeros(3)
    mujoco.mju_axisAngle2Quat(quaternion, turn / np.linalg.norm(turn), np.linalg.norm(turn))
    mujoco.mju_rotVecQuat(axis, np.array([0.0, 0.0, 1.0]), quaternion)
    across = np.cross([0.0, 0.0, 1.0], axis)
    return across / np.linalg.norm(across) * np.arccos(axis[2])


def missing_force(built, station, size, read, stiffness):
    """Largest error of the spring forces at a station whose hinges turn by about `size` [rad]."""
    model, forces = built.model, StaticForces(built.model)
    dofs = [k for k in range(model.nv) if model.dof_bodyid[k] == station + 1]
    directions, worst = np.random.default_rng(3).normal(size=(8, len(dofs))), 0.0

    def posture(turns):
        q = np.zeros(model.nq)
        q[dofs] = turns
        return q

    def energy(turns):
        return stiffness @ read(model, posture(turns), station) ** 2 / 2

    for direction in directions:
        turns = size * direction / np.linalg.norm(direction)
        found = forces.force(posture(turns), np.zeros(model.nu))[dofs]
        worst = max(worst, np.abs(found + differences(energy, turns, 1e-5)).max())
    return worst


@pytest.mark.parametrize("poisson_ratio", [0.0, 0.25, 0.5])
@pytest.mark.parametrize("station", [3, 4])
def test_three_hinges_store_the_energy_of_the_rotation_vector(poisson_ratio, station):
    """To fourth order: the force is right to third, for both orders of the hinges."""
    # Barely off zero the robot is one of ball joints, but gets hinges.
    robot = replace(ROBOT, poisson_ratio=poisson_ratio or 1e-12)
    built = build_scene(SceneConfig(robot, **TWISTING))
    bend, twist = robot.bending_stiffness, robot.torsional_stiffness
    stiffness = np.array([bend, bend, twist]) / built.layout.weights[station]
    errors = [missing_force(built, station, h, turn_of, stiffness) for h in (0.4, 0.2)]
    assert errors[1] < 1e-2 * stiffness[0] * 0.2**3
    assert np.log2(errors[0] / errors[1]) > 3.8


@pytest.mark.parametrize("station", [3, 5])
def test_universal_joints_store_the_energy_of_the_tilt(station):
    built = build_scene(SceneConfig(ROBOT, bending="spatial"))
    stiffness = np.full(3, ROBOT.bending_stiffness) / built.layout.weights[station]
    errors = [missing_force(built, station, h, tilt_of, stiffness) for h in (0.4, 0.2)]
    assert errors[1] < 2e-2 * stiffness[0] * 0.2**3
    assert np.log2(errors[0] / errors[1]) == pytest.approx(5, abs=0.2)


@pytest.mark.parametrize("options", [{"bending": "spatial"}, TWISTING])
def test_a_channel_and_a_load_share_the_error_between_the_axes(options):
    """As the module says: a channel bends by theta^2 / 24 more, a load by theta^2 / 12 less."""
    robot = replace(ROBOT, tendons=CHANNEL, poisson_ratio=0.4)
    model = build_scene(SceneConfig(robot, pieces=1, **options | {"rule": "midpoint"})).model
    theta, stiffness = 0.2, robot.bending_stiffness / LENGTH
    each = np.arccos(np.sqrt(np.cos(theta)))  # of two hinges that tilt by theta
    q = np.array([each, each, -(each**2) / 2][: model.nq])  # the twist that it takes to have none
    spring = -StaticForces(model).force(q, np.zeros(1))
    # A channel towards 45 degrees balances each hinge by its offset's component.
    assert stiffness * theta / np.sqrt(2) / spring[0] - 1 == pytest.approx(theta**2 / 24, rel=0.1)
    # A moment across works on the tilt; cos(theta) = cos(each)^2 gives the hinges' share of it.
    moment = spring[:2].sum() * np.sin(theta) / np.sin(2 * each)
    assert stiffness * theta / moment - 1 == pytest.approx(-(theta**2) / 12, rel=0.1)


@pytest.mark.parametrize("options", [{"bending": "spatial"}, TWISTING])
@pytest.mark.parametrize("poisson_ratio", [-0.5, 1e-12, 0.5])
def test_a_station_resists_all_angles_up_to_more_than_a_right_angle(options, poisson_ratio):
    robot = replace(ROBOT, poisson_ratio=poisson_ratio)
    model = build_scene(SceneConfig(robot, pieces=1, **options | {"rule": "midpoint"})).model
    forces, directions = StaticForces(model), np.random.default_rng(4).normal(size=(60, model.nq))
    for direction in directions / np.linalg.norm(directions, axis=1)[:, None]:
        for angle in (0.5, 1.5, 2.3):
            assert forces.force(angle * direction, np.zeros(0)) @ direction < 0
