"""A benchmark as named jobs that are run one after the other."""

from collections.abc import Callable, Sequence
from typing import Any

Row = dict[str, Any]
#: Description for the progress bar, and what makes the rows.
Job = tuple[str, Callable[[], list[Row]]]
#: Called with description, jobs done and number of jobs.
Progress = Callable[[str, int, int], None]


def run_jobs(
    jobs: Sequence[Job], progress: Progress | None, rows: list[Row] | None = None
) -> list[Row]:
    """Run jobs and collect their rows.

    Args:
        jobs: The jobs.
        progress: Told before each job and at the end, or None.
        rows: List to add to, for jobs that read what earlier ones found; a new one unless given.
    """
    rows = [] if rows is None else rows
    for done, (description, job) in enumerate(jobs):
        if progress is not None:
            progress(description, done, len(jobs))
        rows += job()
    if progress is not None:
        progress("done", len(jobs), len(jobs))
    return rows
