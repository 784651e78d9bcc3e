"""Jobs of studies one after the other, see `core.runs`."""

from collections.abc import Sequence

from softrobot_env.core.runs import Job, Progress, Row, quiet, run_in_processes

__all__ = ["Job", "Progress", "quiet", "run_in_processes", "run_jobs"]


def run_jobs(
    jobs: Sequence[Job], progress: Progress | None, rows: list[Row] | None = None
) -> list[Row]:
    """Run jobs and collect their records.

    Args:
        jobs: The jobs.
        progress: Told before each job and at the end, or None.
        rows: List to add to, for jobs that read what earlier ones found; a new one unless given.
    """
    rows, show = [] if rows is None else rows, progress or quiet
    for done, (description, job) in enumerate(jobs):
        show(description, done, len(jobs))
        rows += job()
    show("done", len(jobs), len(jobs))
    return rows
