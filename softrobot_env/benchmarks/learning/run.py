"""Learning curves and figures of trained policies over several seeds."""

from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

from softrobot_env.benchmarks.learning.cases import CASES, CHAINS, IMITATION, load_run, run_chain
from softrobot_env.benchmarks.records import Record
from softrobot_env.core.jobs import Progress, quiet, run_in_processes
from softrobot_env.training.closed_loop_check import check
from softrobot_env.training.rl_config import DISTURBED

SEEDS = (0, 1, 2)

#: Where finished trainings are kept; they are not repeated.
FOLDER = Path("out") / "learning"

#: Processes that train at the same time, each on one core.
_PROCESSES = 2


@dataclass(frozen=True)
class Row(Record):
    """A training and closed-loop checks of its network; lengths in [m].

    Attributes:
        policy, seed: What was trained.
        minutes: That it took.
        curve: Closed-loop checks during the training, see `watch.Point`.
        swing_max, lshape_max: Largest error on the nominal robot.
        overshoot, settling_time: [1] and [s] of a step of 50 mm; None where it has none.
        worst_modulus: Largest error on swing and L-shape with another Young's modulus.
        worst: The same with all other robots and disturbances as well.
        failures, trials: Numbers of failed episodes and of all.
    """

    policy: str
    seed: int
    minutes: float
    curve: list[dict[str, Any]]
    swing_max: float
    lshape_max: float
    overshoot: float | None
    settling_time: float | None
    worst_modulus: float
    worst: float
    failures: int
    trials: int


def run(quick: bool, progress: Progress | None = None) -> list[Row]:
    """A row per training and seed.

    Args:
        quick: Tiny trainings of one seed, which show that everything works and nothing else.
        progress: Told what is done.
    """
    seeds, folder = (SEEDS[:1], FOLDER / "quick") if quick else (SEEDS, FOLDER)
    show = progress or quiet
    jobs = [(chain, seed) for seed in seeds for chain in CHAINS]
    show("training", 0, len(jobs))
    tasks = [("training", partial(run_chain, *job, folder, quick)) for job in jobs]
    run_in_processes(tasks, show, _PROCESSES)
    rows = []
    names = (IMITATION, *CASES)
    for k, name in enumerate(names):
        show(f"closed-loop checks of {name}", k, len(names))
        rows += [_row(name, seed, folder, quick) for seed in seeds]
    return rows


def _row(name: str, seed: int, folder: Path, quick: bool) -> Row:
    """Figures of a network, on the nominal robot and on others."""
    network, curve, minutes = load_run(name, seed, folder)
    rows = check(network, ({},) if quick else DISTURBED, 0.2 if quick else None)
    tracking = {label: row.e_max for label, row in rows.items() if row.step is None}
    moduli = [e for label, e in tracking.items() if "," not in label or "youngs_modulus" in label]
    step = rows["step 50 mm"].step
    return Row(
        policy=name,
        seed=seed,
        minutes=minutes,
        curve=curve,
        swing_max=tracking["swing"],
        lshape_max=tracking["lshape"],
        overshoot=step.overshoot,
        settling_time=step.settling_time,
        worst_modulus=max(moduli),
        worst=max(tracking.values()),
        failures=sum(row.failure is not None for row in rows.values()),
        trials=len(rows),
    )
