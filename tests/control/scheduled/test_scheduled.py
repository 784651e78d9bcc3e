"""Laws of any robot on tables of operating points, against its chain at rest and in motion."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import lsq_linear
from support.derivatives import differences
from support.driven import driven_steps

import softrobot_env  # noqa: F401  (registers the environments)
from softrobot_env.control.linear_quadratic import BoundedSolver
from softrobot_env.control.observers import OutputFeedback
from softrobot_env.control.registry import make_policy, policy_environment
from softrobot_env.control.scheduled.law import build_table, save_table
from softrobot_env.control.scheduled.lq_preview import LQPreview, Preview
from softrobot_env.control.scheduled.lqi import LQI, Integral
from softrobot_env.control.scheduled.mpc import (
    PREVIEW,
    THESIS,
    Constrained,
    ScheduledMPC,
    WithoutPreview,
)
from softrobot_env.control.scheduled.operating_points import BeamLinearizer, find_points
from softrobot_env.control.scheduled.plan_gains import deviation_cost, plan_gains, regulator_of
from softrobot_env.control.scheduled.table import look_up, row_size
from softrobot_env.control.scheduled.timing import Timing, timing_of
from softrobot_env.envs.tracking import TrackingEnv
from softrobot_env.evaluation.runner import Case, run
from softrobot_env.robots import ARM, find_robot
from softrobot_env.robots.actuation import robot_inputs
from softrobot_env.robots.artifacts import artifact_name
from softrobot_env.robots.file import read_robot, write_robot
from softrobot_env.scene.build import build_scene
from softrobot_env.scene.inverse import workspace_of
from softrobot_env.scene.linearised import Linearizer
from softrobot_env.scene.registry import scene_of
from softrobot_env.tasks.generic import generic_tasks

FINGER, ROD = find_robot("planar_finger"), find_robot("silicone_rod")
TIMING = timing_of(ROD)


@pytest.fixture(scope="module")
def points():
    return find_points(FINGER, most=30, candidates=100)


@pytest.fixture(scope="module")
def table(points):
    return build_table(FINGER, Preview(FINGER), points)


@pytest.fixture(scope="module")
def rod_points():
    return find_points(ROD, most=25, candidates=80)


@pytest.fixture(scope="module")
def rod_table(rod_points):
    return build_table(ROD, Preview(ROD), rod_points)


def environment(robot, task="circle", preview=None, **options):
    """Of a task for a robot, with what laws of it read."""
    times = timing_of(robot)
    task = generic_tasks(robot)[task](**options)
    return TrackingEnv(
        task, observe="all", control_period=times.period, preview=preview or times.knots
    )


def driven(policy, robot, task="circle", count=None, vary=None, **options):
    """Observation before, action, state and observation after each step of an episode."""
    with environment(robot, task, **options) as env:
        yield from driven_steps(env, policy, count, vary=vary or {})


def mean_error(policy, robot, vary=None, **options):
    """[m] on a circle, after the first fifth."""
    errors = [
        float(np.linalg.norm(after["tip_position"] - after["reference"]))
        for *_, after in driven(policy, robot, vary=vary, **options)
    ]
    return np.mean(errors[len(errors) // 5 :])


def first_frequency(model):
    """[rad/s]."""
    return np.sqrt(np.linalg.eigvals(np.linalg.solve(model.mass, model.stiffness)).real.min())


# --- the linear model -----------------------------------------------------------------------------


@pytest.mark.parametrize("robot", [FINGER, ROD, find_robot("hanging_trunk")], ids=lambda r: r.name)
def test_the_model_at_rest_is_the_chains(robot):
    scene = build_scene(scene_of(robot))
    linearizer, space = Linearizer(scene), workspace_of(robot)
    inputs = space.ground.inputs
    angles = space.inverse.posture(inputs)
    model = linearizer.about(angles, inputs)
    slope = np.linalg.solve(model.stiffness, model.inputs)
    scale = robot_inputs(robot).input_scale
    # The commands have kinks where another tendon begins to pull: both sides count alike.
    moved = differences(
        lambda x: space.inverse.posture(inputs + x * scale, angles), 0 * scale, 1e-3
    )
    bend = linearizer.mean @ moved
    assert np.all(np.linalg.norm(slope - bend, axis=0) < 0.01 * np.linalg.norm(bend, axis=0))


def test_its_first_mode_is_the_chains():
    scene = build_scene(scene_of(FINGER))
    linearizer = Linearizer(scene)
    rest = scene.equilibrium(np.zeros(scene.model.nu))
    model = linearizer.about(rest, np.zeros(robot_inputs(FINGER).n_inputs))
    assert 2 * np.pi / first_frequency(model) == pytest.approx(timing_of(FINGER).first, rel=0.01)


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
    run = driven(policy, FINGER, "figure_eight", 1200, {"youngs_modulus": modulus})
    *_, (_, _, state, _) = run
    assert policy.stiffness(state) == pytest.approx(modulus, abs=0.15 * abs(modulus - 1))


def test_an_observer_takes_the_place_of_rates(table):
    period = timing_of(FINGER).period
    policy = LQPreview(FINGER, period, table)
    error = mean_error(OutputFeedback(policy, FINGER, period), FINGER)
    assert error < 1.5 * mean_error(policy, FINGER)


def test_lqi_has_no_offset(points):
    policy = LQI(FINGER, timing_of(FINGER).period, build_table(FINGER, Integral(FINGER), points))
    assert mean_error(policy, FINGER, vary={"youngs_modulus": 0.75}) < 2e-3 * FINGER.reach


@pytest.mark.parametrize("kind", ["lq_preview", "mpc"])
def test_servos_are_not_asked_for_more_than_their_speed(kind, rod_table, law):
    """Far off the reference, every command is one that the servos reach in its period."""
    scale, said = robot_inputs(ROD).input_scale, set()
    policy = law if kind == "mpc" else LQPreview(ROD, TIMING.period, rod_table)
    preview = law._law.times[1:].tolist() if kind == "mpc" else None
    for before, action, state, _ in driven(policy, ROD, "reach", 300, hold=0.2, preview=preview):
        way = np.abs(action * scale - before["tendon_length"])
        assert np.all(way <= ROD.drive.speed * TIMING.period * (1 + 1e-5) + 1e-8)
        said.add(state.status)
    assert len(said) > 1  # it was too far for them, and the law said so


@pytest.mark.parametrize("kind", ["lq_preview", "mpc"])
def test_servos_are_not_asked_for_more_than_their_force(kind, rod_table, law):
    """A plan keeps within what the servos have where it can; a law without one says so."""
    weak = replace(ROD, drive=replace(ROD.drive, gain=2e4, velocity_gain=200.0, force_limit=1.0))
    made = ScheduledMPC if kind == "mpc" else LQPreview
    gains = law._law.table if kind == "mpc" else rod_table
    policy, count, said = made(weak, TIMING.period, gains), 0, set()
    preview = policy._law.times[1:].tolist() if kind == "mpc" else None
    for before, action, state, _ in driven(policy, weak, count=200, preview=preview):
        stretch = policy._law.stiffness * action
        pull = stretch - policy._law.table.moment_arms @ before["curvature"]
        slow = np.abs(action - before["tendon_length"] / robot_inputs(ROD).input_scale)
        within = (slow < policy._law.speed * (1 - 1e-6)) | (kind != "mpc")
        count += int(np.any(within & (pull > 1.0 - 0.5 + 1e-6)))
        said.add(state.status)
    assert "tension limit reached" in said
    assert count == 0 if kind == "mpc" else count > 0


def test_tendons_stay_taut(rod_table):
    policy = LQPreview(ROD, timing_of(ROD).period, rod_table)
    for *_, after in driven(policy, ROD, count=600):
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


# --- plans within limits --------------------------------------------------------------------------


@pytest.fixture(scope="module")
def law(rod_points):
    table = build_table(ROD, Constrained(ROD), rod_points)
    return ScheduledMPC(ROD, TIMING.period, table)


def still(law, **changed):
    """At rest at the first operating point, with the reference there."""
    table = law._law.table
    row, tip, m = table.rows[0], table.tips[0], table.m
    seen = {
        "curvature": row[m : m + table.n],
        "curvature_rate": np.zeros(table.n),
        "tip_position": tip,
        "reference": tip,
        "reference_preview": np.tile(tip, len(law._law.times) - 1),
        "previous_action": row[:m],
        "tendon_length": row[:m] * law._own.input_scale,
    }
    return seen | changed


# ---------------------------------------------------------------- gains


def rolled(regulator, start, places, rates):
    """Least inputs (count, m) from a state for outputs (count, d) and their rates, all at once."""
    (states, order), count = regulator.b.shape, len(places)
    by_input, free = np.zeros((states, count * order)), start.copy()
    hessian, gradient = np.kron(np.eye(count), regulator.change), np.zeros(count * order)
    for k in range(count):
        by_input = regulator.a @ by_input
        by_input[:, k * order : (k + 1) * order] += regulator.b
        free = regulator.a @ free
        wanted = regulator.position.T @ places[k]
        wanted += regulator.velocity_weight * regulator.speed.T @ rates[k]
        hessian += by_input.T @ regulator.weight @ by_input
        gradient += by_input.T @ (regulator.weight @ free - wanted)
    return np.linalg.solve(hessian, -gradient).reshape(count, order)


def test_unbound_plan_is_the_dense_optimum_over_a_long_horizon(rod_points):
    """Two hundred steps by least squares, without Riccati's equation, from states at random."""
    h = TIMING.period
    timing = Timing(TIMING.first, h, (h, 4 * h, 12 * h), (h, 6 * h, 15 * h))
    point, directions = rod_points.points[3], rod_points.directions
    regulator = regulator_of(ROD, point, directions, timing)
    n, m, d = len(point.curvature), len(point.action), len(directions)
    rng = np.random.default_rng(0)
    start = 0.1 * rng.normal(size=2 * n + m)
    ways = np.cumsum(1e-3 * rng.normal(size=(3, d)), axis=0)
    knots, known = np.array([0.0, *timing.knots]), np.vstack([np.zeros((1, d)), ways])
    places = np.stack([np.interp(h * np.arange(201), knots, row) for row in known.T], axis=1)
    rates = np.gradient(places, h, axis=0)
    rates[12:] = 0.0  # it stays at the last knot
    inputs = rolled(regulator, start, places[1:], rates[1:])
    dense = start[-m:] + np.cumsum(inputs, axis=0)[[0, 5, 14]]
    gains = plan_gains(regulator, timing, directions)
    inner = 3 * m * (2 * n + m)
    feedback = gains[:inner].reshape(3 * m, -1) * np.concatenate([regulator.size, np.ones(m)])
    ahead = gains[inner:].reshape(3 * m, 9)
    planned = np.tile(start[-m:], 3) - feedback @ start + ahead @ (ways @ directions).ravel()
    np.testing.assert_allclose(planned.reshape(3, m), dense, atol=2e-3 * np.abs(dense).max())


