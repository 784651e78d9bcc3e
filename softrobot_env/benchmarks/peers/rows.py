"""The rows of the comparison with other packages."""

from dataclasses import dataclass

from softrobot_env.benchmarks.records import Record

#: Who is compared; ours goes first in tables.
OURS = "softrobot_env"


@dataclass(frozen=True)
class Row(Record):
    """A motion, an environment, a ratio, or a note; None where a field does not apply.

    Attributes:
        kind: "motion", "environment", "ratio" or "note".
        package: What simulates; of a ratio and a note the peer.
        version: Of the package.
        model: Model or environment.
        n: Degrees of freedom.
        integrator: Of the motion.
        timestep, tolerance: [s] of fixed steps, or relative and absolute of adapted ones.
        e_mean, e_max: [m], distance of the tip from the converged motion.
        core_seconds: Computing time [s] of one core for a simulated second.
        compiled: Computing time [s] of the first call beyond that of a later one.
        period: [s] of a step of an environment.
        steps_per_second: Of an environment, by one core.
        value: Of a ratio: computing time of the peer over that of the fastest of ours with no
            larger mean error.
        text: Of a note; of a motion what it is compared with.
    """

    kind: str
    package: str
    version: str | None = None
    model: str | None = None
    n: int | None = None
    integrator: str | None = None
    timestep: float | None = None
    tolerance: float | None = None
    e_mean: float | None = None
    e_max: float | None = None
    core_seconds: float | None = None
    compiled: float | None = None
    period: float | None = None
    steps_per_second: float | None = None
    value: float | None = None
    text: str | None = None
