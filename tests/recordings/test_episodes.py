"""Every environment writes recordings that a replay repeats."""

from dataclasses import replace

import gymnasium
import numpy as np
import pytest

from softrobot_env.envs.recording import RecordEpisodes, RecordVectorEpisodes
from softrobot_env.envs.tracking import TrackingEnv
from softrobot_env.envs.vector import VectorTrackingEnv
from softrobot_env.evaluation.run import run_episode
from softrobot_env.identification.replay import replay
from softrobot_env.recordings import Commands, read_recording
from softrobot_env.recordings.recording import at_their_time
from softrobot_env.robots import ARM, ROBOTS
from softrobot_env.robots.twin import rig3d_twin, twin_or_ideal
from softrobot_env.scene.timestep import TimestepWarning
from softrobot_env.tasks import make_task
from softrobot_env.thesis.envs import RigEnv


class Wander:
    """A policy of small random changes."""

    def predict(self, observation, state=None, episode_start=None, deterministic=True):
        rng, action = state or (np.random.default_rng(0), observation["previous_action"])
        action = np.clip(action + 0.05 * rng.standard_normal(action.shape), -0.4, 0.4)
        return action.astype(np.float32), (rng, action)


@pytest.mark.parametrize(
    ("make", "twin"),
    [
        (lambda: TrackingEnv("swing", observe="all"), None),
        (lambda: TrackingEnv("circle", robot="silicone_rod", observe="all"), None),
        (lambda: RigEnv("triangle", observe="all"), twin_or_ideal(None)),
    ],
    ids=["arm", "rod", "rig"],
)
def test_two_episodes_are_replayed_as_they_were(make, twin, tmp_path):
    path = tmp_path / "episodes.csv"
    env = RecordEpisodes(make(), path)
    rollouts = [run_episode(env, Wander(), seed, {"duration": 0.4}) for seed in range(2)]
    task = env.unwrapped.task
    env.close()
    recording = read_recording(path)
    assert recording.runs.tolist() == [k for k, r in enumerate(rollouts) for _ in r.time]
    found = replay(recording, task.robot, twin=twin)
    # Nine digits are written.
    assert not found.failures and found.distance.max() < 1e-7
    for number, rollout in enumerate(rollouts):
        one = recording.part(recording.runs == number)
        own = rollout.recording(task)
        assert one.markers == pytest.approx(own.markers, abs=1e-8, nan_ok=True)
        assert one.commands == pytest.approx(own.commands, rel=1e-8, abs=1e-9)
        assert set(own.labels) == {task.name}


def test_noise_is_recorded_as_the_camera_sees_it():
    """Of a rig at rest the difference to its replay is the noise."""
    twin = rig3d_twin(3)
    env = RecordEpisodes(RigEnv("reach", twin=twin, observe="all"))
    env.reset(seed=0)
    for _ in range(200):
        env.step(np.zeros(3, dtype=np.float32))
    recording = env.recording
    env.close()
    error = replay(recording, env.unwrapped.task.robot, twin=twin).error[:, 0, :2]
    # 90 pictures a second, 200 rows: the deviation is known to about 5 %.
    assert error.std(axis=0) == pytest.approx(twin.camera_noise, rel=0.2)
    assert np.abs(error.mean(axis=0)).max() < 0.3 * twin.camera_noise


def test_a_failed_step_is_left_out(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)  # MuJoCo writes its log there
    task = make_task("swing")
    task = replace(task, robot=replace(task.robot, damping_time=0.0))
    with pytest.warns(TimestepWarning):
        steps = {"integrator": "RK4", "timestep": 0.02, "control_period": 0.02}
        env = RecordEpisodes(TrackingEnv(task, observe="all", **steps))
    env.reset()
    count, failed = 0, False
    while not failed:
        *_, failed, over, _ = env.step(np.ones(3, dtype=np.float32))
        assert not over
        count += 1
    assert len(env.recording.times) == count  # the start, and every step but the last


def test_an_environment_without_what_is_recorded_is_refused():
    with pytest.raises(ValueError, match='tip_position, previous_action: pass observe="all"'):
        RecordEpisodes(gymnasium.make("CartPole-v1"))
    with pytest.raises(ValueError, match='observe_as="dict"'):
        RecordEpisodes(TrackingEnv("swing", observe_as="vector"))
    with pytest.raises(ValueError, match="nothing was recorded"):
        _ = RecordEpisodes(TrackingEnv("swing", observe="all")).recording


def test_pictures_count_at_their_own_time():
    """A tip at constant speed, seen late by two ages in turn, is where it was at each instant."""
    times = 0.02 * np.arange(10)
    ages = np.where(np.arange(10) % 2, 0.005, 0.012)
    tips = np.stack([0.3 * (times - ages), 1 - (times - ages)], axis=1)
    found = at_their_time(times, ages, tips)[1:-1]
    assert found == pytest.approx(np.stack([0.3 * times, 1 - times], axis=1)[1:-1])
    assert at_their_time(times, 0 * ages, tips) is tips


def test_many_environments_are_recorded_as_one_is():
    """Episodes end and begin at different times; each is a run as a single environment's."""
    task = replace(make_task("swing"), duration=0.05)
    many = RecordVectorEpisodes(VectorTrackingEnv(2, task, observe="all"))
    many.reset(seed=[3, 4])
    rng = np.random.default_rng(1)
    actions = rng.uniform(-0.3, 0.3, (9, 2, 3)).astype(np.float32)
    for action in actions:
        many.step(action)
    one = RecordEpisodes(TrackingEnv(task, observe="all"))
    # Two whole episodes: the sixth step, whose action is ignored, begins the second.
    for number in range(2):
        one.reset()
        for action in actions[6 * number : 6 * number + 5, 0]:
            one.step(action)
    found, single = many.recording, one.recording
    many.close()
    assert found.runs.tolist() == [0] * 6 + [1] * 6 + [2] * 4 + [3] * 4
    rows = np.isin(found.runs, (0, 2))
    assert found.part(rows).commands == pytest.approx(single.commands[:10], abs=1e-9)
    assert found.part(rows).markers == pytest.approx(single.markers[:10], abs=1e-9, nan_ok=True)
    with pytest.raises(ValueError, match="NEXT_STEP or DISABLED"):
        RecordVectorEpisodes(VectorTrackingEnv(2, task, autoreset_mode="SameStep", observe="all"))


def test_actions_are_replayed_as_what_they_stand_for():
    """As a Minari data set has them: the drives then apply what the environment's did."""
    task = replace(make_task("swing"), duration=0.2)
    env = RecordEpisodes(TrackingEnv(task, observe="all"))
    rollout = run_episode(env, Wander())
    reported = env.recording
    env.close()
    columns = tuple(f"action.{k}" for k in range(3))
    commands = Commands("action", columns, "1", in_force="until")
    acted = replace(
        reported, header=replace(reported.header, commands=commands), commands=rollout.action
    )
    assert acted.controls(ARM) == pytest.approx(reported.controls(ARM), abs=1e-12)
    assert replay(acted, ARM).distance.max() < 1e-12
    with pytest.raises(ValueError, match="takes actions of 2 numbers, the recording has 3"):
        acted.controls(ROBOTS["planar_finger"])
