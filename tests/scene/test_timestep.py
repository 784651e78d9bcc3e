"""The timestep rule against the chain it is made for."""

from dataclasses import replace
from math import pi

import mujoco
import numpy as np
import pytest
from support.postures import driving_force

from softrobot_env.robots import ARM, CANTILEVER_STIFF, CANTILEVER_WEAK, RobotParams
from softrobot_env.scene.build import build_scene
from softrobot_env.scene.config import SceneConfig
from softrobot_env.scene.objects import Contacts, Sphere
from softrobot_env.scene.timestep import (
    ACCURACY,
    FRICTION_STEP,
    SAFETY,
    SAFETY_IMPLICIT,
    LinearChain,
    TimestepWarning,
    choose_timestep,
    linearize,
    stability_limit,
)

#: One millimetre of steel wire.
WIRE = RobotParams("wire", 0.5, 0.5e-3, 0.0, 2e11, 7800.0, 0.0, 6)
INTEGRATORS = ["implicitfast", "Euler", "implicit", "RK4"]


def chain(damping_time, integrator, timestep, pieces=3):
    """Weightless chain of balanced2 pieces; its model's timestep is set afterwards."""
    robot = replace(ARM, tendons=(), damping_time=damping_time)
    config = SceneConfig(robot, pieces=pieces, timestep=1e-6, integrator=integrator)
    model = build_scene(config).model
    model.opt.timestep = timestep
    return model


def modes(frequencies, damping_time):
    """Independent modes with stiffness-proportional damping."""
    square = np.diag(np.square(frequencies))
    return LinearChain(np.eye(len(frequencies)), square, damping_time * square)


def growth(model, steps=600):
    """Largest growth of a tiny random displacement of the straight chain."""
    data = mujoco.MjData(model)
    start = 1e-9 * np.random.default_rng(1).standard_normal(model.nq)
    data.qpos[:] = start
    largest = 1.0
    for _ in range(steps):
        mujoco.mj_step(model, data)
        largest = max(largest, np.max(np.abs(data.qpos)) / np.max(np.abs(start)))
        if largest > 1e4:
            break
    return largest


@pytest.mark.parametrize("integrator", INTEGRATORS)
@pytest.mark.parametrize("damping_time", [0.0, 2e-4, 1e-3, 0.05])
def test_chain_grows_beyond_the_stability_limit_and_not_below(integrator, damping_time):
    limit = stability_limit(integrator, linearize(chain(damping_time, integrator, 1e-6)))
    # Below the limit a mode may swing up to 1 / sqrt(1 - 0.9^2) = 2.3 times its start.
    assert growth(chain(damping_time, integrator, 0.9 * limit)) < 10
    assert growth(chain(damping_time, integrator, 1.1 * limit)) > 1e4


def test_limits_of_single_modes_are_the_textbooks():
    # Semi-implicit Euler: h omega < 2. RK4: sqrt(8) on the imaginary axis (the limit is found on
    # a grid of 1e-3), 2.785 on the real one.
    undamped = modes([3.0, 50.0], 0.0)
    assert stability_limit("implicitfast", undamped) == pytest.approx(2 / 50)
    assert stability_limit("RK4", undamped) * 50 == pytest.approx(8**0.5, abs=1.1e-3)
    fast_root = 1e3 * 50.0**2  # of an over-damped mode, close to mu omega^2
    limit = stability_limit("RK4", modes([3.0, 50.0], 1e3))
    assert limit * fast_root == pytest.approx(2.785, abs=2e-3)


def length_driven(damping_time, stiffness, **options):
    """The arm on elastic tendons whose drives stand still."""
    tendons = tuple(replace(t, stiffness=stiffness, pretension=1.0) for t in ARM.tendons)
    robot = replace(ARM, damping_time=damping_time, tendons=tendons)
    return build_scene(SceneConfig(robot, actuation="length", **options))


def test_linear_stiffness_contains_the_length_drives():
    """The linearised force of a displaced chain, by differences of MuJoCo's own forces."""
    model = length_driven(0.05, 2e4).model
    displaced = 1e-7 * np.random.default_rng(0).standard_normal(model.nq)
    found = driving_force(model, displaced) - driving_force(model, 0 * displaced)
    expected = -linearize(model).stiffness @ displaced
    np.testing.assert_allclose(found, expected, atol=1e-6 * np.max(np.abs(expected)))


@pytest.mark.parametrize("robot", [ARM, CANTILEVER_WEAK, CANTILEVER_STIFF], ids=lambda r: r.name)
@pytest.mark.parametrize("pieces", [3, 12])
@pytest.mark.parametrize("control_period", [0.1, 0.007, 1e-4])
@pytest.mark.parametrize("damping_time", [0.0, 1e-3, 0.05])
def test_rule_divides_the_control_period_within_its_bounds(
    robot, pieces, control_period, damping_time
):
    robot = replace(robot, damping_time=damping_time)
    choice = choose_timestep(
        linearize(build_scene(SceneConfig(robot, pieces)).model), control_period
    )
    assert choice.timestep * choice.substeps == pytest.approx(control_period, rel=1e-12)
    bounds = (control_period, ACCURACY * choice.first_period, SAFETY * choice.stability_limit)
    assert choice.timestep <= min(bounds) * (1 + 1e-9)
    # One step fewer would break a bound: the step is the largest divisor.
    if choice.substeps > 1:
        assert control_period / (choice.substeps - 1) > min(bounds) * (1 - 1e-6)


