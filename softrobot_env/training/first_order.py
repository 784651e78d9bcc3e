"""First-order policy learning: short-horizon actor-critic (Xu et al., ICLR 2022).

A policy acts in environments for some control periods at a time. The rewards on the way, and what a
critic expects after them, are derived by the policy's weights through the motion. Derivatives of
single periods are kept with each such segment, so that the policy can be changed several times by
the latest of them: near a segment it moves as the derivatives say, without further simulation.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Annotated, Any, NamedTuple

import numpy as np
import torch
from numpy import ndarray
from torch import Tensor, nn

from softrobot_env.core.arrays import TorchArrays
from softrobot_env.core.interfaces import ProgressCallback, quiet
from softrobot_env.core.motion import State
from softrobot_env.core.records import Count, NotNegative, Positive, Range, Record, Share
from softrobot_env.envs.tracking import TrackingEnv
from softrobot_env.gradients import Motion, Rollout
from softrobot_env.learned.network import Network
from softrobot_env.scene.chain import mean_curvature
from softrobot_env.tasks import Task

from .artifacts import as_network, figures, new_layers, save
from .references import training_of
from .request import Metrics, TrainingRequest
from .rl_config import numbers_of, wanted_in

#: Of the moving averages of Adam, as published, and the norm that gradients are cut to.
_BETAS, _NORM = (0.7, 0.95), 1.0

#: Of the last layer at the start, so that a policy begins by doing little; and of rate and
#: deviation at the end, over those at the start.
_SMALL, _LAST = 0.01, 0.02

#: Square [m2] that is added to that of an error, which has no derivative at zero.
_TINY = 1e-14

#: What a policy may see of the robot.
_SEEN = ("tip_position", "tip_velocity", "curvature", "curvature_rate", "previous_action")

_REFERENCE = "reference"


@dataclass(frozen=True)
class FirstOrderConfig(Record, what="first-order learning"):
    """Size and settings of a training.

    Attributes:
        steps: Control periods that are simulated.
        horizon: Control periods of a segment, through which rewards are derived.
        segments: New ones between changes of the policy.
        kept: Latest segments that it is changed by.
        updates: Changes by them.
        hidden: Neurons of the hidden layers of policy and critic.
        rate: Learning rate; that of the policy falls to a fiftieth, as does the deviation.
        discount: Per step.
        far: Error, over the reach, by which it may exceed that at the start of an episode, which is
            begun anew then.
        trace: Weight [1] of later rewards in what the critic learns, 0 of the next one alone.
        deviation: Standard deviation [1] of what is added to outputs.
        fits: Changes of the critic after each of the policy's.
        trial_every: Steps between two checks.
        threads: Of torch.
    """

    steps: Count = 20_000
    horizon: Count = 32
    segments: Count = 2
    kept: Count = 4
    updates: Count = 2
    hidden: tuple[Count, ...] = (64, 64)
    rate: Positive = 2e-3
    discount: Annotated[float, Range("from 0 to below 1", lambda x: 0 <= x < 1)] = 0.98
    far: Positive = 0.2
    trace: Share = 0.95
    deviation: NotNegative = 0.1
    fits: Count = 4
    trial_every: Count = 5_000
    threads: Count = 1


#: Settings that are numbers, which can be set by name, and those of a training that shows that
#: everything runs.
NUMBERS, QUICK = numbers_of(FirstOrderConfig), {"steps": 512}

#: Random references among the tasks of the arm.
_DRAWN = 24


class Segment(NamedTuple):
    """A motion of one robot over some control periods, and its derivatives; tensors of float64.

    Later periods than `length` are filled up. A batch of them has one more dimension in front.

    Attributes:
        state: (h + 1, 2 nv), positions [rad] and velocities [rad/s] of the hinges.
        tip: (h + 1, 6), position [m] and velocity [m/s].
        action: (h + 1, n_inputs) [1], inputs in force over full scale.
        reference: (h + 1, size), columns of the reference.
        by_state, by_action: (h, 2 nv, 2 nv or n_inputs), of states by the ones before and actions.
        by_tip: (h + 1, 6, 2 nv), of the tip by the state.
        noise: (h, n_inputs), that was added to outputs.
        length: () of periods.
        goes_on: (), 1 unless the robot failed at the end.
    """

    state: Tensor
    tip: Tensor
    action: Tensor
    reference: Tensor
    by_state: Tensor
    by_action: Tensor
    by_tip: Tensor
    noise: Tensor
    length: Tensor
    goes_on: Tensor


class Course:
    """A task in its environment of vectors, whose motions are recorded with their derivatives.

    Attributes:
        env: The environment, with `observe_as="vector"`.
        mean: (k, nv) [1/m], from hinge angles to the curvatures that are seen.
    """

    def __init__(self, task: Task | str, **options: Any) -> None:
        """Prepare a task; `options` of `TrackingEnv`.

        Raises:
            ValueError: It has something of which no derivative is known, which is named.
        """
        self.env = env = TrackingEnv(task, **options, observe_as="vector")
        parts, names = env._parts, env.reading.names
        refused = [n for n in names if n not in _SEEN and not n.startswith(_REFERENCE)]
        refused += [f"reward_{term.name}" for term in env._reward.more]
        if env.config.randomization is not None:
            refused.append("randomization")
        if parts.twin is not None:
            refused.append("single periods in which servos turn")
        if refused:
            raise ValueError(f"no derivatives are known of {', '.join(refused)}")
        self._rollout = Rollout.of(TrackingEnv(env.task, **options, act_as="input"))
        scene = self._rollout.scene
        self.mean = torch.tensor(mean_curvature(scene.model, scene.layout, parts.plant.pieces).T)
        self._read = parts.view.reading.on(TorchArrays("cpu"))
        rows = {f"{_REFERENCE}_{name}": row for name, row in parts.reference.rows().items()}
        rows[_REFERENCE] = rows.pop(f"{_REFERENCE}_position")
        self._sizes = {n: rows[n].shape[1] for n in map(str, names) if n in rows}
        self._table = np.hstack([rows[name] for name in self._sizes])
        self._seen: ndarray | None = None
        self._error = 0.0  # at the start of the episode

    def record(
        self, act: Callable[[ndarray], tuple[ndarray, ndarray]], horizon: int, far: float
    ) -> Segment:
        """Go on for some control periods, or from the start after the end of an episode.

        Args:
            act: From what is seen (k,) to an action (n_inputs,) and what was added to it.
            horizon: Control periods, at most.
            far: [m], by which the error may be larger than at the start of an episode.

        Raises:
            IntegrationError: The motion diverged.
        """
        env = self.env
        if self._seen is None:
            self._seen, info = env.reset()
            self._error = info["error"]
        first, data, given, noise = env._index, env.data, [env._action_array], []
        start, over, failed = State(data.qpos.copy(), data.qvel.copy()), False, False
        while len(noise) < horizon and not over:
            action, added = act(self._seen)
            self._seen, _, failed, over, info = env.step(action)
            given.append(env._action_array)
            noise.append(added)
            over = over or failed or info["error"] > self._error + far
        if over:
            self._seen = None
        motion = self._rollout.run(np.array(given[1:]), start)
        return self._segment(motion, np.array(given), np.array(noise), first, horizon, failed)

    def _segment(
        self, motion: Motion, given: ndarray, noise: ndarray, first: int, horizon: int, failed: bool
    ) -> Segment:
        seen, n = motion.observed, len(noise)
        by_tip = np.hstack([motion.tip_by_states(name) for name in ("tip", "tip_velocity")])
        rows = (
            np.hstack([seen.position, seen.velocity]),
            np.hstack([seen.tip, seen.tip_velocity]),
            given,
            self._table[first : first + n + 1],
            *motion.linearised(),
            by_tip,
            noise,
        )
        filled = [np.concatenate([x, np.repeat(x[-1:], horizon - n, axis=0)]) for x in rows]
        return Segment(*map(torch.tensor, filled), torch.tensor(n), torch.tensor(1.0 - failed))

    def _columns(self, reference: Tensor) -> dict[str, Tensor]:
        """What is seen of the reference, of rows (..., size)."""
        parts = reference.split([*self._sizes.values()], dim=-1)
        return dict(zip(self._sizes, parts, strict=True))

    def vectors(self, state: Tensor, tip: Tensor, action: Tensor, reference: Tensor) -> Tensor:
        """What policies see (..., k) of such parts of a segment."""
        nv, axes = state.shape[-1] // 2, self.env.axes
        seen = {
            "tip_position": tip[..., :3][..., axes],
            "tip_velocity": tip[..., 3:][..., axes],
            "curvature": state[..., :nv] @ self.mean,
            "curvature_rate": state[..., nv:] @ self.mean,
            "previous_action": action,
            **self._columns(reference),
        }
        return self._read(torch.cat([seen[name] for name in self.env.reading.names], dim=-1))

    def reward(self, tip: Tensor, action: Tensor, before: Tensor, reference: Tensor) -> Tensor:
        """Of steps (n,)."""
        env, goal = self.env, self._columns(reference)[_REFERENCE]
        error = (((tip[:, :3][:, env.axes] - goal) ** 2).sum(dim=1) + _TINY).sqrt()
        return sum(env._reward.batch_terms(error, action, before).values())


class Seen(NamedTuple):
    """What was seen (h + 1, n, k) and earned (h, n) in n segments."""

    vectors: Tensor
    reward: Tensor


def _by(matrices: Tensor, vectors: Tensor) -> Tensor:
    """Products (n, i) of matrices (n, i, j) and vectors (n, j)."""
    return torch.einsum("nij,nj->ni", matrices, vectors)


class Learner:
    """A policy that learns on courses.

    Attributes:
        policy: Layers from vector to action.
        critic: Layers from vector to the discounted rewards that follow.
        steps: Control periods so far.
    """

    def __init__(self, courses: Sequence[Course], config: FirstOrderConfig, seed: int) -> None:
        """Begin with a policy that does little; the seed is of everything random."""
        torch.manual_seed(seed)
        torch.set_num_threads(config.threads)
        self._config, self._rng, self.steps = config, np.random.default_rng(seed), 0
        self._courses, self._kept, env = list(courses), [], courses[0].env
        count, outputs = len(env.reading.take), env.action_space.shape[0]
        self._change, self._far = env.reading.change, config.far * env.task.robot.reach
        self.policy = new_layers(count, config.hidden, outputs).double()
        self.critic = new_layers(count, config.hidden, 1).double()
        with torch.no_grad():
            self.policy[-1].weight *= _SMALL
            self.policy[-1].bias.zero_()
        layers = self.policy.parameters(), self.critic.parameters()
        adams = (torch.optim.Adam(x, config.rate, betas=_BETAS) for x in layers)
        self._adam, self._adam_critic = adams

    @property
    def _left(self) -> float:
        """Share of rate and deviation that is left."""
        return max(_LAST, 1 - self.steps / self._config.steps)

    def _act(self, seen: ndarray) -> tuple[ndarray, ndarray]:
        deviation = self._left * self._config.deviation
        noise = self._rng.normal(0.0, deviation, self.policy[-1].out_features)
        with torch.no_grad():
            output = self.policy(torch.tensor(seen, dtype=torch.float64)).numpy()
        return np.clip(output + noise, -1.0, 1.0), noise

    def move(self, batch: Segment) -> Seen:
        """How the policy moves near recorded segments."""
        course, share = self._courses[0], 1 - self._config.discount
        state, tip, action = batch.state[:, 0], batch.tip[:, 0], batch.action[:, 0]
        seen, earned = [course.vectors(state, tip, action, batch.reference[:, 0])], []
        for k in range(batch.noise.shape[1]):
            output = (self.policy(seen[-1]) + batch.noise[:, k]).clamp(-1.0, 1.0)
            before, action = action, (action + self._change * output).clamp(-1.0, 1.0)
            away = _by(batch.by_state[:, k], state - batch.state[:, k])
            away = away + _by(batch.by_action[:, k], action - batch.action[:, k + 1])
            state = batch.state[:, k + 1] + away
            tip = batch.tip[:, k + 1] + _by(batch.by_tip[:, k + 1], away)
            reference = batch.reference[:, k + 1]
            earned.append(share * course.reward(tip, action, before, reference))
            seen.append(course.vectors(state, tip, action, reference))
        return Seen(torch.stack(seen), torch.stack(earned))

    def total(self, batch: Segment, seen: Seen) -> Tensor:
        """Mean discounted rewards, and what the critic expects after them."""
        horizon, discount = len(seen.reward), self._config.discount
        within = torch.arange(horizon)[:, None] < batch.length
        weight = discount ** torch.arange(horizon, dtype=torch.float64)[:, None]
        last = seen.vectors[batch.length, torch.arange(len(batch.length))]
        after = batch.goes_on * discount**batch.length * self.critic(last)[:, 0]
        return ((within * weight * seen.reward).sum(dim=0) + after).mean()

    def record(self) -> Segment:
        """Act for some periods; the latest segments."""
        config = self._config
        for _ in range(config.segments):
            course = self._courses[int(self._rng.integers(len(self._courses)))]
            self._kept.append(course.record(self._act, config.horizon, self._far))
            self.steps += int(self._kept[-1].length)
        self._kept = self._kept[-config.kept :]
        return Segment(*map(torch.stack, zip(*self._kept, strict=True)))

    def improve(self) -> float:
        """Act, then change the policy and the critic; return the mean reward near what was kept."""
        config, batch = self._config, self.record()
        self._adam.param_groups[0]["lr"] = config.rate * self._left
        for _ in range(config.updates):
            seen = self.move(batch)
            total = self.total(batch, seen)
            self._adam.zero_grad()
            (-total).backward()
            nn.utils.clip_grad_norm_(self.policy.parameters(), _NORM)
            self._adam.step()
            self._fit(batch, Seen(*(x.detach() for x in seen)))
        return float(seen.reward.detach().mean()) / (1 - config.discount)

    def _fit(self, batch: Segment, seen: Seen) -> None:
        """Let the critic learn from what was seen and earned."""
        within = torch.arange(len(seen.reward))[:, None] < batch.length
        goals = self._goals(batch, seen)
        for _ in range(self._config.fits):
            wrong = (self.critic(seen.vectors[:-1])[..., 0] - goals)[within]
            self._adam_critic.zero_grad()
            (wrong**2).mean().backward()
            self._adam_critic.step()

    def _goals(self, batch: Segment, seen: Seen) -> Tensor:
        """What the critic should say (h, n) of what was seen before each step."""
        config, goals = self._config, torch.empty_like(seen.reward)
        with torch.no_grad():
            values = self.critic(seen.vectors)[1:, :, 0]
        later = values[-1]
        for k in reversed(range(len(goals))):
            mixed = (1 - config.trace) * values[k] + config.trace * later
            mixed = torch.where(batch.length == k + 1, values[k] * batch.goes_on, mixed)
            goals[k] = later = seen.reward[k] + config.discount * mixed
        return goals


def train(
    courses: Sequence[Course],
    config: FirstOrderConfig,
    seed: int = 0,
    show: ProgressCallback = quiet,
    watch: Callable[[int, Network], None] | None = None,
) -> Network:
    """Train from scratch.

    Args:
        courses: Of one robot, seen alike.
        config: Size and settings.
        seed: Of everything random.
        show: Shows the progress.
        watch: Called with steps and network before the training, about every `trial_every` steps
            and after it.

    Returns:
        The network after the last step.

    Raises:
        IntegrationError: A motion diverged.
    """
    learner, due = Learner(courses, config, seed), 0
    while learner.steps < config.steps:
        if watch is not None and learner.steps >= due:
            watch(learner.steps, as_network(learner.policy))
            due += config.trial_every
        earned = learner.improve()
        show(f"reward {earned:.4f}", min(learner.steps, config.steps), config.steps)
    network = as_network(learner.policy)
    if watch is not None:
        watch(learner.steps, network)
    return network


def run(request: TrainingRequest, show: ProgressCallback) -> Metrics:
    """Train as requested, and write the network.

    Raises:
        ValueError: A setting that does not exist or is no number, or a robot or a task of which no
            derivatives are known.
    """
    robot, rng = request.robot, np.random.default_rng([request.seed, 1])
    own = training_of(robot)
    config = FirstOrderConfig(**(QUICK if "quick" in request.settings else {}))
    wanted = wanted_in(request.settings, NUMBERS, own.tasks, robot.name)
    tasks = wanted.pop("tasks", own.tasks)
    config, courses = replace(config, **wanted), []
    for name in tasks:
        for task, options in own.learned_tasks(name, _DRAWN, rng):
            named = {"robot": robot} if isinstance(task, str) else {}
            courses.append(Course(task, **named, **options))
    network = train(courses, config, request.seed, show)
    reading = courses[0].env.reading
    save(network, request.path, request.seed, robot, reading)
    return figures(network, robot=robot, view=reading)
