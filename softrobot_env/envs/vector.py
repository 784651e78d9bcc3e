"""Tip tracking with many robots at once."""

from collections.abc import Iterable, Iterator
from dataclasses import replace
from sys import maxsize
from typing import Any, ClassVar, NamedTuple, NoReturn

import gymnasium
import numpy as np
from gymnasium.vector import AutoresetMode
from gymnasium.vector.utils import batch_space

from softrobot_env.core.arrays import HOST, HostArrays, namespace
from softrobot_env.core.interfaces import Seen
from softrobot_env.core.records import check_argument
from softrobot_env.envs.config import VECTOR, EnvConfig
from softrobot_env.envs.disturbances import (
    Drives,
    SensorNoise,
    noise_seed,
    reported_variation,
    rounded,
)
from softrobot_env.envs.observations.readouts import Cameras, filmed, fitted, noisy
from softrobot_env.envs.observations.table import Sources, arrays
from softrobot_env.envs.options import (
    ResetOptions,
    checked_actions,
    parse_seeds,
    parse_variation,
    seed_generators,
    take_mask,
)
from softrobot_env.envs.parts import EpisodeSpec, SimulatedParts, Start
from softrobot_env.envs.reference import ReferenceTable
from softrobot_env.envs.simulation import warp_limits
from softrobot_env.envs.simulation.batch import BatchSimulation
from softrobot_env.robots.variations import VARIATIONS, neutral
from softrobot_env.tasks import Task, remake_task


class _Beginning(NamedTuple):
    """How episodes begin: start, reference, and index of the last instant."""

    start: Start
    reference: ReferenceTable
    last: int


class _References:
    """References of n environments: one that they share, or a row each once they differ.

    Attributes:
        columns: By name, (rows * instants, size), row by row.
    """

    def __init__(self, count: int, shared: ReferenceTable, arrays: HostArrays) -> None:
        self._count, self._offset = count, np.zeros(count, dtype=np.int64)
        self._shared: ReferenceTable | None = shared
        self._instants, self._arrays = shared.last_index + 1, arrays
        self.columns = {name: arrays.real(column) for name, column in shared.rows().items()}

    def set(self, which: np.ndarray, table: ReferenceTable) -> None:
        """Let environments `which` (k,) have a reference."""
        if table is self._shared:
            return
        if self._shared is not None:
            self._part()
        instants = table.last_index + 1
        if instants > self._instants:
            self._lengthen(instants)
        robots = self._arrays.index(which)
        for name, values in table.rows().items():
            column = self._arrays.real(values)
            rows = self.columns[name].reshape(self._count, self._instants, -1)
            rows[robots, :instants] = column
            rows[robots, instants:] = column[-1]

    def _part(self) -> None:
        """Give every environment a row of its own."""
        self._shared = None
        self._offset = np.arange(self._count) * self._instants
        self.columns = {
            name: namespace(c).tile(c, (self._count, 1)) for name, c in self.columns.items()
        }

    def _lengthen(self, instants: int) -> None:
        more = instants - self._instants
        for name, column in self.columns.items():
            rows = column.reshape(self._count, self._instants, -1)
            kind = namespace(rows)
            longer = kind.concatenate((rows, kind.tile(rows[:, -1:], (1, more, 1))), axis=1)
            self.columns[name] = longer.reshape(self._count * instants, -1)
        self._instants = instants
        self._offset = np.arange(self._count) * instants

    def at(self, index: np.ndarray) -> np.ndarray:
        """Where in `columns` the instants `index` (n,) of all environments stand."""
        return self._arrays.index(self._offset + index)

    def rows(self, name: str, at: np.ndarray) -> np.ndarray:
        """Rows (n, size) of a column."""
        return self._arrays.rows(self.columns[name], at)


