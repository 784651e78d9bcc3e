"""Closed loops of the arm's laws: steps and paths as thesis or audit have them, or better."""

from typing import NamedTuple

import numpy as np
import pytest

from softrobot_env.evaluation import runner
from softrobot_env.evaluation.metrics import step_metrics, tracking_metrics
from softrobot_env.tasks import make_task

LQ = ("lq_preview", "lq_adaptive")
SLOW = pytest.mark.slow
ANY = (0.0, np.inf)


def episode(name, task, plant="mujoco", feedback="state", duration=None, vary=None, **options):
    """Of a policy on the arm."""
    given = {"plant": plant, "feedback": feedback, "duration": duration}
    rollout = runner.run(runner.Case(make_task(task, **options), name, vary or {}, **given)).rollout
    assert rollout.failure is None
    return rollout


#: What the audit's section 3 leaves open of steps: rise and settling time [s], overshoot.
LQI, MPC = ((0.078, 0.098), (0.6, 0.95), (0.25, 0.36)), ((0.08, 0.1), (0.81, 1.05), (0.265, 0.295))
QUICK = ((0, 0.25), (0, 0.25), (0, 0.04))
SOFT = {"vary": {"youngs_modulus": 0.5}}


@pytest.mark.parametrize(
    ("name", "plant", "width", "rise", "settling", "overshoot", "left", "options"),
    [
        *(("lqi", plant, 0.05, *LQI, 1e-4, {}) for plant in ("pcc", "mujoco")),
        *(("mpc", "pcc", width, *MPC, 1e-4, {}) for width in (0.05, 0.2)),
        *(("mpc_preview", "mujoco", w, *QUICK, 1e-4, {}) for w in (0.05, 0.2)),
        ("mpc_preview", "mujoco", 0.05, ANY, ANY, (0, 0.05), np.inf, SOFT),
        *((name, "mujoco", 0.05, (0, 0.4), (0, 0.4), (0, 0.05), 1e-4, {}) for name in LQ),
        *((name, "mujoco", 0.1, (0, 0.5), (0, 0.5), (0, 0.05), 1e-4, {}) for name in LQ),
        *((name, "mujoco", 0.2, (0, 0.5), (0, 0.5), (0, 0.1), 1e-4, {}) for name in LQ),
        # Thesis: rise 0.237 s, settling 7.65 s, overshoot 47.5 %; audit: 6.7 to 12 s, 61 to 69 %.
        ("qs_nn", "pcc", 0.05, (0.22, 0.26), (5, 12), (0.55, 0.72), 0.02, {"duration": 25.0}),
    ],
)
def test_steps(name, plant, width, rise, settling, overshoot, left, options):
    rollout = episode(name, "step", plant, step_width=width, **{"duration": 3.0} | options)
    metrics = step_metrics(rollout.time, rollout.tip, rollout.reference[-1])
    assert rise[0] < metrics.rise_time < rise[1]
    assert settling[0] < metrics.settling_time < settling[1]
    assert overshoot[0] < metrics.overshoot < overshoot[1]
    assert metrics.steady_state_error < left


class Case(NamedTuple):
    """A path, and bands in mm of its largest error, and of the largest and mean ones later on."""

    name: str
    plant: str
    task: str
    duration: float
    largest: tuple[float, float]
    after: float = 1.0
    late: tuple[float, float] = (0.0, np.inf)
    mean: tuple[float, float] = (0.0, np.inf)
    rms: tuple[float, float] = (0.0, np.inf)
    modulus: float = 1.0


