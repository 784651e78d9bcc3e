"""The judge of random scenes is judged: scenes known to be right, wrong and failing."""

from dataclasses import replace

import numpy as np
import pytest

from softrobot_env.beams import signals
from softrobot_env.beams.pcc import PCC
from softrobot_env.evaluation.models.runs import Verdict
from softrobot_env.robots import ARM
from softrobot_env.scene.config import SceneConfig
from softrobot_env.scene.simulation import Simulation
from studies import scenes
from studies.scenes import STUDY, Refined, judge, measure, neutral_scene, refine, refined_run
from studies.scenes_drawn import EXCITATIONS, G, RandomScene, draw_scene

#: Drawn and refined scenes take long.
pytestmark = pytest.mark.slow


def of_arm(robot=ARM, periods=40, **options):
    """The arm under tensions that jump every tenth of a second."""
    config = SceneConfig(robot, **options)
    levels = np.random.default_rng(3).random((periods // 10, len(robot.tendons)))
    controls = 20.0 * np.repeat(levels, 10, axis=0)
    return RandomScene(0, 0, config, np.zeros(3), controls, "steps")


@pytest.fixture(scope="module")
def many():
    return [draw_scene(7, index) for index in range(300)]


def test_a_scene_is_the_same_whenever_it_is_drawn(many):
    again = draw_scene(7, 11)
    assert again.config == many[11].config
    assert np.array_equal(again.controls, many[11].controls)
    assert again.config != draw_scene(8, 11).config


def test_scenes_cover_what_robots_can_be(many):
    configs = [scene.config for scene in many]
    robots = [config.robot for config in configs]
    for low, high, found in (
        (10, 1000, [r.length / r.outer_radius for r in robots]),
        (1e4, 1e11, [r.youngs_modulus for r in robots]),
        (5, 29, [config.n_pieces for config in configs]),
    ):
        assert min(found) < low and max(found) > high
    assert {round(float(np.linalg.norm(r.gravity)) / G, 6) for r in robots} == {0.0, 1.0, 100.0}
    assert {scene.excitation for scene in many} == set(EXCITATIONS)
    assert {len(r.tendons) for r in robots} == {1, 2, 3, 4}
    assert all(0.002 <= config.control_period <= 0.05 for config in configs)
    rare = [r.has_friction for r in robots], [r.head is not None for r in robots]
    assert all(sum(each) > 20 for each in (*rare, [config.torsion for config in configs]))


def test_controls_stay_where_actuators_do_not_clamp_them(many):
    for scene in many[:20]:
        low, high = neutral_scene(scene.config).model.actuator_ctrlrange.T
        limited = neutral_scene(scene.config).model.actuator_ctrllimited.astype(bool)
        inside = (scene.controls >= low) & (scene.controls <= high)
        assert np.all(inside[:, limited])


def refined_arm(**options):
    drawn = of_arm(periods=20, **options)
    scene = neutral_scene(drawn.config)
    found = refine(scene, drawn, lambda _, uncertainty: uncertainty < 1e-6)
    assert found.method == "implicitfast extrapolated" and found.uncertainty < 1e-6
    return drawn, scene, found.tips


def test_refined_runs_of_two_methods_agree():
    drawn, scene, tips = refined_arm(pieces=3)
    assert np.max(np.abs(refined_run(scene, drawn, "RK4", 400) - tips)) < 5e-6


def test_a_refined_run_is_that_of_another_model():
    """Curvatures instead of hinges: two discretisations, 0.1 % of the length apart at most."""
    drawn, _, tips = refined_arm(pieces=12)
    beam, inputs = PCC(ARM, 12), signals.held(drawn.controls, 0.01)
    motion = beam.simulate(0.2, inputs, samples=0.01 * np.arange(21))
    assert np.max(np.abs(beam.tip(motion.q) - tips)) < 5e-4


def test_the_arm_is_accurate():
    row = judge(of_arm())
    assert row.verdict == Verdict.ACCURATE and row.error_share <= row.asked_share
    assert row.uncertainty <= 0.25 * row.asked_share * row.length


LIVELY = ARM.vary(damping_time=0.1, youngs_modulus=0.5)
STIFF = ARM.vary(damping_time=0.01, youngs_modulus=100.0)
THIN = RandomScene(
    *(0, 0, SceneConfig(replace(ARM, outer_radius=1e-6, inner_radius=0.0, tendons=()))),
    *(np.zeros(3), np.zeros((5, 0)), "let_go"),
)


@pytest.mark.parametrize(
    ("drawn", "forced", "verdict", "why", "refined_fine"),
    [
        (of_arm(LIVELY, 100), {"integrator": "discrete", "timestep": 0.01}, "WRONG", "", None),
        (of_arm(STIFF), {"integrator": "Euler", "timestep": 0.01}, "REPORTED", "diverged", True),
        (THIN, {}, "REPORTED", "Error", None),
    ],
    ids=["coarse", "failed", "refused"],
)
def test_what_goes_wrong_is_said(drawn, forced, verdict, why, refined_fine):
    row = judge(replace(drawn, config=replace(drawn.config, **forced)))
    assert row.verdict == Verdict[verdict] and why in (row.why or "")
    assert row.refined_fine is refined_fine
    assert row.error_share > 0.05 if verdict == "WRONG" else row.error is None


def test_creeping_robots_whose_tendons_turn_round_at_once_are_right():
    """What they rub until then is part of the estimate."""
    row = judge(draw_scene(4242, 277))
    assert row.verdict is Verdict.ACCURATE
    assert row.error_share < row.estimate_share


def test_what_refined_runs_do_not_agree_on_is_not_judged(monkeypatch):
    monkeypatch.setattr(scenes, "refine", lambda *_: Refined(np.zeros((41, 3)), 0.3, 8, "RK4"))
    row = judge(of_arm())
    why = "refined runs differ by 60 % of the length"
    assert (row.verdict, row.why) == (Verdict.UNJUDGED, why)


def test_an_estimate_is_good_within_its_factor():
    known = replace(judge(of_arm()), error_share=1e-3)
    for share, good in ((np.float64(2.9e-3), True), (3.1e-3, False), (3e-4, False), (None, None)):
        assert replace(known, estimate_share=share).estimate_is_good is good


def test_an_error_beyond_the_estimate_is_counted():
    """Less what refined runs differ by among themselves."""
    known = replace(judge(of_arm()), estimate_share=1e-4)
    length = known.length
    for error, uncertainty, twice, tenfold in (
        (1.9e-4, 0.0, False, False),
        (2.1e-4, 0.0, True, False),
        (2.1e-4, 0.2e-4, False, False),
        (11e-4, 0.2e-4, True, True),
    ):
        row = replace(known, error=error * length, uncertainty=uncertainty * length)
        assert (row.beyond_twice, row.beyond_tenfold) == (twice, tenfold)
    assert replace(known, error=length, estimate_share=0.0).beyond_tenfold
    assert not replace(known, error=length, estimate_share=None).beyond_twice


def test_verdicts_do_not_depend_on_processes():
    clock = {"wall_time"}
    here = [measure((2, index)).row() for index in range(3)]
    there = [row.row() for row in STUDY.run(count=3, seed=2)]
    for a, b in zip(here, there, strict=True):
        assert {k: a[k] for k in a.keys() - clock} == {k: b[k] for k in b.keys() - clock}


def test_an_estimate_without_bound_is_none(monkeypatch):
    """A report has no infinities."""
    monkeypatch.setattr(Simulation, "integration_error", np.inf)
    assert judge(of_arm()).estimate_share is None


@pytest.mark.parametrize(("seed", "index"), [(1, 43), (1, 48), (1, 158), (77, 12)])
def test_tendons_that_slacken_or_stick_within_a_step_are_accurate(seed, index):
    """Damped robots, whose smooth motion lets steps be as long as control periods."""
    row = measure((seed, index))
    assert row.verdict == Verdict.ACCURATE
    assert not row.beyond_twice


def test_a_standing_rod_that_falls_is_no_better_than_its_estimate():
    """The shadow falls and stops first, while the simulation still parts from the truth."""
    row = measure((9001, 128))
    assert row.verdict == Verdict.WARNED
    assert not row.beyond_twice
