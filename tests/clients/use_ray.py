"""RLlib: our example of it, which trains on a cluster of two nodes and saves a policy that runs."""

import subprocess
import sys
from pathlib import Path
from tempfile import TemporaryDirectory

import gymnasium
from ray.cluster_utils import Cluster
from uses import SOME, tried

from softrobot_env.control.registry import make_policy

EXAMPLE = Path(__file__).resolve().parents[2] / "examples" / "rllib_ppo.py"


def example(env_id: str) -> None:
    cluster = Cluster(initialize_head=True, head_node_args={"num_cpus": 2})
    try:
        cluster.add_node(num_cpus=2)
        cluster.wait_for_nodes()
        with TemporaryDirectory() as folder:
            network = Path(folder) / "rllib.npz"
            words = ["--env", env_id, "--rollouts", "2", "--rollout", "256", "--runners", "2"]
            words += ["--robots", "4", "--address", cluster.address, "--out", str(network)]
            done = subprocess.run(
                [sys.executable, str(EXAMPLE), *words], capture_output=True, text=True, check=False
            )
            print(done.stdout, done.stderr, file=sys.stderr)
            if done.returncode != 0 or not network.is_file():
                raise RuntimeError((done.stderr.strip().splitlines() or ["nothing saved"])[-1])
            env = gymnasium.make(f"softrobot_env:{env_id}", observe="all")
            policy = make_policy(str(network), env)
            action, _ = policy.predict(env.reset(seed=0)[0])
            assert action in env.action_space
    finally:
        cluster.shutdown()


tried("examples/rllib_ppo.py", SOME, example)
