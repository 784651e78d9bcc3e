"""The rows of the speed benchmark."""

from dataclasses import dataclass

from softrobot_env.benchmarks.records import Record


@dataclass(frozen=True)
class Row(Record):
    """How long something takes; None where a field does not apply.

    Attributes:
        what: "env.step", "moving", "vector env.step", "warp env.step", "robots", "decision",
            "scaling", "start" or "render".
        variant: Environment, policy, or what is waited for.
        n_envs, threads: Environments stepped at once, and by how many threads or processes.
        steps_per_second: Of all environments together.
        raw_steps_per_second: Of bare simulations in the same motion.
        ratio: Time of the bare simulation over that of the environment.
        overhead: [s] that a step of one environment takes beyond the simulation.
        overhead_ratio: The same over that of the yardstick.
        seconds: [s] of a step of one environment, of a decision (median), or of the wait.
        accuracy: That was asked for, as a share of the length [1].
        error, estimate: [m], largest distance of the tip from the truth in the motion, and what the
            environment itself tells.
        dof: Degrees of freedom of the robot.
        period, longest, stacked: [s], of decisions: the control period, the computing time of the
            longest one, and the time of a call for 256 environments.
        efficiency, started: Of several cores: the speed-up over their number, and the time [s]
            until processes had loaded what they need; `seconds` is then that of a job.
    """

    what: str
    variant: str
    n_envs: int | None = None
    threads: int | None = None
    steps_per_second: float | None = None
    raw_steps_per_second: float | None = None
    ratio: float | None = None
    overhead: float | None = None
    overhead_ratio: float | None = None
    seconds: float | None = None
    accuracy: float | None = None
    error: float | None = None
    estimate: float | None = None
    dof: int | None = None
    period: float | None = None
    longest: float | None = None
    stacked: float | None = None
    efficiency: float | None = None
    started: float | None = None


def step_row(
    what: str,
    variant: str,
    seconds: float,
    raw: float | None,
    *,
    count: int = 1,
    threads: int = 1,
    yardstick: float | None = None,
) -> Row:
    """Row of a step.

    Args:
        what, variant: Of the row.
        seconds: [s] of a step of all environments.
        raw: [s] of their bare simulations, or None.
        count, threads: Environments, and threads or processes.
        yardstick: Overhead [s] to compare with.
    """
    bare = {}
    if raw is not None:
        overhead = (seconds - raw) / count
        bare = {"raw_steps_per_second": count / raw, "ratio": raw / seconds, "overhead": overhead}
        bare |= {} if yardstick is None else {"overhead_ratio": overhead / yardstick}
    speed = {"steps_per_second": count / seconds, "seconds": seconds / count}
    return Row(what, variant, count, threads, **speed, **bare)
