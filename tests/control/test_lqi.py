from dataclasses import replace

import numpy as np
import pytest
from scipy.linalg import solve_continuous_lyapunov
from support.driven import driven_steps

from softrobot_env.beams.constant_curvature import ConstantCurvatureStatics
from softrobot_env.beams.model import State
from softrobot_env.beams.pcc import PCC
from softrobot_env.beams.planar_arm import make_planar_arm
from softrobot_env.control.feedforward.statics import least_norm
from softrobot_env.control.observers import linear_model
from softrobot_env.core.files import models_dir
from softrobot_env.envs.tracking import TrackingEnv
from softrobot_env.robots import ARM
from softrobot_env.tasks import make_task
from softrobot_env.thesis.arm import operating_points as gains
from softrobot_env.thesis.arm.policies import make_lqi
from softrobot_env.thesis.arm.statics import follow

PERIOD = 1e-3
ARM_DATA = make_planar_arm(ARM)
STATICS = ConstantCurvatureStatics(ARM)
LIMIT = np.full(3, 80.0)
BENT = np.repeat([3.0, -1.0, 4.0], 2)


# ---------------------------------------------------------------- linear model and gains


def test_linear_model_is_that_of_the_general_beam_model():
    """By complex steps through the equations of motion, at an equilibrium under tension."""
    model = PCC(ARM, axes="planar")
    curvature = np.repeat([2.0, 1.0, 0.5], 2)
    reduced = np.linalg.lstsq(ARM_DATA.inputs, ARM_DATA.stiffness * curvature, rcond=None)[0]
    tension = np.maximum(np.stack([reduced, -reduced], axis=1).ravel(), 0)
    space = model.linearize(State(curvature, np.zeros(6)), tension)
    a, b, c = linear_model(ARM_DATA, curvature).state_space()
    np.testing.assert_allclose(a, space.a, rtol=1e-8, atol=1e-6)
    np.testing.assert_allclose(b, space.b[:, ::2], rtol=1e-8, atol=1e-9)
    np.testing.assert_allclose(c, space.c[[0, 2]], atol=1e-12)


def test_gains_minimise_the_cost():
    """Any other stabilising gain costs more, by Lyapunov's equation of each closed loop."""
    a, b, c = linear_model(ARM_DATA, BENT).state_space()
    a = np.block([[a, np.zeros((12, 2))], [c, np.zeros((2, 2))]])
    b = np.vstack([b, np.zeros((2, 3))])
    best = gains.lqi_design(ARM_DATA, BENT).reshape(3, 14)
    start = np.concatenate([np.full(6, 0.1), np.zeros(6), np.full(2, 1e-3)])
    weights = np.diag([0.0] * 12 + [gains.ERROR_WEIGHT] * 2)

    def cost(gain):
        weight = weights + gains.LQI_INPUT_WEIGHT * gain.T @ gain
        return start @ solve_continuous_lyapunov((a - b @ gain).T, -weight) @ start

    rng = np.random.default_rng(0)
    others = [cost(best * (1 + 0.1 * rng.normal(size=best.shape))) for _ in range(5)]
    assert 0 < cost(best) < min(others)


def test_shipped_table_holds_stabilising_gains_everywhere():
    """At each of the thesis' 2288 points; the straight pose is none of them."""
    table = gains.load_gains(models_dir() / "lqi.npz", ARM, "lqi", 42)
    assert table.shape == (16, 13, 11, 42)
    rows = zip(gains.operating_points(6), table.reshape(-1, 3, 14), strict=True)
    for number, (bend, gain) in enumerate(rows):
        assert np.any(bend != 0) and growth(bend, gain) < 0
        if number % 97:
            continue
        np.testing.assert_allclose(  # half precision, and a mirrored half
            gain, gains.lqi_design(ARM_DATA, bend).reshape(3, 14), rtol=2e-3, atol=1e-2
        )


