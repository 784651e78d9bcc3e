"""Static feedforward of any robot: it holds what it is asked for, and says where it cannot."""

from dataclasses import replace

import mujoco
import numpy as np
import pytest
from support.example_robots import SOME
from support.postures import rest_tip

from softrobot_env.control.base import REASONS, UNREACHABLE
from softrobot_env.control.registry import make_policy
from softrobot_env.envs.tracking import TrackingEnv
from softrobot_env.evaluation.run import run_episode
from softrobot_env.evaluation.runner import Case, run
from softrobot_env.robots import CANTILEVER_WEAK, RIG, find_robot
from softrobot_env.robots.actuation import robot_inputs
from softrobot_env.scene.build import build_scene
from softrobot_env.scene.registry import model_scene
from softrobot_env.scene.tangent import StaticForces
from softrobot_env.tasks import make_task
from softrobot_env.tasks.generic import GENERIC_TASKS, site_of
from softrobot_env.training.quasi_static import Learning, train


def asked(task, times):
    """Observations at times [s], with the start in force."""
    inputs = robot_inputs(task.robot)
    action = (np.array(task.start_input) - inputs.input_centre) / inputs.input_scale
    axes = ["xyz".index(name) for name in task.axes]
    points = task.trajectory.position(times)[:, axes]
    return [{"reference": point, "previous_action": action} for point in points]


@pytest.mark.parametrize("name", ["arm", "rig", *SOME])
def test_the_tip_comes_to_rest_on_the_reference(name):
    """In a scene of its own, after a motion along the reference."""
    robot = find_robot(name)
    task = make_task("circle", robot=robot)
    policy, state = make_policy("static", robot, 0.01), None
    observations = asked(task, np.linspace(0, task.duration / 2, 15))
    for observation in observations:
        action, state = policy.predict(observation, state)
        assert state.status is None
    inputs = robot_inputs(robot)
    tip = rest_tip(robot, inputs.input_centre + action * inputs.input_scale)
    axes = ["xyz".index(axis) for axis in task.axes]
    # Actions are single precision: 6e-8 of full scale.
    assert np.abs(tip[axes] - observations[-1]["reference"]).max() < 2e-5 * robot.reach


def test_a_height_of_its_own_is_met_where_inputs_are_left():
    """A trunk of two sections lifts its tip above where the least inputs hold it; a rod cannot."""
    for name, free in (("hanging_trunk", True), ("silicone_rod", False)):
        task = make_task("circle", robot=name)
        (observation,) = asked(task, np.zeros(1))
        policy = make_policy("static", task.robot, 0.01)
        _, state = policy.predict(observation)
        assert state.status is None
        lifted = observation | {"reference": observation["reference"] + [0.0, 0.0, 2e-3]}
        _, state = policy.predict(lifted, state)
        assert state.status == (None if free else REASONS[UNREACHABLE])


PERIOD = 0.01


@pytest.fixture(scope="module")
def trained(tmp_path_factory):
    """A small network of the rod, and its file."""
    robot = find_robot("silicone_rod")
    shown = []
    found = train(robot, show=lambda *row: shown.append(row), how=Learning(150, (12,), 40))
    path = tmp_path_factory.mktemp("networks") / "qs_nn.npz"
    found.network.save(path, found.about)
    return robot, found, path, shown


def test_it_knows_places_it_has_not_seen(trained):
    """Errors of the tip's place at rest, by the chain's own statics; it tells how far it is."""
    robot, found, _, shown = trained
    assert found.network.sizes == (2, 12, 3)
    assert np.median(found.errors) < 5e-3 * robot.length
    assert {row[0].split()[0] for row in shown} == {"inverse", "squared"}


def test_its_law_and_the_hybrid_begin_as_the_statics(trained):
    robot, _, path, _ = trained
    task = make_task("circle", robot=robot)
    point = task.trajectory.position(np.zeros(1))[0]
    seen = observed(point, np.zeros(3), np.zeros(3), robot)
    static, _ = make_policy("static", robot, PERIOD).predict(seen)
    for name, option in (("qs_nn", "weights"), ("hybrid", "identified")):
        policy = make_policy(name, robot, PERIOD, **{option: path})
        action, state = policy.predict(seen)
        assert np.abs(action - static).max() < 0.05 and state.status is None
        far = seen | {"reference": point + np.array([0.5, 0.0, 0.0])}
        _, state = policy.predict(far, state)
        assert state.status in ("outside the trained workspace", "reference out of reach")


def test_other_robots_are_told_how_to_train(trained):
    _, _, path, _ = trained
    finger = find_robot("planar_finger")
    for name, option in (("qs_nn", "weights"), ("hybrid", "identified")):
        command = "softrobot train qs_nn --robot .*planar_finger"
        with pytest.raises(ValueError, match=command):
            make_policy(name, finger, PERIOD)
        with pytest.raises(ValueError, match=command):
            make_policy(name, finger, PERIOD, **{option: path})


def lap(name, share, path="circle"):
    """A path whose base frequency is a share of the first mode's, its rest cut short."""
    robot = find_robot(name)
    make = GENERIC_TASKS.find(path)
    speed = 2 * np.pi * share / site_of(robot).period * make(robot).trajectory.curve.top_rate
    task = make(robot, speed=speed)
    return replace(task, duration=round(task.duration - 1.0 + PERIOD, 2))


def errors_of(task, *names):
    """Mean error [m] of policies on a task."""
    env = TrackingEnv(task, observe="all", control_period=PERIOD)
    runs = [run_episode(env, make_policy(name, task.robot, PERIOD), seed=0) for name in names]
    return [run.error.mean() for run in runs]


