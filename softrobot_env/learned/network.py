"""Feed-forward network with tanh neurons, a linear output layer and scaled inputs and outputs."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path
from typing import NoReturn

import numpy as np
from numpy import ndarray

from softrobot_env.core.artifacts import Arrays, read_arrays, write_arrays
from softrobot_env.core.records import placed
from softrobot_env.robots import RobotParams
from softrobot_env.robots.artifacts import fingerprint, refuse_artifact, train_command

_ABOUT = "about_"

#: Descriptions that may hold infinity: empty sectors of a workspace, tendons that do not stretch.
_MAY_BE_INFINITE = tuple(f"{_ABOUT}{name}" for name in ("workspace", "tendon_stiffness"))

#: What the statics of a robot depend on, by name.
Describe = Callable[[RobotParams], dict[str, ndarray]]


@dataclass(frozen=True)
class Scaling:
    """Affine map of the range [low, high] of each quantity to [-1, 1], and back.

    Attributes:
        low, high: (n,), in the unit of the quantity.
    """

    low: ndarray
    high: ndarray

    def __post_init__(self) -> None:
        if np.shape(self.low) != np.shape(self.high) or not np.all(self.low < self.high):
            raise ValueError("scaling needs low < high in every entry, and as many of both")

    @classmethod
    def of(cls, data: ndarray) -> "Scaling":
        """The range of data (k, n)."""
        return cls(data.min(axis=0), data.max(axis=0))

    @property
    def centre(self) -> ndarray:
        """(n,), what is mapped to zero."""
        return (self.high + self.low) / 2

    @property
    def half(self) -> ndarray:
        """(n,), half the width of the range."""
        return (self.high - self.low) / 2

    def scale(self, values: ndarray) -> ndarray:
        """(..., n) [1] of values (..., n)."""
        return (values - self.centre) / self.half

    def restore(self, scaled: ndarray) -> ndarray:
        """(..., n) values of (..., n) [1]."""
        return scaled * self.half + self.centre


@dataclass(frozen=True)
class Network:
    """Layers y = tanh(W x + b), the last one without tanh, between scaled inputs and outputs.

    Attributes:
        weights: (n_neurons, n_previous) of each layer.
        biases: (n_neurons,) of each layer.
        inputs, outputs: Scaling of the inputs (n_in,) and outputs (n_out,).
    """

    weights: tuple[ndarray, ...]
    biases: tuple[ndarray, ...]
    inputs: Scaling
    outputs: Scaling

    def __post_init__(self) -> None:
        if not self.weights or len(self.weights) != len(self.biases):
            raise ValueError("a network needs a layer, and as many weights as biases")
        sizes = [len(self.inputs.low), *(len(b) for b in self.biases)]
        shapes = [w.shape for w in self.weights]
        if shapes != list(zip(sizes[1:], sizes, strict=False)) or sizes[-1] != len(
            self.outputs.low
        ):
            raise ValueError(
                f"layers do not fit together: weights {shapes}, neurons {sizes}, "
                f"{len(self.outputs.low)} outputs"
            )

    @classmethod
    def unscaled(cls, weights: tuple[ndarray, ...], biases: tuple[ndarray, ...]) -> "Network":
        """Layers whose inputs and outputs are in [-1, 1] as they are."""
        ends = weights[0].shape[1], len(biases[-1])
        return cls(weights, biases, *(Scaling(-np.ones(n), np.ones(n)) for n in ends))

    @property
    def sizes(self) -> tuple[int, ...]:
        """Number of inputs, of neurons in every hidden layer, and of outputs."""
        return (len(self.inputs.low), *(len(b) for b in self.biases))

    def __call__(self, inputs: ndarray) -> ndarray:
        """Outputs (k, n_out) for inputs (k, n_in)."""
        return self.outputs.restore(self.activations(self.inputs.scale(inputs))[-1])

    def activations(self, scaled: ndarray) -> list[ndarray]:
        """Scaled inputs (k, n_in), what every hidden layer gives, and the scaled outputs."""
        values = [scaled]
        for weight, bias in zip(self.weights[:-1], self.biases[:-1], strict=True):
            values.append(np.tanh(values[-1] @ weight.T + bias))
        values.append(values[-1] @ self.weights[-1].T + self.biases[-1])
        return values

    def jacobian(self, scaled: ndarray) -> ndarray:
        """Derivative (k, n_out, n_parameters) of scaled outputs at scaled inputs (k, n_in)."""
        blocks = []
        for below, slope in self.slopes(self.activations(scaled)):
            by_weight = slope[..., None] * below[:, None, None, :]
            blocks += [slope, by_weight.reshape(*slope.shape[:2], -1)]
        return np.concatenate(blocks[::-1], axis=2)

    def slopes(self, values: list[ndarray]) -> Iterator[tuple[ndarray, ndarray]]:
        """What every layer gets (k, n_previous), and the outputs' slope by what enters its neurons.

        From the last layer to the first, slopes (k, n_out, n_neurons), at given activations.
        """
        samples, outputs = values[-1].shape
        slope = np.broadcast_to(np.eye(outputs), (samples, outputs, outputs))
        for below, weight in zip(values[-2::-1], self.weights[::-1], strict=True):
            yield below, slope
            slope = (slope @ weight) * (1 - below**2)[:, None, :]

    @property
    def parameters(self) -> ndarray:
        """(n_parameters,): of each layer its weights by rows, then its biases."""
        pairs = zip(self.weights, self.biases, strict=True)
        return np.concatenate([part.ravel() for pair in pairs for part in pair])

    def with_parameters(self, parameters: ndarray) -> "Network":
        """The network with other weights and biases, ordered as `parameters`."""
        weights, biases, at = [], [], 0
        for weight, bias in zip(self.weights, self.biases, strict=True):
            middle, end = at + weight.size, at + weight.size + bias.size
            weights.append(parameters[at:middle].reshape(weight.shape))
            biases.append(parameters[middle:end])
            at = end
        return replace(self, weights=tuple(weights), biases=tuple(biases))

    def save(self, path: str | Path, about: Mapping[str, object]) -> None:
        """Write an npz file, with numbers, texts and arrays `about` what it was trained for."""
        values = {f"{_ABOUT}{name}": np.asarray(value) for name, value in about.items()}
        for k, (weight, bias) in enumerate(zip(self.weights, self.biases, strict=True)):
            values |= {f"weight_{k}": weight, f"bias_{k}": bias}
        for name, scaling in (("input", self.inputs), ("output", self.outputs)):
            values |= {f"{name}_low": scaling.low, f"{name}_high": scaling.high}
        write_arrays(path, values)

    @classmethod
    def load(cls, path: str | Path) -> tuple["Network", Arrays]:
        """Read what `save` wrote: the network, and the arrays `about` it.

        Raises:
            FileNotFoundError: No such file.
            ValueError: The file is damaged, not finite, or its arrays do not fit together.
        """
        values = read_arrays(path)
        values.check_finite(_MAY_BE_INFINITE)
        layers = range(max(1, sum(name.startswith("weight_") for name in values)))
        ends = [f"{end}_{side}" for end in ("input", "output") for side in ("low", "high")]
        shapes = {f"weight_{k}": (None, None) for k in layers}
        shapes |= dict.fromkeys([*(f"bias_{k}" for k in layers), *ends], (None,))
        values.check_shapes(shapes)
        weights, biases = (tuple(values[f"{n}_{k}"] for k in layers) for n in ("weight", "bias"))
        with placed(path):
            inputs, outputs = (
                Scaling(values[f"{end}_low"], values[f"{end}_high"]) for end in ("input", "output")
            )
            network = cls(weights, biases, inputs, outputs)
        about = {n.removeprefix(_ABOUT): v for n, v in values.items() if n.startswith(_ABOUT)}
        return network, Arrays(path, about)


@dataclass(frozen=True)
class Dataset:
    """Inputs of a network and the outputs wanted of it.

    Attributes:
        inputs: (k, n_in).
        outputs: (k, n_out).
    """

    inputs: ndarray
    outputs: ndarray

    def __len__(self) -> int:
        return len(self.inputs)

    def take(self, which: ndarray | slice) -> "Dataset":
        """Some of them, by index or slice."""
        return Dataset(self.inputs[which], self.outputs[which])

    @staticmethod
    def join(parts: Sequence["Dataset"]) -> "Dataset":
        """All of them, in order."""
        return Dataset(
            np.concatenate([part.inputs for part in parts]),
            np.concatenate([part.outputs for part in parts]),
        )

    def new_network(self, hidden: Sequence[int], rng: np.random.Generator) -> Network:
        """A network before training, scaled by the ranges of the data, see `initial_network`."""
        return initial_network(hidden, Scaling.of(self.inputs), Scaling.of(self.outputs), rng)


def initial_network(
    hidden: Sequence[int], inputs: Scaling, outputs: Scaling, rng: np.random.Generator
) -> Network:
    """A network before training, its tanh neurons spread over the inputs (Nguyen and Widrow 1990).

    Args:
        hidden: Neurons of each hidden layer; none makes the network affine.
        inputs, outputs: Scaling of the inputs and outputs.
        rng: Source of randomness.
    """
    sizes = [len(inputs.low), *hidden, len(outputs.low)]
    weights, biases = [], []
    for below, here in pairwise(sizes[:-1]):
        direction = rng.uniform(-1, 1, (here, below))
        reach = 0.7 * here ** (1 / below)
        weights.append(reach * direction / np.linalg.norm(direction, axis=1, keepdims=True))
        biases.append(reach * np.linspace(-1, 1, here) * np.sign(weights[-1][:, 0]))
    weights.append(rng.uniform(-0.5, 0.5, (sizes[-1], sizes[-2])))
    biases.append(rng.uniform(-0.5, 0.5, sizes[-1]))
    return Network(tuple(weights), tuple(biases), inputs, outputs)


def describe(robot: RobotParams) -> dict[str, ndarray]:
    """What the statics of a robot depend on, by name; the first is the robot's own name."""
    return {
        "robot": np.array(robot.name),
        "length": np.array(robot.length),
        "bending_stiffness": np.array(robot.bending_stiffness),
        "tendon_offset": robot.of_tendons("offset"),
        "tendon_end": robot.of_tendons("end"),
    }


