"""Several runs of a training: folders, what goes on, what is refused, and the search's space."""

import json
from dataclasses import replace
from functools import partial
from time import monotonic, sleep

import pytest
from support.commands import TIMES, called, rows_in, stopped_after

from softrobot_env.core.runs import KEPT, Kept, run_cases
from softrobot_env.robots import ARM
from softrobot_env.training.request import Quantity, Training, TrainingRequest, curve_file
from softrobot_env.training.several import runs
from softrobot_env.training.several.report import best_of, plot, tables
from softrobot_env.training.several.runs import requests_of, run_all
from softrobot_env.training.several.search import Range, corners, parsed, read_space

CURVE = [
    {"steps": 0, "reward": 0.1, "max_mm": 90.0, "failures": 0},
    {"steps": 10, "reward": 0.4, "max_mm": 30.0, "failures": 1},
    {"steps": 20, "reward": 0.3, "max_mm": 40.0, "failures": 0},
]


def fake(order, show):
    """A training whose reward is its seed, and which fails on seed 13."""
    if order.seed == 13:
        raise ValueError("no luck\nat all")
    show("half", 1, 2)
    order.path.write_bytes(b"network")
    curve = [{**point, "reward": point["reward"] + order.seed} for point in CURVE]
    curve_file(order.path).write_text(json.dumps(curve))
    return [("error", Quantity(0.001 * (1 + order.seed), ".3g", "mm")), ("about", "a text")]


@pytest.fixture
def orders(tmp_path, monkeypatch):
    """Orders of the fake training over seeds, whose jobs run here."""
    monkeypatch.setattr(runs, "TRAININGS", {"fake": Training("fake", fake, ("checkpoint", "set"))})
    monkeypatch.setattr(runs, "run_cases", partial(run_cases, processes=0))
    return partial(requests_of, TrainingRequest(ARM, tmp_path / "fake.npz", near=tmp_path))


def test_runs_have_folders_by_what_tells_them_apart(orders, tmp_path):
    found = orders((0, 2), {"rate": (1e-4, 3e-4), "batch": (64,)})
    assert list(found) == [f"rate_{r}_seed_{s}" for r in ("0.0001", "0.0003") for s in (0, 2)]
    last = found["rate_0.0003_seed_2"]
    assert last.path == tmp_path / "rate_0.0003_seed_2" / "fake.npz" and last.seed == 2
    assert last.settings["set"] == [("rate", 3e-4), ("batch", 64)] and last.folder == tmp_path


def test_rows_tell_the_best_check_and_one_failure_costs_no_other_run(orders, tmp_path):
    found = run_all("fake", orders((0, 13, 2), {}), Kept(tmp_path / KEPT, "a study"))
    assert run_all("fake", orders((0, 13, 2), {}), Kept(tmp_path / KEPT, "a study")) == found
    assert [run.reward for run in found] == [0.4, None, 2.4]
    assert [run.failure for run in found] == [None, "no luck", None]
    assert (found[0].steps, found[0].best_steps, found[0].failures) == (20, 10, 1)
    assert found[2].max_error == pytest.approx(0.03) and found[2].figures == {"error": 0.003}
    assert best_of(found) is found[2] and "reported" not in found[0].row()
    assert (tmp_path / "seed_2" / "fake.npz").read_bytes() == b"network"


def test_files_of_another_machine_are_written_here(orders, tmp_path, monkeypatch):
    def elsewhere(*study, **more):
        found = trained(*study, **more)
        for path in tmp_path.glob("seed_*/*"):
            path.unlink()
        return found

    trained = runs._trained
    monkeypatch.setattr(runs, "_trained", elsewhere)
    run_all("fake", orders((0,), {}), Kept(tmp_path / KEPT, "a study"))
    names = {path.name for path in (tmp_path / "seed_0").iterdir()}
    assert names == {"fake.npz", "fake_curve.json"}


def test_another_study_is_not_replaced_unless_it_may(orders, tmp_path):
    first, second = (Kept(tmp_path / f"{name}.jsonl", name) for name in ("first", "second"))
    run_all("fake", orders((0,), {}), first)
    run_all("fake", orders((0,), {}), first)
    with pytest.raises(FileExistsError, match="seed_0 is of another command"):
        run_all("fake", orders((0, 1), {}), second)
    run_all("fake", orders((0, 1), {}), second, overwrite=True)
    (tmp_path / "seed_3").mkdir()
    (tmp_path / "seed_3" / "fake.npz").touch()
    with pytest.raises(FileExistsError, match="seed_3"):
        run_all("fake", orders((3,), {}), second)


