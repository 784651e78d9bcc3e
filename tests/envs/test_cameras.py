"""Many cameras at once are single ones."""

import numpy as np
import pytest

from softrobot_env.envs.observations.readouts import Camera, Cameras

COUNT, NOISE = 4, 1e-3


@pytest.mark.parametrize("delay", [0, 1, 3])
@pytest.mark.parametrize("period", [0.004, 0.02, 0.05])
@pytest.mark.parametrize("coordinates", [2, 3])
def test_many_cameras_are_single_ones(delay, period, coordinates):
    """Started at different times, two of them again, over more than a block of noise."""
    rng = np.random.default_rng(0)
    many = Cameras(COUNT, NOISE, delay, period, coordinates)
    single = {}

    def start(which, seeds, tip):
        many.start(np.array(which), seeds, tip[which])
        for i, seed in zip(which, seeds, strict=True):
            single[i] = Camera(NOISE, delay, period, coordinates)
            single[i].start(None, [seed], tip[[i]])

    tip = rng.uniform(-1, 1, (COUNT, coordinates))
    start(list(range(COUNT)), [3, 4, 5, 6], tip)
    for k in range(300):
        tip = rng.uniform(-1, 1, (COUNT, coordinates))
        which = None
        if k == 7:
            start([0, 2], [9, 9], tip)
        elif k % 10 == 0:  # some only
            which = np.array([1, 3])
        many.see(tip, which)
        for i in range(COUNT) if which is None else which.tolist():
            single[i].see(tip[i])
        for i, camera in single.items():
            np.testing.assert_array_equal(many.position[i], camera.position)
            np.testing.assert_array_equal(many.velocity[i], camera.velocity)
