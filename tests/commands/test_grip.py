"""`softrobot grip`: what comes of a grip, and its video."""

import pytest

from softrobot_env.cli import main

pytestmark = pytest.mark.filterwarnings("ignore::softrobot_env.scene.timestep.TimestepWarning")


def test_a_grip_is_told(capsys):
    words = ["grip", "--task", "enclose", "--diameter", "0.06", "--tension", "18"]
    assert main(words) == 0
    assert "bar of 60.0 mm: success" in capsys.readouterr().out
    assert main(["grip", "--tension", "0.1", "--mass", "0.03", "--seed", "1"]) == 1
    assert "the bar was lost" in capsys.readouterr().out


def test_a_grip_is_filmed(tmp_path, capsys):
    pytest.importorskip("imageio")
    out = tmp_path / "grip.gif"
    words = ["grip", "--task", "enclose", "--fps", "2", "--size", "160", "120"]
    try:
        assert main([*words, "--out", str(out)]) == 0
    except RuntimeError as error:
        pytest.skip(str(error))
    assert out.stat().st_size > 1000
    assert "Wrote" in capsys.readouterr().out


def test_what_is_no_gripper_is_refused_in_one_line(capsys):
    assert main(["grip", "--gripper", "hand"]) == 2
    assert (
        capsys.readouterr().err == "softrobot grip: unknown gripper 'hand'; choose from gripper\n"
    )
