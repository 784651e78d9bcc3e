"""Environment steps per second, what the Python side of a step costs, and decisions.

The overhead of an environment is the time of `env.step` minus that of the bare simulation in it:
`mj_step` of Gymnasium's environments, a control period of ours. Ours and Gymnasium's own MuJoCo
environments are timed in turns within one run, each by its best block, so that their ratio does not
depend on the machine's load.
"""

import json
import subprocess
import sys
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import partial
from importlib.util import find_spec
from math import cos, hypot, pi, sin
from time import perf_counter, process_time, thread_time
from typing import Any

import gymnasium
import mujoco
import numpy as np
from numpy import ndarray

from softrobot_env.control.registry import (
    REDUCED_POLICIES,
    RIG_POLICIES,
    home_robot,
    installed_policies,
    make_policy,
    policy_environment,
)
from softrobot_env.envs.rendering import RenderError
from softrobot_env.envs.tracking import TrackingEnv
from softrobot_env.envs.vector import VectorTrackingEnv
from softrobot_env.evaluation.models.runs import best_of
from softrobot_env.registration import ENVIRONMENTS
from softrobot_env.robots import ARM, EXAMPLES, RobotParams, find_robot
from softrobot_env.robots.parameters import Drive
from softrobot_env.scene.simulation import Simulation
from studies.lab import Column, Job, Record, Study, TableMaker, quantity, table

#: Observations stacked in a decision for many.
STACKED = 256


@dataclass(frozen=True)
class Row(Record):
    """How long something takes; None where a field does not apply.

    Attributes:
        what: "env.step", "warp env.step", "robots", "eight tendons", "decision", "start" or
            "render".
        variant: Environment, policy, or what is waited for.
        n_envs, threads: Environments stepped at once, and by how many threads or processes.
        steps_per_second: Of all environments together.
        raw_steps_per_second: Of bare simulations in the same motion.
        ratio: Time of the bare simulation over that of the environment.
        overhead: [s] that a step of one environment takes beyond the simulation.
        overhead_ratio: The same over that of the yardstick.
        seconds: [s] of a step of one environment, of a decision (median), or of the wait.
        computed_steps: Of all environments, in a second of computing time of all threads.
        evaluations: Of all forces in a step of one environment, in the mean.
        error: [m], largest estimated error in time of any environment.
        dof: Degrees of freedom of the robot.
        period, longest, stacked: [s], of decisions: the control period, the computing time of the
            longest one, and the time of a call for 256 environments.
    """

    what: str
    variant: str
    n_envs: int | None = None
    threads: int | None = None
    steps_per_second: float | None = quantity("", ".0f", "steps/s", default=None)
    raw_steps_per_second: float | None = quantity("", ".0f", "raw/s", default=None)
    ratio: float | None = quantity("", ".2f", "raw/\nenv", default=None)
    overhead: float | None = quantity("µs", ".1f", "over-\nhead", default=None)
    overhead_ratio: float | None = quantity("", ".2f", "over-\nhead\nratio", default=None)
    seconds: float | None = None
    computed_steps: float | None = quantity("", ".0f", "steps/\nCPU s", default=None)
    evaluations: float | None = quantity("", ".1f", "evalu-\nations", default=None)
    error: float | None = quantity("mm", ".3f", "largest\nerror", default=None)
    dof: int | None = quantity("", "d", "DOF", default=None)
    period: float | None = quantity("ms", "g", default=None)
    longest: float | None = quantity("ms", ".3f", "longest,\ncomputing", default=None)
    stacked: float | None = quantity("ms", ".2f", f"{STACKED} stacked", default=None)


def step_row(
    what: str,
    variant: str,
    seconds: float,
    raw: float | None = None,
    *sizes: int,
    yardstick: float | None = None,
) -> Row:
    """Row of a step.

    Args:
        what, variant: Of the row.
        seconds: [s] of a step of all environments.
        raw: [s] of their bare simulations, or None.
        *sizes: Environments, and threads or processes; one of each unless given.
        yardstick: Overhead [s] to compare with.
    """
    count, threads = sizes or (1, 1)
    found = {"steps_per_second": count / seconds, "seconds": seconds / count}
    if raw is not None:
        found |= {"raw_steps_per_second": count / raw, "ratio": raw / seconds}
        found["overhead"] = (seconds - raw) / count
    if yardstick is not None:
        found["overhead_ratio"] = found["overhead"] / yardstick
    return Row(what, variant, count, threads, **found)


