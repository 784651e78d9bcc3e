"""Operating points as beam models have them, against equilibria, other plants and motions."""

import numpy as np
import pytest

from softrobot_env.control.scheduled.law import build_table
from softrobot_env.control.scheduled.lq_preview import LQPreview, Preview
from softrobot_env.control.scheduled.operating_points import BeamLinearizer, find_points
from softrobot_env.control.scheduled.timing import timing_of
from softrobot_env.evaluation.runner import Case, run
from softrobot_env.robots import ARM, find_robot
from softrobot_env.robots.actuation import robot_inputs
from softrobot_env.scene.inverse import workspace_of
from softrobot_env.scene.linearised import Linearizer
from softrobot_env.tasks.generic import generic_tasks

FINGER, ROD = find_robot("planar_finger"), find_robot("silicone_rod")


def first_frequency(model):
    return np.sqrt(np.linalg.eigvals(np.linalg.solve(model.mass, model.stiffness)).real.min())


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
    at = beam.rest(inputs)
    slope, step = np.linalg.solve(at.model.stiffness, at.model.inputs), 1e-3
    bend, moved = [], []
    for push in step * np.diag(scale):
        above, below = beam.rest(inputs + push), beam.rest(inputs - push)
        bend.append((above.curvature - below.curvature) / (2 * step))
        moved.append((above.tip - below.tip) / (2 * step))
    np.testing.assert_allclose(slope.T, bend, atol=2e-3 * np.abs(bend).max())
    error = np.abs((at.model.tip @ slope).T - moved).max(0) / np.abs(moved).max()
    assert (error <= [left[0], left[0], left[1]]).all(), error


@pytest.mark.parametrize("robot", [FINGER, ROD], ids=lambda robot: robot.name)
def test_first_frequency_and_damping_are_about_those_of_the_chain(robot):
    """Pieces of constant curvature and hinges are different models of the same beam."""
    space = workspace_of(robot)
    inputs = space.ground.inputs
    chain = Linearizer(space.scene).about(space.inverse.posture(inputs), inputs)
    beam = BeamLinearizer(robot, "pcc").rest(inputs).model
    assert first_frequency(beam) == pytest.approx(first_frequency(chain), rel=0.05)
    ratios = [np.trace(m.damping) / np.trace(m.stiffness) for m in (beam, chain)]
    assert ratios[0] == pytest.approx(ratios[1], rel=0.05)
    # Springs twice as stiff: what the curvatures lose by it is the curvature itself, to first
    # order, where nothing but springs is stiff.
    shares = [np.linalg.norm(m.elastic) / np.trace(m.stiffness) for m in (beam, chain)]
    assert shares[0] == pytest.approx(shares[1], rel=0.05, abs=1e-6)


def test_a_model_that_lacks_what_the_robot_has_says_so():
    with pytest.raises(ValueError, match="one section"):
        find_points(FINGER, plant="ancf")


@pytest.mark.slow
def test_a_law_tuned_on_another_plant_tracks_about_as_well_on_either():
    """A tenth of what holding still errs, and within a third of the law that is at home."""
    timing, errors = timing_of(FINGER), {}
    task = generic_tasks(FINGER)["circle"](frequency=0.3)
    for tuned in ("mujoco", "pcc"):
        points = find_points(FINGER, most=40, candidates=120, plant=tuned)
        law = LQPreview(FINGER, timing.period, build_table(FINGER, Preview(FINGER), points))
        for plant in ("mujoco", "pcc"):
            case = Case(task, "lq_preview", plant=plant)
            env = Case(task, "hold", plant=plant, scene=_times(timing)).environment()
            errors[tuned, plant] = float(np.mean(run(case, env, law).rollout.error))
    hold = float(np.mean(run(Case(task, "hold")).rollout.error))
    assert max(errors.values()) < hold / 10, errors
    assert errors["pcc", "mujoco"] < 4 / 3 * errors["mujoco", "mujoco"], errors
    assert errors["mujoco", "pcc"] < 4 / 3 * errors["pcc", "pcc"], errors


def _times(timing):
    return {"control_period": timing.period, "preview": timing.knots}
