"""Pictures of the test rig."""

import numpy as np
import pytest
from support.rig_episodes import rig

from softrobot_env.envs.rendering import lifted
from softrobot_env.robots import RIG


def test_references_are_drawn_on_the_dome():
    """The height of an arc of the angle that puts the head's output there."""
    angle = np.array([1e-6, 0.3, 1.2])
    distance = 0.18 * (1 - np.cos(angle)) / angle + 0.022 * np.sin(angle)
    height = 0.18 * np.sin(angle) / angle + 0.022 * np.cos(angle)
    points = np.stack([distance * np.cos(2.0), distance * np.sin(2.0)], axis=1)
    placed = lifted(RIG, points)
    np.testing.assert_array_equal(placed[:, :2], points)
    np.testing.assert_allclose(placed[:, 2], height, atol=2e-5)


def test_frames_show_the_rig():
    from softrobot_env.envs.rendering import RenderError

    env = rig("triangle", render_mode="rgb_array", width=160, height=120)
    env.reset()
    try:
        start = env.render().astype(int)
    except RenderError as error:
        pytest.skip(f"no OpenGL on this machine: {error}")
    for _ in range(40):
        env.step(np.array([0.5, 0.0, 0.0], np.float32))
    bent = env.render().astype(int)
    assert start.shape == (120, 160, 3)
    body = [np.argwhere(f[..., 0] - f[..., 2] > 60) for f in (start, bent)]  # the orange skin
    assert all(len(pixels) > 100 for pixels in body)
    assert body[1][:, 1].max() > body[0][:, 1].max() + 5  # it leans towards +x, to the right
    env.close()
