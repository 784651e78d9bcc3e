"""What measurements of the tip say of its motion and of its error."""

import numpy as np
import pytest
from gymnasium import spaces

from softrobot_env.envs.real import StaleError, TipFilter, reference_at
from softrobot_env.hardware.tip import TipMeasurement


def test_velocity_is_by_difference_of_different_pictures():
    tip = TipFilter(TipMeasurement(1.0, np.zeros(2)), spaces.Box(-1.0, 1.0, (2,), np.float64))
    assert tip.velocity.tolist() == [0.0, 0.0]
    tip.add(TipMeasurement(1.01, np.array([0.002, -0.001])))
    assert tip.velocity == pytest.approx([0.2, -0.1])
    tip.add(TipMeasurement(1.01, np.array([0.002, -0.001])))
    assert tip.velocity == pytest.approx([0.2, -0.1])


def test_a_tip_that_is_faster_than_the_limit_is_refused():
    tip = TipFilter(
        TipMeasurement(1.0, np.zeros(2)), spaces.Box(-1.0, 1.0, (2,), np.float64), speed=5.0
    )
    tip.add(TipMeasurement(1.01, np.array([0.049, 0.0])))
    with pytest.raises(StaleError, match=r"moves at 5\.1 m/s, allowed are 5 m/s"):
        tip.add(TipMeasurement(1.02, np.array([0.1, 0.0])))
    assert tip.velocity == pytest.approx([4.9, 0.0])


def test_reference_between_control_instants():
    points = np.array([[0.0, 0.0], [1.0, 10.0], [2.0, 40.0]])
    assert reference_at(points, 1.5) == pytest.approx([1.5, 25.0])
    assert reference_at(points, -1.0) == pytest.approx([0.0, 0.0])
