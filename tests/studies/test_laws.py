"""The studies of laws and of transfer: paths, the best law, goals, worlds, ratios; small runs."""

from dataclasses import replace

import numpy as np
import pytest

from softrobot_env.core.files import models_dir
from softrobot_env.evaluation.runner import Case, run
from softrobot_env.robots import ARM, RIG, find_robot
from softrobot_env.robots.twin import rig3d_twin, sampled_twin
from softrobot_env.tasks.generic import generic_tasks
from studies import laws as study
from studies.laws import (
    LIMITS,
    PLANT,
    ROOM,
    TASKS,
    TWIN,
    RefusedRow,
    TransferRow,
    demand,
    difference,
    feasible_task,
    goal_rows,
    inputs_of_lap,
    laps_case,
    prepare,
    ranked_laws,
    refusal,
    run_laps,
    worlds,
)

FINGER = find_robot("planar_finger")


@pytest.fixture
def untrained(monkeypatch):
    """Trainings take minutes: policies that need one are refused."""
    monkeypatch.setattr(study, "TRAINED", ())


@pytest.fixture(scope="module")
def row():
    task = generic_tasks(FINGER)["circle"](frequency=0.5)
    return run_laps(laps_case(task, "hold"))


def made_up(row, shares, what=""):
    """Rows of laws by their mean errors over the length at the three frequencies."""
    return [
        replace(row, policy=law, task=task, frequency=f, what=what, share_mean=share, failure=None)
        for law, errors in shares.items()
        for f, share in zip(LIMITS, errors, strict=True)
        for task in TASKS
    ]


def test_an_episode_that_stands_still_errs_by_what_the_path_says(row):
    """Held at the start of a circle: 4 r / pi in the mean and 2 r at most, at full rate."""
    assert row.failure is None and row.what == "" and row.feedback == "state"
    np.testing.assert_allclose(row.lap_mean, 4 * row.radius / np.pi, rtol=0.02)
    np.testing.assert_allclose(row.lap_max, 2 * row.radius, rtol=0.02)
    assert row.share_max == row.lap_max / FINGER.length


def test_inputs_that_a_path_asks_for_keep_the_tip_on_it():
    """A small circle of the hanging trunk at half of the first frequency, without any feedback."""
    task = generic_tasks(find_robot("hanging_trunk"))["circle"](radius=0.01, frequency=0.5)
    lap, needed = inputs_of_lap(task)

    class Played:
        requires = ("previous_action",)

        def predict(self, observation, state=None, episode_start=None, deterministic=True):
            k = 0 if state is None else state + 1
            phase = (k + 0.5) * 0.01 / lap % 1 * len(needed)
            low, share = int(phase), phase % 1
            value = (1 - share) * needed[low] + share * needed[(low + 1) % len(needed)]
            return value / scale, k

    case = Case(task, "hold", duration=12 * lap)
    with case.environment() as env:
        scale = env.unwrapped.input_scale
        rollout = run(case, env, Played()).rollout
    late = rollout.time > 11 * lap
    ends = task.trajectory.curve.derivative(2 * np.pi * rollout.time[late] / lap, 0)
    error = np.linalg.norm((rollout.tip[late] - ends)[:, :2], axis=1)
    assert error.max() < 0.1 * 0.01


def test_paths_that_servos_cannot_follow_become_smaller(monkeypatch):
    rod = find_robot("silicone_rod")
    task, asked = feasible_task(rod, "circle", 0.5)
    full = generic_tasks(rod)["circle"](frequency=0.5)
    assert demand(full).speed > 1 > max(asked)
    assert task.option("radius") < full.option("radius")
    monkeypatch.setattr(study, "_LEAST", 0.9)
    with pytest.raises(ValueError, match="times what its drives can do"):
        feasible_task(rod, "circle", 0.5)


def test_what_differs_is_reported():
    task = generic_tasks(FINGER)["circle"](frequency=0.5)
    rig = replace(task, robot=RIG, start_input=(0.0,) * 3, axes="xyz")
    assert difference(laps_case(task, "static")) == difference(laps_case(rig, "rig_nn")) == ""
    assert difference(laps_case(rig, "rig_nn", twin=2)) == "twin 2"
    varied = laps_case(task, "static", variation={"density": 1.4}, feedback="output", plant="pcc")
    assert difference(varied) == "pcc, rho x 1.4, observer"


def test_the_best_law_is_that_of_the_worst_path(row):
    rows = made_up(row, {"hold": (0, 0, 0), "a": (0.001, 0.009, 0.05), "b": (0.002, 0.012, 0.01)})
    assert ranked_laws(rows) == {FINGER.name: ["b", "a"]}
    lost = [replace(r, share_mean=None, failure="folded") if r.policy == "b" else r for r in rows]
    assert ranked_laws(lost) == {FINGER.name: ["a", "b"]}


def test_the_best_law_stands_a_softer_robot(row):
    """What is nearly perfect on the nominal robot, and lost on another, comes second."""
    rows = made_up(row, {"a": (0.0001, 0.0001, 0.0001), "b": (0.002, 0.002, 0.002), "c": (0, 0, 0)})
    rows += made_up(row, {"a": (0.1, 0.1, 0.1), "b": (0.004, 0.004, 0.004)}, "E x 0.75")
    assert ranked_laws(rows) == {FINGER.name: ["b", "a", "c"]}


