"""The model predictive controllers as policies, and their closed loops."""

import sys
from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import least_squares
from support.derivatives import differences

from softrobot_env.beams import planar_arm
from softrobot_env.beams.model import State
from softrobot_env.beams.pcc import PCC
from softrobot_env.control.registry import make_policy
from softrobot_env.robots import ARM
from softrobot_env.robots.actuation import TendonMap
from softrobot_env.thesis.arm.mpc import MPC, Optimiser, Problem
from softrobot_env.thesis.arm.mpc_settings import PREVIEW, THESIS

EACH = pytest.mark.parametrize("settings", [THESIS, PREVIEW], ids=["thesis", "preview"])

#: Tip of an arm bent by 1/m everywhere, a circular arc of 0.5 rad.
TIP = np.array([1 - np.cos(0.5), np.sin(0.5)])
NEARBY = (TIP[0] + 2e-3, TIP[1] - 1e-3)


def observe(reference=NEARBY, curvature=1.0, **changed):
    """A bent arm at rest and a resting reference."""
    reference = np.asarray(reference, dtype=float)
    observation = {
        "curvature": np.full(6, curvature),
        "curvature_rate": np.zeros(6),
        "tip_position": TIP,
        "reference": reference,
        "reference_preview": np.tile(reference, len(PREVIEW.steps)),
        "previous_action": np.full(3, 0.06),
    }
    return observation | changed


# ---------------------------------------------------------------- as policies


@EACH
def test_weights_do_not_depend_on_how_forces_are_geared(settings):
    """Half the moment arms and twice the tensions are the same robot to its actions."""

    def geared(tendon):
        offset = tuple(x / 2 for x in tendon.offset)
        return replace(tendon, offset=offset, tension_limit=2 * tendon.tension_limit)

    other = replace(ARM, tendons=tuple(geared(t) for t in ARM.tendons))
    actions = [
        MPC(robot, settings.period, settings).predict(observe())[0] for robot in (ARM, other)
    ]
    np.testing.assert_allclose(actions[1], actions[0], rtol=1e-3)


def test_missing_package_is_named(monkeypatch):
    monkeypatch.setitem(sys.modules, "daqp", None)
    with pytest.raises(ImportError, match=r'pip install "daqp>='):
        make_policy("mpc", ARM, THESIS.period)


# ---------------------------------------------------------------- where no optimum is found


@pytest.mark.parametrize(
    ("settings", "observation", "reason"),
    [
        (replace(THESIS, iterations=0), observe(), "not converged in 0 iterations"),
        (replace(THESIS, iterations=1), observe((-0.3, 0.3)), "not converged in 1 iterations"),
        (THESIS, observe(curvature_rate=np.full(6, 1e200)), "prediction failed"),
    ],
)
def test_action_is_kept_where_the_optimisation_fails(settings, observation, reason):
    policy = MPC(ARM, settings.period, settings)
    action, state = policy.predict(observation)
    assert state.status == f"last action kept: {reason}"
    np.testing.assert_allclose(action, observation["previous_action"])


@EACH
def test_after_a_failure_the_next_decision_begins_anew(settings):
    policy = MPC(ARM, settings.period, settings)
    action, state = policy.predict(observe())
    kept, state = policy.predict(observe(curvature_rate=np.full(6, 1e200)), state)
    np.testing.assert_array_equal(kept, action)
    assert state.status == "last action kept: prediction failed"
    after, state = policy.predict(observe(), state)
    assert state.status is None
    np.testing.assert_array_equal(after, action)  # the same problem, begun from the same inputs


def test_tension_limit_is_kept_and_reported():
    tendons = tuple(replace(t, tension_limit=6.0) for t in ARM.tendons)
    policy = MPC(replace(ARM, tendons=tendons), THESIS.period)
    action, state = policy.predict(observe((0.3, 0.37)))
    assert state.status == "tension limit reached"
    assert np.abs(action).max() == 1.0


# ---------------------------------------------------------------- the optimisation

DATA = planar_arm.make_planar_arm(ARM)
MAP = TendonMap(ARM)
MODEL = PCC(ARM, axes="planar")


def optimiser(settings, limit=80.0):
    return Optimiser(settings, np.full(3, limit))


def make_problem(settings, seed=0, force=0.0):
    """A moving arm, bent by some 1 rad, and a reference that leads away from its tip."""
    rng = np.random.default_rng(seed)
    curvature = 2.0 + rng.normal(size=6)
    tip, jacobian = np.empty(2), np.empty((2, 6))
    planar_arm.tip(DATA, curvature, tip, jacobian)
    ahead = np.linspace(0.0, 1.0, len(settings.steps) + 1)[:, None]
    return Problem(
        arm=DATA,
        start=np.stack([curvature, rng.normal(size=6)]),
        force=force * rng.normal(size=6),
        before=rng.normal(size=3),
        reference=tip + ahead * rng.normal(size=2) * 0.03,
    )


def some_inputs(settings):
    return 5.0 + 3.0 * np.random.default_rng(1).normal(size=(len(settings.moves), 3))


def residuals(solver, settings, problem, inputs):
    """Roots of the terms of the cost, written out from the predicted path."""
    path = solver.evaluate(problem, inputs, settings.no_guess(6)).path
    states = np.concatenate((problem.start[None], path))
    tips, jacobian = np.empty((len(states), 2)), np.empty((2, 6))
    for state, tip in zip(states, tips, strict=True):
        planar_arm.tip(DATA, state[0], tip, jacobian)
    error = tips - problem.reference
    steps = np.array(settings.steps)[:, None]
    share = np.sqrt(steps / steps[0])
    applied = inputs[settings.block]
    change = np.diff(np.concatenate((problem.before[None], applied)), axis=0)
    terms = (
        np.sqrt(settings.error) * share * error[1:],
        np.sqrt(settings.rate) * share * np.diff(error, axis=0) / steps,
        np.sqrt(settings.effort) * share * applied,
        np.sqrt(settings.change) * change,
    )
    return np.concatenate([term.ravel() for term in terms])