def test_cost_of_deviations_is_what_they_cost_step_by_step(rod_points):
    """By running both plans for long, each with the best feedback after the last node."""
    timing = PREVIEW.timing(ROD)
    regulator = regulator_of(ROD, rod_points.points[1], rod_points.directions, timing)
    m, rng = regulator.b.shape[1], np.random.default_rng(1)
    hessian = deviation_cost(regulator, timing)
    off = rng.normal(size=(2, len(timing.nodes), m))
    start = 0.1 * rng.normal(size=len(regulator.a))
    costs = [_cost(regulator, timing, start, more) for more in (0 * off[0], *off)]
    one, two = (more.ravel() @ hessian @ more.ravel() for more in off)
    assert (costs[1] - costs[0]) / (costs[2] - costs[0]) == pytest.approx(one / two, rel=1e-5)


def _cost(regulator, timing, start, off):
    """Of the LQ plan from a state, plus deviations (c, m) of the actions at the nodes."""
    nodes = np.array([0.0, *timing.nodes])
    last, m = round(nodes[-1] / timing.period), off.shape[1]
    best, state, cost = start.copy(), start.copy(), 0.0
    for k in range(last + 3000):
        wanted = best[-m:] - regulator.feedback @ best
        best = regulator.a @ best - regulator.b @ regulator.feedback @ best
        if k < last:
            time = (k + 1) * timing.period
            more = [np.interp(time, nodes, [0.0, *column]) for column in off.T]
            change = wanted + more - state[-m:]
        else:
            change = -regulator.feedback @ state
        state = regulator.a @ state + regulator.b @ change
        cost += state @ regulator.weight @ state + change @ regulator.change @ change
    return cost


