import json
import os
import re
import sys
import time
from argparse import ArgumentParser
from pathlib import Path

import pytest
from support.commands import called, evaluated
from support.processes import finished

from softrobot_env.cli import main
from softrobot_env.commands import cases as evaluate_cases
from softrobot_env.commands.arguments import declare
from softrobot_env.commands.registry import COMMANDS
from softrobot_env.commands.robot.command import COMMANDS as ROBOT_COMMANDS
from softrobot_env.compile.notice import Notice
from softrobot_env.core import under_way

HOLD = "--tasks lshape --policies hold --control-period 0.2"


def test_evaluate_writes_report_and_plots(tmp_path, capsys):
    words = "--tasks lshape --policies hold feedforward --control-period 0.1 --save-rollouts"
    rows = evaluated(tmp_path, words)
    meta = json.loads((tmp_path / "report.json").read_text())["meta"]
    assert meta["command"].startswith("softrobot evaluate --tasks lshape")
    assert [row["policy"] for row in rows] == ["hold", "feedforward"]
    assert rows[0]["e_max"] > rows[1]["e_max"] > 0
    written = {path.name for path in tmp_path.iterdir()}
    assert written >= {"report.md", "lshape_tip.png", "lshape_inputs.png", "lshape_shapes.png"}
    assert "lshape_hold.npz" in written
    assert "feedforward" in capsys.readouterr().out


def test_policies_are_compared_on_the_only_robot(tmp_path, capsys):
    evaluated(tmp_path, HOLD, "--vary density=2")
    assert (tmp_path / "lshape_tip.png").exists() and "Wrote plots" in capsys.readouterr().out


# Of a control period that is long for the arm.
@pytest.mark.filterwarnings("ignore::softrobot_env.scene.timestep.TimestepWarning")
def test_repeated_variations_add_up(tmp_path):
    vary = "--vary youngs_modulus=0.5 --vary youngs_modulus=2 --vary density=1,2"
    rows = evaluated(tmp_path, HOLD, "--no-plots", vary)
    assert [row["variation"] for row in rows] == [
        {"youngs_modulus": modulus} | density
        for modulus in (0.5, 2.0)
        for density in ({}, {"density": 2.0})
    ]


def test_delays_that_policies_know_are_told_apart(tmp_path):
    words = "--tasks lshape --policies feedforward --control-period 0.1 --no-plots --save-rollouts"
    rows = evaluated(tmp_path, words, "--vary delay=0,0.2 --predict 0,0.2")
    known = [(row["variation"].get("delay", 0.0), row["known_delay"]) for row in rows]
    assert known == [(0.0, 0.0), (0.0, 0.2), (0.2, 0.0), (0.2, 0.2)]
    assert len({row["e_rms"] for row in rows}) == 4
    stem = "lshape_feedforward"
    names = (stem, f"{stem}_known_0.2", f"{stem}_delay_0.2", f"{stem}_delay_0.2_known_0.2")
    assert {path.name for path in tmp_path.glob("*.npz")} == {f"{name}.npz" for name in names}
    assert "delay 200 ms, known delay 200 ms" in (tmp_path / "report.md").read_text()


@pytest.mark.filterwarnings("ignore::softrobot_env.scene.timestep.TimestepWarning")
def test_real_drives_are_a_column(tmp_path):
    words = "--tasks lshape --policies feedforward --control-period 0.1 --no-plots"
    rows = evaluated(tmp_path, words, "--real-drive")
    assert [row["real_drive"] for row in rows] == [False, True]
    assert rows[0]["e_mean"] < rows[0]["e_mean_real_drive"] == rows[1]["e_mean"]
    table = (tmp_path / "report.md").read_text()
    assert "with real drive mm" in table and table.count("| feedforward |") == 1