@EACH
def test_prediction_is_that_of_the_general_model(settings):
    """Step by step with the integrator of the same name of the package's simulation."""
    solver, problem = optimiser(settings), make_problem(settings)
    inputs = some_inputs(settings)
    path = solver.evaluate(problem, inputs, settings.no_guess(6)).path
    state = State(*problem.start)
    for k, step in enumerate(settings.steps):
        tension = MAP.tension(inputs[settings.block[k]])
        motion = MODEL.simulate(step, tension, state, method=settings.integrator, step=step)
        state = motion.end
        np.testing.assert_allclose(path[k, 0], state.q, rtol=1e-6, atol=1e-7)
        np.testing.assert_allclose(path[k, 1], state.v, rtol=1e-6, atol=1e-5)


def test_force_acts_like_the_inputs_that_cause_it():
    """A force B u_d on the curvatures is what further inputs u_d would do."""
    settings, further = THESIS, np.array([1.0, -2.0, 3.0])
    solver, problem, inputs = optimiser(settings), make_problem(settings), some_inputs(settings)
    pushed = problem._replace(force=DATA.inputs @ further)
    by_force = solver.evaluate(pushed, inputs, settings.no_guess(6)).path
    by_inputs = solver.evaluate(problem, inputs + further, settings.no_guess(6)).path
    np.testing.assert_allclose(by_force, by_inputs, rtol=1e-7, atol=1e-7)


@EACH
def test_cost_and_its_model_follow_from_the_path(settings):
    """Cost, gradient and Gauss-Newton Hessian against finite differences of the terms."""
    solver, problem = optimiser(settings), make_problem(settings, force=1e-3)
    inputs = some_inputs(settings)
    now = solver.evaluate(problem, inputs, settings.no_guess(6))
    terms = residuals(solver, settings, problem, inputs)
    assert now.cost == pytest.approx(terms @ terms, rel=1e-12)
    alone = solver.evaluate(problem, inputs, settings.no_guess(6), differentiate=False)
    assert alone.cost == now.cost and alone.gradient.size == 0
    slopes = differences(
        lambda x: residuals(solver, settings, problem, x.reshape(inputs.shape)),
        inputs.ravel(),
        1e-3,
    )
    scale = np.abs(now.hessian).max()
    np.testing.assert_allclose(now.gradient, 2 * terms @ slopes, atol=1e-5 * scale)
    np.testing.assert_allclose(now.hessian, 2 * slopes.T @ slopes, atol=1e-5 * scale)


@pytest.mark.parametrize("limit", [80.0, 6.0], ids="{:g} N".format)
@pytest.mark.parametrize("seed", range(3))
def test_optimum_is_that_of_a_general_solver(seed, limit):
    solver, problem = optimiser(THESIS, limit), make_problem(THESIS, seed)
    begin = np.zeros((3, 3))
    optimum = solver.minimise(problem, begin, THESIS.no_guess(6))
    assert optimum.failure is None
    general = least_squares(
        lambda x: residuals(solver, THESIS, problem, x.reshape(3, 3)),
        begin.ravel(),
        bounds=(-limit, limit),
        xtol=1e-12,
        ftol=1e-14,
        gtol=1e-12,
        max_nfev=500,
    )
    inputs = optimum.last.inputs
    assert np.any(np.abs(inputs) == limit) == (limit == 6.0)
    assert optimum.last.cost <= 2 * general.cost * (1 + 1e-6)
    np.testing.assert_allclose(inputs.ravel(), general.x, atol=0.02)


@EACH
@pytest.mark.parametrize("seed", range(5))
def test_cost_never_increases(settings, seed):
    settings = replace(settings, iterations=50, tolerance=1e-4)
    solver, problem = optimiser(settings, 20.0), make_problem(settings, seed)
    far = problem._replace(reference=np.tile([-0.3, 0.3], (len(settings.steps) + 1, 1)))
    begin = np.tile(problem.before, (len(settings.moves), 1))
    optimum = solver.minimise(far, begin, settings.no_guess(6))
    assert optimum.failure is None
    assert len(optimum.costs) > 2 and np.all(np.diff(optimum.costs) <= 0)
    assert np.abs(optimum.last.inputs).max() <= 20.0 + 1e-12


@pytest.mark.parametrize(
    ("changes", "reason"),
    [
        ({"integrator": "rk4"}, "choose from implicit_euler, sdirk2"),
        ({"steps": (0.1, -0.1)}, "steps must be positive"),
        ({"period": 0.2}, "period in"),
        ({"moves": (1, 1)}, "5 in sum"),
        ({"effort": 0.0}, "effort must be positive"),
    ],
)
def test_bad_settings_are_refused(changes, reason):
    with pytest.raises(ValueError, match=reason):
        replace(THESIS, **changes)


def test_shift_moves_a_plan_on_by_one_period():
    np.testing.assert_array_equal(THESIS.shift, [1, 2, 2])
    settings = replace(THESIS, period=0.02, steps=(0.02, 0.02, 0.04, 0.08), moves=(1, 1, 1, 1))
    # Blocks start at 0, 20, 40 and 80 ms; 20 ms later blocks 1, 2, 2 and 3 are in force.
    np.testing.assert_array_equal(settings.shift, [1, 2, 2, 3])
