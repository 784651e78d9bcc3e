"""Episodes of a policy, step by step."""


def driven_steps(env, policy, count=None, shown=lambda k, seen: seen, **options):
    """Of each step what the policy is shown, its action and state, and the observation after it.

    Args:
        env: Environment, which must not fail.
        policy: Policy.
        count: Number of steps; to the end of the episode unless given.
        shown: Number of a step and observation -> what the policy is shown.
        **options: Of `reset`.
    """
    observation, _ = env.reset(seed=0, options=options)
    state, over, k = None, False, 0
    while not over and k != count:
        seen = shown(k, observation)
        action, state = policy.predict(seen, state)
        observation, _, failed, over, info = env.step(action)
        assert not failed, info["failure"]
        yield seen, action, state, observation
        k += 1
