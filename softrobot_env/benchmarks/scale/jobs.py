"""What a driver spends on jobs: time, memory, and files of kept results."""

import tracemalloc
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from time import process_time

from softrobot_env.benchmarks.scale.rows import CORES, PRICE, Row
from softrobot_env.core import journal
from softrobot_env.core.jobs import run_in_processes
from softrobot_env.core.processes import Workers, chosen_processes, using

#: Numbers of jobs whose costs are compared, so that starts do not count.
_FEW, _MANY, _QUICK = 20, 1020, 120


def run(ways: dict[str, Workers], quick: bool) -> list[Row]:
    """A row of jobs, and one of a sweep on many cores, for each way to run them."""
    many = _QUICK if quick else _MANY
    rows = []
    for name, workers in ways.items():
        with using(workers), chosen_processes():  # which keeps the connection to a cluster
            _timed(_FEW)
            (few, _), (all_, kept) = _timed(_FEW), _timed(many)
            held = _memory(many) - _memory(_FEW)
        seconds, memory = (all_ - few) / (many - _FEW), held / (many - _FEW)
        rows.append(Row("jobs", name, seconds=seconds, memory=memory, kept=kept))
        rows.append(
            Row(
                "sweep",
                name,
                cores=CORES,
                cost=CORES * PRICE,
                price=PRICE,
                shortest_job=CORES * seconds,
            )
        )
    return rows


def _timed(count: int) -> tuple[float, float]:
    """Computing time [s] of the driver on empty jobs, and size [B] of a result that is kept."""
    sizes: list[int] = []
    with TemporaryDirectory() as folder, journal.kept_in(Path(folder), "scale"):

        def look(what: str, done: int, total: int) -> None:
            if done == total:
                kept = (Path(folder) / journal.FOLDER).iterdir()
                sizes.extend(path.stat().st_size for path in kept)

        begin = process_time()
        run_in_processes([("job", partial(_row_of, k)) for k in range(count)], look)
        taken = process_time() - begin
    return taken, sum(sizes) / len(sizes)


def _memory(count: int) -> int:
    """Most memory [B] of Python's that empty jobs take in the driver."""
    tracemalloc.start()
    try:
        run_in_processes([("job", partial(_row_of, k)) for k in range(count)])
        return tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()


def _row_of(number: int) -> dict[str, float]:
    """What a job returns: a row of twenty numbers."""
    return {f"column_{k}": float(number + k) for k in range(20)}
