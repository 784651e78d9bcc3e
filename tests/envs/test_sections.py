"""Environments and batches of robots with sections, discs and bases."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose
from support.routed_robots import TWO

from softrobot_env.envs.simulation.batch import BatchSimulation
from softrobot_env.envs.tracking import TrackingEnv
from softrobot_env.robots import ARM, Base, Disc, Section
from softrobot_env.robots.variations import neutral
from softrobot_env.scene.build import build_scene, vary_scene
from softrobot_env.scene.config import SceneConfig
from softrobot_env.scene.simulation import Simulation
from softrobot_env.tasks.registry import make_task

DISC = Disc.uniform(0.25, 0.03, 0.02, 0.004)
VARIED = {"density": 1.5, "youngs_modulus": 0.8, "damping_time": 0.7}


def conical_arm(**changes):
    """The arm, thinner in each third and with a taper."""
    sections = (
        Section(0.5 / 3, radius, 7.32e5, 1070.0, 0.05, 2, inner_radius=0.0125)
        for radius in (0.026, (0.025, 0.022), 0.020)
    )
    return replace(ARM.with_sections(*sections), name="conical arm", **changes)


def _vary(batch, **changes):
    values = {
        name: np.array([value]) for name, value in (neutral(robots_only=True) | changes).items()
    }
    batch.vary(np.array([1]), values)


def test_a_varied_robot_of_a_batch_is_the_varied_single_one():
    robot = replace(TWO.vary(tendon_radius=0.5), discs=(DISC,), gravity=(0.0, 0.0, -9.81))
    robot = replace(robot, base=Base(direction=(0.3, 0.2, -1.0)))
    scene = build_scene(SceneConfig(robot, bending="spatial", torsion=True, pieces=(3, 3)))
    batch, single = BatchSimulation(scene, 2), Simulation(vary_scene(scene, VARIED))
    _vary(batch, **VARIED)
    batch.ctrl[:] = single.data.ctrl[:] = [3.0, 1.0]
    for _ in range(5):
        batch.advance()
        single.advance()
    assert_allclose(batch.qpos[1], single.data.qpos, atol=1e-12)
    assert np.abs(batch.qpos[0] - single.data.qpos).max() > 1e-3


def test_a_robot_of_tapered_sections_and_a_base_tracks():
    robot = conical_arm(discs=(DISC,), base=Base((0.1, 0.0, 0.2), (0.6, 0.0, 0.8)))
    env = TrackingEnv(replace(make_task("swing"), robot=robot))
    env.reset(seed=0)
    for _ in range(5):
        seen, *_ = env.step(np.array([0.1, -0.1, 0.2], dtype=np.float32))
    scene = env.unwrapped.scene
    assert_allclose(seen["tip_position"], scene.tip(env.unwrapped.data.qpos)[[0, 2]], atol=1e-12)
    curvature = scene.curvature(env.unwrapped.data.qpos)[:, 1]
    assert_allclose(seen["curvature"], curvature, atol=1e-12)


def test_a_base_out_of_the_plane_is_refused_where_x_and_z_are_measured():
    robot = conical_arm(base=Base(direction=(0.0, 1.0, 0.0)))
    with pytest.raises(ValueError, match="moves in space, axes must be xy or xyz"):
        replace(make_task("swing"), robot=robot)


def test_measured_pieces_have_to_be_pieces_of_the_chain():
    from softrobot_env.envs.simulation.plants import MujocoPlant

    with pytest.raises(ValueError, match="do not divide the robot's own 12"):
        MujocoPlant(TWO, 0.01, bending="spatial", torsion=True, pieces=(8, 4))
