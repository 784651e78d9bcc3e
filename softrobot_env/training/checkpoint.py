"""What a training needs to go on, in one file that is written whole and runs nothing when read."""

import warnings
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.buffers import ReplayBuffer

from softrobot_env.core.files import atomic_write
from softrobot_env.core.interfaces import ProgressCallback, quiet
from softrobot_env.learned.network import Network

#: The newest state of a training, and the one before.
_NEWEST, _BEFORE = "checkpoint.pt", "checkpoint_before.pt"

#: Where versions of this package before wrote pickles, which run what they hold.
_OLD = "model.zip"

#: What else a learner needs, where it has it: numbers, and tensors that are learned.
_NUMBERS = ("num_timesteps", "_n_updates", "_episode_num", "learning_starts")

#: Arrays of a replay buffer, as far as it is filled.
_BUFFER = ("observations", "next_observations", "actions", "rewards", "dones", "timeouts")


@dataclass(frozen=True)
class Checkpoint:
    """A state of a training.

    Attributes:
        settings: What it was given, as text and numbers.
        curve: Its learning curve.
        best: Its best network.
        learner: Of `learner_state`.
    """

    settings: dict[str, Any]
    curve: list[dict[str, float]]
    best: Network
    learner: dict[str, Any]


def write(folder: Path, checkpoint: Checkpoint) -> None:
    """Write a state beside the one before, so that one of them is whole at any time."""
    newest, held = folder / _NEWEST, dict(vars(checkpoint))
    held["best"] = _network_state(checkpoint.best)
    with atomic_write(newest) as aside:
        torch.save(held, aside)
        if newest.is_file():
            newest.replace(folder / _BEFORE)


def forget(folder: Path) -> None:
    """Delete the states in a folder."""
    for name in (_NEWEST, _BEFORE):
        (folder / name).unlink(missing_ok=True)


def read(folder: Path | None, show: ProgressCallback = quiet) -> Checkpoint | None:
    """The newest state in a folder that is whole, None if there is none at all.

    Args:
        folder: Of the checkpoint.
        show: Says if it is the one before the newest.

    Raises:
        ValueError: There are files, but no whole one.
    """
    if folder is None:
        return None
    found = [folder / name for name in (_NEWEST, _BEFORE) if (folder / name).is_file()]
    if not found and (folder / _OLD).is_file():
        raise ValueError(
            f"{folder / _OLD} is of an earlier version and could run programs: train anew into "
            "another folder"
        )
    refused: ValueError | None = None
    for path in found:
        try:
            checkpoint = _read(path)
        except ValueError as error:
            refused = error
            continue
        if refused is not None:
            steps = int(checkpoint.curve[-1]["steps"])
            show(f"{refused}: going on from step {steps}", steps, steps)
        return checkpoint
    if refused is not None:
        raise refused
    return None


def _read(path: Path) -> Checkpoint:
    """A file of `write`; weights alone are read, no other objects."""
    try:
        with warnings.catch_warnings(action="ignore"):  # of what is refused then, in one line
            held = torch.load(path, map_location="cpu", weights_only=True)
        checkpoint = Checkpoint(**{**held, "best": _network(held["best"])})
        numbers = [list(point.values()) for point in checkpoint.curve]
        fine = _all_finite(checkpoint.learner) and np.isfinite(numbers).all()
        fine = fine and np.isfinite(checkpoint.best.parameters).all() and len(numbers) > 0
    except Exception as error:  # whatever zip, pickle and torch raise on damage
        raise ValueError(f"{path} is no checkpoint of a training, or damaged") from error
    if not fine:
        raise ValueError(f"{path} holds numbers that are not finite")
    return checkpoint


def _all_finite(value: Any) -> bool:
    if isinstance(value, dict):
        return all(map(_all_finite, value.values()))
    if isinstance(value, list | tuple):
        return all(map(_all_finite, value))
    return not isinstance(value, torch.Tensor) or bool(torch.isfinite(value).all())


def _network_state(network: Network) -> dict[str, list[torch.Tensor]]:
    parts = {"weights": network.weights, "biases": network.biases}
    return {name: [torch.tensor(array) for array in arrays] for name, arrays in parts.items()}


def _network(state: dict[str, list[torch.Tensor]]) -> Network:
    weights, biases = (
        tuple(tensor.numpy() for tensor in state[name]) for name in ("weights", "biases")
    )
    return Network.unscaled(weights, biases)


def learner_state(model: BaseAlgorithm) -> dict[str, Any]:
    """Weights, optimizers, counts and replay buffer of a learner, as tensors and numbers."""
    state = {"weights": model.get_parameters(), "tensors": _tensors(model)}
    state["numbers"] = {name: getattr(model, name) for name in _NUMBERS if hasattr(model, name)}
    buffer = getattr(model, "replay_buffer", None)
    if buffer is not None:
        filled = buffer.size()
        arrays = {name: getattr(buffer, name)[:filled] for name in _BUFFER}
        state["buffer"] = {name: torch.from_numpy(array) for name, array in arrays.items()}
        state["position"] = {"pos": buffer.pos, "full": buffer.full}
    return state


def put_learner_state(model: BaseAlgorithm, state: dict[str, Any]) -> None:
    """Let a new learner go on where another, made alike, was.

    Raises:
        ValueError: The state is of a learner that was made otherwise.
    """
    try:
        model.set_parameters(state["weights"], exact_match=True, device="cpu")
        with torch.no_grad():
            for name, tensor in _tensors(model).items():
                tensor.copy_(state["tensors"][name])
        for name, number in state["numbers"].items():
            setattr(model, name, number)
        if "buffer" in state:
            _fill(model.replay_buffer, state)
    except (KeyError, RuntimeError, ValueError, AttributeError) as error:
        raise ValueError(f"the checkpoint is of another learner: {error}") from None


def _fill(buffer: ReplayBuffer, state: dict[str, Any]) -> None:
    for name, tensor in state["buffer"].items():
        getattr(buffer, name)[: len(tensor)] = tensor.numpy()
    buffer.pos, buffer.full = int(state["position"]["pos"]), bool(state["position"]["full"])


def _tensors(model: BaseAlgorithm) -> dict[str, torch.Tensor]:
    """Tensors that a learner has besides its networks, such as the entropy's coefficient."""
    return {name: getattr(model, name) for name in model._get_torch_save_params()[1]}
