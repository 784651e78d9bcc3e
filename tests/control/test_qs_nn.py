"""The quasi-static controller with the weights that the package ships."""

import numpy as np
import pytest
from scipy.linalg import expm

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


# Close to a pose at rest, with the statics h, every such network is
# h(u_k+1) = b z_ref - a z_k + (1 - b + a) h(u_k): what follows is said on its model card.

#: Of the arm's first mode, undamped frequency [rad/s] and damping ratio (audit of sec. 6.3), and
#: the speed of the swing's reference [m/s]; and [m], the thesis' largest error on the swing.
FREQUENCY, RATIO, SPEED, THESIS = 5.07, 0.127, 0.1, 0.0273


def growth(a, b, stiffness=1.0):
    """Of a pose of rest, per decision: of tip, its speed and h with one mode of a robot."""
    square = stiffness * FREQUENCY**2
    damping = stiffness * 2 * RATIO * FREQUENCY  # both are in proportion to the modulus
    rates = np.array([[0, 1, 0], [-square, -damping, FREQUENCY**2], [0, 0, 0]])
    decide = np.array([[1, 0, 0], [0, 1, 0], [-a, 0, 1 - b + a]])
    return np.abs(np.linalg.eigvals(expm(0.2 * rates) @ decide)).max()


def test_feedback_is_stable_up_to_a_third_of_the_tip_and_a_quarter_of_its_error():
    assert growth(0.33, 1.0) < 1 < growth(0.35, 1.0)
    assert growth(0.25, 0.25) < 1 < growth(0.262, 0.262)  # 0.256 (audit of sec. 6.3)


@pytest.mark.parametrize("stiffness", [1.25, 1.5])
def test_no_gains_both_correct_the_model_and_follow_the_swing(stiffness):
    """At rest z = h / stiffness, so that the error is (1 - a / b) over that without feedback."""
    found = 0
    for b in np.linspace(0.02, 1, 50):
        for share in np.linspace(0, 1, 51):
            left = (1 - share) / (1 - share * (1 - 1 / stiffness))
            if left <= 1 / 3 and max(growth(share * b, b), growth(share * b, b, stiffness)) < 1:
                found += 1
                assert SPEED * 0.2 * (1 - b) / b > THESIS
    assert found > 10


@pytest.mark.parametrize("force", [-14.0, -10.0, -5.0, 0.0, 5.0, 10.0, 14.0])
def test_the_shipped_network_is_a_feedforward_law(force):
    network, _ = Network.load(WEIGHTS)
    tip, step = ConstantCurvatureStatics(ARM).tip, 1e-4
    inputs = np.full(3, force)
    here = np.array(tip(inputs))

    def slopes(function, count):
        return np.transpose(
            [(function(d) - function(-d)) / (2 * step) for d in step * np.eye(count)]
        )

    statics = slopes(lambda d: np.array(tip(inputs + d)), 3)
    at_rest = np.concatenate([here, here, inputs])
    gains = statics @ slopes(lambda d: network((at_rest + d)[None])[0], 7)
    along = statics.sum(axis=1) / np.linalg.norm(statics.sum(axis=1))
    assert along @ gains[:, 2:4] @ along == pytest.approx(1, abs=0.03)
    assert -0.1 < -along @ gains[:, :2] @ along < 0.15
