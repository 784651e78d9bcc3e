"""Tip tracking with many robots at once."""

from collections.abc import Iterator
from dataclasses import replace
from sys import maxsize
from typing import Any, ClassVar, Literal, NamedTuple, NoReturn

import gymnasium
import numpy as np
from gymnasium.vector import AutoresetMode
from gymnasium.vector.utils import batch_space

from softrobot_env.core.arrays import HostArrays, namespace
from softrobot_env.core.interfaces import Seen
from softrobot_env.core.records import Count, Whole, check_argument
from softrobot_env.envs.disturbances import (
    NEUTRAL,
    Drives,
    SensorNoise,
    noise_seed,
    rounded,
    told_variation,
)
from softrobot_env.envs.observations.camera import Cameras, filmed
from softrobot_env.envs.observations.readouts import fitted, noisy
from softrobot_env.envs.observations.table import Sources, arrays
from softrobot_env.envs.options import (
    ResetOptions,
    checked_actions,
    parse_autoreset,
    parse_seeds,
    parse_variation,
    seed_generators,
    take_mask,
)
from softrobot_env.envs.randomization import Randomization
from softrobot_env.envs.reference import ReferenceTable
from softrobot_env.envs.rewards import NO_REWARD, TrackingReward
from softrobot_env.envs.setting import (
    DEFAULT_ACCURACY,
    SimulatedSetting,
    Start,
    check_task_options,
)
from softrobot_env.envs.simulation import warp_limits
from softrobot_env.envs.simulation.batch import BatchSimulation
from softrobot_env.envs.spec import EpisodeSpec
from softrobot_env.envs.tracking import DEFAULT_PERIOD
from softrobot_env.robots import VARIABLE, RobotParams
from softrobot_env.robots.twin import Twin
from softrobot_env.tasks import Task, remake_task

#: Reset options that hold for all environments of a call alike.


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


