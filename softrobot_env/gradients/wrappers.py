"""Rollouts as functions of PyTorch and JAX, with their derivatives."""

from collections.abc import Callable
from typing import Any

import numpy as np

from softrobot_env.core.motion import State

from .motions import Motion, Observed
from .rollout import Rollout


def torch_function(rollout: Rollout) -> Callable[..., Observed]:
    """Function of inputs (periods, n_inputs), and of positions and velocities (nv,) at the start.

    Tensors of real numbers; without a start it is the rollout's. Returns `Observed` of tensors of
    the inputs' kind, through which gradients flow back to all of these.
    """
    import torch

    class Run(torch.autograd.Function):
        @staticmethod
        def forward(ctx: Any, inputs: Any, *start: Any) -> tuple:
            ctx.motion = _run(rollout, *(x.detach().cpu().numpy() for x in (inputs, *start)))
            return tuple(inputs.new_tensor(x) for x in ctx.motion.observed)

        @staticmethod
        def backward(ctx: Any, *weights: Any) -> tuple:
            given = [x.detach().cpu().numpy() for x in weights]
            found = _pull(ctx.motion, given)
            like = next(iter(weights))
            return tuple(
                like.new_tensor(x) if wanted else None
                for x, wanted in zip(found, ctx.needs_input_grad, strict=False)
            )

    return lambda inputs, *start: Observed(*Run.apply(inputs, *start))


def jax_function(rollout: Rollout) -> Callable[..., Observed]:
    """As `torch_function`, of JAX's arrays, also within `jax.jit`.

    Backwards the motion is simulated once more. JAX's numbers have half of the digits unless
    `jax_enable_x64` is set.
    """
    import jax
    import jax.numpy as jnp

    def run(inputs: Any, *start: Any) -> Observed:
        kind = jnp.result_type(float)
        observed = _run(rollout, inputs, *start).observed
        return Observed(*(np.asarray(x, kind) for x in observed))

    def pull(given: tuple, weights: Observed) -> tuple:
        kind = jnp.result_type(float)
        found = _pull(_run(rollout, *given), weights)
        return tuple(np.asarray(x, kind) for x, _ in zip(found, given, strict=False))

    def shapes(periods: int) -> Observed:
        model, k = rollout.scene.model, periods + 1
        sizes = model.nv, model.nv, 3, 3, model.ntendon, model.nu
        return Observed(*(jax.ShapeDtypeStruct((k, n), jnp.result_type(float)) for n in sizes))

    @jax.custom_vjp
    def observed(inputs: Any, *start: Any) -> Observed:
        return jax.pure_callback(run, shapes(len(inputs)), inputs, *start)

    def forward(*given: Any) -> tuple:
        return observed(*given), given

    def backward(given: tuple, weights: Observed) -> tuple:
        kinds = tuple(jax.ShapeDtypeStruct(x.shape, jnp.result_type(float)) for x in given)
        return jax.pure_callback(pull, kinds, given, weights)

    observed.defvjp(forward, backward)
    return observed


def _run(rollout: Rollout, inputs: Any, *start: Any) -> Motion:
    given = State(*(np.asarray(x, float) for x in start)) if start else None
    return rollout.run(np.asarray(inputs, float), given)


def _pull(motion: Motion, weights: Any) -> tuple:
    """Derivatives by inputs and start, of weights in the order of `Observed`."""
    named = zip(Observed._fields, weights, strict=True)
    found = motion.vjp(**{name: np.asarray(x, float) for name, x in named})
    return found.inputs, found.position, found.velocity