@pytest.mark.parametrize("robot", [ARM, CANTILEVER_WEAK, CANTILEVER_STIFF], ids=lambda r: r.name)
def test_rule_keeps_its_promise_on_the_first_modes_phase(robot):
    """Its steps change the first period by less than pi ACCURACY, as the module says."""
    linear = linearize(build_scene(SceneConfig(robot)).model)
    choice = choose_timestep(linear, 0.01)
    w, mu, h = linear.frequencies()[0], robot.damping_time, choice.timestep
    # Linear map of implicitfast on the mode, from the state (q, v).
    speed = np.array([-h * w**2, 1.0]) / (1 + h * mu * w**2)
    step = np.array([[1 + h * speed[0], h * speed[1]], speed])
    angle = np.max(np.angle(np.linalg.eigvals(step)))
    true_angle = h * w * np.sqrt(1 - (mu * w / 2) ** 2)
    assert angle == pytest.approx(true_angle, rel=pi * ACCURACY)


@pytest.mark.parametrize(
    ("asked", "substeps"), [(0.01, 1), (0.5, 1), (0.004, 3), (0.005, 2), (1e-3, 10)]
)
def test_asked_timestep_is_rounded_down_to_a_divisor(asked, substeps):
    choice = choose_timestep(modes([5.0, 50.0], 0.05), 0.01, timestep=asked)
    assert choice.substeps == substeps
    assert choice.timestep == pytest.approx(0.01 / substeps)
    assert "was asked for" in choice.reason


@pytest.mark.parametrize("friction", [False, True])
def test_undamped_robot_driven_by_length_gets_rk4(friction):
    chain = linearize(length_driven(0.0, 1e4).model)
    choice = choose_timestep(chain, 0.02, friction=friction)
    assert choice.integrator == "RK4" and choice.timestep < choice.stability_limit
    damped = linearize(length_driven(0.05, 1e4).model)
    assert choose_timestep(damped, 0.02).integrator == "implicitfast"


def test_rubbing_tendons_bound_the_timestep():
    """A slow robot could take 10 ms, but friction must not turn soft."""
    slow = modes([1.0, 10.0], 0.05)
    assert choose_timestep(slow, 0.01).timestep == 0.01
    rubbing = choose_timestep(slow, 0.01, friction=True)
    assert rubbing.integrator == "discrete" and rubbing.timestep == FRICTION_STEP == 2e-3


def test_implicit_keeps_a_larger_distance_from_the_limit():
    stiff = modes([3.0, 1000.0], 0.0)  # semi-implicit Euler is stable below 2 / 1000 s
    for integrator, share in (("implicitfast", SAFETY), ("implicit", SAFETY_IMPLICIT)):
        choice = choose_timestep(stiff, 0.02, integrator=integrator)
        assert choice.timestep == pytest.approx(share * 2e-3, rel=1e-6)
        assert f"{share:g} times the stability limit" in choice.reason
    assert SAFETY_IMPLICIT < SAFETY


def test_extremely_stiff_undamped_robot_gets_discrete_and_a_warning():
    """Steel wire on 48 hinges: the fastest mode is thousands of times the first."""
    scene = build_scene(SceneConfig(WIRE, pieces=24))
    with pytest.warns(TimestepWarning, match="using discrete, which damps fast modes"):
        choice = choose_timestep(linearize(scene.model), 0.01)
    assert choice.integrator == "discrete"
    assert choice.stability_limit == np.inf
    assert scene.model.opt.integrator == mujoco.mjtIntegrator.mjINT_DISCRETE
    model, data = scene.model, mujoco.MjData(scene.model)
    data.qpos[:] = 0.02
    mujoco.mj_step(model, data, 2000)
    # An equilibrium at zero is approached, by numerical damping; nothing blows up.
    assert np.max(np.abs(data.qpos)) < 0.05
    # At this timestep implicitfast does.
    model.opt.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    assert growth(model) > 1e4


def test_short_links_shorten_the_timestep_with_contacts():
    """Links are what is light: twice as many quarter it, whatever the pieces they make."""
    far = (Sphere(name="far", radius=0.01, position=(9.0, 0.0, 0.0)),)

    def step(pieces, rule):
        config = SceneConfig(ARM, pieces=pieces, rule=rule, contacts=Contacts(), objects=far)
        return build_scene(config).timestep.timestep

    assert step(12, "balanced2") == pytest.approx(step(24, "midpoint"))
    assert step(24, "balanced2") == pytest.approx(step(24, "midpoint") / 4, rel=0.02)