def test_gains_are_as_many_as_files_are_checked_for(law):
    table = law._law.table
    before = row_size(table.n, table.m, len(table.directions))
    assert table.rows.shape[1] == before + Constrained(ROD).count(table.n, table.m, 2)


# ---------------------------------------------------------------- programs


def test_bounded_solver_agrees_with_another():
    """Rows that are invertible make a problem with bounds alone, in other unknowns."""
    rng, low, high = np.random.default_rng(3), np.full(5, -0.2), np.full(5, 0.3)
    factor, rows = rng.normal(size=(8, 5)), rng.normal(size=(5, 5)) + 3 * np.eye(5)
    goal = 3 * rng.normal(size=8)
    hessian, gradient, solve = factor.T @ factor, -factor.T @ goal, BoundedSolver()
    expected = lsq_linear(factor, goal, (-0.2, 0.3), "bvls").x
    assert 0 < np.sum((low < expected) & (expected < high)) < 5
    np.testing.assert_allclose(solve(hessian, gradient, low, high), expected, atol=1e-9)
    assert solve(hessian, np.nan * gradient, low, high) is None
    back = np.linalg.inv(rows)
    expected = back @ lsq_linear(factor @ back, goal, (-0.2, 0.3), "bvls").x
    wide = np.full(5, 1e3)
    bounds = np.concatenate([-wide, low]), np.concatenate([wide, high])
    np.testing.assert_allclose(solve(hessian, gradient, *bounds, rows), expected, atol=1e-6)


