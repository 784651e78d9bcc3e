"""Tasks for any robot: reachable, smooth, at rest at both ends, refused where they cannot be."""

from dataclasses import replace

import numpy as np
import pytest
from support.example_robots import SOME
from support.postures import rest_tip
from support.routed_robots import ONE_PAIR

from softrobot_env.robots import ARM, RIG, Base, find_robot
from softrobot_env.robots.tendons import Tendon
from softrobot_env.scene.inverse import InverseStatics, workspace_of
from softrobot_env.tasks import make_task, remake_task, tasks_of
from softrobot_env.tasks.generic import _Sheet, site_of
from studies.files_drawn import drawn_robot

#: As the silicone rod, sideways.
SIDEWAYS = replace(
    find_robot("silicone_rod"), name="sideways", base=Base((0.2, 0.1, 0.5), (1.0, 0.0, 0.0))
)
PATHS = ("circle", "figure_eight", "random")


def wound(name, *places):
    """A finger whose tendons, at places [m] across it, are wound up by servos."""
    tendons = [
        Tendon(f"t{place}", (place, 0.0), 0.1, number, 10.0, stiffness=2000.0, pretension=0.2)
        for number, place in enumerate(places)
    ]
    drive = find_robot("silicone_rod").drive
    return replace(ONE_PAIR, name=name, tendons=tuple(tendons), drive=drive)


#: Robots whose tips move on lines: both ways by tension, one way by a servo, both ways by two.
LINES = (ONE_PAIR, wound("one", 0.008), wound("two", 0.008, -0.006))


@pytest.fixture(params=[*SOME, SIDEWAYS.name])
def robot(request):
    return SIDEWAYS if request.param == SIDEWAYS.name else find_robot(request.param)


@pytest.mark.parametrize("name", PATHS)
def test_the_tip_can_rest_all_along_a_path(robot, name):
    """Between the solved points too, in all three coordinates: to 1e-4 of the reach."""
    task = make_task(name, robot=robot)
    times = np.linspace(0.0, task.trajectory.end_time / 2, 23)
    points = task.trajectory.position(times)
    inverse = workspace_of(robot).inverse
    found = inverse.solve(points, np.array(task.start_input))
    assert found.errors.max() <= inverse.tolerance
    assert np.abs(inverse.scene.tip(found.postures) - points).max() < 1e-4 * robot.reach
    tip = rest_tip(robot, np.array(task.start_input))
    np.testing.assert_allclose(tip, points[0], atol=1e-5 * robot.reach)
    assert task.axes == ("xz" if robot.is_planar else "xyz")


def test_no_tip_of_a_fitted_surface_lies_beyond_the_reach():
    """A level plane through the tip of a straight robot does everywhere else."""
    site, turn = site_of(find_robot("silicone_rod")), np.linspace(0, 2 * np.pi, 13)
    robot, height = site.inverse.scene.config.robot, np.zeros(45)
    flat = site.ground.middle + 0.03 * np.stack([np.cos(turn), np.sin(turn)]).T @ site.ground.axes
    for lower, bounds in ((0.0, (1 - 1e-5, 1.0)), (0.02, (0.0, 0.95))):
        height[0] = -lower * np.sign(site.ground.middle @ np.cross(*site.ground.axes))
        tips = _Sheet(site, np.array([0.05, 0.05]), height).over(flat)
        away = np.linalg.norm(tips - robot.clamp.position, axis=1) / robot.reach
        assert bounds[0] <= away.min() <= away.max() <= bounds[1]


@pytest.mark.filterwarnings("ignore::UserWarning")
@pytest.mark.parametrize("index", [49, pytest.param(85, marks=pytest.mark.slow)])
def test_redundant_robots_have_set_points_at_a_bounded_cost(index, monkeypatch):
    """Random robots along whose paths the inputs of least norm change fast.

    Points took 17 linearisations each, of which many were lost on discs ever smaller than usual.
    """
    robot, counted = drawn_robot(7, index), []
    site, once = site_of(robot), InverseStatics.linearised
    with monkeypatch.context() as patched:
        patched.setattr(
            InverseStatics, "linearised", lambda *a, **k: counted.append(1) or once(*a, **k)
        )
        task = make_task("reach", robot=robot)
    assert task.option("radius") > 0.75 * site.ground.radius > 0.05 * robot.reach
    assert len(counted) < 14 * 120  # 120 points tell what the disc is like
    points, inverse = task.trajectory.path(), site.inverse
    found = inverse.solve(points)
    assert found.errors.max() <= inverse.tolerance
    assert np.abs(inverse.scene.tip(found.postures) - points).max() < 1e-3 * robot.reach


def test_set_points_begin_in_the_middle(robot):
    tip = rest_tip(robot, np.array(make_task("reach", robot=robot).start_input))
    np.testing.assert_allclose(tip, workspace_of(robot).ground.middle, atol=1e-7)


