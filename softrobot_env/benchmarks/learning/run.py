"""Learning curves and figures of trained policies over several seeds."""

from concurrent.futures import as_completed
from pathlib import Path

from softrobot_env.benchmarks.jobs import Progress, Row
from softrobot_env.benchmarks.learning.cases import (
    CASES,
    CHAINS,
    IMITATION,
    Run,
    load_run,
    run_chain,
)
from softrobot_env.processes import worker_processes
from softrobot_env.training.closed_loop_check import trial
from softrobot_env.training.rl_config import DISTURBED

SEEDS = (0, 1, 2)

#: Where finished trainings are kept; they are not repeated.
FOLDER = Path("out") / "learning"

#: Processes that train at the same time, each on one core.
_PROCESSES = 2


def run(quick: bool, progress: Progress | None = None) -> list[Row]:
    """A row per training and seed.

    Args:
        quick: Tiny trainings of one seed, which show that everything works and nothing else.
        progress: Told what is done.
    """
    seeds, folder = (SEEDS[:1], FOLDER / "quick") if quick else (SEEDS, FOLDER)
    show = progress or (lambda text, done, total: None)
    jobs = [(chain, seed) for seed in seeds for chain in CHAINS]
    with worker_processes(_PROCESSES) as pool:
        waiting = [pool.submit(run_chain, *job, folder, quick) for job in jobs]
        show("training", 0, len(jobs))
        for done, future in enumerate(as_completed(waiting)):
            future.result()
            show("training", done + 1, len(jobs))
    rows = []
    names = (IMITATION, *CASES)
    for k, name in enumerate(names):
        show(f"trials of {name}", k, len(names))
        rows += [_row(load_run(name, seed, folder), quick) for seed in seeds]
    return rows


def _row(run: Run, quick: bool) -> Row:
    """Figures of a network, on the nominal robot and on others."""
    rows = trial(run.network, ({},) if quick else DISTURBED, 0.2 if quick else None)
    nominal = {name: row for name, row in rows.items() if "," not in name}
    tracking = [row["max_mm"] for name, row in rows.items() if not name.startswith("step")]
    moduli = [
        row["max_mm"]
        for name, row in rows.items()
        if "," not in name or "youngs_modulus" in name
        if not name.startswith("step")
    ]
    return {
        "policy": run.name,
        "seed": run.seed,
        "minutes": run.minutes,
        "curve": run.curve,
        "swing_max": 1e-3 * nominal["swing"]["max_mm"],
        "lshape_max": 1e-3 * nominal["lshape"]["max_mm"],
        "overshoot": _share(nominal["step 50 mm"]["overshoot_percent"]),
        "settling_time": nominal["step 50 mm"]["settling_s"],
        "worst_modulus": 1e-3 * max(moduli),
        "worst": 1e-3 * max(tracking),
        "failures": sum(row["failure"] is not None for row in rows.values()),
        "trials": len(rows),
    }


def _share(percent: float | None) -> float | None:
    return None if percent is None else percent / 100
