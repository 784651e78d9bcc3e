"""The trainings whose learning curves and spread over seeds are compared."""

import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from time import perf_counter
from typing import Any

from softrobot_env.core.artifacts import read_facts
from softrobot_env.core.jobs import quiet
from softrobot_env.core.writing import write_text
from softrobot_env.learned.network import Network
from softrobot_env.training.artifacts import save
from softrobot_env.training.imitation import ImitationConfig, imitate
from softrobot_env.training.rl import train
from softrobot_env.training.rl_config import RLConfig, preset
from softrobot_env.training.watch import Point

IMITATION = "imitation"

#: Only so much of everything in a quick run.
_QUICK_STEPS = 2000


@dataclass(frozen=True)
class Case:
    """A training by reinforcement learning.

    Attributes:
        algorithm: "ppo", "sac" or "td3".
        warm: Whether it starts from the imitation of the same seed.
        disturbed: Whether robots and disturbances are drawn from broad ranges.
    """

    algorithm: str
    warm: bool
    disturbed: bool

    def config(self, quick: bool) -> RLConfig:
        """Its settings."""
        config = preset(self.algorithm, self.warm, self.disturbed)
        if not quick:
            return config
        return replace(
            config,
            steps=_QUICK_STEPS,
            critic_steps=0,
            envs_per_task=1,
            drawn_tasks=1,
            trials=({},),
            trial_duration=0.2,
        )


#: Name of the artifact or curve -> training.
CASES = {
    "ppo": Case("ppo", warm=False, disturbed=False),
    "sac": Case("sac", warm=False, disturbed=False),
    "sac_randomized": Case("sac", warm=False, disturbed=True),
    "ppo_tuned": Case("ppo", warm=True, disturbed=False),
    "ppo_randomized": Case("ppo", warm=True, disturbed=True),
}

#: What is trained one after the other, in one process: what starts from a network comes after it.
CHAINS = (
    (IMITATION, "ppo_tuned", "ppo_randomized"),
    ("ppo",),
    ("sac",),
    ("sac_randomized",),
)


def run_chain(chain: Sequence[str], seed: int, folder: Path, quick: bool) -> None:
    """Train what is missing in a folder, which then holds it; see `load_run`."""
    for name in chain:
        settings, path = _settings(name, seed, quick), _facts(folder, name, seed)
        if not path.is_file() or read_facts(path)["settings"] != settings:
            _train(name, seed, folder, quick)


def _train(name: str, seed: int, folder: Path, quick: bool) -> None:
    began = perf_counter()
    curve: list[Point] = []
    if name == IMITATION:
        network = imitate(_imitation(quick), seed, quiet)
    else:
        case = CASES[name]
        start = Network.load(_file(folder, IMITATION, seed))[0] if case.warm else None
        network, curve = train(case.config(quick), seed, quiet, start)
    folder.mkdir(parents=True, exist_ok=True)
    save(network, _file(folder, name, seed), seed)
    minutes, settings = (perf_counter() - began) / 60, _settings(name, seed, quick)
    facts = {"minutes": minutes, "curve": curve, "settings": settings}
    write_text(_facts(folder, name, seed), json.dumps(facts))


def _imitation(quick: bool) -> ImitationConfig:
    small = {"rounds": 1, "samples": 200, "shares": 1, "epochs": 1, "last_epochs": 1}
    return replace(ImitationConfig(), processes=0, **(small if quick else {}))


def _settings(name: str, seed: int, quick: bool) -> dict[str, Any]:
    """All that a training depends on, of the network it starts from as well."""
    case, found = CASES.get(name), {"seed": seed}
    if case is None or case.warm:
        found["imitation"] = asdict(_imitation(quick))
    if case is not None:
        found["config"] = asdict(case.config(quick))
    return json.loads(json.dumps(found))


def load_run(name: str, seed: int, folder: Path) -> tuple[Network, list[Point], float]:
    """A training that `run_chain` made.

    Returns:
        Its network, closed-loop checks during it (none of an imitation), and minutes that it took.
    """
    facts: dict[str, Any] = read_facts(_facts(folder, name, seed))
    network, _ = Network.load(_file(folder, name, seed))
    return network, facts["curve"], facts["minutes"]


def _file(folder: Path, name: str, seed: int) -> Path:
    return folder / f"{name}_{seed}.npz"


def _facts(folder: Path, name: str, seed: int) -> Path:
    return _file(folder, name, seed).with_suffix(".json")
