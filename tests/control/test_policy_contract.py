"""What every policy promises, whatever its law."""

import copy
import pickle
from dataclasses import replace

import numpy as np
import pytest

from softrobot_env.control.registry import (
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

ROBOTS = {name: home_robot(name) for name in POLICIES | RIG_POLICIES | REDUCED_POLICIES}

#: The laws of others with other weights or gains.
ALIKE = ("ppo_randomized", "sac", "sac_randomized", "hybrid_ahead", "rig_nn_p")

#: Those that read rates of curvatures, for which an observer may stand in.
BY_RATES = (
    *("lqi", "lq_preview", "lq_adaptive", "mpc", "mpc_preview"),
    *("imitation", "ppo", "sac", "ppo_randomized", "sac_randomized"),
)

#: Long enough for several decisions of the slowest policy [s].
DURATION = 0.6

TIMED = [name for name in ROBOTS if "control_period" in policy_environment(name, ROBOTS[name])]


def make_env(name, duration=DURATION):
    """The environment of a policy's robot."""
    kind, task = (TrackingEnv, "swing") if ROBOTS[name] is ARM else (RigEnv, "triangle")
    task = replace(make_task(task), duration=duration)
    return kind(task, observe="all", **policy_environment(name, ROBOTS[name]))


def case(name, feedback="state"):
    marks = [pytest.mark.slow] if name in ALIKE else []
    return pytest.param((name, feedback), id=f"{name}-{feedback}", marks=marks)


@pytest.fixture(
    scope="module", params=[*map(case, ROBOTS), *(case(name, "output") for name in BY_RATES)]
)
def which(request):
    """Name and feedback."""
    return request.param


@pytest.fixture(scope="module")
def name(which):
    return which[0]


@pytest.fixture(scope="module")
def env(name):
    return make_env(name)


@pytest.fixture(scope="module")
def policy(which, env):
    name, feedback = which
    policy = make_policy(name, ROBOTS[name], env.control_period, feedback)
    if feedback == "state":
        assert ("curvature_rate" in policy.requires) == (name in BY_RATES)
    return policy


#: Option of `reset`, what a full action is in its unit, and two starts.
STARTS = {
    ARM.name: ("start_input", 80, ((5.0, 5.0, 5.0), (-8.0, 4.0, -2.0))),
    RIG.name: ("start_length", 0.03, ((2e-3, 0.0, 4e-3), (8e-3, -1e-3, 1e-3))),
}


@pytest.fixture(scope="module")
def seen(name, env, policy):
    """Two episodes of some decisions from different starts, as lists of observations."""
    episodes = []
    option, scale, starts = STARTS[ROBOTS[name].name]
    for start in starts:
        observation, _ = env.reset(options={option: np.array(start)})
        action = (np.array(start) / scale).astype(np.float32)
        episode = [observation]
        while len(episode) < policy.hold + 8:
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


@pytest.fixture(scope="module")
def actions(policy, seen):
    """Over the first episode."""
    return follow(policy, seen[0])


def stacked(*observations):
    return {key: np.stack([o[key] for o in observations]) for key in observations[0]}


def test_stacked_observations_give_the_same_actions(policy, seen, actions):
    single, state = [actions, follow(policy, seen[1])], None
    for k, pair in enumerate(zip(*seen, strict=True)):
        found, state = policy.predict(stacked(*pair), state, np.array([k == 0, k == 0]))
        assert found.shape == (2, 3) and found.dtype == np.float32
        np.testing.assert_array_equal(found, [single[0][k], single[1][k]])


def test_one_of_several_environments_can_restart(policy, seen):
    fresh, _ = policy.predict(seen[1][0], None)
    state = None
    for observation in seen[0][:3]:
        _, state = policy.predict(stacked(observation, observation), state)
    found, _ = policy.predict(stacked(seen[0][3], seen[1][0]), state, np.array([False, True]))
    np.testing.assert_array_equal(found[1], fresh)


def test_state_is_not_changed_in_place(policy, seen):
    episode, state = seen[0], None
    for observation in episode[:5]:
        _, state = policy.predict(observation, state)
    once, then = policy.predict(episode[5], state)
    again, _ = policy.predict(episode[5], state)
    np.testing.assert_array_equal(once, again)
    policy.predict(episode[6], then)
    np.testing.assert_array_equal(policy.predict(episode[5], state)[0], once)


def test_episode_start_forgets_the_state(policy, seen, actions):
    _, state = policy.predict(seen[1][0], None)
    restarted, _ = policy.predict(seen[0][0], state, episode_start=np.array([True]))
    np.testing.assert_array_equal(restarted, actions[0])


def test_missing_observables_are_named(policy):
    with pytest.raises(ValueError, match=rf"needs the observables .*{policy.requires[0]}"):
        policy.predict({"tendon_length": np.zeros(6)}, None)


def test_policies_can_be_copied_and_pickled(policy, seen, actions):
    for other in (copy.deepcopy(policy), pickle.loads(pickle.dumps(policy))):
        np.testing.assert_array_equal(follow(other, seen[0]), actions)


def test_observations_may_be_strided_and_stay_and_be_changed_afterwards_as_actions_may(
    policy, seen, actions
):
    state = None
    for observation, wanted in zip(seen[0], actions, strict=True):
        shown = {key: np.stack([value] * 2, axis=1)[:, 0] for key, value in observation.items()}
        action, state = policy.predict(shown, state)
        np.testing.assert_array_equal(action, wanted)
        for key, value in shown.items():
            assert observation[key].flags.c_contiguous
            np.testing.assert_array_equal(value, observation[key])
            value += 1.0
        action += 0.3


def test_observations_of_another_size_are_refused(name, policy, seen):
    for key in {*policy.requires} - {"curvature_rate"} if name != "hold" else ():
        short = {**seen[0][0], key: seen[0][0][key][:1]}
        with pytest.raises(ValueError, match=r"entries|preview="):
            policy.predict(short, None)


def test_states_and_starts_of_other_numbers_of_environments_are_refused(policy, seen):
    one, two = seen[0][0], stacked(seen[0][0], seen[0][0])
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


def test_absurd_observations_do_not_stay(policy, seen):
    for key in policy.requires:
        state = None
        for k, observation in enumerate(seen[0]):
            if k in (2, 5):
                value = 1e6 if k == 2 else 1e200
                observation = {**observation, key: np.full_like(observation[key], value)}
            with np.errstate(all="ignore"):
                action, state = policy.predict(observation, state)
            assert np.all(np.isfinite(action)) and np.all(np.abs(action) <= 1), key
        assert state_is_finite(state), key


def test_observations_that_are_not_finite_keep_the_action(policy, seen):
    """And nothing of it stays in the state."""
    for key in policy.requires:
        state = None
        for value in (np.nan, np.inf):
            bad = {**seen[0][0], key: np.full_like(seen[0][0][key], value)}
            action, state = policy.predict(bad, state)
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
    if isinstance(state, np.ndarray | float):
        return bool(np.all(np.isfinite(state)))
    parts = state if isinstance(state, tuple) else getattr(state, "__dict__", {}).values()
    return all(map(state_is_finite, parts))


def test_references_out_of_reach_are_reported(name, policy, env):
    """The reference is 1.27 times as far away as the arm is long, 1.23 times as the rig."""
    reasons = ["reference out of reach", "outside the trained workspace"]
    if name == "mpc_preview":  # pulls with all it has
        reasons.append("tension limit reached")
    observation, _ = env.reset()
    far = np.array([0.45, 0.45] if ROBOTS[name] is ARM else [0.175, 0.175])
    state, status = None, ""
    while name != "hold" and not any(reason in status for reason in reasons):
        observation["reference"] = far
        observation["reference_preview"] = np.tile(far, observation["reference_preview"].size // 2)
        action, state = policy.predict(observation, state)
        assert np.all(np.abs(action) <= 1)
        status = state.status or ""
        observation, _, terminated, truncated, info = env.step(action)
        assert not (terminated or truncated), info


def test_policies_run_in_stable_baselines3(name, policy):
    evaluation = pytest.importorskip("stable_baselines3.common.evaluation")
    vec_env = pytest.importorskip("stable_baselines3.common.vec_env")
    monitor = pytest.importorskip("stable_baselines3.common.monitor")
    envs = vec_env.DummyVecEnv(2 * [lambda: monitor.Monitor(make_env(name, DURATION / 3))])
    rewards, lengths = evaluation.evaluate_policy(
        policy, envs, n_eval_episodes=2, return_episode_rewards=True
    )
    period = envs.envs[0].unwrapped.control_period
    assert lengths == [round(DURATION / 3 / period)] * 2
    assert rewards[0] == pytest.approx(rewards[1])  # no randomness, no state shared


def test_records_have_one_time_and_status_per_decision(policy, env):
    rollout = run_episode(env, policy)
    steps = len(rollout.time) - 1
    assert len(rollout.policy_time) == len(rollout.policy_status) == -(-steps // policy.hold)
    assert rollout.failure is None


@pytest.mark.parametrize("name", TIMED)
def test_control_periods_that_do_not_fit_are_refused(name):
    with pytest.raises(ValueError, match="control_period that divides"):
        make_policy(name, ROBOTS[name], 0.0017)
