"""Episodes of one of softrobot_env's policies as a LeRobotDataset, to learn from.

python -m lerobot_robot_softrobot.record --policy lq_adaptive --episodes 20 --out out/swings
"""

import json
from argparse import ArgumentParser
from pathlib import Path

import gymnasium
import numpy as np
from lerobot.datasets.lerobot_dataset import LeRobotDataset

import softrobot_env  # noqa: F401  # registers the environments
from softrobot_env.control.registry import make_policy, policy_environment

from .names import OPTIONS, TASK, action_names, observation_names, split


def features(env: gymnasium.Env) -> dict[str, dict]:
    """What the columns of a dataset are."""
    seen = observation_names(env)
    of_task = [name for name in seen if name.startswith(TASK)]
    columns = {
        "observation.state": [name for name in seen if name not in of_task],
        "observation.environment_state": of_task,
        "action": action_names(env),
    }
    return {
        key: {"dtype": "float32", "shape": (len(names),), "names": names}
        for key, names in columns.items()
        if names
    }


def record(
    env_id: str, policy: str, episodes: int, out: Path, noise: float = 0.0
) -> LeRobotDataset:
    """Record episodes.

    Args:
        env_id: Gymnasium's id.
        policy: Name of a policy of its robot.
        episodes: Their number.
        out: New folder.
        noise: Largest share of full scale by which actions are disturbed, so that there is
            something to correct; the dataset has the policy's own.
    """
    robot = gymnasium.make(env_id).unwrapped.task.robot
    options = policy_environment(policy, robot)
    env = gymnasium.make(env_id, **options)
    expert = make_policy(policy, env)
    rate = 1 / env.unwrapped.control_period
    dataset = LeRobotDataset.create(
        f"softrobot/{out.name}", fps=round(rate), features=features(env), root=out, use_videos=False
    )
    if abs(rate - round(rate)) > 1e-9:
        raise ValueError(f"LeRobot needs whole actions a second, not {rate:g}")
    rng = np.random.default_rng(0)
    for episode in range(episodes):
        observation, _ = env.reset(seed=episode)
        state, start, over = None, True, False
        while not over:
            action, state = expert.predict(observation, state, np.array([start]), True)
            action = np.asarray(action, np.float32)
            frame = split(observation) | {"action": action, "task": env.unwrapped.task.name}
            dataset.add_frame(frame)
            shaken = np.clip(action + rng.uniform(-noise, noise, action.shape), -1, 1)
            observation, _, terminated, truncated, _ = env.step(shaken.astype(np.float32))
            start, over = False, terminated or truncated
        dataset.save_episode()
    env.close()
    dataset.finalize()
    (out / OPTIONS).write_text(json.dumps(options))
    return dataset


def main() -> None:
    """Record as the command line says."""
    parser = ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--env", default="SoftRobot/ArmSwing-v0")
    parser.add_argument("--policy", default="lq_adaptive")
    parser.add_argument("--episodes", type=int, default=20)
    parser.add_argument("--noise", type=float, default=0.0)
    parser.add_argument("--out", type=Path, required=True)
    args = parser.parse_args()
    made = record(args.env, args.policy, args.episodes, args.out, args.noise)
    print(f"Wrote {made.num_episodes} episodes, {made.num_frames} frames, to {args.out}")


if __name__ == "__main__":
    main()
