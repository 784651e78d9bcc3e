"""Other packages beside ours on the same cases, each as fast as it can be made, on one core.

A package that is not installed is noted, and the rest is measured. Times are computing times of the
process, with one thread, so that they hold on a busy machine as well; compilation is told apart.
"""

import os
from importlib.util import find_spec

from softrobot_env.benchmarks.peers import soromox_arm, spatial_arm
from softrobot_env.benchmarks.peers.rows import OURS, Row
from softrobot_env.benchmarks.records import select
from softrobot_env.core.jobs import Job, Progress, run_jobs


def run(quick: bool = False, progress: Progress | None = None) -> list[Row]:
    """Measure ours, and those of the peers that are installed.

    Args:
        quick: Fewer resolutions.
        progress: Called with (description, done, total), or None.
    """
    # Before JAX is loaded; what the user has set already goes first.
    os.environ.setdefault("XLA_FLAGS", "--xla_cpu_multi_thread_eigen=false")
    rows: list[Row] = []
    limit = soromox_arm.truth(quick)
    jobs = [("our motions", lambda: list(soromox_arm.our_rows(limit, quick)))]
    if find_spec("soromox") is None:
        jobs.append(_missing(soromox_arm.PEER))
    else:
        jobs.append((soromox_arm.PEER, lambda: list(soromox_arm.peer_rows(limit, quick))))
        jobs.append(("ratios", lambda: ratios(rows)))
    jobs.append(("our environment", lambda: [spatial_arm.our_row(quick)]))
    if find_spec("gym_softrobot") is None:
        jobs.append(_missing(spatial_arm.PEER))
    else:
        jobs.append((spatial_arm.PEER, lambda: [spatial_arm.peer_row(quick)]))
        jobs.append(("ratios", lambda: [_steps_ratio(rows)]))
    return run_jobs(jobs, progress, rows)


def _missing(peer: str) -> Job:
    text = f"{peer} is not installed: its rows are left out (pip install {peer})"
    return peer, lambda: [Row("note", peer, text=text)]


def ratios(rows: list[Row]) -> list[Row]:
    """For each run of SoRoMoX that no faster one of it beats, its time over that of ours."""
    motions = select(rows, kind="motion")
    ours, out, best = select(motions, package=OURS), [], float("inf")
    for row in sorted(select(motions, package=soromox_arm.PEER), key=lambda r: r.core_seconds):
        if row.e_mean >= 0.85 * best:
            continue
        best = row.e_mean
        for family in ("mujoco_chain", "pcc"):
            alike = [r for r in ours if r.model.startswith(family) and r.e_mean <= row.e_mean]
            if alike:
                fast = min(alike, key=lambda r: r.core_seconds)
                value = row.core_seconds / fast.core_seconds
                told = {"e_mean": row.e_mean, "tolerance": row.tolerance, "value": value}
                integrator = f"{row.model}, {row.integrator}"
                out.append(
                    Row("ratio", row.package, row.version, family, row.n, integrator, **told)
                )
    return out


def _steps_ratio(rows: list[Row]) -> Row:
    ours, theirs = select(rows, kind="environment")
    value = theirs.core_seconds / ours.core_seconds
    return Row("ratio", theirs.package, theirs.version, theirs.model, theirs.n, value=value)
