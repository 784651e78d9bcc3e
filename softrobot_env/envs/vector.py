"""Tip tracking with many robots at once."""

from collections.abc import Callable
from functools import partial
from sys import maxsize
from typing import Any, ClassVar, NoReturn

import gymnasium
import numpy as np
from gymnasium.vector import AutoresetMode
from gymnasium.vector.utils import batch_space
from numpy import ndarray

from softrobot_env.core.arrays import HOST, HostArrays, namespace
from softrobot_env.core.interfaces import Seen
from softrobot_env.core.records import check_argument
from softrobot_env.robots.variations import VARIATIONS, neutral
from softrobot_env.tasks import Task

from .config import VECTOR, EnvConfig
from .disturbances import Periphery, reported_variation, rounded
from .observations.table import Sources, arrays, reads
from .options import (
    ResetOptions,
    checked_actions,
    parse_seeds,
    parse_variation,
    seed_generators,
    take_mask,
)
from .parts import EpisodeSpec, SimulatedParts
from .reference import ReferenceTable
from .simulation import warp_limits
from .simulation.batch import BatchSimulation


class _References:
    """References of n environments: a shared one, or one row each once they differ.

    Attributes:
        columns: By name, (rows * instants, size), row by row.
    """

    def __init__(self, count: int, shared: ReferenceTable, arrays: HostArrays) -> None:
        self._count, self._offset = count, np.zeros(count, np.int64)
        self._shared: ReferenceTable | None = shared
        self._instants, self._arrays = shared.last_index + 1, arrays
        self.columns = {name: arrays.real(column) for name, column in shared.rows().items()}

    def set(self, which: ndarray, table: ReferenceTable) -> None:
        """Set the reference of environments `which` (k,)."""
        if table is self._shared:
            return
        instants = table.last_index + 1
        if self._shared is not None or instants > self._instants:
            self._spread(max(instants, self._instants))
        robots = self._arrays.index(which)
        for name, values in table.rows().items():
            column = self._arrays.real(values)
            rows = self.columns[name].reshape(self._count, self._instants, -1)
            rows[robots, :instants] = column
            rows[robots, instants:] = column[-1]

    def _spread(self, instants: int) -> None:
        """Give every environment its own row of so many instants, in which the last one is held."""
        before = self._count if self._shared is None else 1
        for name, column in self.columns.items():
            kind, rows = namespace(column), column.reshape(before, self._instants, -1)
            held = kind.tile(rows[:, -1:], (1, instants - self._instants, 1))
            rows = kind.tile(kind.concatenate((rows, held), axis=1), (self._count // before, 1, 1))
            self.columns[name] = rows.reshape(self._count * instants, -1)
        self._shared, self._instants = None, instants
        self._offset = np.arange(self._count) * instants

    def at(self, index: ndarray) -> ndarray:
        """Rows of `columns` with the instants `index` (n,) of all environments."""
        return self._arrays.index(self._offset + index)

    def rows(self, name: str, at: ndarray) -> ndarray:
        """Rows (n, size) of a column."""
        return self._arrays.rows(self.columns[name], at)


class BatchEnv(gymnasium.vector.VectorEnv[Seen, ndarray, ndarray]):
    """Episodes of many robots at once: their start, end and restart.

    Subclasses define robots, observations and rewards by the hooks that follow `step`.

    Attributes:
        takes: Names of its options, see `config.EnvConfig`.
        config: The options.
        simulation: Of all.
        arrays: The kind of all arrays that are returned.
    """

    spec = EpisodeSpec()
    metadata: ClassVar = {"render_modes": [], "autoreset_mode": AutoresetMode.NEXT_STEP}
    takes: ClassVar[tuple[str, ...]]
    usual: ClassVar[dict[str, Any]] = {}
    arrays = HOST

    def _prepare(
        self, config: EnvConfig, observation: gymnasium.Space, action: gymnasium.Space
    ) -> None:
        """Store the options and the spaces of a single environment, before any episode."""
        self.config, self.num_envs = config, int(config.num_envs)
        self._mode = self.autoreset_mode = AutoresetMode(config.autoreset_mode)
        self.metadata = {**self.metadata, "autoreset_mode": self._mode}
        self.single_observation_space, self.single_action_space = observation, action
        self.observation_space = batch_space(observation, self.num_envs)
        self.action_space = batch_space(action, self.num_envs)
        self._everyone = np.ones(self.num_envs, bool)
        self._index, self._last = np.zeros((2, self.num_envs), np.int64)
        self._done = np.ones(self.num_envs, bool)
        self._generators: list[np.random.Generator] = []
        self._started = False
        self._observation: Seen | None = None

    def __getstate__(self) -> NoReturn:
        raise TypeError(
            f"a {type(self).__name__} cannot be copied or pickled, as its simulations live in "
            "MuJoCo's memory: make another with the same arguments"
        )

    def reset(
        self, *, seed: int | list[int | None] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Seen, dict[str, Any]]:
        """Start episodes at rest.

        Args:
            seed: Seed of the first environment, others get consecutive ones; or one each.
            options: Those documented in the class, and `reset_mask` (n,) bool, the environments to
                reset, by default all.

        Raises:
            ValueError: A bad option; the message names what is allowed.
        """
        # Everything that can be refused comes before anything is changed.
        check_argument("options", options, dict | None)
        given = dict(options or {})
        which = take_mask(given, self.num_envs, self._started)
        begin, seeds = self._parsed(given), parse_seeds(seed, self.num_envs)
        seed_generators(self._generators, seeds)
        begin(which)
        self._started = True
        self._observation = self._observe(which)
        terms = {name: self.arrays.real(np.zeros(self.num_envs)) for name in self._reward.none}
        return self._observation, self._info_of(terms)

    def step(self, actions: ndarray) -> tuple[Seen, ndarray, ndarray, ndarray, dict[str, Any]]:
        """Apply actions (n, inputs) in [-1, 1] for one control period.

        Raises:
            ValueError: A wrong number of real numbers, or one beyond [-1, 1] by more than 1e-6.
            RuntimeError: This is a forked child of the process that made the environments.
            gymnasium.error.ResetNeeded: No episode was started, or one is over and autoreset is
                disabled.
        """
        if not self._started or (self._mode == AutoresetMode.DISABLED and self._done.any()):
            raise gymnasium.error.ResetNeeded("call reset() before step(): an episode is over")
        self.simulation.check_process()
        previous, before = self._action, self._observation
        actions = checked_actions(actions, self.action_space.shape, self.arrays)
        resets = self._mode == AutoresetMode.NEXT_STEP and self._done.any()
        ended = self._done.copy() if resets else None  # which this step resets
        self._act(actions, ended)
        diverged = self._advance(ended)
        self._index += 1
        if ended is not None:
            self._begin(np.flatnonzero(ended))
        self._observation = self._observe()
        failed, terms = diverged | self._outside(), self._terms(previous)
        if ended is not None:
            failed[ended] = False
            for term in terms.values():
                term[self._where(ended)] = 0.0
        failures = self._fail(failed, diverged, terms, before) if failed.any() else {}
        over = (self._index >= self._last) & ~failed
        info = self._info_of(terms, over) | failures
        self._done = failed | over
        if self._mode == AutoresetMode.SAME_STEP and self._done.any():
            info = self._restarted(info)
        flags = self.arrays.flags
        return self._observation, sum(terms.values()), flags(failed), flags(over), info

    def _advance(self, ended: ndarray | None) -> ndarray:
        """Integrate all except the ended (n,) bool; returns whether each (n,) diverged."""
        if ended is None:
            return self.simulation.advance()
        running = np.flatnonzero(~ended)
        return self.simulation.advance(running) & ~ended if len(running) else ~self._everyone

    def _where(self, mask: ndarray) -> ndarray:
        """Index that selects the environments of a mask (n,) bool from arrays."""
        return self.arrays.index(np.flatnonzero(mask))

    def _fail(
        self, failed: ndarray, diverged: ndarray, terms: dict[str, ndarray], before: Seen
    ) -> dict[str, ndarray]:
        """Penalise failed episodes, restore the previous observation, and report the failure."""
        texts, where = np.full(self.num_envs, None, object), self._where(failed)
        for i in np.flatnonzero(failed):
            texts[i] = self._what_failed(i, diverged[i], self._index[i] * self.control_period)
        for name, value in self._reward.failed_terms()[1].items():
            terms[name][where] = float(value)
        for value, last in zip(arrays(self._observation), arrays(before), strict=True):
            value[where] = last[where]
        return {"failure": texts, "_failure": self.arrays.flags(failed.copy())}

    def _restarted(self, last: dict[str, Any]) -> dict[str, Any]:
        """`info` of episodes that begin in the step that ended others with `info` `last`."""
        done = self.arrays.flags(self._done.copy())
        final = {"final_obs": self._observation, "_final_obs": done}
        final |= {"final_info": last, "_final_info": done}
        ended = np.flatnonzero(self._done)
        terms = {name: self.arrays.copy(last[name]) for name in self._reward.none}
        for term in terms.values():
            term[self._where(self._done)] = 0.0
        self._begin(ended)
        self._observation = self._observe(ended)
        return self._info_of(terms) | final

    def _masked(self, info: dict[str, Any]) -> dict[str, Any]:
        """`info` with masks that mark all environments."""
        everyone = self.arrays.flags(self._everyone.copy())
        return info | dict.fromkeys([f"_{name}" for name in info], everyone)

    # ------------------------------------------------------------------ of each class

    def _parsed(self, given: dict[str, Any]) -> Callable[[ndarray], None]:
        """Function that starts episodes of environments (k,) with a reset's checked options."""

    def _begin(self, which: ndarray) -> None:
        """Start episodes of the environments `which` (k,) without options."""

    def _act(self, actions: ndarray, ended: ndarray | None) -> None:
        """Apply actions (n, inputs), except those of the ended (n,) bool."""

    def _observe(self, started: ndarray | None = None) -> Seen:
        """New arrays (n, ...), which the caller may keep; also updates error and outputs.

        Args:
            started: (k,) int, the environments whose instant has changed since the last
                observation; by default all.
        """

    def _outside(self) -> ndarray:
        """(n,) bool, which robots failed without a divergence."""

    def _terms(self, previous: ndarray) -> dict[str, ndarray]:
        """Terms (n,) of the reward, given the previous actions (n, inputs)."""

    def _what_failed(self, i: int, diverged: bool, time: float) -> str:
        """Why the episode of environment `i` failed at a time [s]."""

    def _info_of(self, terms: dict[str, Any], over: ndarray | None = None) -> dict[str, Any]:
        """`info` of this instant, with terms of the reward and which (n,) bool are over."""


class VectorTrackingEnv(BatchEnv, gymnasium.vector.VectorEnv[Seen, ndarray, ndarray]):
    """n times `TrackingEnv`, simulated on a thread pool: the same episodes, step for step.

    Spaces, observations, rewards and options are those of the single environment, stacked along a
    first axis; `info` holds stacked arrays, with the masks of Gymnasium's convention.

    Autoreset is one of Gymnasium's modes: by default the step after an episode's last one resets
    it, ignoring its action ("next step"); "same step" gives the last observation in
    `info["final_obs"]`; without autoreset ("disabled") call
    `reset(options={"reset_mask": mask})`.

    Simulations run on threads of the process that created them: in a forked child `reset` and
    `step` raise RuntimeError (start the child with "spawn"), and an environment can be neither
    copied nor pickled (create another with the same arguments).

    With `backend="warp"` MuJoCo Warp simulates the robots on a `device`, and observations, rewards,
    flags and numbers in `info` are tensors of PyTorch there. Actions may be tensors or arrays.
    Docs: docs/howto/gpu.md.

    Options of `reset` are those of `TrackingEnv.reset`, the same for all; values in `vary` may also
    be arrays (n,).

    Attributes:
        takes: Names of its options, see `config.EnvConfig`.
        config: The options.
        simulation: Of all robots, a `BatchSimulation` or a `WarpBatch`.
        arrays: Kind of the returned arrays.
        task, twin, control_period, input_scale, vector_layout, reading: See `TrackingEnv`.
    """

    takes: ClassVar = VECTOR

    def __init__(self, num_envs: int = 1, task: str | Task = "swing", **options: Any) -> None:
        """Build the environments.

        Args:
            num_envs: Their number n.
            task: A task or its name.
            **options: Those named in `VectorTrackingEnv.takes`, see `config.EnvConfig`, and those
                of a task given by name.

        Raises:
            ValueError: An option out of range; the message names what is allowed.
            ImportError: A package of the backend is not installed; the message says how to install
                it.
            TypeError: An unknown option.
        """
        config = EnvConfig.of(type(self), {"num_envs": num_envs, "task": task, **options})
        self._on_device, device = config.backend == "warp", config.device
        if self._on_device:
            device = warp_limits.checked_device(device)
            warp_limits.check_options(config.threads, config.integrator, config.accuracy)
        elif device is not None:
            raise ValueError(f"device {device!r} is for backend='warp'; MuJoCo has threads")
        parts = SimulatedParts(config)
        parts.show_in(self)
        self._prepare(config, parts.observation_space, parts.action_space)
        self._most_steps = config.max_episode_steps or maxsize
        self.max_episode_steps = min(parts.reference.last_index, self._most_steps)
        self.twin, self._servos = parts.twin, parts.servos(self.num_envs)
        nominal, error = parts.plant.nominal, parts.plant.discretization_error
        self._discretization = np.full(self.num_envs, error)
        if self._on_device:
            warp_limits.check_robot(nominal, config.randomization)
            self.simulation = warp_limits.make_batch(nominal, self.num_envs, device)
        else:
            self.simulation = BatchSimulation(nominal, self.num_envs, config.threads)
        self.arrays = self.simulation.arrays
        self._target = self.simulation.ctrl
        if self._servos is not None:
            self.simulation.drive_by(self._servos)
            self._target = self._servos.command
        # State of the episodes, and values that a step would otherwise look up.
        n = self.num_envs
        self._references = _References(n, parts.reference, self.arrays)
        self._command = parts.inputs.per_action(self.arrays).command
        self._action = self.arrays.real(np.zeros(self.action_space.shape))
        self._variation = {name: np.full(n, value) for name, value in neutral().items()}
        self._exact = parts.plant.readout(self.simulation, self._servos)
        self._periphery = Periphery(parts, n, self.arrays)
        self._measure()
        self._usual = parts.parse_options({})

    def _measure(self) -> None:
        """Connect the measurements, through the existing sensors."""
        self._readout, references = self._periphery.readout(self._exact), self._references
        sources = Sources(
            self._readout,
            lambda column: lambda: references.rows(column, self._at),
            lambda: self.arrays.copy(self._action),
        )
        self._reads, view = reads(self._parts.observed, sources), self._parts.view
        self._view = view if view is None or self.arrays is HOST else view.on(self.arrays)

    # ------------------------------------------------------------------ episodes

    def _parsed(self, given: dict[str, Any]) -> Callable[[ndarray], None]:
        variation = None
        if "vary" in given:
            variation = parse_variation(given.pop("vary"), self.num_envs, self.control_period)
        parsed = self._parts.parse_options(given)
        if variation is not None:
            self._parts.check_variation(variation)
            for name, value in neutral().items():  # including variations registered later
                self._variation.setdefault(name, np.full(self.num_envs, value))
            if self._on_device:
                odd = (n for n, v in variation.items() if np.any(v != VARIATIONS[n].neutral))
                warp_limits.check_varied(self._parts.plant.nominal, odd)
        self._parts.beginning(parsed)
        return partial(self._start, parsed, variation)

    def _begin(self, which: ndarray) -> None:
        self._start(self._usual, None, which)

    def _start(
        self, options: ResetOptions, variation: dict[str, ndarray] | None, which: ndarray
    ) -> None:
        """Start episodes of the environments `which` (k,).

        Args:
            options: Of all of them.
            variation: Variation of their robots; None for nominal or randomized ones.
            which: The environments.
        """
        starts = []
        for some in which[:, None] if self._parts.is_sampled(options) else [which]:
            own = self._parts.beginning(self._parts.sampled(options, self._generators[some[0]]))
            self._references.set(some, own.reference)
            self._last[some] = min(own.reference.last_index, self._most_steps)
            starts += [own.start] * len(some)
        _, action, command, posture = map(np.array, zip(*starts, strict=True))
        for name, values in self._variation.items():
            usual = VARIATIONS[name].neutral
            values[which] = usual if variation is None else variation[name][which]
        if variation is None and self.config.randomization is not None:
            for i in which:
                randomized = self.config.randomization.draw(self._generators[i])
                for name, value in rounded(randomized, self.control_period).items():
                    self._variation[name][i] = value
        own = {n: v[which] for n, v in self._variation.items() if VARIATIONS[n].apply is not None}
        self.simulation.vary(which, own)
        command = self._periphery.start_drives(which, self._variation, command)
        if self._servos is not None:
            self._servos.start(command, which)
            command = self.arrays.host(self._servos.horn)[which]
        self.simulation.reset(which, posture, command)
        how = which, self._variation, self._generators, self._exact
        if self._periphery.start_sensors(*how):
            self._measure()
        self._index[which] = 0
        self._action[self.arrays.index(which)] = self.arrays.real(action)
        self._done[which] = False

    # ------------------------------------------------------------------ steps

    def _act(self, actions: ndarray, ended: ndarray | None) -> None:
        self._action = self._parts.wanted(actions, self._action)
        if ended is not None:
            self._action[self._where(ended)] = 0.0
        command, drives = self._command(self._action), self._periphery.drives
        self._target[:] = command if drives is None else drives.apply(command)

    def _outside(self) -> ndarray:
        return self._exact.outside

    def _terms(self, previous: ndarray) -> dict[str, ndarray]:
        return self._reward.batch_terms(self._error, self._action, previous, self._exact)

    def _what_failed(self, i: int, diverged: bool, time: float) -> str:
        if diverged:
            return f"simulation diverged in the control period ending at t = {time:.3f} s"
        return self._exact.what_left(i, time)

    # ------------------------------------------------------------------ read-outs

    def _observe(self, started: ndarray | None = None) -> Seen:
        self._readout.update(started)
        self._at = self._references.at(self._index)
        gap = self._exact.tip - self._references.rows("position", self._at)
        self._error = namespace(gap).einsum("ij,ij->i", gap, gap) ** 0.5
        seen = {name: read() for name, read in self._reads}
        return seen if self._view is None else self._view(seen)

    def _info_of(self, terms: dict[str, Any], over: ndarray | None = None) -> dict[str, Any]:
        info: dict[str, Any] = {
            "time": self.arrays.real(self._index * self.control_period),
            "error": self._error,
            "tendon_tension": self._exact.tendon_tension(),
            "tendon_length": self._exact.true_length(),
            **terms,
        }
        estimate = self.simulation.integration_error
        if estimate is not None:
            info["integration_error"] = estimate
            info["discretization_error"] = self.arrays.real(self._discretization.copy())
        if self.config.randomization is not None:
            own = reported_variation(self._variation)
            info |= {name: self.arrays.real(value) for name, value in own.items()}
        info = self._masked(info)
        if self._readout.truth is not None:
            truth, periphery = self._readout.truth(), self._periphery
            sensed = self._everyone if periphery.cameras is not None else periphery.noise.noisy
            info |= truth | {f"_{name}": self.arrays.flags(sensed.copy()) for name in truth}
        return info
