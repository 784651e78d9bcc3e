"""Robots described by files in the one environment, and what their curvature sensors read."""

from dataclasses import replace

import gymnasium
import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from support.example_robots import SOME

from softrobot_env.beams.registry import BeamPlant
from softrobot_env.core.files import assets_dir
from softrobot_env.envs.tracking import TrackingEnv
from softrobot_env.robots import ARM, RIG, Base, Sensor, find_robot
from softrobot_env.robots.actuation import robot_inputs
from softrobot_env.robots.artifacts import fingerprint
from softrobot_env.robots.file import write_robot
from softrobot_env.robots.twin import Twin, rig3d_twin
from softrobot_env.tasks import make_task

ID = "SoftRobot/Track-v0"


def file_of(name):
    return str(assets_dir() / "robots" / f"{name}.toml")


def actions_of(env, count, size=0.2, seed=0):
    rng = np.random.default_rng(seed)
    return size * rng.uniform(-1, 1, (count, *env.action_space.shape))


@pytest.mark.parametrize("name", SOME)
def test_episodes_of_a_file_start_in_equilibrium_on_the_reference(name):
    """Held there by the start's inputs, the robot stays."""
    env = gymnasium.make(ID, robot=file_of(name), task="circle", observe="all").unwrapped
    assert env.task.robot == find_robot(name)
    _, info = env.reset(seed=0)
    assert info["error"] < 1e-6 * env.task.robot.reach
    action = np.array(env.task.start_input) - robot_inputs(env.task.robot).input_centre
    start = env.reset()[0]["tip_position"]
    for _ in range(20):
        observation, *_ = env.step(action / env.input_scale)
        assert env.observation_space.contains(observation)
    assert_allclose(observation["tip_position"], start, atol=1e-6 * env.task.robot.reach)
    assert len(start) == (2 if env.task.robot.is_planar else 3)


def test_a_file_without_pieces_has_an_accurate_chain_and_curvatures_of_its_own(tmp_path):
    path, section = tmp_path / "whip.toml", find_robot("planar_finger").backbone.sections[0]
    whip = replace(section, outer_radius=(0.010, 0.0025), inner_radius=0.0, pieces=6)
    tendon = replace(
        find_robot("planar_finger").tendons[0], end=section.length, offset=(0.002, 0.0)
    )
    tendons = tendon, tendon.turned(np.pi, name="other")
    named = replace(find_robot("planar_finger"), name="whip", sensors=(), tendons=tendons)
    write_robot(replace(named.with_sections(whip), adaptive_pieces=True), path)
    options = {"robot": str(path), "task": "reach", "observe": ("curvature", "tip_position")}
    env = gymnasium.make(ID, **options)
    observation, info = env.reset(seed=0)
    scene = env.unwrapped.scene
    assert scene.layout.pieces > 6 and observation["curvature"].shape == (6,)
    assert env.unwrapped.task.robot.adaptive_pieces
    assert 0 < info["discretization_error"] < 1e-3 * section.length
    many = gymnasium.make_vec(ID, 2, **options)
    assert_array_equal(many.reset(seed=0)[1]["discretization_error"], info["discretization_error"])
    sharper = gymnasium.make(ID, **options, accuracy="0.02%")
    assert sharper.reset(seed=0)[1]["discretization_error"] < 2e-4 * section.length
    artifacts = fingerprint(env.unwrapped.task.robot), fingerprint(named.with_sections(whip))
    assert artifacts[0]["fingerprint"] == artifacts[1]["fingerprint"]


# ---------------------------------------------------------------- other robots, and refusals


def test_a_planar_robot_in_a_turned_plane_is_seen_in_space():
    """It moves as the same robot in the x-z plane, turned."""
    upright = find_robot("planar_finger")
    turned = replace(upright, name="turned", base=Base(roll=np.pi / 3))
    envs = [TrackingEnv("circle", robot=robot) for robot in (upright, turned)]
    tips = []
    for env in envs:
        env.reset(seed=0)
        for row in actions_of(env, 10):
            observation, *_ = env.step(row)
        tips.append(observation["tip_position"])
    (x, z), seen = tips
    assert_allclose(seen, [x * np.cos(np.pi / 3), x * np.sin(np.pi / 3), z], atol=1e-9)


def test_a_finger_with_one_tendon_is_pulled_from_nothing_to_its_limit():
    finger = find_robot("planar_finger")
    one = replace(finger, name="one", tendons=finger.tendons[-2:-1])
    env = TrackingEnv("reach", robot=one, observe="all")
    env.reset(seed=0)
    for action, tension in ((-1.0, 0.0), (0.0, 5.0), (1.0, 10.0)):
        observation, *_ = env.step(np.array([action]))
        assert_allclose(observation["tendon_tension"], tension, atol=1e-12)
    with pytest.raises(ValueError, match=r"'one' is not found to .* 'reach' works"):
        make_task("circle", robot=one)


def test_a_built_rod_with_errors_is_a_twin_of_its_own():
    """Any robot driven by length has servos, and a camera in all its coordinates."""
    rod = find_robot("silicone_rod")
    built = Twin(
        robot=rod.vary(youngs_modulus=0.9),
        servo_speed=0.05,
        servo_offset=(1e-3, 0.0, 0.0),
        backlash=(2e-4,) * 3,
        camera_noise=1e-3,
        camera_delay=0.02,
    )
    env = TrackingEnv("circle", robot=rod, twin=built, observe="all")
    _, info = env.reset(seed=0)
    assert info["error"] > 1e-3  # softer, and its servo pulls in 1 mm too much
    observation, *_, info = env.step(np.zeros(3))
    assert info["tip_position"].shape == observation["tip_position"].shape == (3,)
    assert np.abs(info["tip_position"] - observation["tip_position"]).max() > 1e-5
    assert_allclose(np.abs(info["tendon_length"] - observation["tendon_length"]).max(), 1e-3, 0.2)


# ---------------------------------------------------------------- curvature sensors

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
    assert_allclose(*read, atol=0.02)
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
    assert_array_equal(unseen.reset(seed=1)[0]["tip_position"], seen)
