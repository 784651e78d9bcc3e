"""The examples run as they are, for a few steps; those of RLlib and rl_zoo3 in `tests/clients`."""

import runpy
import sys
from pathlib import Path

import pytest

from softrobot_env.cli import main

EXAMPLES = Path(__file__).resolve().parents[1] / "examples"


def run(name, monkeypatch, *words):
    monkeypatch.setattr(sys, "argv", [name, *map(str, words)])
    return runpy.run_path(str(EXAMPLES / name), run_name="__main__")


@pytest.mark.slow  # a rollout with default settings has 8192 steps
def test_stable_baselines3(monkeypatch, tmp_path, capsys):
    pytest.importorskip("stable_baselines3")
    run("sb3_ppo.py", monkeypatch, "--steps", 1, "--out", tmp_path / "new")
    assert (tmp_path / "new" / "model.zip").stat().st_size > 1000
    assert "mean error:" in capsys.readouterr().out


def test_ppo_in_one_file(monkeypatch, tmp_path, capsys):
    torch = pytest.importorskip("torch")
    words = ["--env", "SoftRobot/ArmStep-v0", "--steps", 64, "--rollout", 16, "--batch", 16]
    ran = run("cleanrl_ppo.py", monkeypatch, *words, "--out", tmp_path / "new" / "ppo.pt")
    saved = torch.load(tmp_path / "new" / "ppo.pt")
    assert all(torch.equal(saved[k], v) for k, v in ran["actor"].state_dict().items())
    assert "mean error:" in capsys.readouterr().out
    given = ["--tasks", "step", "--policies", str(tmp_path / "new" / "ppo_network.npz")]
    assert main(["evaluate", *given, "--no-plots", "--out", str(tmp_path / "out")]) == 0