def test_paths_lie_across_the_axis_of_the_robot():
    """Sideways along x: the circle has its radius in y and z, about the tip of the hanging rod."""
    task = make_task("circle", robot=SIDEWAYS, radius=0.02)
    points = task.trajectory.path()
    middle = workspace_of(SIDEWAYS).ground.middle
    np.testing.assert_allclose(np.linalg.norm((points - middle)[:, 1:], axis=1), 0.02, rtol=1e-9)
    assert np.ptp(points[:, 0]) > 1e-4


def test_options_and_seeds():
    task = make_task("random", robot="silicone_rod", seed=3, radius=0.03, speed=0.05)
    assert task.option("seed") == 3 and task.option("radius") == 0.03
    flat = (task.trajectory.path() - workspace_of(task.robot).ground.middle)[:, :2]
    assert np.linalg.norm(flat, axis=1).max() == pytest.approx(0.03, rel=1e-3)
    assert make_task("random", robot="silicone_rod", **dict(task.options)) == task
    assert make_task("random", robot="silicone_rod", seed=4) != task
    times = np.linspace(0, task.duration, 2001)
    fastest = np.linalg.norm(task.trajectory.velocity(times), axis=1).max()
    assert fastest == pytest.approx(0.05, rel=1e-3)
    points = make_task("reach", robot="silicone_rod", seed=1, radius=0.04).trajectory.path()
    assert len(points) == 10 and np.linalg.norm(points[:, :2], axis=1).max() <= 0.04


def test_a_frequency_is_that_of_the_laps_between_ramps():
    task = make_task("figure_eight", robot="hanging_trunk", frequency=0.3)
    run, site = task.trajectory, site_of(task.robot)
    lap = 1 / (0.3 * site.frequency)
    assert run.end_time == pytest.approx(4 * lap)
    assert dict(task.options).keys() == {"radius", "frequency"}
    times = lap * np.array([1.0, 1.3, 1.9])  # from the end of the first ramp on
    for order in ("position", "velocity"):
        here, next_lap = (getattr(run, order)(t) for t in (times, times + lap))
        np.testing.assert_allclose(here, next_lap, atol=1e-9)
    assert np.abs(run.position(times) - run.position(times + lap / 2)).max() > 0.01
    assert remake_task(task, frequency=0.1).trajectory.end_time == pytest.approx(12 * lap)


def test_remaking_keeps_the_robot_and_what_was_changed_by_hand():
    task = make_task("circle", robot="planar_finger")
    slower = remake_task(task, speed=0.002)
    assert slower.robot is task.robot and slower.option("speed") == 0.002
    assert slower.option("radius") == task.option("radius")
    own = replace(task, start_input=(0.1, 0.2))
    assert remake_task(own, speed=0.002).start_input == (0.1, 0.2)
    assert remake_task(make_task("circle"), speed=0.2).robot is ARM


def test_a_robots_own_tasks_come_first():
    assert make_task("circle", robot=ARM) == make_task("circle")
    assert make_task("reach", robot="rig", seed=2) == make_task("reach", seed=2)
    assert list(tasks_of(ARM))[:4] == ["reach", *PATHS] and "lshape" in tasks_of(ARM)
    assert "triangle" in tasks_of(RIG) and "triangle" not in tasks_of(SIDEWAYS)
    assert make_task("figure_eight", robot="rig").axes == "xyz"


@pytest.mark.parametrize("robot", LINES, ids=lambda robot: robot.name)
def test_a_tip_that_moves_on_a_line_has_set_points_on_it(robot):
    """Points that some actions, of a fine grid of all, hold; not all at one place."""
    for name in PATHS:
        with pytest.raises(ValueError, match=f"{robot.name!r} is not found to.*'reach' works"):
            make_task(name, robot=robot)
    task, inverse = make_task("reach", robot=robot), workspace_of(robot).inverse
    points, radius = task.trajectory.path(), task.option("radius")
    grid = np.stack(np.meshgrid(*[np.linspace(-1, 1, 61)] * inverse.inputs.n_inputs), axis=-1)
    tips = []
    for action in grid.reshape(-1, inverse.inputs.n_inputs):
        tips.append(inverse.tip(inverse.posture(inverse.inputs.from_actions(action))))
    rest = inverse.tip(inverse.posture(inverse.inputs.from_actions(np.zeros(len(grid.shape) - 1))))
    assert radius > 0.05 * robot.length
    assert np.linalg.norm(points - rest, axis=1).max() <= radius
    assert np.ptp(points, axis=0).max() > 0.3 * radius
    for point in points:
        assert np.linalg.norm(tips - point, axis=1).min() < 0.05 * radius
