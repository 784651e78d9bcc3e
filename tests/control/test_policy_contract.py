"""What every policy promises, whatever its law."""

import copy
import pickle
from dataclasses import replace

import numpy as np
import pytest

from softrobot_env.control.registry import (
    FEEDBACKS,
    POLICIES,
    REDUCED_POLICIES,
    RIG_POLICIES,
    home_robot,
    make_policy,
    policy_environment,
)
from softrobot_env.envs.tracking import TrackingEnv
from softrobot_env.evaluation.run import run_episode
from softrobot_env.robots import ARM, RIG
from softrobot_env.tasks import make_task
from softrobot_env.thesis.envs import RigEnv

#: Long enough for several decisions of the slowest policy.
SHORT = replace(make_task("swing"), duration=0.6)
RIG_SHORT = replace(make_task("triangle"), duration=0.6)

ROBOTS = {name: home_robot(name) for name in POLICIES | RIG_POLICIES | REDUCED_POLICIES}


#: The laws of others with other weights or gains.
ALIKE = ("ppo_randomized", "sac", "sac_randomized", "hybrid_ahead", "rig_nn_p")


def make_env(name, **options):
    """The environment of a policy's robot."""
    options |= policy_environment(name, ROBOTS[name])
    return TrackingEnv(SHORT, **options) if ROBOTS[name] is ARM else RigEnv(RIG_SHORT, **options)


@pytest.fixture(
    scope="module",
    params=[pytest.param(n, marks=pytest.mark.slow) if n in ALIKE else n for n in ROBOTS],
)
def name(request):
    return request.param


@pytest.fixture(scope="module")
def env(name):
    return make_env(name, observe="all")


@pytest.fixture(scope="module", params=FEEDBACKS[:2])
def policy(request, name, env):
    robot = ROBOTS[name]
    policy = make_policy(name, robot, env.control_period, request.param)
    if (
        request.param == "output"
        and policy.requires == make_policy(name, robot, env.control_period).requires
    ):
        pytest.skip("measures no rates")
    return policy


#: Option of `reset`, what a full action is in its unit, and two starts.
STARTS = {
    ARM.name: ("start_input", 80, ((5.0, 5.0, 5.0), (-8.0, 4.0, -2.0))),
    RIG.name: ("start_length", 0.03, ((2e-3, 0.0, 4e-3), (8e-3, -1e-3, 1e-3))),
}


@pytest.fixture(scope="module")
def seen(name, env):
    """Two episodes under the hold policy from different starts, as lists of observations."""
    episodes = []
    option, scale, starts = STARTS[ROBOTS[name].name]
    for start in starts:
        observation, _ = env.reset(options={option: np.array(start)})
        action = (np.array(start) / scale).astype(np.float32)
        episode = [observation]
        while len(episode) < 30:
            observation, *_ = env.step(action)
            action = -action  # something has to move
            episode.append(observation)
        episodes.append(episode)
    return episodes


def follow(policy, episode):
    """Actions over an episode, one by one."""
    state, actions = None, []
    for observation in episode:
        action, state = policy.predict(observation, state)
        actions.append(action)
    return actions


def test_stacked_observations_give_the_same_actions(policy, seen):
    single = [follow(policy, episode) for episode in seen]
    state = None
    for k in range(len(seen[0])):
        pair = [episode[k] for episode in seen]
        stacked = {key: np.stack([o[key] for o in pair]) for key in pair[0]}
        actions, state = policy.predict(stacked, state, np.array([k == 0, k == 0]))
        assert actions.shape == (2, 3) and actions.dtype == np.float32
        np.testing.assert_array_equal(actions, [single[0][k], single[1][k]])


def test_one_of_several_environments_can_restart(policy, seen):
    fresh, _ = policy.predict(seen[1][0], None)
    state = None
    for k in range(3):
        pair = [seen[0][k], seen[0][k]]
        stacked = {key: np.stack([o[key] for o in pair]) for key in pair[0]}
        _, state = policy.predict(stacked, state)
    stacked = {key: np.stack([seen[0][3][key], seen[1][0][key]]) for key in seen[0][3]}
    actions, _ = policy.predict(stacked, state, np.array([False, True]))
    np.testing.assert_array_equal(actions[1], fresh)


def test_state_is_not_changed_in_place(policy, seen):
    episode, state = seen[0], None
    for observation in episode[:5]:
        _, state = policy.predict(observation, state)
    once, then = policy.predict(episode[5], state)
    again, _ = policy.predict(episode[5], state)
    np.testing.assert_array_equal(once, again)
    policy.predict(episode[6], then)
    np.testing.assert_array_equal(policy.predict(episode[5], state)[0], once)


def test_episode_start_forgets_the_state(policy, seen):
    fresh, _ = policy.predict(seen[0][0], None)
    _, state = policy.predict(seen[1][0], None)
    restarted, _ = policy.predict(seen[0][0], state, episode_start=np.array([True]))
    np.testing.assert_array_equal(restarted, fresh)


def test_missing_observables_are_named(policy):
    with pytest.raises(ValueError, match=rf"needs the observables .*{policy.requires[0]}"):
        policy.predict({"tendon_length": np.zeros(6)}, None)


def test_observations_are_not_changed(policy, seen):
    observation = {key: value.copy() for key, value in seen[0][0].items()}
    state = None
    for _ in range(3):
        _, state = policy.predict(observation, state)
    for key, value in observation.items():
        np.testing.assert_array_equal(value, seen[0][0][key])


def test_policies_can_be_copied_and_pickled(policy, seen):
    expected = follow(policy, seen[0])
    for other in (copy.deepcopy(policy), pickle.loads(pickle.dumps(policy))):
        np.testing.assert_array_equal(follow(other, seen[0]), expected)