# Of a control period that is long for the arm.
@pytest.mark.filterwarnings("ignore::softrobot_env.scene.timestep.TimestepWarning")
def test_no_number_of_a_table_is_cut_short(tmp_path, capsys, monkeypatch):
    monkeypatch.setenv("COLUMNS", "80")
    words = "--tasks swing step --step-widths 0.05 --control-period 0.1 --no-plots --policies hold"
    vary = "--vary youngs_modulus=0.5 --vary density=2"
    rows = evaluated(tmp_path, words, "feedforward feedforward_pi", vary)
    out = capsys.readouterr().out
    assert "\u2026" not in out
    shown = [r for r in rows if r["task"] == "swing"]
    assert all(f"{1e3 * row['e_max']:.2f}" in out for row in shown)


def test_policies_without_their_package_are_left_out_of_all(tmp_path, capsys, monkeypatch):
    monkeypatch.setattr(evaluate_cases, "installed_policies", lambda: ["hold"])
    rows = evaluated(tmp_path, "--tasks lshape --control-period 0.2 --no-plots")
    out = capsys.readouterr().out
    assert "Left out feedforward" in out and '"daqp>=' in out
    assert [row["policy"] for row in rows] == ["hold"]


def test_without_matplotlib_the_results_still_come(tmp_path, capsys, monkeypatch):
    monkeypatch.setitem(sys.modules, "matplotlib.figure", None)  # as if it were not installed
    evaluated(tmp_path, HOLD)
    written = {path.name for path in tmp_path.glob("[!.]*")}
    assert written == {"report.json", "report.md", "lshape_drawn.npz"}  # to draw elsewhere
    reported = " ".join(capsys.readouterr().out.split())
    assert (
        "No plots: plots need matplotlib: pip install" in reported and "Wrote plots" not in reported
    )


def test_a_failed_episode_sets_the_exit_status(tmp_path):
    from softrobot_env.scene.timestep import TimestepWarning

    words = "--tasks swing --policies feedforward --vary damping_time=0 --no-plots --out"
    diverging = "evaluate --integrator RK4 --timestep 0.02 --control-period 0.02"
    with pytest.warns(TimestepWarning):
        status = called(diverging, words, tmp_path)
    assert status == 1
    assert "failed" in (tmp_path / "report.md").read_text()


@pytest.mark.parametrize(
    ("words", "texts"),
    [
        (
            "--task swing",
            ("12 hinges", "contacts", "constraint solver", "extrapolation", "pair1_up", "µs"),
        ),
        (
            "--rule midpoint --pieces 3 --control-period 0.001",
            ("3 hinges in 3 pieces, rule midpoint",),
        ),
    ],
)
def test_inspect_tells_how_a_scene_is_built_and_what_it_leaves_out(words, texts, capsys):
    assert called("inspect", words) == 0
    out = capsys.readouterr().out
    for text in texts:
        assert text in out


def test_inspect_draws_the_workspace_of_a_robot(tmp_path, capsys):
    pytest.importorskip("matplotlib")
    assert called("inspect --robot planar_finger --workspace --out", tmp_path / "new") == 0
    assert "ground of tasks" in capsys.readouterr().out
    assert (tmp_path / "new" / "workspace_planar_finger.png").stat().st_size > 10_000


@pytest.mark.parametrize("command", [*COMMANDS, *(f"robot {name}" for name in ROBOT_COMMANDS)])
def test_help_has_an_example(command, capsys):
    with pytest.raises(SystemExit, match="0"):
        called(command, "--help")
    assert f"example: softrobot {command}" in " ".join(capsys.readouterr().out.split())


def test_arguments_are_declared_by_lines_of_their_help():
    parser = ArgumentParser()
    text = """
        file FILE?  what is read,
            wherever it is
        [pictures]
        --size W H (640 480)
        --colours COLOUR+ (red)  out of %(choices)s; default: a warm one
        --set NAME=VALUE!  may come again
        --loud
    """
    declare(parser, text, colours=("red", "blue"), set=str)
    found = parser.parse_args(["a.csv", "--set", "b=1", "--set", "c=2"])
    assert (found.file, found.size, found.loud) == (Path("a.csv"), [640, 480], False)
    assert (found.colours, found.set) == (["red"], ["b=1", "c=2"])
    said = " ".join(parser.format_help().split())
    for part in (
        "read, wherever it is",
        "pictures:",
        "default: 640 480",
        "out of red, blue; default",
    ):
        assert part in said
    assert "default: red" not in said
    with pytest.raises(SystemExit):
        parser.parse_args([])  # a set is missing