@pytest.mark.slow
def test_circle_beyond_the_speed_of_servos_is_followed_better_than_by_lq(rod_table, law):
    rate = generic_tasks(ROD)["circle"]().trajectory.curve.top_rate
    fast = {"speed": rate * 2 * np.pi * 0.5 / TIMING.first}  # half the rate of the first mode
    lq = LQPreview(ROD, TIMING.period, rod_table)
    seen = law._law.times[1:].tolist()
    assert mean_error(law, ROD, preview=seen, **fast) < 0.5 * mean_error(lq, ROD, **fast)


def test_tensions_of_a_planar_arm_end_at_their_limits():
    pairs = [t for t in ARM.tendons if t.group < 2]
    pairs = tuple(replace(t, end=0.15 * (t.group + 1), tension_limit=15.0) for t in pairs)
    arm = replace(ARM, name="short", length=0.3, pieces=4, tendons=pairs)
    table = build_table(arm, Constrained(arm), find_points(arm, most=6, candidates=30))
    law = ScheduledMPC(arm, timing_of(arm).period, table)
    seen = still(law)
    flat = {name: seen[name][[0, 2]] for name in ("tip_position", "reference")}
    knots = len(law._law.times) - 1
    seen |= flat | {"reference_preview": np.tile(flat["reference"], knots)}
    action, state = law.predict(seen)
    np.testing.assert_allclose(action, seen["previous_action"], atol=2e-3)
    far = flat["reference"] + [0.1, 0.0]
    for _ in range(20):
        action, state = law.predict(
            seen | {"reference": far, "reference_preview": np.tile(far, knots)}, state
        )
    assert np.abs(action).max() == pytest.approx(1.0, abs=1e-6)
    assert state.status == "tension limit reached"


# ---------------------------------------------------------------- refusals


def test_thesis_settings_need_no_preview(rod_points):
    timing = THESIS.timing(ROD)
    table = build_table(ROD, Constrained(ROD, THESIS), rod_points)
    law = WithoutPreview(ROD, TIMING.period, table)
    assert law.hold == round(timing.period / TIMING.period) and not timing.knots
    assert "reference_preview" not in law.requires
    seen = still(law)
    action, _ = law.predict(seen)
    np.testing.assert_allclose(action, seen["previous_action"], atol=2e-3)


