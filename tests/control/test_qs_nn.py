"""The quasi-static controller with the weights that the package ships."""

import numpy as np

from softrobot_env.beams.constant_curvature import ConstantCurvatureStatics
from softrobot_env.cli import main
from softrobot_env.core.files import models_dir
from softrobot_env.learned.network import Network, suits
from softrobot_env.robots import ARM
from softrobot_env.robots.actuation import TendonMap
from softrobot_env.thesis.arm import quasi_static
from softrobot_env.thesis.arm.qs_nn import QuasiStaticNetwork

WEIGHTS = models_dir() / "qs_nn.npz"


def test_training_command_writes_what_the_policy_loads(tmp_path, capsys, monkeypatch):
    few = quasi_static.Sampling(pairs=200)
    monkeypatch.setattr(quasi_static, "Sampling", lambda: few)
    monkeypatch.setattr(quasi_static, "HIDDEN", (4,))
    assert main(["train", "qs_nn", "--seed", "7", "--out", str(tmp_path)]) == 0
    out = capsys.readouterr().out
    assert "effective parameters" in out and "rms error, fresh data" in out
    inputs = np.full(3, 5.0)
    tip = ConstantCurvatureStatics(ARM).tip(inputs)
    seen = {"tip_position": tip, "reference_preview": tip}
    seen["previous_action"] = inputs / TendonMap(ARM).input_scale
    action, _ = QuasiStaticNetwork(ARM, 0.2, tmp_path / "qs_nn.npz").predict(seen)
    assert np.all(np.isfinite(action))
    _, about = Network.load(tmp_path / "qs_nn.npz")
    assert about["seed"] == 7


def test_shipped_file_says_what_it_is():
    network, about = Network.load(WEIGHTS)
    assert network.sizes == (7, 30, 3)
    assert suits(about, ARM)
    assert about["seed"] == 0
    assert WEIGHTS.with_suffix(".md").read_text("utf-8").count("softrobot train qs_nn") > 0
