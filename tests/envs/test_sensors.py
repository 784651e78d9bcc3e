"""Curvature sensors as observables: single, vectorised, on chain and beam, and who has none."""

from dataclasses import replace

import numpy as np
import pytest

from softrobot_env.beams.registry import BeamPlant
from softrobot_env.envs.tracking import TrackingEnv
from softrobot_env.robots import ARM, RIG, Sensor
from softrobot_env.robots.twin import rig3d_twin
from softrobot_env.tasks import make_task

OBSERVE = ("tip_position", "reference", "sensors")
HOW = {"observe": OBSERVE, "control_period": 0.02}
SENSED_ARM = replace(
    ARM,
    name="sensed_arm",
    sensors=(
        Sensor("lower", "planar", 0.0, 0.25, segments=5),
        Sensor("tags", "tags", 0.25, 0.5, segments=2, rate=30.0, delay=0.04),
    ),
)


def arm(**more):
    task = replace(make_task("swing"), robot=SENSED_ARM)
    return TrackingEnv(task, observe=OBSERVE, **more)


def test_readings_lie_in_the_space_and_a_vector_view_has_them():
    env = arm()
    assert env.observation_space.contains(env.reset(seed=0)[0])
    assert env.observation_space["sensors"].shape == (3,)
    seen = TrackingEnv("rig_circle", observe_as="vector", **HOW)
    observation, _ = seen.reset(seed=0)
    assert len(observation[seen.vector_layout["sensors"]]) == 4
    assert np.abs(observation).max() < 5


@pytest.mark.parametrize("model", ["pcc", pytest.param("cosserat", marks=pytest.mark.slow)])
def test_chain_and_beam_of_one_shape_read_alike(model):
    start = {"start_curvature": np.full(2, 3.0)}
    chain, beam = (
        TrackingEnv("rig_circle", **HOW),
        TrackingEnv("rig_circle", plant=BeamPlant(model), **HOW),
    )
    read = [env.reset(seed=0, options=start)[0]["sensors"] for env in (chain, beam)]
    np.testing.assert_allclose(*read, atol=0.02)
    assert np.abs(read[0] - 1).max() > 0.3


def test_imperfections_are_the_simulated_robot_s():
    assert RIG.sensors[0].drift == 0
    twin = rig3d_twin(3)
    assert twin.robot.sensors[0].drift > 0 and twin.robot.sensors[0].specimen == 3
    env, built = TrackingEnv("rig_circle", **HOW), TrackingEnv("rig_circle", twin=twin, **HOW)
    assert env.observation_space == built.observation_space
    assert env.task == built.task
    ideal, _ = env.reset(seed=0)
    other, _ = env.reset(seed=0, options={"vary": {"sensor_errors": 1.0}})
    assert np.abs(ideal["sensors"] - other["sensors"]).max() > 0.01


def test_episodes_are_the_same_where_sensors_are_not_observed():
    seen = TrackingEnv("rig_circle", twin=3, **HOW).reset(seed=1)[0]["tip_position"]
    unseen = TrackingEnv("rig_circle", twin=3, **HOW | {"observe": ("tip_position",)})
    np.testing.assert_array_equal(unseen.reset(seed=1)[0]["tip_position"], seen)
