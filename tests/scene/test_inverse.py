"""Inverse statics of any robot: on the point, least in norm, honest about what is out of reach."""

from dataclasses import replace
from math import hypot

import numpy as np
import pytest
from support.derivatives import differences
from support.routed_robots import ONE_PAIR

from softrobot_env.core.motion import State
from softrobot_env.robots import ARM, EXAMPLES, RIG, Base, Tendon, find_robot
from softrobot_env.scene.build import build_scene
from softrobot_env.scene.inverse import Held, sample_of, spread, workspace_of
from softrobot_env.scene.linearised import linearised
from softrobot_env.scene.registry import model_scene
from softrobot_env.scene.tangent import StaticForces
from studies.truths.varying_beam import bending_frequencies

#: A helical tendon beside two straight ones: the chain twists, and no tendon opposes another.
HELIX = replace(
    ONE_PAIR,
    name="helix",
    tendons=(
        Tendon("a", (0.008, 0.0), 0.1, 0, 10.0),
        Tendon("b", (0.0, 0.008), 0.1, 1, 10.0),
        Tendon("c", (-0.006, 0.0), 0.1, 2, 5.0, turns=0.3),
    ),
    gravity=(0.0, 0.0, -9.81),
    base=Base((0.1, 0.2, 0.3), (1.0, 0.5, 0.2), 0.4),
    poisson_ratio=0.4,
)

ROBOTS = [ARM, RIG, HELIX, *(find_robot(name) for name in EXAMPLES)]


def inverse_of(robot):
    return workspace_of(robot).inverse


@pytest.fixture(
    params=[*ROBOTS[:-2], *(pytest.param(long, marks=pytest.mark.slow) for long in ROBOTS[-2:])],
    ids=lambda robot: robot.name,
)
def robot(request):
    return request.param


def test_equilibria_of_the_inverse_have_their_tip_on_the_points(robot):
    """The points are tips of other inputs; a new scene of the robot's own drives is the judge.

    Near the limits of nine tendons the search from afar may miss one: it then tells by how far.
    """
    inverse, tips = inverse_of(robot), sample_of(robot, 40).tips[1:40:10]
    found = inverse.solve(tips)
    scene, off = build_scene(model_scene(robot)), []
    for point, inputs, guess in zip(tips, found.inputs, found.postures, strict=True):
        controls = np.zeros(scene.n_inputs)
        controls[: len(robot.tendons)] = inverse.inputs.command(inputs)
        tip = scene.tip(scene.equilibrium(controls, guess))
        off.append(np.linalg.norm(inverse.directions @ (tip - point)))
    np.testing.assert_allclose(off, found.errors, atol=1e-6 * robot.length)
    assert np.sum(found.errors > inverse.tolerance) <= (robot.name == "ftdcr_v4")
    actions = (found.inputs - inverse.inputs.input_centre) / inverse.inputs.input_scale
    assert np.abs(actions).max() <= 1 + 1e-12


def test_no_inputs_nearby_hold_the_tip_with_less():
    """First-order condition of least norm: the actions lie in the row space of the tip Jacobian,
    here by differences of equilibria."""
    trunk = find_robot("hanging_trunk")
    inverse = inverse_of(trunk)
    found = inverse.solve(np.array([[0.06, 0.03, 0.0]]))
    scale = inverse.inputs.input_scale

    def place(change):
        posture = inverse.posture(found.inputs[0] + scale * change, found.postures[0])
        return inverse.directions @ inverse.scene.tip(posture)

    action, jacobian = found.inputs[0] / scale, differences(place, np.zeros(4), 1e-4)
    rows = np.linalg.svd(jacobian, full_matrices=False)[2]
    assert np.linalg.norm(action - rows.T @ (rows @ action)) < 1e-4 * np.linalg.norm(action)


def test_a_point_out_of_reach_has_the_distance_that_is_left():
    """Of the arm, whose reach is a half circle about its base where nothing is bent."""
    inverse = inverse_of(ARM)
    found = inverse.solve(np.array([[0.0, 0.0, 0.6], [0.3, 0.0, 0.6], [0.29, 0.0, 0.325]]))
    assert found.errors[0] == pytest.approx(0.1, rel=1e-3)
    assert found.errors[1] >= hypot(0.3, 0.6) - ARM.length
    assert found.errors[2] < inverse.tolerance  # those after it are looked for all the same
    tips = inverse.scene.tip(found.postures)
    np.testing.assert_allclose(np.linalg.norm(tips[1] - [0.3, 0, 0.6]), found.errors[1])