def growth(bend, gain):
    """Largest real part [1/s] of the closed loop's poles at an operating point."""
    a, b, c = linear_model(ARM_DATA, bend).state_space()
    a = np.block([[a, np.zeros((12, 2))], [c, np.zeros((2, 2))]])
    return np.linalg.eigvals(a - np.vstack([b, np.zeros((2, 3))]) @ gain).real.max()


def test_interpolated_gains_stabilise_too():
    """Except within 0.3 1/m of the straight pose, where they may grow slowly (models/lqi.md)."""
    table = gains.load_gains(models_dir() / "lqi.npz", ARM, "lqi", 42)
    found, rng = np.empty(42), np.random.default_rng(0)
    for _ in range(500):
        bend = np.repeat(rng.uniform(-1, 1, 3) * [limit for _, limit in gains.GRID], 2)
        gains.interpolate(table, bend, found)
        if np.max(np.abs(bend)) > 0.3:
            assert growth(bend, found.reshape(3, 14)) < 0
        gains.interpolate(table, 0.04 * bend, found)
        assert growth(0.04 * bend, found.reshape(3, 14)) < 0.04


# ---------------------------------------------------------------- table


def test_interpolation_is_exact_for_trilinear_functions():
    x, y, z = np.meshgrid(*gains.axes(), indexing="ij")
    values = np.stack([1 + x - 2 * y + x * z, x * y * z], axis=-1)
    out = np.empty(2)
    rng = np.random.default_rng(0)
    for _ in range(50):
        a, b, c = rng.uniform(-1, 1, 3) * [limit for _, limit in gains.GRID]
        assert gains.interpolate(values, np.repeat([a, b, c], 2), out)
        np.testing.assert_allclose(out, [1 + a - 2 * b + a * c, a * b * c], atol=1e-10)
    for corner in ([7.5, 7.2, 7.0], [-7.5, -7.2, -7.0]):
        assert gains.interpolate(values, np.repeat(corner, 2), out)
    # Outside, the nearest point of the grid counts, and it is said.
    assert not gains.interpolate(values, np.repeat([20.0, 1.0, 1.0], 2), out)
    np.testing.assert_allclose(out, [1 + 7.5 - 2 + 7.5, 7.5])


def test_tables_of_other_functions_are_refused(tmp_path):
    made = gains.build_gains(ARM, lambda curvature: np.repeat(curvature[:1] ** 2, 42))
    gains.save_gains(tmp_path / "gains.npz", ARM, made)
    table = gains.load_gains(tmp_path / "gains.npz", ARM, "lqi", 42)
    np.testing.assert_allclose(table[:, 0, 0, 0], gains.axes()[0] ** 2, rtol=1e-3)
    with pytest.raises(ValueError, match="does not fit this version"):
        gains.load_gains(tmp_path / "gains.npz", ARM, "lqi", 41)


@pytest.mark.parametrize("design", (gains.lqi_design, gains.preview_design))
def test_gains_of_a_mirrored_arm_are_mirrored(design):
    """At points of no symmetry, computed on both sides."""
    half, whole = [], []
    for point in np.random.default_rng(5).uniform(-6, 6, (4, 3)):
        bend = np.repeat(point, 2)
        half.append(design(ARM_DATA, bend))
        whole.append(design(ARM_DATA, -bend))
    found = gains.mirrored(np.reshape(half, (4, 1, 1, -1)), 12, 3)
    expected = np.reshape(whole[::-1], (4, 1, 1, -1))
    np.testing.assert_allclose(found[4:], expected, rtol=1e-6, atol=1e-6 * np.abs(whole).max())


# ---------------------------------------------------------------- followed equilibrium


