"""Jobs on a Ray cluster of two nodes of this machine: `make test-cluster`."""

import os
import subprocess
import sys
import time
from functools import partial
from threading import Thread

import numpy as np
import pytest
from support.commands import TIMES, rows_in

ray = pytest.importorskip("ray")
from ray.cluster_utils import Cluster  # noqa: E402

from softrobot_env.cli import main  # noqa: E402
from softrobot_env.core.processes import Workers, using  # noqa: E402
from softrobot_env.core.runs import run_cases  # noqa: E402

pytestmark = [pytest.mark.cluster, pytest.mark.filterwarnings("default")]

COUNT = 24


@pytest.fixture
def two_nodes():
    cluster = Cluster(initialize_head=True, head_node_args={"num_cpus": 1})
    node = cluster.add_node(num_cpus=1)
    cluster.wait_for_nodes()
    yield cluster, node
    ray.shutdown()
    cluster.shutdown()


def square_at(folder, seconds, number):
    node = ray.get_runtime_context().get_node_id()
    (folder / f"{number}-{node}-{os.getpid()}").touch()
    time.sleep(seconds)
    return number**2


def fails(number):
    raise ValueError(f"job {number} fails")


def exits(number):
    os._exit(1)


def test_a_node_that_is_killed_costs_no_row(two_nodes, tmp_path):
    cluster, node = two_nodes
    killed = []

    def kill():
        while len(list(tmp_path.iterdir())) < 6:
            time.sleep(0.05)
        cluster.remove_node(node, allow_graceful=False)
        killed.append(len(list(tmp_path.iterdir())))

    thread = Thread(target=kill)
    thread.start()
    with using(Workers(ray=cluster.address)):
        found = run_cases(range(COUNT), partial(square_at, tmp_path, 0.3))
    thread.join()
    assert found == [number**2 for number in range(COUNT)]
    assert killed[0] < COUNT  # it was in the middle
    assert len({path.name.split("-")[1] for path in tmp_path.iterdir()}) == 2


def test_an_error_of_a_job_is_that_of_the_job(two_nodes):
    with using(Workers(ray=two_nodes[0].address)), pytest.raises(ValueError) as reported:
        run_cases(range(3), fails)
    assert str(reported.value).startswith("job ") and "\n" not in str(reported.value)


def test_a_job_that_ends_its_worker_each_time_is_given_up(two_nodes):
    with using(Workers(ray=two_nodes[0].address)), pytest.raises(RuntimeError, match="gave a job"):
        run_cases([0], exits)