@pytest.mark.parametrize("name", ["arm", *SOME])
def test_the_force_of_a_motion_is_that_of_mujocos_inverse_dynamics(name):
    """With and without the motion, in a random posture."""
    model = build_scene(model_scene(find_robot(name))).model
    rng, data, found = np.random.default_rng(0), mujoco.MjData(model), []
    data.qpos[:] = model.qpos0
    mujoco.mj_integratePos(model, data.qpos, 0.1 * rng.standard_normal(model.nv), 1.0)
    rate, change = rng.standard_normal((2, model.nv))
    forces = StaticForces(model)
    own = forces.of_motion(data.qpos.copy(), rate, change)
    for share in (1.0, 0.0):
        data.qvel[:], data.qacc[:] = share * rate, share * change
        mujoco.mj_inverse(model, data)
        found.append(data.qfrc_inverse.copy())
    np.testing.assert_allclose(own, found[0] - found[1], atol=1e-9 * np.abs(own).max())
    # What is at rest is as if nothing had moved.
    at_rest = forces.force(model.qpos0, np.zeros(model.nu)).copy()
    fresh = StaticForces(model).force(model.qpos0, np.zeros(model.nu))
    np.testing.assert_array_equal(at_rest, fresh)


#: Planar robots are driven faster than spatial ones and those wound up by servos.
SPEEDS = {"planar_finger": 0.3, "arm": 0.3, "rig": 0.1, "silicone_rod": 0.1, "hanging_trunk": 0.1}


@pytest.mark.parametrize(
    "name", ["planar_finger", *(pytest.param(n, marks=pytest.mark.slow) for n in [*SPEEDS][1:])]
)
def test_it_moves_the_tip_where_statics_lag_behind(name):
    """At a share of the first frequency: a tenth of the quasi-static error at most."""
    static, dynamic = errors_of(lap(name, SPEEDS[name]), "static", "chain_dynamics")
    assert dynamic < 0.1 * static


@pytest.mark.parametrize("stiffness", [0.75, pytest.param(1.25, marks=pytest.mark.slow)])
def test_feedback_learns_another_stiffness(stiffness):
    """A hundredth of the error is left in the second lap."""
    task, scene = lap("planar_finger", 0.1), {"control_period": PERIOD}
    wrong, learned = (
        run(Case(task, name, {"youngs_modulus": stiffness}, scene=scene)).rollout
        for name in ("chain_dynamics", "chain_dynamics_pi")
    )
    half = len(wrong.error) // 2
    assert learned.error[half:].mean() < 0.01 * wrong.error[half:].mean()


def observed(point, velocity, acceleration, robot):
    """An observation of a reference."""
    return {
        "reference": np.array(point),
        "reference_velocity": np.array(velocity),
        "reference_acceleration": np.array(acceleration),
        "previous_action": np.zeros(len(robot.tendons) if robot.drive.kind == "length" else 2),
    }


def test_at_rest_it_is_the_statics():
    task = GENERIC_TASKS.find("circle")(find_robot("planar_finger"))
    point = task.trajectory.position(np.zeros(1))[0, [0, 2]]
    seen = observed(point, np.zeros(2), np.zeros(2), task.robot)
    actions = [
        make_policy(name, task.robot, PERIOD).predict(seen)[0]
        for name in ("static", "chain_dynamics", "inverse_dynamics")
    ]
    np.testing.assert_array_equal(actions[0], actions[1])
    np.testing.assert_array_equal(actions[1], actions[2])


def test_it_says_where_servos_are_too_slow_or_the_reference_too_fast():
    task = lap("silicone_rod", 0.5)
    policy, state, said = make_policy("inverse_dynamics", task.robot, PERIOD), None, set()
    times = np.arange(0.0, 0.5, PERIOD)
    moves = (task.trajectory.position, task.trajectory.velocity, task.trajectory.acceleration)
    for row in zip(*(move(times) for move in moves), strict=True):
        action, state = policy.predict(observed(*row, task.robot), state)
        assert np.isfinite(action).all()
        said.add(state.status)
    # 42 mm at 3.8 Hz is 1 m/s of the tip, and 0.1 m/s of the tendons is all that they can do.
    assert "servo too slow" in said
    policy, state, said = make_policy("inverse_dynamics", task.robot, PERIOD), None, set()
    for k in range(40):  # 20 Hz, four times the first frequency
        turn = 2 * np.pi * 20.0 * k * PERIOD
        wave = 0.02 * np.array([np.sin(turn), 40 * np.pi * np.cos(turn), -1.58e4 * np.sin(turn)])
        point = task.trajectory.position(np.zeros(1))[0] + [0.0, wave[0] - 0.02, 0.0]
        seen = observed(point, [0, wave[1], 0], [0, wave[2], 0], task.robot)
        _, state = policy.predict(seen, state)
        said.add(state.status)
    assert said & {"reference too fast for the internal dynamics", "tension limit reached"}


@pytest.mark.parametrize(
    "name", ["static", "feedforward_pi", "chain_dynamics", "chain_dynamics_pi", "inverse_dynamics"]
)
def test_a_robot_without_tendons_is_refused_by_name(name):
    with pytest.raises(ValueError, match=r"'cantilever_weak' has no tendons"):
        make_policy(name, CANTILEVER_WEAK, PERIOD)


def test_the_rig_keeps_the_law_of_the_thesis():
    assert type(make_policy("inverse_dynamics", RIG, PERIOD)).__name__ == "RigFeedforward"
    with pytest.raises(ValueError, match="needs a head and three elastic tendons"):
        make_policy("hybrid_flexible", find_robot("planar_finger"), PERIOD)