class VectorTrackingEnv(gymnasium.vector.VectorEnv[Seen, np.ndarray, np.ndarray]):
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
        simulation: Of all robots, a `BatchSimulation`, or a `WarpBatch`.
        arrays: The kind of all arrays that are returned.
        task, twin, control_period, input_scale, vector_layout, reading: As of `TrackingEnv`.
    """

    spec = EpisodeSpec()

    metadata: ClassVar = {"render_modes": [], "autoreset_mode": AutoresetMode.NEXT_STEP}

    def __init__(
        self,
        num_envs: int = 1,
        task: str | Task = "swing",
        *,
        robot: str | RobotParams | None = None,
        twin: Twin | int | None = None,
        control_period: float = DEFAULT_PERIOD,
        observe: tuple[str, ...] | str | None = None,
        preview: tuple[float, ...] = (0.05, 0.1, 0.2, 0.4),
        observe_as: str = "dict",
        act_as: str | None = None,
        reward: TrackingReward | str | None = None,
        randomization: Randomization | None = None,
        threads: int = 0,
        backend: str = "mujoco",
        device: str | None = None,
        max_episode_steps: int | None = None,
        autoreset_mode: AutoresetMode | str = AutoresetMode.NEXT_STEP,
        pieces: int | tuple[int, ...] | None = None,
        rule: str | None = None,
        timestep: float | None = None,
        integrator: str | None = None,
        accuracy: float | str = DEFAULT_ACCURACY,
        render_mode: None = None,
        **task_options: float,
    ) -> None:
        """Build the environments.

        Args:
            num_envs: Their number n.
            task, robot, twin, control_period, observe, preview, observe_as, act_as, reward,
                randomization: As those of `TrackingEnv`.
            threads: Of the pool, 0 for as many as have enough to do.
            backend: "mujoco", or "warp" (extra `gpu`).
            device: Of the backend "warp": "cuda:0" or "cpu"; the first CUDA device unless given.
            max_episode_steps: After which an episode is truncated, if it is not over before.
            autoreset_mode: One of `AutoresetMode`, or its value.
            pieces, rule, timestep, integrator, accuracy: As those of `TrackingEnv`.
            render_mode: None; many environments are not drawn.
            **task_options: As those of `TrackingEnv`.

        Raises:
            ValueError: An argument out of range; the message names what is allowed.
            ImportError: What the backend needs is not installed; says how to install it.
            TypeError: An unknown argument.
        """
        check_task_options(type(self), task, robot, task_options)
        check_argument("render_mode", render_mode, type(None))
        check_argument("backend", backend, Literal["mujoco", "warp"])
        check_argument("max_episode_steps", max_episode_steps, Count | None)
        check_argument("num_envs", num_envs, Count)
        check_argument("threads", threads, Whole)
        check_argument("randomization", randomization, Randomization | None)
        if backend == "warp":
            device = warp_limits.checked_device(device)
            warp_limits.check_options(threads, integrator, accuracy)
        elif device is not None:
            raise ValueError(f"device {device!r} is for backend='warp'; MuJoCo has threads")
        self._setting = setting = SimulatedSetting(
            task,
            task_options,
            robot=robot,
            twin=twin,
            control_period=control_period,
            observe=observe,
            preview=preview,
            observe_as=observe_as,
            act_as=act_as,
            reward=reward,
            pieces=pieces,
            rule=rule,
            timestep=timestep,
            integrator=integrator,
            accuracy=accuracy,
        )
        self._reward = setting.reward
        setting.check_randomization(randomization)
        self._randomization = randomization
        self._redrawn = isinstance(task, str) and "seed" not in task_options and setting.is_drawn
        self.num_envs, self.task = int(num_envs), setting.task
        self.control_period, self.input_scale = control_period, setting.inputs.input_scale
        self._mode = self.autoreset_mode = parse_autoreset(autoreset_mode)
        self.metadata = {**self.metadata, "autoreset_mode": self._mode}
        self._most_steps = max_episode_steps
        self.single_observation_space = setting.observation_space
        self.single_action_space = setting.action_space
        self.vector_layout, self.reading = setting.vector_layout, setting.reading
        self.observe_as, self.act_as = setting.observe_as, setting.act_as
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self.action_space = batch_space(self.single_action_space, num_envs)
        self.max_episode_steps = min(setting.reference.last_index, max_episode_steps or maxsize)
        self.twin, self._servos = setting.twin, setting.servos(self.num_envs)
        self._on_device = backend == "warp"
        if self._on_device:
            nominal = setting.plant.nominal
            warp_limits.check_robot(nominal, randomization)
            self.simulation = warp_limits.make_batch(nominal, self.num_envs, device)
        else:
            self.simulation = BatchSimulation(setting.plant.nominal, self.num_envs, threads)
        self.arrays = self.simulation.arrays
        self._target = self.simulation.ctrl
        if self._servos is not None:
            self.simulation.drive_by(self._servos)
            self._target = self._servos.command
        self._prepare()

    def __getstate__(self) -> NoReturn:
        raise TypeError(
            f"a {type(self).__name__} cannot be copied or pickled, as its simulations live in "
            "MuJoCo's memory: make another with the same arguments"
        )

    def _prepare(self) -> None:
        """State of the episodes, and what a step would otherwise look up."""
        n, m = self.num_envs, len(self.input_scale)
        setting = self._setting
        self._references = _References(n, setting.reference, self.arrays)
        self._command = setting.inputs.per_action(self.arrays).command
        self._nobody = np.zeros(n, dtype=bool)
        self._nobody.flags.writeable = False
        self._everyone = np.ones(n, dtype=bool)
        self._index = np.zeros(n, dtype=np.int64)
        self._last = np.zeros(n, dtype=np.int64)
        self._action = self.arrays.real(np.zeros((n, m)))
        self._done = np.ones(n, dtype=bool)
        self._variation = {name: np.full(n, value) for name, value in NEUTRAL.items()}
        self._drives: Drives | None = None
        self._generators: list[np.random.Generator] = []
        self._started = False
        self._observation: Seen | None = None
        self._exact = setting.plant.readout(self.simulation, self._servos)
        self._noise: SensorNoise | None = None
        self._cameras, self._bank = self._make_cameras(), setting.bank(n)
        self._measure()
        self._usual = self._beginning(setting.parse_options({}), self.task)

    def _make_cameras(self) -> Cameras | None:
        """Cameras that err, or None."""
        twin = self.twin
        delay = 0 if twin is None else round(twin.camera_delay / self.control_period)
        if twin is None or (twin.camera_noise == 0 and delay == 0):
            return None
        start = self._setting.dimensions
        return Cameras(self.num_envs, twin.camera_noise, delay, self.control_period, start)

    def _measure(self) -> None:
        """Connect to what is measured, through the sensors that there are."""
        self._readout = self._exact
        if self._bank is not None:
            self._readout = fitted(self._readout, self._bank, slice(None))
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
        self._see = self._setting.observer(sources, self.arrays)

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
        check_argument("options", options, dict | None)
        given = dict(options or {})
        which = take_mask(given, self.num_envs, self._started)
        variation = None
        if "vary" in given:
            variation = parse_variation(given.pop("vary"), self.num_envs, self.control_period)
        parsed, seeds = self._setting.parse_options(given), parse_seeds(seed, self.num_envs)
        if variation is not None:
            self._setting.check_variation(variation)
            if self._on_device:
                warp_limits.check_variation(self._setting.plant.nominal, variation)
        beginning = self._beginning(parsed, parsed.changed(self.task))
        seed_generators(self._generators, seeds)
        self._begin(which, beginning, variation, self._redrawn and "seed" not in parsed.task)
        self._started = True
        self._observation = self._observe(which)
        return self._observation, self._info(self._no_reward())

    def _beginning(self, options: ResetOptions, task: Task) -> _Beginning:
        """How episodes of a task begin.

        Raises:
            ValueError: A bad option; the message names what is allowed.
        """
        reference = self._setting.reference_of(task) if task != self.task else None
        reference = self._setting.reference if reference is None else reference
        last = min(reference.last_index, self._most_steps or maxsize)
        return _Beginning(self._setting.start(options, task), reference, last)

    def _drawn(self, which: np.ndarray) -> Iterator[tuple[np.ndarray, _Beginning]]:
        """Beginnings of tasks that the environments `which` (k,) draw, each its own."""
        usual = self._setting.parse_options({})
        for i in which:
            seed = int(self._generators[i].integers(2**31))
            drawn = replace(remake_task(self.task, seed=seed), duration=self.task.duration)
            yield np.array([i]), self._beginning(usual, drawn)

    def _begin(
        self,
        which: np.ndarray,
        beginning: _Beginning,
        variation: dict[str, np.ndarray] | None = None,
        drawn: bool = False,
    ) -> None:
        """Start episodes of the environments `which` (k,).

        Args:
            which: The environments.
            beginning: Of all of them, unless each draws its own.
            variation: What robots they have; unless given, nominal or randomized ones.
            drawn: Whether each draws a task.
        """
        each = self._drawn(which) if drawn else [(which, beginning)]
        starts = []
        for some, own in each:
            self._references.set(some, own.reference)
            self._last[some] = own.last
            starts += [own.start] * len(some)
        action, command, posture = (np.array(parts) for parts in zip(*starts, strict=True))
        for name, values in self._variation.items():
            values[which] = NEUTRAL[name] if variation is None else variation[name][which]
        if variation is None and self._randomization is not None:
            for i in which:
                randomized = self._randomization.draw(self._generators[i])
                for name, value in rounded(randomized, self.control_period).items():
                    self._variation[name][i] = value
        self.simulation.vary(which, {name: self._variation[name][which] for name in VARIABLE})
        command = self._start_drives(which, command)
        if self._servos is not None:
            self._servos.start(command, which)
            command = self.arrays.host(self._servos.horn)[which]
        self.simulation.reset(which, posture, command)
        self._start_sensors(which)
        self._index[which] = 0
        wanted = self._setting.action_of(action)
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
            self._drives = Drives(self.num_envs, self._setting.most, self.arrays)
        self._drives.start(which, gain[which], delay[which], command)
        return self.arrays.host(self._drives.tension)[which]

    def _start_sensors(self, which: np.ndarray) -> None:
        """Start noise and cameras of the environments `which` (k,)."""
        scale = self._variation["sensor_noise"]
        if scale.any() != (self._noise is not None):
            noise = SensorNoise(self.num_envs, self._setting.noise_sizes) if scale.any() else None
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
            if self._bank is not None:
                sensed.append(noise_seed(self._generators[i]))
        if self._cameras is not None:
            self._exact.update()
            self._cameras.start(which, seeds, self.arrays.host(self._exact.tip)[which])
        if self._bank is not None:
            errors = self._variation["sensor_errors"][which].tolist()
            pairs = zip(errors, sensed, strict=True)
            built = [self._setting.built_sensors(*pair) for pair in pairs]
            self._bank.start(which, built, sensed, self._exact.shape()[which])

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
        if not self._started or (self._mode == AutoresetMode.DISABLED and self._done.any()):
            raise gymnasium.error.ResetNeeded("call reset() before step(): an episode is over")
        self.simulation.check_process()
        shape, previous = (self.num_envs, len(self.input_scale)), self._action
        actions = checked_actions(actions, shape, self.arrays)
        resets = self._mode == AutoresetMode.NEXT_STEP and self._done.any()
        ended = self._done.copy() if resets else None
        self._action = self._setting.wanted(actions, previous)
        if ended is not None:
            self._action[self._where(ended)] = 0.0
        command = self._command(self._action)
        self._target[:] = command if self._drives is None else self._drives.apply(command)
        failed = self._advance(ended)
        self._index += 1
        if ended is not None:
            self._begin(np.flatnonzero(ended), self._usual, drawn=self._redrawn)
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
        terms = self._reward.batch_terms(self._error, self._action, previous)
        failures = None
        if ended is not None:
            terminated[ended] = truncated[ended] = False
            for term in terms.values():
                term[self._where(ended)] = 0.0
        if terminated.any():
            failures = self._fail(terminated, failed, terms, before)
        info = self._info(terms)
        if failures is not None:
            info |= {"failure": failures, "_failure": self.arrays.flags(terminated.copy())}
        self._done = terminated | truncated
        if self._mode == AutoresetMode.SAME_STEP and self._done.any():
            info = self._restart(info)
        flags = self.arrays.flags
        return self._observation, sum(terms.values()), flags(terminated), flags(truncated), info

    def _where(self, mask: np.ndarray) -> np.ndarray:
        """What picks the environments of a mask (n,) bool out of arrays."""
        return self.arrays.index(np.flatnonzero(mask))

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
        for value, last in zip(arrays(self._observation), arrays(before), strict=True):
            value[where] = last[where]
        return failures

    def _what_failed(self, i: int, diverged: bool) -> str:
        time = self._index[i] * self.control_period
        if diverged:
            return f"simulation diverged in the control period ending at t = {time:.3f} s"
        return self._exact.what_left(i, time)

    def _restart(self, last: dict[str, Any]) -> dict[str, Any]:
        """Reset ended episodes within the step; `info` of the new ones, and `last` of the ends."""
        done = self.arrays.flags(self._done.copy())
        final = {"final_obs": self._observation, "_final_obs": done}
        final |= {"final_info": last, "_final_info": done}
        ended = np.flatnonzero(self._done)
        terms = {name: self.arrays.copy(last[name]) for name in NO_REWARD}
        for term in terms.values():
            term[self._where(self._done)] = 0.0
        self._begin(ended, self._usual, drawn=self._redrawn)
        self._observation = self._observe(ended)
        return self._info(terms) | final

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

    def _no_reward(self) -> dict[str, np.ndarray]:
        return {name: self.arrays.real(np.zeros(self.num_envs)) for name in NO_REWARD}

    def _info(self, terms: dict[str, np.ndarray]) -> dict[str, Any]:
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
        if self._randomization is not None:
            told = told_variation(self._variation)
            info |= {name: self.arrays.real(value) for name, value in told.items()}
        everyone = self.arrays.flags(self._everyone.copy())
        info |= dict.fromkeys([f"_{name}" for name in info], everyone)
        if self._readout.truth is not None:
            truth = self._readout.truth()
            sensed = self._everyone if self._cameras is not None else self._noise.noisy
            masks = {f"_{name}": self.arrays.flags(sensed.copy()) for name in truth}
            info |= truth | masks
        return info