def test_an_address_without_a_cluster_is_refused(tmp_path, capsys):
    call = ["evaluate", "--tasks", "step", "--step-widths", "0.05", "--policies", "lqi", "--out"]
    assert main([*call, str(tmp_path), "--workers", "ray:127.0.0.1:1"]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert "no Ray cluster at '127.0.0.1:1'" in line


def test_rows_are_those_of_one_process(two_nodes, tmp_path):
    call = ["evaluate", "--tasks", "step", "swing", "--step-widths", "0.05", "--duration", "1"]
    call += ["--policies", "feedforward", "lqi", "lq_preview", "--no-plots", "--out"]
    assert main([*call, str(tmp_path / "alone")]) == 0
    address = two_nodes[0].address
    assert main([*call, str(tmp_path / "ray"), "--workers", f"ray:{address}"]) == 0
    assert rows_in(tmp_path / "ray", TIMES) == rows_in(tmp_path / "alone", TIMES)


# ---------------------------------------------------------------------- trainings

_SETTINGS = ("envs_per_task=1", "drawn_tasks=1", "rollout=16")
SMALL = ["--start", "none", "--quick", *(word for s in _SETTINGS for word in ("--set", s))]


def test_a_sweep_loses_no_run_with_a_node_and_ends_as_a_local_one(two_nodes, tmp_path):
    pytest.importorskip("stable_baselines3")
    cluster, node = two_nodes
    call = ["train", "ppo", *SMALL, "--seeds", "0..3", "--set", "trial_every=500"]
    call += ["--steps", "2000", "--out"]

    def kill():
        while len(list((tmp_path / "ray").rglob("checkpoint_before.pt"))) < 2:
            time.sleep(0.05)
        cluster.remove_node(node, allow_graceful=False)

    thread = Thread(target=kill, daemon=True)
    thread.start()
    assert main([*call, str(tmp_path / "ray"), "--workers", f"ray:{cluster.address}"]) == 0
    thread.join(1)
    assert not thread.is_alive()
    assert main([*call, str(tmp_path / "alone"), "--workers", "2"]) == 0
    assert len(rows_in(tmp_path / "ray")) == 4
    assert rows_in(tmp_path / "ray", TIMES) == rows_in(tmp_path / "alone", TIMES)


SEARCH = ["tune", "ppo", *SMALL, "--search", "rate=1e-5..1e-2:log", "--trials", "4"]


def pruned_steps(curves, steps):
    """Steps at which halving ends trials that come one after the other, by its definition.

    At a ninth, a third and all of the steps a trial ends that is below the best third before it.
    """
    rungs, found = {steps // 9 * 3**k: [] for k in (2, 1, 0)}, []
    for curve in curves:
        seen = set()
        for point in curve:
            rung = next((r for r in rungs if point["steps"] >= r and r not in seen), None)
            if rung is None:
                continue
            seen.add(rung)
            before, rungs[rung] = rungs[rung], [*rungs[rung], point["reward"]]
            if before and point["reward"] < np.percentile(before, 100 * 2 / 3):
                found.append(point["steps"])
                break
        else:
            found.append(curve[-1]["steps"])
    return found


def test_a_search_ends_poor_trials_as_halving_does(tmp_path):
    pytest.importorskip("stable_baselines3")
    call = [*SEARCH, "--trials", "6", "--steps", "1500", "--workers", "1"]
    assert main([*call, "--out", str(tmp_path)]) == 0
    rows = rows_in(tmp_path)
    steps = [row["steps"] for row in rows]
    assert steps == pruned_steps([row["curve"] for row in rows], 1500)
    pruned = [row["pruned"] for row in rows]
    assert pruned == [step < 1500 for step in steps] and any(pruned) and not all(pruned)


def test_a_search_tells_the_best_settings(two_nodes, tmp_path, capsys):
    pytest.importorskip("stable_baselines3")
    call = [*SEARCH, "--steps", "1500", "--out", str(tmp_path)]
    assert main([*call, "--workers", f"ray:{two_nodes[0].address}"]) == 0
    rows, reported = rows_in(tmp_path), capsys.readouterr().out
    assert [row["trial"] for row in rows] == [1, 2, 3, 4]
    assert len({row["settings"]["rate"] for row in rows}) == 4
    assert all(1e-5 <= row["settings"]["rate"] <= 1e-2 and not row["failure"] for row in rows)
    assert all((row["steps"] < 1500) == row["pruned"] for row in rows)
    best = max(rows, key=lambda row: (row["reward"], row["curve"][-1]["reward"]))
    assert f"--set rate={best['settings']['rate']:.17g}" in reported
    assert (tmp_path / "ppo.npz").is_file() and (tmp_path / "curves.png").is_file()

    words = reported.split("Train with its settings: softrobot ")[1].split()
    assert main([*words, "--workers", "1", "--out", str(tmp_path / "anew")]) == 0
    (anew,) = rows_in(tmp_path / "anew")
    assert anew["curve"][: len(best["curve"])] == best["curve"]


def test_a_search_that_was_killed_goes_on(tmp_path):
    pytest.importorskip("stable_baselines3")
    from softrobot_env.training.checkpoint import read

    call = [sys.executable, "-m", "softrobot_env", *SEARCH, "--steps", "1500", "--workers", "2"]
    call += ["--out", str(tmp_path)]
    with subprocess.Popen(call, start_new_session=True) as command:
        while len(list(tmp_path.rglob("checkpoint_before.pt"))) < 2:
            assert command.poll() is None
            time.sleep(0.1)
        command.kill()
    begun = {path: read(path.parent).curve for path in tmp_path.rglob("checkpoint_before.pt")}
    assert subprocess.run(call, check=False).returncode == 0
    rows = rows_in(tmp_path)
    assert [row["folder"] for row in rows] == [f"trials/trial_{k}" for k in (1, 2, 3, 4)]
    for path, curve in begun.items():
        (row,) = (row for row in rows if row["folder"].endswith(path.parent.name))
        pairs = list(zip(row["curve"], curve, strict=False))  # it may be pruned earlier now
        assert pairs and all(now == then for now, then in pairs)