def suits(about: dict[str, ndarray], robot: RobotParams, described: Describe = describe) -> bool:
    """Whether a network was trained for this robot, by the description that its file has."""
    wanted = described(robot)
    if "fingerprint" in wanted:
        wanted.pop("robot")  # a name is no property
    return all(name in about and _same(about[name], value) for name, value in wanted.items())


def load_for(
    path: Path,
    robot: RobotParams,
    policy: str,
    described: Describe = describe,
    ends: tuple[int, int] | None = None,
) -> tuple[Network, Arrays]:
    """Network and description from a file that belongs to a robot.

    Args:
        path: The file.
        robot: The robot.
        policy: Whose network it is, which tells the command that makes it.
        described: What the file tells of its robot, if it has no fingerprint.
        ends: Number of inputs and outputs that it must have, if given.

    Raises:
        FileNotFoundError: No such file.
        ValueError: It belongs to another robot, has other ends, or cannot be used, see
            `Network.load`.
    """
    command = train_command(robot, policy)
    if not path.is_file():
        raise FileNotFoundError(f"no network at {path}; make it with `{command}`")
    try:
        network, about = Network.load(path)
    except ValueError as error:
        raise ValueError(f"{error}; make it anew with `{command}`") from None
    try:
        fits = suits(about, robot, fingerprint if "fingerprint" in about else described)
    except ValueError:  # it has no such numbers: files without fingerprints are of one section
        fits = False
    if not fits:
        refuse_artifact(path, str(about.get("robot")), robot, policy)
    if ends is not None:
        check_ends(network, ends, str(path))
    return network, about