def mean_time(do: Callable[[], object], count: int) -> float:
    """Mean time [s] of so many calls."""
    begin = perf_counter()
    for _ in range(count):
        do()
    return (perf_counter() - begin) / count


def block_time(do: Callable[[], object], clock: Callable[[], float] = perf_counter) -> float:
    """Mean time [s] of a call in a block of 0.3 s, by `process_time` that of computing."""
    begin, count = clock(), 0
    while clock() - begin < _BLOCK:
        do()
        count += 1
    return (clock() - begin) / count


#: [s] of a block.
_BLOCK = 0.3


def _afresh(code: str, *words: str) -> dict[str, float]:
    """Times that code prints in a fresh interpreter.

    Raises:
        RuntimeError: It failed there.
    """
    command = [sys.executable, "-c", code, *words]
    done = subprocess.run(command, capture_output=True, text=True)
    if done.returncode:
        raise RuntimeError(f"{words}: {done.stderr.strip().splitlines()[-1]}")
    return json.loads(done.stdout)


# -------------------- decisions, from the first in a fresh process on, and for many

DECISION = "decision"

#: Policies of a quick run.
QUICK = ("imitation", "ppo")

#: Decisions one by one, and calls with stacked observations.
COUNT, _CALLS = 5000, 20

_DECIDE = """
import json, sys
sys.path[:0] = sys.argv[2:]
from studies.speed import decision_times
print(json.dumps(decision_times(sys.argv[1])))
"""


def measure_afresh(name: str) -> dict[str, float]:
    """`decision_times` in a fresh interpreter."""
    return _afresh(_DECIDE, name, *sys.path)


def decision_times(name: str) -> dict[str, float]:
    """How long the decisions of a policy take on its arm or rig, all but the first in motion.

    A policy that decides every few calls holds its action in the others.

    Returns:
        `period` [s] of the environment; `seconds`, the median over the decisions; `longest` [s], of
        all calls of `predict`, in computing time of this thread: other load does not count, the
        collection of garbage does; and `stacked` [s], the least of a call with as many stacked
        observations as `STACKED`.
    """
    robot = home_robot(name)
    env_id = "SoftRobot/ArmSwing-v0" if robot == ARM else "SoftRobot/RigTriangle-v0"
    env = gymnasium.make(env_id, observe="all", **policy_environment(name, robot)).unwrapped
    policy = make_policy(name, env)
    times, longest, ended = [], 0.0, True
    for _ in range(COUNT):
        if ended:
            (observation, _), state, called = env.reset(seed=0), None, 0
        computed, begin = thread_time(), perf_counter()
        action, state = policy.predict(observation, state)
        if called % policy.hold == 0:
            times.append(perf_counter() - begin)
        longest = max(longest, thread_time() - computed)
        observation, _, terminated, truncated, _ = env.step(action)
        called, ended = called + 1, terminated or truncated
    many = {key: np.stack([value] * STACKED) for key, value in observation.items()}
    state = policy.predict(many, None)[1]
    stacked, _ = best_of(lambda: policy.predict(many, state), _CALLS)
    found = {"period": env.control_period, "seconds": float(np.median(times))}
    return found | {"longest": longest, "stacked": stacked}


# -------------------- robots singly and in batches; bare: as many simulations in the same motion

ROBOT, _SWING = "robots", "SoftRobot/ArmSwing-v0"

#: Numbers of robots in a batch; the first ones are quick.
COUNTS = (1, 16, 256)

#: Control periods of the motion, share of full actions, and time [s] spent on a row.
_STRETCH, _SHARE, _BUDGET = 10, 0.2, 2.0


