"""Models that are compared: the thesis', ours, and what one would take in their place."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Protocol

import numpy as np

from softrobot_env.learned.bayesian import train
from softrobot_env.learned.network import Dataset, Network
from softrobot_env.learned.reduction import THESIS, Record, ReducedModel, Settings, fit
from softrobot_env.learned.reduction.polynomials import Monomials
from softrobot_env.learned.reduction.records import delay_vectors
from softrobot_env.training.ssm import learn, smoothed

#: Of the dictionary of Koopman's operator, and coordinates of the larger linear model.
_KOOPMAN_ORDER, _LARGE = 3, 10

#: Hidden neurons, samples and steps of the network's training.
_HIDDEN, _SAMPLES, _STEPS = (20,), 4000, 60

Records = Sequence[Record]


class Model(Protocol):
    """What predicts outputs of a record from its first samples and its inputs.

    Attributes:
        delays: Number of the first samples that it needs.
    """

    delays: int

    def predict_record(self, record: Record) -> np.ndarray:
        """Outputs (t - delays + 1, o) from the last of the first samples on."""


@dataclass(frozen=True)
class Lifted:
    """Linear dynamics of monomials of a reduced model's coordinates, or a network's map of them.

    Attributes:
        base: The model whose coordinates, outputs and inputs are used.
        step: From coordinates (n,), what else it remembers, and inputs (m,) to the next of both.
        lift: What it remembers at first, from coordinates (n,).
    """

    base: ReducedModel
    step: Callable[[np.ndarray, np.ndarray], np.ndarray]
    lift: Callable[[np.ndarray], np.ndarray]

    @property
    def delays(self) -> int:
        """See `Model`."""
        return self.base.delays

    def predict_record(self, record: Record) -> np.ndarray:
        """See `Model`."""
        base, late = self.base, self.base.delays - 1
        rows = np.maximum(np.arange(record.samples) - base.lag, 0)
        inputs = base.reduced_inputs(record.inputs[rows])[late:]
        state = self.lift(base.encode(delay_vectors(record.outputs[: base.delays], base.delays))[0])
        states = np.empty((len(inputs), len(state)))
        with np.errstate(over="ignore", invalid="ignore"):
            for t, u in enumerate(inputs):
                states[t] = state
                state = self.step(state, u)
            return base.decode(states[:, : base.dimension])


def improved(decays: Records, forced: Records) -> ReducedModel:
    """Ours: products of coordinates and inputs up to order 3, refined on stretches of 1.5 s."""
    return learn(decays, forced)


def thesis(decays: Records, forced: Records) -> ReducedModel:
    """With the settings of Tab. 3.1."""
    return fit(decays, forced, THESIS)


def linear(dimension: int, decays: Records, forced: Records) -> ReducedModel:
    """A linear state space by regression (DMD with control; Proctor et al., SIADS 15, 2016)."""
    settings = Settings(
        order=1, input_order=1, mixed=False, shape_order=1, dimension=dimension, delays=8
    )
    return fit([smoothed(r) for r in decays], [smoothed(r) for r in forced], settings)


def koopman(decays: Records, forced: Records) -> Lifted:
    """Extended DMD with control: monomials of the coordinates move linearly (Korda, Mezic 2018)."""
    base, x, v, then = _transitions(decays, forced)
    scale = base.scale[: base.dimension]
    dictionary = Monomials.of(base.dimension, 0, _KOOPMAN_ORDER, constant=True)
    # Coordinates come first, so that outputs are read off.
    order = np.argsort(dictionary.powers.sum(axis=1) != 1, kind="stable")
    lifted, after = (dictionary(values / scale)[:, order] for values in (x, then))
    solved = np.linalg.lstsq(np.hstack([lifted, v]), after, rcond=1e-10)[0].T
    count = lifted.shape[1]
    matrix, effect = solved[:, :count], solved[:, count:]

    def lift(at: np.ndarray) -> np.ndarray:
        return dictionary((at / scale)[None])[0, order]

    scaled = replace(
        base, shape=base.shape, scale=np.append(np.ones(base.dimension), base.scale[4:])
    )
    return Lifted(scaled, lambda state, u: matrix @ state + effect @ u, lift)


def neural(decays: Records, forced: Records) -> Lifted:
    """A small network of the change of the coordinates in a sample, trained with regularisation."""
    base, x, v, then = _transitions(decays, forced)
    chosen = np.random.default_rng(0).choice(len(x), min(_SAMPLES, len(x)), replace=False)
    data = Dataset(np.hstack([x, v])[chosen], (then - x)[chosen])
    network: Network = train(
        data.new_network(_HIDDEN, np.random.default_rng(0)), data, _STEPS
    ).network
    return Lifted(base, lambda state, u: state + network(np.append(state, u)), lambda at: at)


def _transitions(
    decays: Records, forced: Records
) -> tuple[ReducedModel, np.ndarray, np.ndarray, np.ndarray]:
    """Coordinates of the linear model, inputs, and the next coordinates, of all samples."""
    base = linear(2 * decays[0].outputs.shape[1], decays, forced)
    parts = []
    for record in (*decays, *forced):
        x = base.encode(delay_vectors(smoothed(record).outputs, base.delays))
        v = base.acting(record.inputs)[base.delays - 1 :]
        parts.append((x[:-1], v[:-1], x[1:]))
    return base, *(np.concatenate(part) for part in zip(*parts, strict=True))


#: Name -> how it is learned; and of whose motion.
OURS, THESIS_MODEL = "improved", "thesis"
MODELS: dict[str, Callable[[Records, Records], Model]] = {
    THESIS_MODEL: thesis,
    OURS: improved,
    "linear, 4 states": partial(linear, 4),
    "linear, 10 states": partial(linear, _LARGE),
    "Koopman (EDMD)": koopman,
    "network, 20 neurons": neural,
}
PHYSICAL = "PCC, nominal"
