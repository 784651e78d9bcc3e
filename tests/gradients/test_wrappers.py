"""PyTorch and JAX see the derivatives of the rollout."""

import numpy as np
import pytest

from softrobot_env.core.motion import State
from softrobot_env.gradients import Rollout
from softrobot_env.gradients.wrappers import jax_function, torch_function
from studies.truths.moving_robots import moving

TARGET = np.array([0.02, 0.0, 0.2])


def problem():
    """A robot, and derivatives of its tip's distances from a place and of its last speeds."""
    robot = moving(0)
    rollout, start = Rollout(robot.scene), State(robot.position, robot.velocity)
    motion = rollout.run(robot.inputs, start)
    speeds = np.zeros_like(motion.observed.velocity)
    speeds[-1] = 1e-3
    found = motion.vjp(tip=2 * (motion.observed.tip - TARGET), velocity=speeds)
    return rollout, robot, (found.inputs, found.position, found.velocity)


def test_torch():
    torch = pytest.importorskip("torch")
    rollout, robot, wanted = problem()
    given = robot.inputs, robot.position, robot.velocity
    tensors = [torch.tensor(x, requires_grad=True) for x in given]
    seen = torch_function(rollout)(*tensors)
    loss = ((seen.tip - torch.tensor(TARGET)) ** 2).sum() + 1e-3 * seen.velocity[-1].sum()
    loss.backward()
    for tensor, own in zip(tensors, wanted, strict=True):
        np.testing.assert_allclose(tensor.grad.numpy(), own, rtol=1e-10, atol=1e-14)


def test_jax():
    jax = pytest.importorskip("jax")
    rollout, robot, wanted = problem()
    given = robot.inputs, robot.position, robot.velocity
    with jax.enable_x64(True) if hasattr(jax, "enable_x64") else jax.experimental.enable_x64():
        run = jax_function(rollout)

        def loss(*given):
            seen = run(*given)
            return ((seen.tip - TARGET) ** 2).sum() + 1e-3 * seen.velocity[-1].sum()

        found = jax.jit(jax.grad(loss, argnums=(0, 1, 2)))(*given)
    for one, own in zip(found, wanted, strict=True):
        np.testing.assert_allclose(one, own, rtol=1e-10, atol=1e-14)