def _environments() -> dict[str, tuple[str, dict[str, Any]]]:
    """Arm, rig, the examples, and a rod of 60 degrees of freedom that bends and twists."""
    rod = find_robot("silicone_rod")
    wound = tuple(replace(tendon, turns=0.25) for tendon in rod.tendons)
    rod = replace(rod, name="rod_60", pieces=10, tendons=wound)
    any_robot = {name: find_robot(name) for name in EXAMPLES} | {rod.name: rod}
    others = {
        k: ("SoftRobot/Track-v0", {"robot": r, "task": "reach"}) for k, r in any_robot.items()
    }
    return {"arm": (_SWING, {}), "rig": (RIG, {}), **others}


def robot_rows(quick: bool) -> list[Row]:
    """A row for each robot and number of robots."""
    counts, budget = (COUNTS[:2], _BUDGET / 10) if quick else (COUNTS, _BUDGET)
    return [
        _batch_row(name, *made, count, budget)
        for name, made in list(_environments().items())[: 3 if quick else None]
        for count in counts
    ]


def _batch_row(name: str, env_id: str, options: dict[str, Any], count: int, budget: float) -> Row:
    """A row of robots in random motion, and of bare simulations in the same motion."""
    env = gymnasium.make_vec(env_id, num_envs=count, **options)
    actions = _SHARE * np.random.default_rng(0).uniform(-1, 1, env.action_space.shape)
    times: list[tuple[float, float]] = []
    begin = perf_counter()
    while len(times) < 3 or perf_counter() - begin < budget:
        stepped = _period_time(env, actions, lambda: env.step(actions)[2])
        times.append((_period_time(env, actions, env.simulation.advance), stepped))
    raw, seconds = np.min(times, axis=0).tolist()
    simulation, dof = env.simulation, env.simulation.scene.model.nv
    env.close()
    return replace(step_row(ROBOT, name, seconds, raw, count, simulation.threads), dof=dof)


def _period_time(env: VectorTrackingEnv, actions: ndarray, step: Callable[[], ndarray]) -> float:
    """Mean time [s] of a control period, after a first one that puts the actions in force.

    Raises:
        RuntimeError: A robot has failed.
    """
    env.reset(seed=0)
    env.step(actions)
    failed: list[ndarray] = []
    spent = mean_time(lambda: failed.append(step()), _STRETCH)
    if failed[-1].any():
        raise RuntimeError(f"{env.spec.id} failed while it was timed")
    return spent


# -------------------- many spatial robots with eight tendons

EIGHT = "eight tendons"

#: Environments at once, actions in a row, and control periods for which each is held.
_MANY, _ACTIONS, _HELD = 64, 6, 5


def eight_rows(quick: bool) -> list[Row]:
    """Rows of the hanging trunk with four tendons to the end of each section, by its drives."""
    drives = Drive(), Drive("length", speed=0.2)
    return [_eight_row(drive, 2 if quick else _ACTIONS) for drive in drives]


def _eight_row(drive: Drive, count: int) -> Row:
    """A row of actions by chance, so many one after another, of which the first is not timed."""
    options = {"num_envs": _MANY, "robot": _trunk_of_eight(drive), "task": "reach"}
    env = gymnasium.make_vec("SoftRobot/Track-v0", **options)
    rng, spent, before = np.random.default_rng(0), 0.0, 0
    env.reset(seed=0)
    for number in range(count):
        actions = _SHARE * rng.uniform(-1, 1, env.action_space.shape)
        begin = process_time()
        for _ in range(_HELD):
            terminated = env.step(actions)[2]
        if terminated.any():
            raise RuntimeError("a robot with eight tendons failed while it was timed")
        if number:
            spent += process_time() - begin
        else:
            before = env.simulation.evaluations.sum()
    steps = _MANY * _HELD * (count - 1)
    return Row(
        EIGHT,
        drive.kind,
        _MANY,
        env.simulation.threads,
        computed_steps=steps / spent,
        evaluations=float(env.simulation.evaluations.sum() - before) / steps,
        error=float(env.simulation.integration_error.max()),
        dof=env.simulation.scene.model.nv,
    )


