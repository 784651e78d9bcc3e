"""Plans on a learned model: what they track, keep and refuse."""

import shutil
from dataclasses import replace

import numpy as np
import pytest
from support.derivatives import differences

from softrobot_env.control.reduced.environment import ssm_environment
from softrobot_env.control.reduced.planning import outputs, program
from softrobot_env.control.reduced.policy import ReducedPlanner
from softrobot_env.control.registry import make_policy
from softrobot_env.evaluation.metrics import approached_metrics
from softrobot_env.evaluation.runner import Case, run
from softrobot_env.learned.reduction.polynomials import advance, linearise
from softrobot_env.robots import ARM, RIG
from softrobot_env.robots.artifacts import find_artifact
from softrobot_env.tasks import make_task

PERIOD = ssm_environment(RIG)["control_period"]


@pytest.fixture(scope="module")
def policy():
    pytest.importorskip("daqp")
    return ReducedPlanner(RIG, PERIOD)


@pytest.mark.parametrize("name", [pytest.param("ssm_mpc", marks=pytest.mark.slow), "ssm_lq"])
def test_fast_laps_of_the_triangle(name):
    """The goal of the study: 3 mm on average at one lap a second, without a physical model."""
    if name == "ssm_mpc":
        pytest.importorskip("daqp")
    task = make_task("triangle", period=1.0)
    rollout = run(Case(task, name, twin=0)).rollout
    assert rollout.failure is None
    assert approached_metrics(rollout, task.trajectory).e_mean_tracking < 3e-3


def test_derivatives_of_the_model_are_right(policy):
    """Of a step and of the outputs, against differences."""
    model, rng = policy._model, np.random.default_rng(0)
    x = 0.3 * rng.normal(size=model.dimension) * model.scale[: model.dimension]
    u = 0.2 * rng.normal(size=model.basis.shape[1])
    n, m = len(x), len(u)
    transition, effect = np.empty((n, n)), np.empty((n, m))
    linearise(model.motion, x.copy(), u, transition, effect)

    def moved(both):
        now = both[:n].copy()
        advance(model.motion, now, both[n:], np.empty(len(model.motion.parents)))
        return now

    numeric = differences(moved, np.concatenate([x, u]), 1e-6)
    np.testing.assert_allclose(np.hstack([transition, effect]), numeric, atol=1e-7)
    z, slope = np.empty(2), np.empty((2, n))
    outputs(policy._shape, model.origin, x, z, slope)
    np.testing.assert_allclose(z, model.decode(x), atol=1e-12)
    np.testing.assert_allclose(slope, differences(model.decode, x, 1e-6), atol=1e-7)


def test_the_gradient_of_a_plan_is_right(policy):
    """Against differences of the cost, of which it is half the gradient."""
    model, rng = policy._model, np.random.default_rng(1)
    nodes = 0.1 * rng.normal(size=(len(policy._places), 2))
    x, none, last = np.zeros(model.dimension), np.zeros(2), np.zeros(2)
    reference = 0.02 * rng.normal(size=(len(policy._weights), 2))

    def cost(values):
        now, total, before = x.copy(), 0.0, last
        for weights, wanted in zip(policy._weights, reference, strict=True):
            u = weights @ values
            advance(model.motion, now, u, np.empty(len(model.motion.parents)))
            total += np.sum((model.decode(now) - wanted) ** 2) + 1e-2 * np.sum((u - before) ** 2)
            before = u
        return total

    arguments = model.motion, policy._shape, model.origin, x, none, policy._weights
    hessian, gradient = program(*arguments, nodes, reference, last, 1e-2)
    shifts = np.eye(nodes.size).reshape(-1, *nodes.shape) * 1e-5
    numeric = [(cost(nodes + d) - cost(nodes - d)) / 4e-5 for d in shifts]
    np.testing.assert_allclose(gradient, numeric, atol=1e-6 * np.abs(gradient).max() + 1e-9)
    np.testing.assert_allclose(hessian, hessian.T, atol=1e-12)
    assert np.linalg.eigvalsh(hessian).min() > 0


# Tendons of the twin rub, on a fast path.
@pytest.mark.filterwarnings("ignore::softrobot_env.scene.timestep.TimestepWarning")
def test_plans_keep_to_the_servos(policy):
    """No action changes faster than the servos turn, and none leaves [-1, 1]."""
    rollout = run(Case(make_task("triangle", period=0.5), "ssm_mpc", twin=0, duration=14.0)).rollout
    assert rollout.failure is None
    assert np.abs(rollout.action).max() <= 1
    changes = np.abs(np.diff(rollout.action, axis=0)).max(axis=0)
    assert (changes <= policy._rate * (1 + 1e-5)).all()


def test_what_it_cannot_drive_is_refused():
    with pytest.raises(ValueError, match="ssm has not been trained for robot 'arm'"):
        make_policy("ssm_lq", ARM, PERIOD)
    with pytest.raises(ValueError, match="ssm has not been trained"):
        make_policy("ssm_lq", replace(RIG, name="other", pieces=6), PERIOD)


def test_a_file_of_another_specimen_is_a_policy(tmp_path):
    pytest.importorskip("daqp")
    path = shutil.copy(find_artifact(RIG, "ssm"), tmp_path / "ssm_7.npz")
    case = Case(make_task("triangle", period=1.0), str(path), twin=0, duration=0.1)
    assert case.environment().unwrapped.control_period == PERIOD
    assert isinstance(make_policy(str(path), RIG, PERIOD), ReducedPlanner)
