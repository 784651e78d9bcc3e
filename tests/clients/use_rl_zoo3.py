"""rl_zoo3: its commands for training and for watching what was trained."""

import subprocess
import sys
from pathlib import Path
from tempfile import TemporaryDirectory

from uses import SIMULATED, SOME, tried

#: Our settings, which are for vectors; a training of few steps needs no more than a small rollout.
EXAMPLE = Path(__file__).resolve().parents[2] / "examples" / "rl_zoo3_ppo.yml"

SETTINGS = """
{env_id}:
  n_timesteps: 64
  policy: 'MultiInputPolicy'
  n_envs: 2
  n_steps: 16
  batch_size: 16
  n_epochs: 1
  normalize: true
"""


def command(*words: str) -> None:
    done = subprocess.run(
        [sys.executable, "-m", *words], capture_output=True, text=True, check=False
    )
    if done.returncode != 0:
        print(done.stdout, done.stderr, file=sys.stderr)
        raise RuntimeError(done.stderr.strip().splitlines()[-1])


def train_and_enjoy(env_id: str, settings: Path, *short: str) -> None:
    with TemporaryDirectory() as folder:
        own = ["--algo", "ppo", "--env", env_id, "--gym-packages", "softrobot_env", "-f", folder]
        how = ["--conf-file", str(settings), "--eval-freq", "-1"]
        command("rl_zoo3.train", *own, *how, *short)
        command("rl_zoo3.enjoy", *own, "-n", "20", "--no-render")


def use_settings(env_id: str) -> None:
    with TemporaryDirectory() as folder:
        settings = Path(folder) / "settings.yml"
        settings.write_text(SETTINGS.format(env_id=env_id))
        train_and_enjoy(env_id, settings)


def use_example(env_id: str) -> None:
    short = ["-n", "64", "-params", "n_steps:16", "batch_size:16", "n_epochs:1"]
    train_and_enjoy(env_id, EXAMPLE, *short)


tried("train and enjoy", SIMULATED, use_settings)
tried("examples/rl_zoo3_ppo.yml", SOME, use_example)