def _trunk_of_eight(drive: Drive) -> RobotParams:
    """The hanging trunk, whose tendons of each section are four, and turned by 45 degrees."""
    trunk = find_robot("hanging_trunk")
    tendons = []
    for number, tendon in enumerate((trunk.tendons[0], trunk.tendons[-1])):
        for k in range(4):
            angle, radius = number * pi / 4 + k * pi / 2, hypot(*tendon.offset)
            place = radius * cos(angle), radius * sin(angle)
            tendons.append(replace(tendon, name=f"{'ab'[number]}{k + 1}", offset=place))
    if drive.kind == "length":
        tendons = [replace(tendon, stiffness=5e3, pretension=2.0) for tendon in tendons]
    return replace(trunk, name=f"trunk_of_eight_{drive.kind}", tendons=tuple(tendons), drive=drive)


# -------------------- what a user waits for: imports, the first environment, a rendered frame

#: Runs in a fresh interpreter, so that nothing is loaded before it is timed.
_START = """
import json, time
begin = time.perf_counter()
import gymnasium, mujoco
basis = time.perf_counter()
import softrobot_env
package = time.perf_counter()
env = gymnasium.make("SoftRobot/ArmSwing-v0")
first = time.perf_counter()
gymnasium.make("SoftRobot/ArmSwing-v0")
second = time.perf_counter()
print(json.dumps({
    "import mujoco, gymnasium": basis - begin,
    "import softrobot_env (after them)": package - basis,
    "gymnasium.make, first": first - package,
    "gymnasium.make, again": second - first,
}))
"""


def wait_rows(quick: bool) -> list[Row]:
    """What a user waits for: the least of several fresh interpreters, and a frame."""
    done = [_afresh(_START) for _ in range(2 if quick else 5)]
    rows = [Row("start", name, seconds=min(one[name] for one in done)) for name in done[0]]
    return [*rows, Row("render", "frame 640 x 480", seconds=frame_time())]


def frame_time() -> float | None:
    """Mean time [s] of one offscreen frame of 640 x 480, None without OpenGL."""
    env = TrackingEnv("swing", render_mode="rgb_array")
    env.reset()
    try:
        env.render()
    except RenderError:
        return None
    mean = block_time(env.render)
    env.close()
    return mean


# -------------------- many arms on MuJoCo Warp, where there is a CUDA device

WARP = "warp env.step"

#: Robots at once; control periods of a block, and blocks.
WARP_COUNTS, _WARP_STEPS, _BLOCKS = (256, 1024, 4096, 16384), 50, 5


def warp_rows(
    quick: bool, device: str = "cuda:0", counts: tuple[int, ...] = WARP_COUNTS
) -> list[Row]:
    """Rows by number of robots; or one row that says why nothing was measured."""
    missing = _missing(device)
    if missing is not None:
        return [Row(WARP, f"not measured: {missing}")]
    return [_warp_row(count, device, 1 if quick else _BLOCKS) for count in counts]


def _missing(device: str) -> str | None:
    """What keeps a device from being measured."""
    if find_spec("torch") is not None and device != "cpu":
        import torch

        if not torch.cuda.is_available():
            return "no CUDA device"
    if find_spec("mujoco_warp") is None or find_spec("torch") is None:
        return "no MuJoCo Warp"
    return None


def _warp_row(count: int, device: str, blocks: int) -> Row:
    """Row of the arm's environment, with actions and observations on the device."""
    import torch

    env = VectorTrackingEnv(count, "swing", backend="warp", device=device, observe_as="vector")
    env.reset(seed=0)
    actions = torch.zeros((count, len(env.input_scale)), device=device)

    def block() -> None:
        for _ in range(_WARP_STEPS):
            found = env.step(actions)
        found[1].sum().item()  # waits for the device

    block()  # loads what Warp and PyTorch compile
    least = min(mean_time(block, 1) for _ in range(blocks)) / _WARP_STEPS
    name = "cpu" if device == "cpu" else torch.cuda.get_device_name(device)
    return step_row(WARP, f"arm on {name}", least, None, count, 1)


# -------------------- the study

#: Gymnasium's environments to compare with; the first one is the yardstick.
YARDSTICKS = ("HalfCheetah-v5", "Reacher-v5", "InvertedDoublePendulum-v5")

