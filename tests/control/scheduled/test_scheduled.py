"""Laws of any robot on tables of operating points, against its chain at rest and in motion."""

import numpy as np
import pytest
import scipy.linalg

from softrobot_env.control.observers import OutputFeedback
from softrobot_env.control.registry import make_policy, policy_environment
from softrobot_env.control.scheduled.law import build_table
from softrobot_env.control.scheduled.lq_preview import LQPreview, Preview
from softrobot_env.control.scheduled.lqi import LQI, Integral
from softrobot_env.control.scheduled.operating_points import find_points
from softrobot_env.control.scheduled.policies import save_table
from softrobot_env.control.scheduled.table import look_up
from softrobot_env.control.scheduled.timing import timing_of
from softrobot_env.envs.tracking import TrackingEnv
from softrobot_env.robots import find_robot
from softrobot_env.robots.actuation import robot_inputs
from softrobot_env.robots.artifacts import artifact_name
from softrobot_env.robots.file import read_robot, write_robot
from softrobot_env.scene.build import build_scene
from softrobot_env.scene.inverse import workspace_of
from softrobot_env.scene.linearised import Linearizer
from softrobot_env.scene.registry import scene_of
from softrobot_env.tasks.generic import generic_tasks

FINGER, ROD = find_robot("planar_finger"), find_robot("silicone_rod")


@pytest.fixture(scope="module")
def points():
    return find_points(FINGER, most=30, candidates=100)


@pytest.fixture(scope="module")
def table(points):
    return build_table(FINGER, Preview(FINGER), points)


@pytest.fixture(scope="module")
def rod_table():
    return build_table(ROD, Preview(ROD), find_points(ROD, most=25, candidates=80))


def environment(robot, task="circle", **options):
    """Of a task for a robot, with what laws of it read."""
    times = timing_of(robot)
    task = generic_tasks(robot)[task](**options)
    return TrackingEnv(task, observe="all", control_period=times.period, preview=times.knots)


def driven(policy, robot, task="circle", steps=None, vary=None, **options):
    """Observation before, action, state and observation after each step of an episode."""
    with environment(robot, task, **options) as env:
        observation, _ = env.reset(seed=0, options={"vary": vary or {}})
        state, over, count = None, False, 0
        while not over and count != steps:
            before = observation
            action, state = policy.predict(observation, state)
            observation, _, failed, over, info = env.step(action)
            assert not failed, info["failure"]
            count += 1
            yield before, action, state, observation


