"""The study of transfer: worlds, trainings on plants and ratios."""

from dataclasses import replace

import numpy as np
import pytest

from softrobot_env.control.registry import make_policy
from softrobot_env.evaluation.runner import Case
from softrobot_env.robots import ARM, RIG, find_robot
from softrobot_env.robots.twin import drawn_twin, rig3d_twin
from softrobot_env.tasks.generic import generic_tasks
from studies import laws as study
from studies.laws import PLANT, TWIN, TransferRow, laps_case, run_laps, worlds

FINGER = find_robot("planar_finger")


@pytest.fixture(scope="module")
def rows():
    """One made-up policy in all worlds of the finger, its error in % told by its place."""
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
    assert drawn_twin(RIG, 2) == rig3d_twin(2)
    rod = find_robot("silicone_rod")
    twin = drawn_twin(rod, 0)
    assert twin.robot.youngs_modulus != rod.youngs_modulus and twin != drawn_twin(rod, 1)
    assert twin.servo_speed == rod.drive.speed
    with pytest.raises(ValueError, match="driven by tension"):
        drawn_twin(FINGER, 0)


def test_a_policy_runs_on_a_drawn_twin():
    rod = find_robot("silicone_rod")
    task = generic_tasks(rod)["circle"](radius=0.01, frequency=0.5)
    row = run_laps(laps_case(task, "hold", scene={"twin": drawn_twin(rod, 0)}))
    assert row.failure is None and row.what == "twin 0" and row.lap_mean > 0


def test_ratios_are_over_the_plant_of_the_tuning(rows):
    found = {(row.tuned_on, row.world): row.ratio for row in rows}
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
def test_a_network_of_another_plant_drives_the_arm(tmp_path, monkeypatch):
    monkeypatch.setattr(study, "_PAIRS", 150)
    study.train_qs_nn("pcc", tmp_path / "qs_nn.npz")
    policy = make_policy("qs_nn", ARM, 0.01, weights=tmp_path / "qs_nn.npz")
    task = generic_tasks(ARM)["circle"](frequency=0.5)
    case = Case(task, "qs_nn", given={"weights": tmp_path / "qs_nn.npz"})
    assert type(case.make_policy(0.01)) is type(policy)


@pytest.mark.slow
def test_an_imitation_learns_on_another_plant(tmp_path, monkeypatch):
    pytest.importorskip("torch")
    pytest.importorskip("daqp")
    from softrobot_env.training.imitation import ImitationConfig

    tiny = ImitationConfig(
        hidden=(8,), rounds=1, samples=40, shares=1, duration=0.3, last_epochs=1, processes=0
    )
    monkeypatch.setattr(study, "_IMITATION", tiny)
    study.train_imitation("pcc", tmp_path / "imitation.npz")
    assert make_policy("imitation", ARM, 0.01, weights=tmp_path / "imitation.npz").requires