class BatchEnv(gymnasium.vector.VectorEnv[Seen, np.ndarray, np.ndarray]):
    """Episodes of many robots at once: what begins, ends and restarts them.

    Attributes:
        takes: Names of the options that it has, which `config.EnvConfig` explains.
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
        """Take the options and the spaces of one, before any episode has begun."""
        self.config, self.num_envs = config, int(config.num_envs)
        self._mode = self.autoreset_mode = AutoresetMode(config.autoreset_mode)
        self.metadata = {**self.metadata, "autoreset_mode": self._mode}
        self.single_observation_space, self.single_action_space = observation, action
        self.observation_space = batch_space(observation, self.num_envs)
        self.action_space = batch_space(action, self.num_envs)
        self._everyone = np.ones(self.num_envs, dtype=bool)
        self._index = np.zeros(self.num_envs, dtype=np.int64)
        self._done = np.ones(self.num_envs, dtype=bool)
        self._generators: list[np.random.Generator] = []
        self._started = False
        self._observation: Seen | None = None

    def __getstate__(self) -> NoReturn:
        raise TypeError(
            f"a {type(self).__name__} cannot be copied or pickled, as its simulations live in "
            "MuJoCo's memory: make another with the same arguments"
        )

    def _given(self, options: dict[str, Any] | None) -> tuple[dict[str, Any], np.ndarray]:
        """The options of a reset but the mask, and the environments (k,) that are reset."""
        check_argument("options", options, dict | None)
        given = dict(options or {})
        return given, take_mask(given, self.num_envs, self._started)

    def _check_running(self) -> None:
        if not self._started or (self._mode == AutoresetMode.DISABLED and self._done.any()):
            raise gymnasium.error.ResetNeeded("call reset() before step(): an episode is over")
        self.simulation.check_process()

    def _ended(self) -> np.ndarray | None:
        """(n,) bool, the environments that this step resets; None without any."""
        resets = self._mode == AutoresetMode.NEXT_STEP and self._done.any()
        return self._done.copy() if resets else None

    def _where(self, mask: np.ndarray) -> np.ndarray:
        """What picks the environments of a mask (n,) bool out of arrays."""
        return self.arrays.index(np.flatnonzero(mask))

    def _keep_last(self, failed: np.ndarray, before: Seen) -> None:
        """Show of failed episodes (n,) bool what was seen before."""
        where = self._where(failed)
        for value, last in zip(arrays(self._observation), arrays(before), strict=True):
            value[where] = last[where]

    def _restarted(self, last: dict[str, Any], names: Iterable[str]) -> dict[str, Any]:
        """`info` of episodes that begin in the step that ended others, whose `info` is `last`."""
        done = self.arrays.flags(self._done.copy())
        final = {"final_obs": self._observation, "_final_obs": done}
        final |= {"final_info": last, "_final_info": done}
        ended = np.flatnonzero(self._done)
        terms = {name: self.arrays.copy(last[name]) for name in names}
        for term in terms.values():
            term[self._where(self._done)] = 0.0
        self._begin_again(ended)
        return self._info_of(terms) | final

    def _begin_again(self, which: np.ndarray) -> None:
        """Start usual episodes of the environments `which` (k,), and observe."""
        raise NotImplementedError

    def _info_of(self, terms: dict[str, Any]) -> dict[str, Any]:
        """`info` of this instant, with terms of the reward."""
        raise NotImplementedError


class VectorTrackingEnv(BatchEnv, gymnasium.vector.VectorEnv[Seen, np.ndarray, np.ndarray]):
    """`TrackingEnv` n times, simulated on a thread pool: the same episodes, step for step.

    Spaces, observations, rewards and options are those of the single environment, stacked along a
    first axis; `info` holds stacked arrays, with the masks of Gymnasium's convention.

    Autoreset is one of Gymnasium's modes: by default the step after an episode's last one resets
    it, ignoring its action ("next step"); "same step" gives the last observation in
    `info["final_obs"]`; without autoreset ("disabled") call
    `reset(options={"reset_mask": mask})`.

    Simulations run on threads of the process that made them: in a forked child `reset` and `step`
    raise RuntimeError (start the child with "spawn"), and an environment can be neither copied nor
    pickled (make another with the same arguments).

    With `backend="warp"` MuJoCo Warp simulates the robots on a `device`, and observations, rewards,
    flags and numbers in `info` are tensors of PyTorch there. Actions may be tensors or arrays.
    Docs: docs/howto/gpu.md.

    Attributes:
        takes: Names of the options that it has, which `config.EnvConfig` explains.
        config: The options.
        simulation: Of all robots, a `BatchSimulation`, or a `WarpBatch`.
        arrays: The kind of all arrays that are returned.
        task, twin, control_period, input_scale, vector_layout, reading: As of `TrackingEnv`.
    """

    takes: ClassVar = VECTOR

    def __init__(self, num_envs: int = 1, task: str | Task = "swing", **options: Any) -> None:
        """Build the environments.

        Args:
            num_envs: Their number n.
            task: A task or its name.
            **options: Those that `VectorTrackingEnv.takes` names, see `config.EnvConfig`, and of a
                task given by name its own.

        Raises:
            ValueError: An option out of range; the message names what is allowed.
            ImportError: What the backend needs is not installed; says how to install it.
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
        nominal = parts.plant.nominal
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
        self._connect()

    def _connect(self) -> None:
        """State of the episodes, and what a step would otherwise look up."""
        n, m = self.num_envs, len(self.input_scale)
        parts = self._parts
        self._references = _References(n, parts.reference, self.arrays)
        self._command = parts.inputs.per_action(self.arrays).command
        self._nobody = np.zeros(n, dtype=bool)
        self._nobody.flags.writeable = False
        self._last = np.zeros(n, dtype=np.int64)
        self._action = self.arrays.real(np.zeros((n, m)))
        self._variation = {name: np.full(n, value) for name, value in neutral().items()}
        self._drives: Drives | None = None
        self._exact = parts.plant.readout(self.simulation, self._servos)
        self._noise: SensorNoise | None = None
        self._cameras, self._sensors = self._make_cameras(), parts.sensors(n)
        self._measure()
        self._usual = self._beginning(parts.parse_options({}), self.task)

    def _make_cameras(self) -> Cameras | None:
        """Cameras that err, or None."""
        twin = self.twin
        delay = 0 if twin is None else round(twin.camera_delay / self.control_period)
        if twin is None or (twin.camera_noise == 0 and delay == 0):
            return None
        start = self._parts.dimensions
        return Cameras(self.num_envs, twin.camera_noise, delay, self.control_period, start)

    def _measure(self) -> None:
        """Connect to what is measured, through the sensors that there are."""
        self._readout = self._exact
        if self._sensors is not None:
            self._readout = fitted(self._readout, self._sensors, slice(None))
        if self._cameras is not None:
            self._readout = filmed(self._readout, self._cameras)
        if self._noise is not None:
            self._readout = noisy(self._readout, self._noise, slice(None))
        references = self._references
        sources = Sources(
            self._readout,
            lambda column: lambda: references.rows(column, self._at),
            lambda: self.arrays.copy(self._action),
        )
        self._see = self._parts.observer(sources, self.arrays)

    # ------------------------------------------------------------------ episodes

    def reset(
        self,
        *,
        seed: int | list[int | None] | None = None,
        options: dict[str, Any] | None = None,
    ) -> tuple[Seen, dict[str, Any]]:
        """Start episodes at rest.

        Args:
            seed: Seed of the first environment, the others follow; or one each.
            options: As those of `TrackingEnv.reset`, the same for all; values in `vary` may also be
                arrays (n,). And `reset_mask` (n,) bool, the environments to
                reset, all unless given.

        Raises:
            ValueError: A bad option; the message names what is allowed.
        """
        # Everything that can be refused comes before anything is changed.
        given, which = self._given(options)
        variation = None
        if "vary" in given:
            variation = parse_variation(given.pop("vary"), self.num_envs, self.control_period)
        parsed, seeds = self._parts.parse_options(given), parse_seeds(seed, self.num_envs)
        if variation is not None:
            self._parts.check_variation(variation)
            for name, value in neutral().items():  # also what was registered since
                self._variation.setdefault(name, np.full(self.num_envs, value))
            if self._on_device:
                odd = (n for n, v in variation.items() if np.any(v != VARIATIONS[n].neutral))
                warp_limits.check_varied(self._parts.plant.nominal, odd)
        beginning = self._beginning(parsed, parsed.changed(self.task))
        seed_generators(self._generators, seeds)
        resampled = self._parts.is_resampled and "seed" not in parsed.task
        self._begin(which, beginning, variation, resampled)
        self._started = True
        self._observation = self._observe(which)
        terms = {name: self.arrays.real(np.zeros(self.num_envs)) for name in self._reward.none}
        return self._observation, self._info_of(terms)

    def _beginning(self, options: ResetOptions, task: Task) -> _Beginning:
        """How episodes of a task begin.

        Raises:
            ValueError: A bad option; the message names what is allowed.
        """
        reference = self._parts.reference_of(task) if task != self.task else None
        reference = self._parts.reference if reference is None else reference
        last = min(reference.last_index, self._most_steps)
        return _Beginning(self._parts.start(options, task), reference, last)

    def _sampled(self, which: np.ndarray) -> Iterator[tuple[np.ndarray, _Beginning]]:
        """Beginnings of tasks that the environments `which` (k,) sample, each its own."""
        usual = self._parts.parse_options({})
        for i in which:
            seed = int(self._generators[i].integers(2**31))
            task = replace(remake_task(self.task, seed=seed), duration=self.task.duration)
            yield np.array([i]), self._beginning(usual, task)

    def _begin(
        self,
        which: np.ndarray,
        beginning: _Beginning,
        variation: dict[str, np.ndarray] | None = None,
        resampled: bool = False,
    ) -> None:
        """Start episodes of the environments `which` (k,).

        Args:
            which: The environments.
            beginning: Of all of them, unless each samples its own.
            variation: What robots they have; unless given, nominal or randomized ones.
            resampled: Whether each samples a task.
        """
        each = self._sampled(which) if resampled else [(which, beginning)]
        starts = []
        for some, own in each:
            self._references.set(some, own.reference)
            self._last[some] = own.last
            starts += [own.start] * len(some)
        action, command, posture = (np.array(parts) for parts in zip(*starts, strict=True))
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
        command = self._start_drives(which, command)
        if self._servos is not None:
            self._servos.start(command, which)
            command = self.arrays.host(self._servos.horn)[which]
        self.simulation.reset(which, posture, command)
        self._start_sensors(which)
        self._index[which] = 0
        wanted = self._parts.action_of(action)
        self._action[self.arrays.index(which)] = self.arrays.real(wanted)
        self._done[which] = False

    def _start_drives(self, which: np.ndarray, command: np.ndarray) -> np.ndarray:
        """Start the drives of the environments `which` (k,); returns what they apply (k, m)."""
        gain = self._variation["tension_gain"]
        delay = np.rint(self._variation["delay"] / self.control_period).astype(int)
        if np.all(gain == 1) and not delay.any():
            self._drives = None  # all apply what is commanded
            return command
        if self._drives is None:
            self._drives = Drives(self.num_envs, self._parts.most, self.arrays)
        self._drives.start(which, gain[which], delay[which], command)
        return self.arrays.host(self._drives.tension)[which]

    def _start_sensors(self, which: np.ndarray) -> None:
        """Start noise and cameras of the environments `which` (k,)."""
        scale = self._variation["sensor_noise"]
        if scale.any() != (self._noise is not None):
            noise = SensorNoise(self.num_envs, self._parts.noise_sizes) if scale.any() else None
            self._noise = noise
            self._measure()
        seeds, sensed = [], []  # of cameras, and of curvature sensors
        for i in which.tolist():
            if self._noise is not None:
                seed = noise_seed(self._generators[i]) if scale[i] else None
                self._noise.start(i, scale[i], seed)
            if self._cameras is not None:
                blurred = self.twin.camera_noise > 0
                seeds.append(noise_seed(self._generators[i]) if blurred else 0)
            if self._sensors is not None:
                sensed.append(noise_seed(self._generators[i]))
        if self._cameras is not None:
            self._exact.update()
            self._cameras.start(which, seeds, self.arrays.host(self._exact.tip)[which])
        if self._sensors is not None:
            errors = self._variation["sensor_errors"][which].tolist()
            pairs = zip(errors, sensed, strict=True)
            built = [self._parts.built_sensors(*pair) for pair in pairs]
            self._sensors.start(which, built, sensed, self._exact.shape()[which])

    def step(
        self, actions: np.ndarray
    ) -> tuple[Seen, np.ndarray, np.ndarray, np.ndarray, dict[str, Any]]:
        """Apply actions (n, n_inputs) in [-1, 1] for one control period.

        Raises:
            ValueError: Not so many real numbers, or one beyond [-1, 1] by more than 1e-6.
            RuntimeError: This is a forked child of the process that made the environments.
            gymnasium.error.ResetNeeded: Nothing was started, or an episode is over and autoreset
                is disabled.
        """
        self._check_running()
        shape, previous = (self.num_envs, len(self.input_scale)), self._action
        actions = checked_actions(actions, shape, self.arrays)
        ended = self._ended()
        self._action = self._parts.wanted(actions, previous)
        if ended is not None:
            self._action[self._where(ended)] = 0.0
        command = self._command(self._action)
        self._target[:] = command if self._drives is None else self._drives.apply(command)
        failed = self._advance(ended)
        self._index += 1
        if ended is not None:
            self._begin_usual(np.flatnonzero(ended))
        return self._result(previous, failed, ended)

    def _advance(self, ended: np.ndarray | None) -> np.ndarray:
        """Integrate all but the ended (n,) bool; whether each (n,) diverged."""
        if ended is None:
            return self.simulation.advance()
        running = np.flatnonzero(~ended)
        return self.simulation.advance(running) & ~ended if len(running) else self._nobody

    def _result(
        self, previous: np.ndarray, failed: np.ndarray, ended: np.ndarray | None
    ) -> tuple[Seen, np.ndarray, np.ndarray, np.ndarray, dict[str, Any]]:
        before = self._observation
        self._observation = self._observe()
        terminated = failed | self._exact.outside
        truncated = (self._index >= self._last) & ~terminated
        terms = self._reward.batch_terms(self._error, self._action, previous, self._exact)
        failures = None
        if ended is not None:
            terminated[ended] = truncated[ended] = False
            for term in terms.values():
                term[self._where(ended)] = 0.0
        if terminated.any():
            failures = self._fail(terminated, failed, terms, before)
        info = self._info_of(terms)
        if failures is not None:
            info |= {"failure": failures, "_failure": self.arrays.flags(terminated.copy())}
        self._done = terminated | truncated
        if self._mode == AutoresetMode.SAME_STEP and self._done.any():
            info = self._restarted(info, self._reward.none)
        flags = self.arrays.flags
        return self._observation, sum(terms.values()), flags(terminated), flags(truncated), info

    def _begin_usual(self, which: np.ndarray) -> None:
        self._begin(which, self._usual, resampled=self._parts.is_resampled)

    def _begin_again(self, which: np.ndarray) -> None:
        self._begin_usual(which)
        self._observation = self._observe(which)

    def _fail(
        self,
        failed: np.ndarray,
        diverged: np.ndarray,
        terms: dict[str, np.ndarray],
        before: Seen,
    ) -> np.ndarray:
        """Penalise failed episodes, show what was seen before, and say what happened."""
        failures = np.full(self.num_envs, None, dtype=object)
        for i in np.flatnonzero(failed):
            failures[i] = self._what_failed(i, diverged[i])
        where = self._where(failed)
        for name, value in self._reward.failed_terms()[1].items():
            terms[name][where] = float(value)
        self._keep_last(failed, before)
        return failures

    def _what_failed(self, i: int, diverged: bool) -> str:
        time = self._index[i] * self.control_period
        if diverged:
            return f"simulation diverged in the control period ending at t = {time:.3f} s"
        return self._exact.what_left(i, time)

    # ------------------------------------------------------------------ read-outs

    def _observe(self, started: np.ndarray | None = None) -> Seen:
        """New arrays (n, ...), which the caller may keep; updates error and read-outs too.

        Args:
            started: (k,) int, the environments at another instant than in the last observation;
                all unless given.
        """
        self._readout.update(started)
        self._at = self._references.at(self._index)
        gap = self._exact.tip - self._references.rows("position", self._at)
        self._error = namespace(gap).einsum("ij,ij->i", gap, gap) ** 0.5
        return self._see()

    def _info_of(self, terms: dict[str, np.ndarray]) -> dict[str, Any]:
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
        if self.config.randomization is not None:
            own = reported_variation(self._variation)
            info |= {name: self.arrays.real(value) for name, value in own.items()}
        everyone = self.arrays.flags(self._everyone.copy())
        info |= dict.fromkeys([f"_{name}" for name in info], everyone)
        if self._readout.truth is not None:
            truth = self._readout.truth()
            sensed = self._everyone if self._cameras is not None else self._noise.noisy
            masks = {f"_{name}": self.arrays.flags(sensed.copy()) for name in truth}
            info |= truth | masks
        return info