#: Of the rig, its tasks differ in the reference alone.
RIG = "SoftRobot/RigTriangle-v0"

#: Control steps per block: short, so that some block of many runs undisturbed.
_STEPS = 100


def jobs(quick: bool) -> Iterator[Job]:
    """Single environments, many on MuJoCo Warp, batches of robots, decisions and waits;
    quickly fewer repeats."""
    yield "env.step", partial(_environment_rows, quick)
    yield "start", partial(wait_rows, quick)
    yield "warp", partial(warp_rows, quick)
    yield "robots", partial(robot_rows, quick)
    yield EIGHT, partial(eight_rows, quick)
    for name in [*installed_policies(), *RIG_POLICIES, *REDUCED_POLICIES]:
        if name in QUICK or not quick:
            yield f"decisions of {name}", partial(_decision_rows, name)


def _decision_rows(name: str) -> list[Row]:
    return [Row(DECISION, name, **measure_afresh(name))]


def _environment_rows(quick: bool) -> list[Row]:
    """Ours and Gymnasium's in turns, each by its best block."""
    contestants = {name: gymnasium.make(name) for name in (*YARDSTICKS, *ENVIRONMENTS, RIG)}
    rounds = range(20 if quick else 300)
    blocks = [[_time_block(env) for env in contestants.values()] for _ in rounds]
    times = dict(zip(contestants, np.min(blocks, axis=0).tolist(), strict=True))
    stepped, bare = times[YARDSTICKS[0]]
    return [step_row("env.step", name, *t, yardstick=stepped - bare) for name, t in times.items()]


def _time_block(env: gymnasium.Env) -> tuple[float, float]:
    """Times [s] per step, in one block of steps and in one of the bare simulations in them."""
    action = np.zeros(env.action_space.shape, dtype=np.float32)
    env.reset(seed=0)
    step_time = mean_time(lambda: env.step(action), _STEPS)
    env.reset(seed=0)
    return step_time, mean_time(_bare(env.unwrapped), _STEPS)


def _bare(env: gymnasium.Env) -> Callable[[], object]:
    """The simulation in a step of an environment that was reset, under its zero action."""
    model, data = env.model, env.data
    if not isinstance(env, TrackingEnv):
        data.ctrl[:] = 0.0
        return lambda: mujoco.mj_step(model, data, env.frame_skip)
    simulation = Simulation(env.scene)
    simulation.reset(data.qpos, np.zeros(model.nu))
    return simulation.advance


def tabled(what: str, *columns: str | Column, name: str = "") -> TableMaker:
    """A table of the rows of a kind, headed by it or by a name for what their variants are."""
    return table("", Column(name or what, "variant"), *columns, where={"what": what})


def _sizes(head: str) -> Column:
    return Column(head, lambda row: f"{row.n_envs} x {row.threads}", ">")


STUDY = Study(
    kinds=(Row,),
    jobs=jobs,
    tables=[
        tabled(
            *("env.step", "steps_per_second", "raw_steps_per_second"),
            *("ratio", "overhead", "overhead_ratio"),
        ),
        tabled(
            *(WARP, Column("robots", "n_envs", "d"), "steps_per_second"),
            name="many arms on MuJoCo Warp",
        ),
        tabled(
            *(ROBOT, "dof", _sizes("robots x\nthreads")),
            Column("µs a robot\nand period", "seconds", ".1f", "µs"),
            *("steps_per_second", "raw_steps_per_second", "ratio"),
            name="env.step, moving",
        ),
        tabled(
            *(EIGHT, "dof", "n_envs", "computed_steps", "evaluations", "error"),
            name=f"{EIGHT}, driven by",
        ),
        tabled(
            *(DECISION, "period", Column("decision µs,\nmedian", "seconds", ".1f", "µs")),
            *("longest", "stacked"),
        ),
        table(
            *("", Column("", "variant"), Column("ms (-: no OpenGL)", "seconds", ".1f", "ms")),
            where=lambda row: row.what in ("start", "render"),
        ),
    ],
    alone=True,
)
