"""Environments, the virtual rig and replays of robots whose servos have a force."""

import pickle
from dataclasses import replace

import gymnasium
import numpy as np
import pytest

from softrobot_env.beams.registry import BeamPlant
from softrobot_env.envs.simulation.virtual_rig import VirtualRig
from softrobot_env.envs.tracking import TrackingEnv
from softrobot_env.identification.replay import Body
from softrobot_env.robots import ROBOTS, read_robot, write_robot
from softrobot_env.robots.twin import nominal_twin, sampled_twin, twin_of

ID = "SoftRobot/Track-v0"
FORCED = replace(
    ROBOTS["silicone_rod"].drive,
    speed=0.15, gain=2e4, velocity_gain=200.0, reflected_mass=0.5, force_limit=8.0,
    gear_friction=0.3, encoder_step=2e-5, command_delay=0.013, spool_radius=0.01,
    wire_diameter=5e-4, seating=5e-4, backlash=2e-4,
)  # fmt: skip
ROBOT = replace(ROBOTS["silicone_rod"], name="forced", drive=FORCED)

pytestmark = pytest.mark.filterwarnings("ignore::softrobot_env.scene.timestep.TimestepWarning")


def actions(count, size, seed=0):
    return np.repeat(np.random.default_rng(seed).uniform(-1, 1, (count, size)), 4, axis=0)


def test_files_keep_all_of_a_servo(tmp_path):
    write_robot(ROBOT, tmp_path / "forced.toml")
    assert read_robot(tmp_path / "forced.toml").drive == FORCED


def test_one_is_as_many_and_a_copy_goes_on_alike():
    seen = ("tip_position", "motor_force")
    options = {"task": "circle", "robot": ROBOT, "observe": seen, "twin": 4}
    one, many = gymnasium.make(ID, **options), gymnasium.make_vec(ID, 2, **options)
    seen, _ = one.reset(seed=0)
    both, _ = many.reset(seed=0)
    np.testing.assert_array_equal(both["motor_force"][0], seen["motor_force"])
    copy = None
    for k, action in enumerate(actions(5, one.action_space.shape[0])):
        seen, *_, info = one.step(action)
        both, *_, infos = many.step(np.tile(action, (2, 1)))
        for name in seen:
            np.testing.assert_array_equal(both[name][0], seen[name])
        assert np.abs(seen["motor_force"]).max() <= 8.0 * (1 + 1e-9)
        np.testing.assert_array_equal(infos["tendon_length"][0], info["tendon_length"])
        if k >= 9:
            copy = pickle.loads(pickle.dumps(one)) if copy is None else copy
            if k > 9:
                again, *_ = copy.step(action)
                np.testing.assert_allclose(again["tip_position"], seen["tip_position"], atol=1e-9)


def test_an_episode_begins_at_rest():
    env = TrackingEnv("circle", robot=ROBOT, observe="all")
    inputs = env.reset(seed=0)[0]
    start = {"start_input": np.full(3, 2e-3)} if env.action_space.shape == (3,) else {}
    inputs, _ = env.reset(seed=0, options=start)
    still = env.unwrapped.simulation.posture
    for _ in range(10):
        env.unwrapped.simulation.advance()
    np.testing.assert_allclose(env.unwrapped.simulation.posture, still, rtol=0, atol=1e-7)
    assert inputs["motor_force"].shape == (3,)


def test_weak_servos_vary():
    env = TrackingEnv("circle", robot=ROBOT, observe=("motor_force",))
    env.reset(seed=0, options={"vary": {"servo_force": 0.25}})
    for action in actions(4, env.action_space.shape[0]):
        seen, *_ = env.step(action)
        assert np.abs(seen["motor_force"]).max() <= 2.0 * (1 + 1e-9)
    with pytest.raises(ValueError, match="servo_force varies servos' force_limit"):
        TrackingEnv("circle", robot="silicone_rod").reset(options={"vary": {"servo_force": 0.5}})


def test_only_robots_with_motors_have_their_force():
    with pytest.raises(ValueError, match="observe needs distinct names"):
        TrackingEnv("circle", robot="silicone_rod", observe=("motor_force",))


def test_beams_refuse_motors():
    with pytest.raises(ValueError, match="beam models have servos of any force"):
        TrackingEnv("circle", robot=ROBOT, plant=BeamPlant("pcc"))


def test_the_virtual_rig_has_them():
    robot = replace(
        ROBOTS["rig"],
        drive=replace(ROBOTS["rig"].drive, gain=2e4, velocity_gain=200.0, force_limit=5.0),
    )
    rig = VirtualRig(sampled_twin(robot, 3), seed=0)
    for _ in range(1500):
        assert rig.advance(np.array([4e-3, 0.0, 0.0])) is None
    off = 4e-3 - rig.length[0]
    assert 0 <= off <= rig.tension[0] / 2e4 * (1 + 1e-3)
    assert rig.tension.max() <= 5.0 * (1 + 1e-6)
    free = rig.length.copy()
    for _ in range(50):
        assert rig.advance(None) is None
    assert np.abs(rig.length - free).max() < 5e-4


def test_replays_end_where_motions_do():
    body = Body(ROBOT, twin_of(ROBOT, None), "mujoco", "length", 0.01)
    body.begin(np.zeros(3))
    command = np.array([4e-3, 0.0, 0.0])
    for _ in range(300):
        assert body.advance(command) is None
    ideal = replace(ROBOT, drive=replace(FORCED, gear_friction=0.0, encoder_step=0.0))
    rest = Body(ideal, nominal_twin(ideal), "mujoco", "length", 0.01).at_rest(command)
    assert np.abs(body.q - rest).max() < 0.02 * np.abs(rest).max()