def mean_error(policy, robot, vary=None):
    """[m] on a circle, after the first fifth."""
    errors = [
        float(np.linalg.norm(after["tip_position"] - after["reference"]))
        for *_, after in driven(policy, robot, vary=vary)
    ]
    return np.mean(errors[len(errors) // 5 :])


# --- the linear model -----------------------------------------------------------------------------


@pytest.mark.parametrize("robot", [FINGER, ROD, find_robot("hanging_trunk")], ids=lambda r: r.name)
def test_the_model_at_rest_is_the_chains(robot):
    scene = build_scene(scene_of(robot))
    linearizer, space = Linearizer(scene), workspace_of(robot)
    inputs = space.ground.inputs
    angles = space.inverse.posture(inputs)
    model = linearizer.about(angles, inputs)
    slope = np.linalg.solve(model.stiffness, model.inputs)
    step, scale = 1e-3, robot_inputs(robot).input_scale
    for j in range(len(inputs)):
        push = step * scale * np.eye(len(inputs))[j]
        ends = [space.inverse.posture(inputs + sign * push, angles) for sign in (1, -1)]
        bend = linearizer.mean @ (ends[0] - ends[1]) / (2 * step)
        # The commands have kinks where another tendon begins to pull: both sides count alike.
        assert np.linalg.norm(slope[:, j] - bend) < 0.01 * np.linalg.norm(bend)


def test_its_first_mode_is_the_chains():
    scene = build_scene(scene_of(FINGER))
    linearizer = Linearizer(scene)
    rest = scene.equilibrium(np.zeros(scene.model.nu))
    model = linearizer.about(rest, np.zeros(robot_inputs(FINGER).n_inputs))
    slowest = np.sqrt(scipy.linalg.eigh(model.stiffness, model.mass, eigvals_only=True)[0])
    assert 2 * np.pi / slowest == pytest.approx(timing_of(FINGER).first, rel=0.01)


# --- the table ------------------------------------------------------------------------------------


def test_errors_fall_with_the_number_of_points(points):
    assert points.errors[-1] < 0.1 * points.errors[4]


def test_between_points_the_tip_is_where_it_shall_be(table):
    """Places that no point is at: the equilibrium under the blended actions holds the tip there."""
    space = workspace_of(FINGER)
    ground, inputs = space.ground, robot_inputs(FINGER)
    middle = (ground.inputs - inputs.input_centre) / inputs.input_scale
    rng = np.random.default_rng(1)
    for way in rng.uniform(-0.7, 0.7, size=(5, 2)) * [ground.length, ground.radius]:
        place = ground.middle + way @ ground.axes
        found = look_up(table, place, middle)
        angles = space.inverse.posture(inputs.input_centre + found.action * inputs.input_scale)
        tip = space.scene.tip(angles)
        assert np.linalg.norm(tip - place) < 5e-3 * FINGER.reach


# --- closed loops ---------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "modulus", [1.0, *(pytest.param(m, marks=pytest.mark.slow) for m in (0.75, 1.25))]
)
def test_the_tip_follows_a_circle(table, modulus):
    policy = LQPreview(FINGER, timing_of(FINGER).period, table)
    error = mean_error(policy, FINGER, vary={"youngs_modulus": modulus})
    assert error < 1e-3 * FINGER.reach


@pytest.mark.parametrize("modulus", [0.75, 1.25])
def test_an_adaptive_law_finds_the_stiffness(table, modulus):
    policy = LQPreview(FINGER, timing_of(FINGER).period, table, adaptive=True)
    steps = driven(policy, FINGER, "figure_eight", 1200, {"youngs_modulus": modulus})
    *_, (_, _, state, _) = steps
    assert policy.stiffness(state) == pytest.approx(modulus, abs=0.15 * abs(modulus - 1))


def test_an_observer_takes_the_place_of_rates(table):
    period = timing_of(FINGER).period
    policy = LQPreview(FINGER, period, table)
    error = mean_error(OutputFeedback(policy, FINGER, period), FINGER)
    assert error < 1.5 * mean_error(policy, FINGER)


def test_lqi_has_no_offset(points):
    policy = LQI(FINGER, timing_of(FINGER).period, build_table(FINGER, Integral(FINGER), points))
    assert mean_error(policy, FINGER, vary={"youngs_modulus": 0.75}) < 2e-3 * FINGER.reach


def test_servos_are_not_asked_for_more_than_their_speed(rod_table):
    """Far off the reference, every command is one that the servos reach in its period."""
    timing, scale = timing_of(ROD), robot_inputs(ROD).input_scale
    policy, said = LQPreview(ROD, timing.period, rod_table), set()
    for before, action, state, _ in driven(policy, ROD, "reach", 300, hold=0.2):
        way = np.abs(action * scale - before["tendon_length"])
        assert np.all(way <= ROD.drive.speed * timing.period * (1 + 1e-5) + 1e-8)
        said.add(state.status)
    assert len(said) > 1  # it was too far for them, and the law said so


def test_tendons_stay_taut(rod_table):
    policy = LQPreview(ROD, timing_of(ROD).period, rod_table)
    for *_, after in driven(policy, ROD, steps=600):
        assert after["tendon_tension"].min() > 0


# --- files and refusals ---------------------------------------------------------------------------


def test_a_file_beside_the_robots_is_found(points, table, tmp_path):
    write_robot(FINGER, tmp_path / "mine.toml")
    robot = read_robot(tmp_path / "mine.toml")
    with pytest.raises(ValueError, match=r"softrobot train lq_preview --robot .*mine\.toml"):
        make_policy("lq_preview", robot, 1e-3)
    path = tmp_path / artifact_name(robot, "lq_preview")
    save_table(path, table, robot, points.errors)
    period = policy_environment("lq_preview", robot)["control_period"]
    policy = make_policy("lq_preview", robot, period)
    assert mean_error(policy, FINGER) < 1e-3 * FINGER.reach
    write_robot(FINGER.vary(density=1.5), tmp_path / "mine.toml")
    other = read_robot(tmp_path / "mine.toml")
    with pytest.raises(ValueError, match=r"softrobot train lq_preview"):
        make_policy("lq_preview", other, period)


def test_too_few_previews_are_refused(table):
    timing = timing_of(FINGER)
    policy = LQPreview(FINGER, timing.period, table)
    with TrackingEnv(
        generic_tasks(FINGER)["circle"](), observe="all", control_period=timing.period
    ) as env:
        observation, _ = env.reset(seed=0)
        with pytest.raises(ValueError, match="needs an environment with preview="):
            policy.predict(observation)


def test_values_that_are_not_finite_keep_the_action(table):
    policy = LQPreview(FINGER, timing_of(FINGER).period, table)
    with environment(FINGER) as env:
        observation, _ = env.reset(seed=0)
    _, state = policy.predict(observation)
    bad = observation | {"curvature": observation["curvature"] * np.nan}
    action, state = policy.predict(bad, state)
    np.testing.assert_allclose(action, observation["previous_action"], atol=1e-6)
    assert state.status == "observation not finite"
    action, state = policy.predict(observation, state)
    assert state.status is None and np.isfinite(action).all()
