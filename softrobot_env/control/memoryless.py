"""Policies whose action depends on the present observation only, for one or many environments."""

from abc import abstractmethod
from collections.abc import Callable
from typing import Any, ClassVar

import numpy as np
from numpy import ndarray

from softrobot_env.core.interfaces import Observation
from softrobot_env.learned.plain_inference import numba_is_loaded

from .base import NOT_COMPUTED, NOT_FINITE, Controller, Held, Said

#: Writes actions and codes for observations; all arrays are flat: (k * size,), float32 (k *
#: n_inputs,) and (k,).
Decide = Callable[[ndarray, ndarray, ndarray], None]


class Memoryless(Controller):
    """A policy that is a function of its observables; one call computes any number of decisions.

    The function is compiled if Numba is already loaded when the policy is made or unpickled, as it
    is after a simulation was made; otherwise it runs in plain NumPy, which gives the same result up
    to rounding, takes some 40 µs longer and avoids the import of Numba. Subclasses implement both,
    set `requires`, `sizes` and `n_inputs`, and then call `prepare`.

    Attributes:
        says: State for each code below `NOT_FINITE` that the functions return.
        n_inputs: Size of an action.
    """

    says: ClassVar[tuple[Said, ...]]
    n_inputs: int

    @abstractmethod
    def plain(self, observed: dict[str, ndarray]) -> tuple[ndarray, ndarray]:
        """Actions (k, n_inputs) in [-1, 1] and codes (k,) for finite observables (k, size)."""

    @abstractmethod
    def compiled(self) -> Decide:
        """The same as machine code, which checks itself for values that are not finite."""

    def prepare(self) -> None:
        """Choose a function and call it once, so that no decision waits for compilation."""
        self._function = self.compiled() if numba_is_loaded() else self._by_numpy
        self._width = sum(self.sizes[name] for name in self.requires)
        self._answers(np.zeros(self._width), 1)

    def __getstate__(self) -> dict[str, Any]:
        return {**vars(self), "_function": None}

    def __setstate__(self, state: dict[str, Any]) -> None:
        vars(self).update(state)
        self.prepare()

    def start(self, observation: Observation) -> Said:
        """Nothing is remembered."""
        return self.says[0]

    def act(self, observation: Observation, state: Said) -> tuple[ndarray, Said]:
        """The result of the function; the current action where that is not finite."""
        seen = np.concatenate([observation[name] for name in self.requires], dtype=float)
        actions, codes = self._answers(seen, 1)
        code = codes.item()
        if code < NOT_FINITE:
            return actions, self.says[code]
        return self._kept(observation, actions)

    _choose = act

    def _decide_stacked(
        self, observation: Observation, states: list[Any]
    ) -> tuple[ndarray, list[Any]]:
        """See `Controller`; the decisions that are due are made in one call."""
        if self.hold == 1:
            return self._choose_stacked(observation)
        due = [state is None or not state.left for state in states]
        shown = {name: observation[name][due] for name in self.requires}
        decided = zip(*self._choose_stacked(shown), strict=True)
        then = []
        for now, state in zip(due, states, strict=True):
            action, inner = next(decided) if now else (state.action, state.inner)
            then.append(Held(inner, action, self.hold - 1 if now else state.left - 1))
        return np.stack([state.action for state in then]), then

    def _choose_stacked(self, observation: Observation) -> tuple[ndarray, list[Said]]:
        """Actions (k, n_inputs) and states for stacked observations."""
        seen = np.concatenate([observation[name] for name in self.requires], axis=1, dtype=float)
        flat, codes = self._answers(seen.ravel(), len(seen))
        actions = flat.reshape(len(seen), self.n_inputs)
        states = [self.says[code] if code < NOT_FINITE else self.says[0] for code in codes.tolist()]
        for i in np.flatnonzero(codes >= NOT_FINITE):
            one = {name: observation[name][i] for name in self.requires}
            actions[i], states[i] = self._kept(one, actions[i])
        return actions, states

    def _kept(self, observation: Observation, action: ndarray) -> tuple[ndarray, Said]:
        """The current action, and why it is kept."""
        kept, why = self._failed(observation, action, None)
        return kept.astype(np.float32), Said(why.status)

    def _answers(self, observed: ndarray, count: int) -> tuple[ndarray, ndarray]:
        """Actions float32 (count * n_inputs,) and codes (count,)."""
        if len(observed) != count * self._width:
            raise ValueError(f"{type(self).__name__}: an observable has changed its size")
        actions = np.empty(count * self.n_inputs, np.float32)
        codes = np.empty(count, np.int64)
        self._function(observed, actions, codes)
        return actions, codes

    def _by_numpy(self, observed: ndarray, actions: ndarray, codes: ndarray) -> None:
        """`plain` with the signature of `Decide`."""
        rows = observed.reshape(len(codes), self._width)
        sound = np.isfinite(rows).all(axis=1)
        shown, at = {}, 0
        for name in self.requires:
            shown[name] = rows[sound, at : at + self.sizes[name]]
            at += self.sizes[name]
        wanted, said = self.plain(shown)
        actions.reshape(len(codes), self.n_inputs)[sound] = wanted
        codes[:] = NOT_FINITE
        codes[sound] = np.where(np.isfinite(wanted).all(axis=1), said, NOT_COMPUTED)