def test_what_is_returned_or_shown_may_be_changed_afterwards(policy, seen):
    expected, state = follow(policy, seen[0]), None
    for observation, wanted in zip(seen[0], expected, strict=True):
        shown = {key: value.copy() for key, value in observation.items()}
        action, state = policy.predict(shown, state)
        np.testing.assert_array_equal(action, wanted)
        action += 0.3
        for value in shown.values():
            value += 1.0


def test_strided_observations_are_as_good(policy, seen):
    for value in seen[0][0].values():
        assert value.flags.c_contiguous
    strided = [{k: np.stack([v, v], axis=1)[:, 0] for k, v in o.items()} for o in seen[0]]
    np.testing.assert_array_equal(follow(policy, strided), follow(policy, seen[0]))


def test_observations_of_another_size_are_refused(name, policy, seen):
    if name == "hold":
        pytest.skip("takes any robot")
    for key in policy.requires:
        if key == "curvature_rate":
            continue
        short = {**seen[0][0], key: seen[0][0][key][:1]}
        with pytest.raises(ValueError, match=r"entries|preview="):
            policy.predict(short, None)


def test_states_and_starts_of_other_numbers_of_environments_are_refused(policy, seen):
    one = seen[0][0]
    two = {key: np.stack([value, value]) for key, value in one.items()}
    _, single = policy.predict(one, None)
    _, double = policy.predict(two, None)
    for observation, state, start in (
        (two, single, None),
        (one, double, None),
        (two, None, np.zeros(3, bool)),
        (one, single, np.zeros(2, bool)),
        ({key: value[:1] for key, value in two.items()}, double, None),
    ):
        with pytest.raises(ValueError, match="environment"):
            policy.predict(observation, state, start)


@pytest.mark.parametrize("value", [1e6, 1e200])
def test_absurd_observations_do_not_stay(policy, seen, value):
    for key in policy.requires:
        state = None
        for k, observation in enumerate(seen[0]):
            if k == 2:
                observation = {**observation, key: np.full_like(observation[key], value)}
            with np.errstate(all="ignore"):
                action, state = policy.predict(observation, state)
            assert np.all(np.isfinite(action)) and np.all(np.abs(action) <= 1), key
        assert state_is_finite(state), key


@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_observations_that_are_not_finite_keep_the_action(policy, seen, value):
    """And nothing of it stays in the state."""
    for key in policy.requires:
        bad = {**seen[0][0], key: np.full_like(seen[0][0][key], value)}
        action, state = policy.predict(bad, None)
        assert np.all(np.isfinite(action)) and np.all(np.abs(action) <= 1)
        if policy.requires != ("previous_action",):  # `hold` looks at nothing else
            assert "not finite" in state.status
            if key != "previous_action":
                np.testing.assert_allclose(action, bad["previous_action"], atol=1e-6)
        for observation in seen[0]:
            action, state = policy.predict(observation, state)
        assert np.all(np.isfinite(action)) and state_is_finite(state)


def state_is_finite(state):
    """Whether all numbers in a state are finite."""
    if isinstance(state, np.ndarray):
        return bool(np.all(np.isfinite(state)))
    if isinstance(state, float):
        return bool(np.isfinite(state))
    if isinstance(state, tuple):
        return all(state_is_finite(part) for part in state)
    if hasattr(state, "__dict__"):
        return all(state_is_finite(part) for part in vars(state).values())
    return True


def test_references_out_of_reach_are_reported(name, policy, env):
    """The reference is 1.27 times as far away as the arm is long, 1.23 times as the rig."""
    if name == "hold":
        pytest.skip("follows no reference")
    observation, _ = env.reset()
    far = np.array([0.45, 0.45] if ROBOTS[name] is ARM else [0.175, 0.175])
    state, statuses = None, set()
    for _ in range(min(500, len(env._rows["position"]) - 1)):
        observation["reference"] = far
        observation["reference_preview"] = np.tile(far, observation["reference_preview"].size // 2)
        action, state = policy.predict(observation, state)
        assert np.all(np.abs(action) <= 1)
        statuses.add(state.status)
        observation, _, terminated, _, info = env.step(action)
        assert not terminated, info
    reasons = ("reference out of reach", "outside the trained workspace")
    if name == "mpc_preview":  # pulls with all it has
        reasons += ("tension limit reached",)
    assert any(reason in status for status in statuses - {None} for reason in reasons)


def test_policies_run_in_stable_baselines3(name, policy):
    evaluation = pytest.importorskip("stable_baselines3.common.evaluation")
    vec_env = pytest.importorskip("stable_baselines3.common.vec_env")
    monitor = pytest.importorskip("stable_baselines3.common.monitor")

    def make():
        # The default observation of a robot driven by tension has no reference acceleration.
        return monitor.Monitor(make_env(name, observe="all"))

    envs = vec_env.DummyVecEnv([make, make])
    rewards, lengths = evaluation.evaluate_policy(
        policy, envs, n_eval_episodes=2, return_episode_rewards=True
    )
    period = envs.envs[0].unwrapped.control_period
    assert lengths == [round(SHORT.duration / period)] * 2
    assert rewards[0] == pytest.approx(rewards[1])  # no randomness, no state shared


def test_records_have_one_time_and_status_per_decision(policy, env):
    rollout = run_episode(env, policy)
    steps = len(rollout.time) - 1
    assert len(rollout.policy_time) == len(rollout.policy_status) == -(-steps // policy.hold)
    assert rollout.failure is None


def test_control_periods_that_do_not_fit_are_refused(name):
    if "control_period" not in policy_environment(name, ROBOTS[name]):
        pytest.skip("works at any control period")
    with pytest.raises(ValueError, match="control_period that divides"):
        make_policy(name, ROBOTS[name], 0.0017)