def test_followed_equilibrium_ends_at_least_norm_on_the_target():
    """Against the inverse statics of the continuous beam, another method and model."""
    target = np.array([0.24, 0.30])
    expected = least_norm(STATICS, target, np.array([-30.0, 0.0, 30.0]))
    inputs = np.array([5.0, 8.0, 8.0])
    rest, inverse, gap = np.empty(6), np.empty((3, 2)), 1.0
    start = STATICS.tip(inputs)
    for share in np.minimum(np.linspace(0, 3, 3000), 1):
        here = start + share * (target - start)
        gap = follow(ARM_DATA, here, np.zeros(6), 1.0, LIMIT, inputs, rest, inverse)
    assert expected.reached and gap < 1e-7
    np.testing.assert_allclose(inputs, expected.inputs, atol=1e-4)
    np.testing.assert_allclose(
        rest, np.repeat(STATICS.curvature(inputs, np.array([0.1, 0.2, 0.4])), 2), atol=1e-9
    )


def test_followed_equilibrium_of_a_softer_arm_under_a_force():
    """Half the stiffness takes half the inputs; a force that inputs can cancel is cancelled."""
    target, limit = np.array([0.2, 0.44]), LIMIT
    push = np.array([1.0, -2.0, 0.5])
    found = []
    for scale, force in ((1.0, np.zeros(6)), (0.5, np.zeros(6)), (1.0, ARM_DATA.inputs @ push)):
        inputs, rest, inverse = np.array([4.0, 4.0, 4.0]), np.empty(6), np.empty((3, 2))
        for _ in range(50):
            gap = follow(ARM_DATA, target, force, scale, limit, inputs, rest, inverse)
        assert gap < 1e-7
        point = STATICS.tip(
            (inputs + np.linalg.lstsq(ARM_DATA.inputs, force, rcond=None)[0]) / scale
        )
        np.testing.assert_allclose(point, target, atol=1e-6)
        found.append(inputs)
    assert np.linalg.norm(found[1]) < 0.7 * np.linalg.norm(found[0])


# ---------------------------------------------------------------- closed loop


def waited(limit, far, near, wait, **vary):
    """Errors [m] of the arm after it has waited for steps at a reference, and what was said."""
    robot = replace(ARM, tendons=tuple(replace(t, tension_limit=limit) for t in ARM.tendons))
    task = replace(make_task("step"), robot=robot, duration=20.0)
    env, policy = TrackingEnv(task, control_period=PERIOD, observe="all"), make_lqi(robot, PERIOD)

    def shown(k, seen):
        return seen | {"reference": far if k < wait else near}

    run = list(driven_steps(env, policy, wait + 1500, shown, vary=vary))
    errors = [np.linalg.norm(after["tip_position"] - seen["reference"]) for seen, *_, after in run]
    return np.array(errors), {state.status for _, _, state, _ in run}


@pytest.mark.parametrize(
    ("limit", "far", "reason"),
    [(20.0, (0.24, 0.30), "tension limit reached"), (80.0, (0.0, 0.60), "reference out of reach")],
)
def test_integral_does_not_wind_up(limit, far, reason):
    """A reference that cannot be reached; the way back is as if nobody had waited there."""
    back = []
    for wait in (1500, 4000):
        errors, statuses = waited(limit, np.array(far), np.array([0.2, 0.44]), wait)
        assert reason in statuses
        back.append(errors[wait:])
    assert back[1][-1] < 1e-3
    np.testing.assert_allclose(back[1], back[0], atol=2e-3)


def test_saturation_does_not_wind_up_the_integral():
    """A reference within reach of the arm that the law knows; the real one is half as stiff again.

    The error stays for as long as the wait lasts, and afterwards the arm comes back as usual.
    """
    far, near = STATICS.tip(np.full(3, 16.0)), STATICS.tip(np.full(3, 6.0))
    errors, statuses = waited(20.0, far, near, 4000, youngs_modulus=1.5)
    assert errors[3999] > 0.02
    assert "tension limit reached" in statuses and "reference out of reach" not in statuses
    assert errors[4999] < 3e-3
