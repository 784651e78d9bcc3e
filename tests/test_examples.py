"""The examples run as they are, for a few steps; those of RLlib and rl_zoo3 in `tests/clients`."""

import json
import runpy
import shutil
import sys
from pathlib import Path

import matplotlib.image as plt_image
import pytest

import notebooks
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


#: Each writes a picture of its name to out/examples.
PICTURES = (
    *("first_steps", "compare_controllers", "own_robot", "own_task", "own_controller"),
    *("identify_stiffness", "gripper_sensors", "randomised_batch", "plain_mujoco", "beam_model"),
    *("train_and_show", "virtual_rig", "design_tendons"),
)


def test_every_example_is_tested_and_short():
    # Of other libraries, see above, and in test_teleoperation.
    others = {"cleanrl_ppo", "rllib_ppo", "sb3_ppo", "teleoperation"}
    assert {path.stem for path in EXAMPLES.glob("*.py")} == {*PICTURES, *others}
    assert all(len((EXAMPLES / f"{x}.py").read_text().splitlines()) <= 60 for x in PICTURES)
    page = (EXAMPLES.parent / "docs" / "tutorials" / "index.md").read_text()
    assert all(f"examples/{name}.py" in page for name in PICTURES)


@pytest.mark.slow
@pytest.mark.parametrize("name", PICTURES)
def test_pictures(name, monkeypatch, tmp_path):
    if name == "train_and_show":
        pytest.importorskip("stable_baselines3")
    if name == "virtual_rig" and shutil.which("c++") is None:
        pytest.skip("no C++ compiler")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("STEPS", "64")
    try:
        known = run(f"{name}.py", monkeypatch)
    except RuntimeError as error:
        if "OpenGL" not in str(error):
            raise
        pytest.skip(str(error))
    assert known["picture"] == Path("out/examples") / f"{name}.png"
    assert plt_image.imread(known["picture"]).std() > 0.01  # something is drawn
    if name == "identify_stiffness":
        assert known["found"] == pytest.approx(0.8, abs=0.01)
    if name == "own_controller":
        static, shifted = (x.error.mean() for x in known["rollouts"].values())
        assert shifted < 0.3 * static
    if name == "gripper_sensors":
        assert known["info"]["success"]
    if name == "design_tendons":
        assert max(known["gaps"]) < 1.0  # mm


def test_notebooks_are_made_of_examples(tmp_path):
    assert notebooks.main([str(tmp_path)]) == 0
    cells = json.loads((tmp_path / "beam_model.ipynb").read_text())["cells"]
    assert cells[0]["cell_type"] == "markdown" and "A beam model alone" in cells[0]["source"]
    code = [cell["source"] for cell in cells if cell["cell_type"] == "code"]
    assert "PCC(ARM" in "\n".join(code) and "Image(" in code[-1]
    for source in code:
        compile(source, "cell", "exec")


@pytest.mark.parametrize("name", notebooks.SHOWN)
def test_notebooks_of_the_docs_have_the_code_of_examples(name):
    there = json.loads((notebooks.NOTEBOOKS / f"{name}.ipynb").read_text())
    made = notebooks.notebook((EXAMPLES / f"{name}.py").read_text(), notebooks.SHOWN[name])
    assert notebooks.sources(there) == notebooks.sources(made)
    shown = [x for cell in there["cells"] for x in cell.get("outputs", ()) if "data" in x]
    assert any("image/png" in one["data"] for one in shown)


@pytest.mark.slow
@pytest.mark.parametrize("name", notebooks.SHOWN)
def test_notebooks_run(name, monkeypatch):
    pytest.importorskip("nbclient")
    pytest.importorskip("ipykernel")
    if name == "train_and_show":
        pytest.importorskip("stable_baselines3")
    if name == "virtual_rig" and shutil.which("c++") is None:
        pytest.skip("no C++ compiler")
    monkeypatch.setenv("STEPS", "64")
    made = notebooks.notebook((EXAMPLES / f"{name}.py").read_text(), notebooks.SHOWN[name])
    last = notebooks.executed(made)["cells"][-1]
    assert "image/png" in last["outputs"][0]["data"]
