"""RLlib: our example of it, which trains and saves."""

import subprocess
import sys
from pathlib import Path
from tempfile import TemporaryDirectory

from uses import SOME, tried

EXAMPLE = Path(__file__).resolve().parents[2] / "examples" / "rllib_ppo.py"


def example(env_id: str) -> None:
    with TemporaryDirectory() as folder:
        words = ["--env", env_id, "--rollouts", "2", "--rollout", "256", "--out", folder]
        done = subprocess.run(
            [sys.executable, str(EXAMPLE), *words], capture_output=True, text=True, check=False
        )
        print(done.stdout, done.stderr, file=sys.stderr)
        if done.returncode != 0 or not any(Path(folder).iterdir()):
            raise RuntimeError((done.stderr.strip().splitlines() or ["nothing saved"])[-1])


tried("examples/rllib_ppo.py", SOME, example)
