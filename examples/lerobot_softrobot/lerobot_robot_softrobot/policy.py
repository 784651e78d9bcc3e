"""A policy that LeRobot trained, as a policy of softrobot_env.

    LEROBOT_POLICY=out/train/checkpoints/last/pretrained_model \\
        softrobot evaluate --tasks swing --policies lerobot_robot_softrobot.policy:trained
"""

import json
import os
from pathlib import Path
from typing import Any

import numpy as np
import torch
from lerobot.configs.policies import PreTrainedConfig
from lerobot.policies.factory import get_policy_class, make_pre_post_processors

from .names import OPTIONS, split


class LeRobotPolicy:
    """Decides by what `record` put into its dataset: robot and task, or all of it as the state."""

    def __init__(self, path: Path | str) -> None:
        """Load the folder `pretrained_model` of a checkpoint."""
        config = PreTrainedConfig.from_pretrained(path)
        self._policy = get_policy_class(config.type).from_pretrained(path, config=config)
        self._policy.eval()
        device = {"device_processor": {"device": str(config.device)}}
        self._before, self._after = make_pre_post_processors(
            config, pretrained_path=str(path), preprocessor_overrides=device
        )

    def predict(
        self,
        observation: dict[str, np.ndarray],
        state: Any = None,
        episode_start: Any = None,
        deterministic: bool = True,
    ) -> tuple[np.ndarray, Any]:
        """See stable-baselines3; the memory of chunks is in the policy itself."""
        if episode_start is None or np.any(episode_start):
            for part in (self._policy, self._before, self._after):
                part.reset()
        inputs = {key: torch.from_numpy(value)[None] for key, value in split(observation).items()}
        with torch.inference_mode():
            action = self._after(self._policy.select_action(self._before(inputs)))
        return np.clip(action[0].cpu().numpy(), -1, 1).astype(np.float32), state


def _folder() -> Path:
    if "LEROBOT_POLICY" not in os.environ:
        raise ValueError("LEROBOT_POLICY must name the folder pretrained_model of a checkpoint")
    return Path(os.environ["LEROBOT_POLICY"])


def environment(robot: Any) -> dict[str, Any]:
    """Options of the environment that the dataset was recorded in, from its folder."""
    config = json.loads((_folder() / "train_config.json").read_text())
    return json.loads((Path(config["dataset"]["root"]) / OPTIONS).read_text())


def trained(robot: Any, control_period: float) -> LeRobotPolicy:
    """The policy in the folder that the environment variable LEROBOT_POLICY names."""
    return LeRobotPolicy(_folder())


trained.environment = environment
