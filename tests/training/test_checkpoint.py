"""Checkpoints: whole or as before, nothing in them is run, and the newest whole one goes on."""

import errno
import pickle
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

torch = pytest.importorskip("torch")
pytest.importorskip("stable_baselines3")

from softrobot_env.learned.network import Network, Scaling  # noqa: E402
from softrobot_env.training.checkpoint import Checkpoint, read, write  # noqa: E402

BEST = Network(
    (np.eye(2),), (np.zeros(2),), Scaling(-np.ones(2), np.ones(2)), Scaling(-np.ones(2), np.ones(2))
)
FIRST = Checkpoint(
    {"steps": 10}, [{"steps": 5, "reward": 0.5}], BEST, {"weights": {"policy": torch.ones(300)}}
)
SECOND = replace(FIRST, curve=[*FIRST.curve, {"steps": 7, "reward": 0.6}])


@pytest.fixture
def folder(tmp_path):
    write(tmp_path, FIRST)
    write(tmp_path, SECOND)
    return tmp_path


def test_what_was_written_is_read(folder):
    found = read(folder)
    assert (found.settings, found.curve) == (SECOND.settings, SECOND.curve)
    assert found.best.sizes == BEST.sizes
    assert torch.equal(found.learner["weights"]["policy"], torch.ones(300))
    assert read(folder / "none") is None


@pytest.mark.parametrize("share", [0.0, 0.3, 0.9, 0.999])
def test_a_damaged_one_gives_way_to_the_one_before_which_is_said(folder, share):
    newest = folder / "checkpoint.pt"
    data = newest.read_bytes()
    newest.write_bytes(data[: int(share * len(data))])
    reported = []
    assert read(folder, lambda text, *_: reported.append(text)).curve == FIRST.curve
    assert len(reported) == 1 and "damaged: going on from step 5" in reported[0]
    (folder / "checkpoint_before.pt").unlink()
    with pytest.raises(ValueError, match=r"checkpoint\.pt is no checkpoint of a training, or dam"):
        read(folder)


@pytest.mark.parametrize("when", range(3))
def test_a_full_disk_or_a_kill_loses_nothing(folder, monkeypatch, when):
    def fail(*_, **__):
        raise OSError(errno.ENOSPC, "full")

    patches = [(torch, "save"), (Path, "replace"), ("softrobot_env.core.files._flush", None)]
    owner, name = patches[when]
    monkeypatch.setattr(*((owner, fail) if name is None else (owner, name, fail)))
    with pytest.raises(OSError, match=r"No space left.*checkpoint\.pt"):
        write(folder, replace(FIRST, curve=[{"steps": 9}]))
    monkeypatch.undo()
    assert read(folder).curve == SECOND.curve
    assert not [path for path in folder.iterdir() if path.name.startswith(".")]


def test_nothing_in_a_file_is_run(tmp_path):
    class Crafted:
        def __reduce__(self):
            return (Path.touch, (tmp_path / "ran",))

    torch.save({"settings": Crafted()}, tmp_path / "checkpoint.pt")
    (tmp_path / "checkpoint_before.pt").write_bytes(pickle.dumps(Crafted()))
    with pytest.raises(ValueError, match="no checkpoint of a training"):
        read(tmp_path)
    assert not (tmp_path / "ran").exists()


@pytest.mark.parametrize("protocol", [2, 4])
def test_what_torch_warns_of_is_told_in_our_line_alone(protocol, tmp_path, recwarn):
    (tmp_path / "checkpoint.pt").write_bytes(pickle.dumps({"best": Path()}, protocol))
    with pytest.raises(ValueError, match=r"checkpoint\.pt is no checkpoint of a training"):
        read(tmp_path)
    assert not recwarn.list


def test_numbers_that_are_not_finite_and_pickles_of_earlier_versions_are_refused(tmp_path):
    bad = {"weights": {"policy": torch.tensor([0.0, float("nan")])}}
    write(tmp_path, replace(FIRST, learner=bad))
    with pytest.raises(ValueError, match="not finite"):
        read(tmp_path)
    (tmp_path / "old").mkdir()
    (tmp_path / "old" / "model.zip").touch()
    with pytest.raises(ValueError, match=r"model\.zip is of an earlier version"):
        read(tmp_path / "old")
