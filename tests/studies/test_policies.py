"""The study of the arm's policies: what is run, motion errors, ratios."""

from dataclasses import fields
from functools import cache

import numpy as np
import pytest

from softrobot_env.control.registry import POLICIES, policy_environment
from softrobot_env.envs.tracking import TrackingEnv
from softrobot_env.evaluation.rollout import Rollout
from studies import policies as study
from studies.policies import DISTURBANCES, MODULI, PARAMETERS, TASKS, ControllerRow, E
from studies.truths.thesis_values import CONTROLLERS

cases = cache(study.cases)

#: Figures of a made-up episode.
GOOD = {
    "e_mean": 1e-4,
    "e_max": 1e-4,
    "e_rms": 5e-5,
    "e_final": 1e-6,
    "e_motion": 1e-4,
    "e_motion_least": 1e-5,
    "rise_time": 0.1,
    "settling_time": 0.2,
    "overshoot": 0.01,
    "steady_state_error": 1e-6,
    "tension_max": 20.0,
}


def make_row(case, **changes):
    setting, plant, policy, task, options, variation = case
    names = {"setting": setting, "plant": plant, "policy": policy, "task": task}
    values = dict.fromkeys(f.name for f in fields(ControllerRow)) | {
        "step_width": options.get("step_width"),
        "variation": variation,
        "feedback": "output" if setting == "output" else "state",
        "policy_time_median": 1e-6,
    }
    metrics = dict.fromkeys(GOOD) if changes.get("failure") else GOOD
    return ControllerRow(**values | names | metrics | changes)


def rollout(error, time, failure=None):
    """Error (T,) [m] in x at times (T,) [s]."""
    tip = np.zeros((len(time), 3))
    tip[:, 0] = error
    zeros, few = np.zeros((len(time), 3)), np.zeros(len(time))
    return Rollout(
        time, zeros, tip, zeros, zeros, zeros, zeros, few, policy_time=few[1:],
        policy_status=np.full(len(time) - 1, ""), wall_time=1.0, failure=failure,
    )  # fmt: skip


def test_error_during_the_motion_leaves_the_kinks_out():
    time = np.arange(0.0, 15.01, 0.25)
    error = np.full(len(time), 2e-3)
    error[(time <= 0.5) | (time >= 10)] = 9e-3
    error[time == 3.0] = 1e-3
    assert study.motion_errors(rollout(error, time), "swing") == (1e-3, 2e-3)
    error[(time >= 5) & (time <= 6)] = 7e-3  # the corner of the L-shape
    error[(time > 0.5) & (time <= 1)] = 8e-3
    assert study.motion_errors(rollout(error, time), "lshape")[1] == 2e-3
    assert study.motion_errors(rollout(error, time), "step") == (None, None)
    assert study.motion_errors(rollout(error, time, "diverged"), "swing") == (None, None)


def test_ratios_are_the_largest_over_the_nominal_robot():
    swing = ("mujoco", "mujoco", "lqi", "swing", {})
    varied = ("robustness", *swing[1:])
    rows = [
        make_row((*swing, {}), e_max=2e-3, e_rms=1e-3),
        make_row((*varied, {E: 0.5}), e_max=3e-3, e_rms=4e-3),
        make_row((*varied, {E: 0.75}), e_max=2e-3, e_rms=5e-3),
    ]
    assert study._largest(rows) == "1.50 / 5.00"
    assert study._largest([*rows, make_row((*varied, {E: 1.5}), failure="diverged")]) == "failed"


def test_a_full_run_covers_every_setting_and_a_quick_one_is_a_part_of_it():
    every, quick = map(cases, (False, True))
    assert study.policies()[:3] == list(CONTROLLERS)
    assert set(study.policies()) == set(POLICIES) - {"hold"}
    for setting in ("thesis", "mujoco"):
        assert sum(case[0] == setting for case in every) == len(TASKS) * len(study.policies())
    output = {case[2] for case in every if case[0] == "output"}
    assert {"lqi", "lq_adaptive"} <= output and not output & {"qs_nn", "feedforward"}
    varied = [case for case in every if case[:3] == ("robustness", "mujoco", "lqi")]
    for task in TASKS:
        met = [case[5] for case in varied if case[3:5] == task]
        assert all(modulus in met for modulus in MODULI)
    assert {case[0] for case in every} == {case[0] for case in quick}
    assert all(case in every for case in quick) and len(quick) < len(every) / 5


@pytest.mark.parametrize("policy", ["lqi", "mpc_preview"])  # 1 and 5 ms
def test_environments_accept_every_variation(policy):
    env = TrackingEnv("step", **policy_environment(policy))
    for variation in (*PARAMETERS, *DISTURBANCES):
        env.reset(seed=0, options={"vary": variation})
        row = make_row(("disturbed", "mujoco", policy, "step", {}, variation))
        assert row.varied != "nominal" and (row.group == "other drives, sensors") == (
            variation in DISTURBANCES
        )
