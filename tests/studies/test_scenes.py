"""The judge of random scenes is judged: scenes known to be right, wrong and failing."""

from dataclasses import replace

import numpy as np
import pytest

from softrobot_env.beams import signals
from softrobot_env.beams.pcc import PCC
from softrobot_env.benchmarks.stability.runs import neutral_scene
from softrobot_env.evaluation.models.runs import Verdict, verdict_of
from softrobot_env.robots import ARM
from softrobot_env.scene.config import SceneConfig
from softrobot_env.scene.simulation import Simulation
from studies import scenes
from studies.scenes import STUDY, Refined, judge, measure, refine, refined_run
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
    robots = [scene.config.robot for scene in many]
    slenderness = np.array([r.length / r.outer_radius for r in robots])
    assert slenderness.min() < 10 and slenderness.max() > 1000
    moduli = np.array([r.youngs_modulus for r in robots])
    assert moduli.min() < 1e4 and moduli.max() > 1e11
    weights = {round(float(np.linalg.norm(r.gravity)) / G, 6) for r in robots}
    assert weights == {0.0, 1.0, 100.0}
    assert {scene.excitation for scene in many} == set(EXCITATIONS)
    assert {len(r.tendons) for r in robots} == {1, 2, 3, 4}
    pieces = {scene.config.n_pieces for scene in many}
    assert min(pieces) == 4 and max(pieces) == 30
    assert all(0.002 <= scene.config.control_period <= 0.05 for scene in many)
    assert sum(r.has_friction for r in robots) > 20
    assert sum(r.head is not None for r in robots) > 20
    assert sum(scene.config.torsion for scene in many) > 20


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
    explicit = refined_run(scene, drawn, "RK4", 400)
    assert np.max(np.abs(explicit - tips)) < 5e-6


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


def test_a_coarse_step_is_wrong_and_the_judge_says_so():
    lively = ARM.vary(damping_time=0.1, youngs_modulus=0.5)
    row = judge(of_arm(lively, periods=100), integrator="discrete", timestep=0.01)
    assert row.verdict == Verdict.WRONG and row.error_share > 0.05


def test_a_failure_is_reported_beside_a_refined_run_that_is_fine():
    stiff = ARM.vary(damping_time=0.01, youngs_modulus=100.0)
    row = judge(of_arm(stiff), integrator="Euler", timestep=0.01)
    assert row.verdict == Verdict.REPORTED and "diverged" in row.why
    assert row.refined_fine is True and row.error is None


def test_a_scene_that_cannot_be_built_is_reported():
    robot = replace(ARM, outer_radius=1e-6, inner_radius=0.0, tendons=())
    drawn = RandomScene(0, 0, SceneConfig(robot), np.zeros(3), np.zeros((5, 0)), "let_go")
    row = judge(drawn)
    assert row.verdict == Verdict.REPORTED and row.why and row.joints is None
    assert row.refined_fine is None


def verdict(error, warning=None):
    """The verdict of a run of the arm that is `error` [m] off."""
    asked = SceneConfig(ARM).wanted_accuracy
    return verdict_of(error, asked, ARM.length, failure=None, warning=warning)


def test_a_warning_excuses_what_silence_does_not():
    assert verdict(0.0) == Verdict.ACCURATE
    assert verdict(0.01) == Verdict.INACCURATE  # 2 % of the length
    assert verdict(0.1) == Verdict.WRONG
    assert verdict(0.1, "expect divergence") == Verdict.WARNED
    assert verdict(0.0, "expect divergence") == Verdict.ACCURATE
    assert verdict(None) == Verdict.UNJUDGED
    assert verdict(float("nan")) == Verdict.WRONG


def test_what_refined_runs_do_not_agree_on_is_not_judged(monkeypatch):
    monkeypatch.setattr(scenes, "refine", lambda *_: Refined(np.zeros((41, 3)), 0.3, 8, "RK4"))
    row = judge(of_arm())
    assert (
        row.verdict == Verdict.UNJUDGED and row.why == "refined runs differ by 60 % of the length"
    )


def test_an_estimate_is_good_within_its_factor():
    known = replace(judge(of_arm()), error_share=1e-3)
    assert replace(known, estimate_share=np.float64(2.9e-3)).estimate_is_good is True
    assert not replace(known, estimate_share=3.1e-3).estimate_is_good
    assert not replace(known, estimate_share=3e-4).estimate_is_good
    assert replace(known, estimate_share=None).estimate_is_good is None


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


@pytest.mark.parametrize(("seed", "index"), [(1, 43), (1, 48), (1, 158)])
def test_tendons_that_slacken_or_stick_within_a_step_are_accurate(seed, index):
    """Overdamped robots, whose smooth motion lets steps be as long as control periods."""
    assert measure((seed, index)).verdict == Verdict.ACCURATE