def check_ends(network: Network, ends: tuple[int, int], what: str = "the network") -> None:
    """Raise ValueError unless a network has these numbers of inputs and outputs."""
    found = network.sizes[0], network.sizes[-1]
    if found != ends:
        raise ValueError(
            f"{what} must have {ends[0]} inputs and {ends[1]} outputs, it has {found[0]} and "
            f"{found[1]}"
        )


def _same(one: ndarray, other: ndarray) -> bool:
    if "U" in (one.dtype.kind, other.dtype.kind):
        return str(one) == str(other)
    return one.shape == other.shape and np.allclose(one, other, rtol=1e-9, atol=0)


def absorbed(network: Network) -> list[tuple[ndarray, ndarray]]:
    """Weights and biases of the layers between inputs and outputs that are not scaled."""
    weights = [np.array(w, float) for w in network.weights]
    biases = [np.array(b, float) for b in network.biases]
    weights[0] /= network.inputs.half
    biases[0] -= weights[0] @ network.inputs.centre
    weights[-1] *= network.outputs.half[:, None]
    biases[-1] = network.outputs.restore(biases[-1])
    return list(zip(weights, biases, strict=True))


def refuse_inputs(wanted: str, inputs: ndarray) -> NoReturn:
    """Raise ValueError for inputs that do not have the shape `wanted`."""
    raise ValueError(f"the network needs inputs of shape {wanted}, got {np.shape(inputs)}")