def test_runs_under_way_are_told_by_what_is_in_their_folders(orders, tmp_path, monkeypatch):
    monkeypatch.setattr(runs, "_EVERY", 0.01)
    begun, reported, wanted = orders((0, 1, 2, 3), {}), [], ("1 of 4 runs", 1250, 4000)
    for label, study, share in (("seed_1", "mine", "0.250"), ("seed_2", "other", "0.9")):
        folder = begun[label].path.parent
        folder.mkdir()
        (folder / "study.txt").write_text(study)
        (folder / "share.txt").write_text(share)
    with runs._watched(begun, "mine", lambda *now: reported.append(now)) as show:
        show("seed_0", 1, 4)
        until = monotonic() + 10
        while wanted not in reported and monotonic() < until:
            sleep(0.01)
    assert wanted in reported


def test_tables_and_curves(orders, tmp_path):
    found = run_all("fake", orders((0, 1, 13), {"rate": (1, 2)}), Kept(tmp_path / KEPT, "a study"))
    found.append(replace(found[0], trial=7, pruned=True, settings={}))
    from rich.console import Console

    console = Console(record=True, width=120)
    console.print(tables(found))
    text = console.export_text()
    assert "0.9000 (0.4000 to 1.4000, 1 never)" in text and "no luck" in text and "pruned" in text
    assert "1.5 (1 to 2)" in text
    pytest.importorskip("matplotlib")
    plot(found, tmp_path / "curves.png")
    assert (tmp_path / "curves.png").stat().st_size > 1000


@pytest.mark.slow
def test_a_sweep_that_was_stopped_goes_on_and_ends_as_one_that_was_not(tmp_path, capsys):
    pytest.importorskip("stable_baselines3")
    call = "train ppo --start none --quick --seeds 0..1 --set steps=600 --set trial_every=200 "
    call += "--set envs_per_task=1 --set drawn_tasks=1 --workers 1 --out"
    assert called(call, tmp_path / "whole") == 0
    stopped_after(1, call, tmp_path / "stopped")
    capsys.readouterr()
    assert called(call, tmp_path / "stopped") == 0
    assert "Took up 1 runs" in capsys.readouterr().out
    assert rows_in(tmp_path / "stopped", TIMES) == rows_in(tmp_path / "whole", TIMES)
    for name in ("seed_0/ppo.npz", "seed_1/ppo.npz", "report.md", "curves.png"):
        assert (tmp_path / "stopped" / name).is_file()


@pytest.mark.slow
def test_seeds_of_other_trainings(tmp_path, capsys):
    assert called("train qs_nn --quick --seeds 0,4 --workers 2 --out", tmp_path) == 0
    assert "rms error, fresh data" in capsys.readouterr().out
    first, second = rows_in(tmp_path)
    assert first["figures"] != second["figures"] and first["reward"] is None


# ---------------------------------------------------------------------- spaces of a search


def test_spaces_are_values_and_ranges(tmp_path):
    assert parsed("rate=1e-5..1e-3:log") == ("rate", Range(1e-5, 1e-3, log=True))
    assert parsed("deviation=0.1..0.3") == ("deviation", Range(0.1, 0.3))
    assert parsed("batch=64,128,64") == ("batch", (64, 128))
    file = tmp_path / "space.toml"
    file.write_text('[search]\nrate = "1e-5..1e-3:log"\nbatch = [64, 128]\ndiscount = 0.9\n')
    space = read_space(file)
    assert space == {"rate": Range(1e-5, 1e-3, True), "batch": (64, 128), "discount": (0.9,)}
    ends = corners(space)
    assert len(ends) == 5 and {end["rate"] for end in ends} == {1e-5, 1e-3}


@pytest.mark.parametrize(
    ("content", "reason"),
    [
        ("rate = 1", r"must have one table \[search\]"),
        ("[search\n", "space.toml: "),
        ("[search]\nrate = '-1..1:log'", "above zero"),
        *(
            (f"[search]\nrate = '{text}'", f"space.toml: 'rate={text}' is not NAME=LOW")
            for text in ("", "fast", "1..", "2..1", "1..2:lin")
        ),
    ],
)
def test_spaces_that_are_none_are_refused(content, reason, tmp_path):
    file = tmp_path / "space.toml"
    file.write_text(content)
    with pytest.raises(ValueError, match=reason):
        read_space(file)
    with pytest.raises(ValueError, match="'rate' is not NAME=LOW"):
        parsed("rate")