def test_goals_compare_the_worst_path_with_limits(row):
    rows = made_up(row, {"a": (0.002, 0.02, 0.02)}) + made_up(
        row, {"a": (0.005, 0.005, 0.05)}, "E x 0.75"
    )
    rows[0] = replace(rows[0], share_mean=0.0029)
    goals = {(g.what, g.frequency): g for g in goal_rows(rows)}
    assert len(goals) == len(ROOM) * len(LIMITS)
    assert [goals["", f].met for f in LIMITS] == [True, False, True]
    assert [goals["E x 0.75", f].met for f in LIMITS] == [True, True, False]
    assert goals["E x 0.75", 0.3].ratio == pytest.approx(0.25)
    assert goals["", 0.1].share == 0.0029
    assert goals["observer", 0.1].share is None and not goals["observer", 0.1].met


def test_what_cannot_serve_is_a_row_with_the_reason(untrained, tmp_path):
    task = generic_tasks(FINGER)["circle"](frequency=0.3)
    found = run_laps(laps_case(task, "static", plant="ancf"))
    assert isinstance(found, RefusedRow) and "ANCF needs a backbone of one" in found.reason
    reported = refusal("finger", "ppo", "", f"{models_dir()}/ppo.npz is of another")
    assert reported.reason == "models/ppo.npz is of another"
    known = prepare(FINGER.name, ("circle",), (0.3,), tmp_path)
    assert [task.name for task in known.tasks] == ["circle"] and "hold" in known.policies
    assert {r.policy for r in known.rows if isinstance(r, RefusedRow)}.isdisjoint(known.policies)


# ---------------------------------------------------------------- transfer


@pytest.fixture(scope="module")
def travelled():
    """One made-up policy in all worlds of the finger, its error in % reported by its place."""
    task = generic_tasks(FINGER)["circle"](frequency=0.5)
    own = {"tuned_on": "mujoco", "trained_here": False}
    first = run_laps(laps_case(task, "hold"), TransferRow, world="mujoco", group=PLANT, **own)
    made = [
        replace(first, world=w.name, group=w.group, lap_mean=1e-3 * k, share_mean=1e-2 * k)
        for k, w in enumerate(worlds(FINGER), start=1)
    ]
    of_pcc = [replace(row, tuned_on="pcc", trained_here=True) for row in made]
    return [study._with_ratio(row, made + of_pcc) for row in made + of_pcc]


def test_worlds_have_all_plants_and_twins_where_there_are_servos():
    names = [world.name for world in worlds(FINGER)]
    assert names[:4] == ["mujoco", "pcc", "cosserat", "ancf"] and "E x 0.75" in names
    assert not [world for world in worlds(FINGER) if world.group == TWIN]
    seeds = [world.case["twin"] for world in worlds(RIG) if world.group == TWIN]
    assert seeds == [1]
    made = [w.case["scene"]["twin"] for w in worlds(find_robot("ftdcr_v4")) if w.group == TWIN]
    assert [twin.seed for twin in made] == [1] and len(made[0].backlash) == 9


def test_a_drawn_twin_of_the_rig_is_its_twin():
    assert sampled_twin(RIG, 2) == rig3d_twin(2)
    rod = find_robot("silicone_rod")
    twin = sampled_twin(rod, 0)
    assert twin.robot.youngs_modulus != rod.youngs_modulus and twin != sampled_twin(rod, 1)
    assert twin.servo_speed == rod.drive.speed
    with pytest.raises(ValueError, match="driven by tension"):
        sampled_twin(FINGER, 0)


def test_a_policy_runs_on_a_drawn_twin():
    rod = find_robot("silicone_rod")
    task = generic_tasks(rod)["circle"](radius=0.01, frequency=0.5)
    row = run_laps(laps_case(task, "hold", scene={"twin": sampled_twin(rod, 0)}))
    assert row.failure is None and row.what == "twin 0" and row.lap_mean > 0


def test_ratios_are_over_the_plant_of_the_tuning(travelled):
    found = {(row.tuned_on, row.world): row.ratio for row in travelled}
    assert found["mujoco", "mujoco"] == 1 and found["pcc", "pcc"] == 1
    assert found["mujoco", "ancf"] == pytest.approx(4)
    assert found["pcc", "ancf"] == pytest.approx(2)


@pytest.mark.parametrize("plant", ["mujoco", "pcc"])
def test_statics_of_plants_agree(plant):
    """Those of the arm's chain and PCC to 1 % of the length of those of constant curvature."""
    from softrobot_env.beams.constant_curvature import ConstantCurvatureStatics

    inputs = np.array([8.0, -5.0, 12.0])
    wanted = ConstantCurvatureStatics(ARM).tip(inputs)
    assert np.linalg.norm(study._statics(plant)(inputs) - wanted) < 0.01 * ARM.length


@pytest.mark.slow
@pytest.mark.parametrize("policy", ["qs_nn", "imitation"])
def test_a_policy_of_another_plant_drives_the_arm(policy, tmp_path, monkeypatch):
    pytest.importorskip("torch")
    pytest.importorskip("daqp")
    tiny = {"hidden": (8,), "rounds": 1, "samples": 40, "shares": 1, "duration": 0.3}
    monkeypatch.setattr(study, "_PAIRS", 150)
    monkeypatch.setattr(study, "_IMITATION", replace(study._IMITATION, last_epochs=1, **tiny))
    (tuned,) = study.train_network(policy, "pcc", tmp_path)
    task = generic_tasks(ARM)["circle"](frequency=0.5)
    case = Case(task, policy, given=tuned.given, duration=0.2)
    assert tuned.label == f"{policy} of pcc" and run(case).rollout.failure is None
