"""Networks of the inverse statics: trained on any robot, used as law and in the hybrid."""

import numpy as np
import pytest

from softrobot_env.control.registry import make_policy
from softrobot_env.robots import find_robot
from softrobot_env.tasks import make_task
from softrobot_env.training.quasi_static import Learning, train

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
    seen = {
        "reference": point,
        "reference_velocity": np.zeros(3),
        "reference_acceleration": np.zeros(3),
        "previous_action": np.zeros(3),
    }
    static, _ = make_policy("static", robot, PERIOD).predict(seen)
    for name, option in (("qs_nn", "weights"), ("hybrid", "learnt")):
        policy = make_policy(name, robot, PERIOD, **{option: path})
        action, state = policy.predict(seen)
        assert np.abs(action - static).max() < 0.05 and state.status is None
        far = seen | {"reference": point + np.array([0.5, 0.0, 0.0])}
        _, state = policy.predict(far, state)
        assert state.status in ("outside the trained workspace", "reference out of reach")


def test_other_robots_are_told_how_to_train(trained):
    _, _, path, _ = trained
    finger = find_robot("planar_finger")
    for name, option in (("qs_nn", "weights"), ("hybrid", "learnt")):
        command = "softrobot train qs_nn --robot .*planar_finger"
        with pytest.raises(ValueError, match=command):
            make_policy(name, finger, PERIOD)
        with pytest.raises(ValueError, match=command):
            make_policy(name, finger, PERIOD, **{option: path})