# ---------------------------------------------------------------- grip

WITHOUT_LIMITS = pytest.mark.filterwarnings("ignore::softrobot_env.scene.timestep.TimestepWarning")


@WITHOUT_LIMITS
def test_a_grip_is_reported(capsys):
    assert main(["grip", "--task", "enclose", "--diameter", "0.06", "--tension", "18"]) == 0
    assert "bar of 60.0 mm: success" in capsys.readouterr().out
    assert main(["grip", "--tension", "0.1", "--mass", "0.03", "--seed", "1"]) == 1
    assert "the bar was lost" in capsys.readouterr().out


@WITHOUT_LIMITS
def test_a_grip_is_filmed(tmp_path, capsys):
    pytest.importorskip("imageio")
    out = tmp_path / "grip.gif"
    try:
        assert called("grip --task enclose --fps 2 --size 160 120 --out", out) == 0
    except RuntimeError as error:
        pytest.skip(str(error))
    assert out.stat().st_size > 1000
    assert "Wrote" in capsys.readouterr().out


# ---------------------------------------------------------------- warm-up


def test_long_compilations_are_reported_once_they_are_long(capsys, monkeypatch):
    monkeypatch.setattr(under_way, "SPEAKS", True)
    monkeypatch.setattr(under_way, "GAP", 0.1)
    listener = Notice()
    listener.on_start(None)
    listener.on_end(None)
    time.sleep(0.2)
    assert capsys.readouterr().err == ""
    listener.on_start(None)
    listener.on_start(None)
    listener.on_end(None)
    time.sleep(0.4)
    listener.on_end(None)
    said = capsys.readouterr().err
    assert re.fullmatch(r"(compiling, once .*: 2 functions, 0 s\n)+", said)
    assert listener.count == 3
    time.sleep(0.2)
    assert capsys.readouterr().err == ""


_HURRIED = """
import sys
from softrobot_env.core import under_way
under_way.GAP = 0.05
from softrobot_env.cli import main
sys.exit(main(sys.argv[1:]))
"""


def test_what_runs_says_so_where_there_is_no_terminal(tmp_path):
    """On standard error, so that standard output holds results alone."""
    widths = ("--step-widths", "0.05", "0.1", "--duration", "0.5", "--no-plots")
    command = ("evaluate", "--tasks", "step", "--policies", "lqi", *widths)
    run = finished("-c", _HURRIED, *command, "--out", str(tmp_path / "out"), check=True)
    lines = [line.rpartition(", ")[0] for line in run.stderr.splitlines()]
    assert "softrobot evaluate" in lines  # before it knows of episodes
    for number in (1, 2):
        assert sum(line.endswith(f", {number} of 2") for line in lines) == 1, lines
    assert "Wrote" in run.stdout and " of 2" not in run.stdout


_COUNT = """
from softrobot_env.commands.warm_up import warm
from softrobot_env.compile.notice import NOTICE
warm("hold")
print(NOTICE.count)
"""


@pytest.mark.slow
def test_what_was_warmed_up_is_not_compiled_again(tmp_path):
    places = dict.fromkeys(("NUMBA_CACHE_DIR", "XDG_CACHE_HOME"), str(tmp_path))
    environment = {**os.environ, **places}
    warmed = ("-m", "softrobot_env", "warm-up", "mujoco", "hold")
    finished(*warmed, env=environment, check=True, timeout=300)
    done = finished("-c", _COUNT, env=environment, check=True)
    assert int(done.stdout) == 0