# The thesis has 6.13 (less than 1 in motion) and 1.71 mm for lqi, 27.3 for qs_nn; the audit 5.9 to
# 6.7 and 1.9 to 2.1; 12.8, a period's way of 8.9 in the mean, and 2.6 for mpc, which loses the tip
# on another stiffness; 14 to 18 in the first second for qs_nn, which fails where E falls by a
# quarter (sec. 6.6.3). The stiffness hardly matters for lqi after a transient (Fig. 6.21).
CASES = [
    *(Case("lqi", p, "swing", 3.0, (5.5, 6.7), late=(0, 1)) for p in ("pcc", "mujoco")),
    *(Case("lqi", plant, "lshape", 7.0, (1.6, 2.1)) for plant in ("pcc", "mujoco")),
    *(Case("lqi", "pcc", "swing", 4.0, ANY, 2.5, (0, 2), modulus=E) for E in (0.5, 1.5)),
    Case("mpc", "pcc", "swing", 6.0, (12.5, 13.1), mean=(8.4, 9.4)),
    Case("mpc", "pcc", "lshape", 7.0, (2.5, 2.7)),
    Case("mpc", "pcc", "swing", 12.0, ANY, 9.0, (40, np.inf), modulus=0.5),
    # Largest at the start, in the L's corner (5 s) and at the swing's end (10 s).
    pytest.param(Case("mpc_preview", "mujoco", "swing", 12.0, (0, 0.8), rms=(0, 0.1)), marks=SLOW),
    Case("mpc_preview", "mujoco", "lshape", 6.0, (0, 0.4), rms=(0, 0.1)),
    # It starts out of balance, of which the law knows nothing before it moves.
    Case("mpc_preview", "mujoco", "swing", 3.0, (0, 1.2), 0.5, (0, 0.3), modulus=0.5),
    *(Case(name, "mujoco", "swing", 3.0, (0, 1.3), 0.5, (0, 0.15)) for name in LQ),
    *(Case(name, "mujoco", "lshape", 7.0, (0, 0.5)) for name in LQ),
    Case("qs_nn", "pcc", "swing", 15.0, (100, np.inf), modulus=0.75),
    Case("qs_nn", "pcc", "swing", 15.0, (15, 18), 2.0, late=(0, 15)),  # largest at the start
    Case("qs_nn", "pcc", "swing", 15.0, ANY, 14.9, late=(0, 5)),
]


@pytest.mark.parametrize("case", CASES)
def test_paths(case):
    vary = {"youngs_modulus": case.modulus}
    rollout = episode(case.name, case.task, case.plant, duration=case.duration, vary=vary)
    error, late = 1e3 * rollout.error, 1e3 * rollout.error[rollout.time > case.after]
    for found, (low, high) in (
        (error.max(), case.largest),
        (late.max(), case.late),
        (late.mean(), case.mean),
        (np.sqrt((error**2).mean()), case.rms),
    ):
        assert low <= found < high


@pytest.mark.parametrize("feedback", ["state", pytest.param("output", marks=SLOW)])
@pytest.mark.parametrize("factor", [0.5, *(pytest.param(f, marks=SLOW) for f in (0.75, 1.25, 1.5))])
def test_the_adaptive_policy_stays_within_twice_its_error(factor, feedback):
    for task, options in (
        ("swing", {"duration": 3.0}),
        ("lshape", {"duration": 7.0}),
        ("step", {"duration": 3.0, "step_width": 0.2}),
    ):
        nominal, varied = (
            tracking_metrics(episode("lq_adaptive", task, feedback=feedback, vary=vary, **options))
            for vary in ({}, {"youngs_modulus": factor})
        )
        assert varied.e_max < 2 * nominal.e_max, task
        if task == "step" or factor > 0.5:
            assert varied.e_rms < 2 * nominal.e_rms, task


def test_saturation_ends_without_after_effects():
    """A stiffer arm cannot quite reach the L-shape's corner; soon after, the error is as before."""
    vary = {"youngs_modulus": 1.6}
    rollout = episode("lq_adaptive", "lshape", duration=8.0, vary=vary)
    assert "tension limit reached" in rollout.policy_status
    assert rollout.error[rollout.time > 6.5].max() < 0.1e-3


def test_output_feedback_tracks_nearly_as_well():
    errors = {
        feedback: episode("lqi", "swing", feedback=feedback, duration=3.0).error.max()
        for feedback in ("state", "output")
    }
    assert errors["output"] < 1.1 * errors["state"]


def test_a_stiffer_arm_stays_too_high_for_the_thesis_mpc():
    """Audit sec. 3."""
    rollout = episode("mpc", "swing", "pcc", duration=12.0, vary={"youngs_modulus": 1.5})
    assert rollout.error[rollout.time > 9.0].max() > 40e-3
    assert rollout.tip[-1, 2] > rollout.reference[-1, 2] + 0.02