def test_other_previews_references_periods_and_plants_are_refused(law):
    with pytest.raises(ValueError, match="needs an environment with preview="):
        law.predict(still(law, reference_preview=np.zeros(6)))
    with pytest.raises(ValueError, match="of three coordinates"):
        law.predict(still(law, reference=np.zeros(1), tip_position=np.zeros(1)))
    with pytest.raises(ValueError, match=r"mpc_preview decides every 0\.001 s"):
        ScheduledMPC(ROD, 0.003, law._law.table)
    with pytest.raises(ValueError, match="one section"):
        find_points(FINGER, plant="ancf")


# --- points of beam models ------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("robot", "plant", "left"),
    [
        (FINGER, "pcc", (2e-3, 2e-3)),
        (ROD, "pcc", (2e-3, 2e-3)),
        # The tip also follows stretch, along the axis, and shapes within a piece, which curvatures
        # do not tell.
        pytest.param(ROD, "cosserat", (0.03, 0.12), marks=pytest.mark.slow),
        pytest.param(ARM, "ancf", (0.03, 0.12), marks=pytest.mark.slow),
    ],
    ids=lambda x: getattr(x, "name", x),
)
def test_shape_and_tip_follow_the_actions_as_equilibria_do(robot, plant, left):
    """Shapes by 2e-3, the error of the differences, and the tip but for what is left to it.

    `left` is a share of the largest motion, across the axis and along it.
    """
    beam, scale = BeamLinearizer(robot, plant), robot_inputs(robot).input_scale
    inputs = 0.2 * scale * np.array([1.0, -0.6, 0.4])[: len(scale)]
    inputs = robot_inputs(robot).input_centre + inputs
    *_, model = beam.rest(inputs)
    slope = np.linalg.solve(model.stiffness, model.inputs)
    bend, moved = (
        differences(lambda x, k=k: beam.rest(inputs + x * scale)[k], 0 * scale, 1e-3)
        for k in (1, 2)
    )
    np.testing.assert_allclose(slope, bend, atol=2e-3 * np.abs(bend).max())
    error = np.abs(model.tip @ slope - moved).max(1) / np.abs(moved).max()
    assert (error <= [left[0], left[0], left[1]]).all(), error


@pytest.mark.parametrize("robot", [FINGER, ROD], ids=lambda robot: robot.name)
def test_first_frequency_and_damping_are_about_those_of_the_chain(robot):
    """Pieces of constant curvature and hinges are different models of the same beam."""
    space = workspace_of(robot)
    inputs = space.ground.inputs
    chain = Linearizer(space.scene).about(space.inverse.posture(inputs), inputs)
    *_, beam = BeamLinearizer(robot, "pcc").rest(inputs)
    assert first_frequency(beam) == pytest.approx(first_frequency(chain), rel=0.05)
    ratios = [np.trace(m.damping) / np.trace(m.stiffness) for m in (beam, chain)]
    assert ratios[0] == pytest.approx(ratios[1], rel=0.05)
    # Springs twice as stiff: what the curvatures lose by it is the curvature itself, to first
    # order, where nothing but springs is stiff.
    shares = [np.linalg.norm(m.elastic) / np.trace(m.stiffness) for m in (beam, chain)]
    assert shares[0] == pytest.approx(shares[1], rel=0.05, abs=1e-6)


@pytest.mark.slow
def test_a_law_tuned_on_another_plant_tracks_about_as_well_on_either():
    """A tenth of what holding still errs, and within a third of the law that is at home."""
    timing, errors = timing_of(FINGER), {}
    times = {"control_period": timing.period, "preview": timing.knots}
    task = generic_tasks(FINGER)["circle"](frequency=0.3)
    for tuned in ("mujoco", "pcc"):
        points = find_points(FINGER, most=40, candidates=120, plant=tuned)
        law = LQPreview(FINGER, timing.period, build_table(FINGER, Preview(FINGER), points))
        for plant in ("mujoco", "pcc"):
            case = Case(task, "lq_preview", plant=plant)
            env = Case(task, "hold", plant=plant, scene=times).environment()
            errors[tuned, plant] = float(np.mean(run(case, env, law).rollout.error))
    hold = float(np.mean(run(Case(task, "hold")).rollout.error))
    assert max(errors.values()) < hold / 10, errors
    assert errors["pcc", "mujoco"] < 4 / 3 * errors["mujoco", "mujoco"], errors
    assert errors["mujoco", "pcc"] < 4 / 3 * errors["pcc", "pcc"], errors