def test_a_call_goes_on_from_the_one_before():
    inverse = inverse_of(RIG)
    path = np.outer(np.linspace(0, 1, 5), [0.05, -0.03, 0.0])
    whole = inverse.solve(path)
    held, rows = None, []
    for point in path:
        held = inverse.solve(point[None], held)
        rows.append(held.inputs[0])
    np.testing.assert_allclose(rows, whole.inputs, atol=1e-9)
    assert isinstance(held, Held)


def test_the_controls_derivative_is_that_of_the_force(robot):
    scene, held = inverse_of(robot).scene, sample_of(robot, 40)
    forces, posture = StaticForces(scene.model), held.postures[5]
    controls, tense = np.zeros(scene.n_inputs), robot.drive.kind == "tension"
    controls[: len(robot.tendons)] = inverse_of(robot).inputs.command(held.inputs[5])
    forces.force(posture, controls)
    exact, step = forces.by_controls(), 1e-4 if tense else 1e-7
    change = differences(lambda x: forces.force(posture, x).copy(), controls, step)
    taut = ~(tense & (controls == 0))
    np.testing.assert_allclose(exact[:, taut], change[:, taut], atol=1e-5 * np.abs(exact).max())


def test_the_spread_fills_the_box_more_evenly_than_chance():
    """Star discrepancy over corner boxes of 200 points in 3-D: random ones have about 0.1."""
    points = (spread(200, 3) + 1) / 2
    corners = np.random.default_rng(0).uniform(size=(300, 3))
    share = (points[None] < corners[:, None]).all(axis=-1).mean(axis=1)
    assert np.abs(share - corners.prod(axis=1)).max() < 0.05


def test_a_sample_counts_what_it_leaves_out_and_stays_in_the_box(robot):
    sample = sample_of(robot, 40)
    inputs = inverse_of(robot).inputs
    assert len(sample.tips) + sample.left_out == 41
    action = (sample.inputs - inputs.input_centre) / inputs.input_scale
    assert np.abs(action).max() <= 1 + 1e-9
    away = sample.tips - (np.zeros(3) if robot.base is None else robot.base.position)
    assert np.linalg.norm(away, axis=1).max() <= robot.reach * (1 + 1e-9)


# ---------------------------------------------------------------- linearised chains
def test_frequencies_of_the_straight_arm_are_those_of_a_cantilever():
    found = linearised(workspace_of(ARM).inverse, np.zeros(3)).frequencies[:2]
    off = np.abs(found / bending_frequencies(ARM, 2) - 1)
    assert np.all(off < [5e-3, 3e-2])  # 6 pieces


@pytest.mark.parametrize("name", ["planar_finger", "hanging_trunk", "silicone_rod"])
def test_at_rest_the_tip_answers_as_equilibria_do(name):
    inverse = workspace_of(find_robot(name)).inverse
    scale = inverse.inputs.input_scale
    inputs = 0.15 * scale * np.array([1.0, -0.3, -0.7, 0.8])[: len(scale)]
    step = 1e-3 * scale * np.array([1.0, 0.5, -0.2, 0.3])[: len(scale)]
    ends = [inverse.scene.tip(inverse.posture(inputs + h)) for h in (step, -step)]
    answer = linearised(inverse, inputs).response(0.0)
    assert np.abs(answer.imag).max() == 0
    wanted = ends[0] - ends[1]
    np.testing.assert_allclose(answer.real @ (2 * step), wanted, atol=1e-4 * np.abs(wanted).max())


def test_a_forced_motion_is_that_of_the_response():
    """A small sine at 0.7 of the first frequency, after ten periods, against the simulation."""
    inverse = workspace_of(find_robot("planar_finger")).inverse
    scene, inputs = inverse.scene, 0.2 * inverse.inputs.input_scale
    chain = linearised(inverse, inputs)
    rate, change = 0.7 * 2 * np.pi * chain.frequencies[0], np.array([0.02, 0.0])
    lap, period = 2 * np.pi / rate, scene.config.control_period
    posture = inverse.posture(inputs)

    def controls(time):
        out = np.zeros(scene.n_inputs)
        out[:4] = inverse.inputs.command(inputs + change * np.sin(rate * time))
        return out

    count = round(12 * lap / period)
    start = State(posture, np.zeros(scene.model.nv))
    motion = scene.simulate(count * period, controls, start, samples=period)
    late = motion.time > 10 * lap
    found = scene.tip(motion.q[late]) - scene.tip(posture)
    turn = np.exp(1j * rate * motion.time[late])
    wanted = np.outer(turn, chain.response(rate) @ change).imag
    assert np.abs(found - wanted).max() < 0.02 * np.abs(wanted).max()
