"""Between torch's layers and the networks that policies run."""

from itertools import pairwise

import numpy as np
import torch

from softrobot_env.learned.network import Network, Scaling


def new_layers(inputs: int, hidden: tuple[int, ...], outputs: int) -> torch.nn.Sequential:
    """Linear layers with tanh between them."""
    sizes = (inputs, *hidden, outputs)
    layers: list[torch.nn.Module] = []
    for below, here in pairwise(sizes):
        layers += [torch.nn.Linear(below, here), torch.nn.Tanh()]
    return torch.nn.Sequential(*layers[:-1])


def linear_layers(module: torch.nn.Module) -> list[torch.nn.Linear]:
    """Linear layers within a module, in order."""
    return [part for part in module.modules() if isinstance(part, torch.nn.Linear)]


def as_network(*modules: torch.nn.Module) -> Network:
    """The network that modules with linear layers and tanh between them make, one by one."""
    layers = [layer for module in modules for layer in linear_layers(module)]
    weights = tuple(layer.weight.detach().numpy().astype(float) for layer in layers)
    biases = tuple(layer.bias.detach().numpy().astype(float) for layer in layers)
    return Network(weights, biases, _unscaled(weights[0].shape[1]), _unscaled(len(biases[-1])))


def put_network(network: Network, *modules: torch.nn.Module) -> None:
    """Set the layers that `as_network` reads."""
    layers = [layer for module in modules for layer in linear_layers(module)]
    with torch.no_grad():
        for layer, weight, bias in zip(layers, network.weights, network.biases, strict=True):
            layer.weight.copy_(torch.from_numpy(weight))
            layer.bias.copy_(torch.from_numpy(bias))


def _unscaled(count: int) -> Scaling:
    return Scaling(-np.ones(count), np.ones(count))
