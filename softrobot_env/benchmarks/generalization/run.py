"""All policies on references that they have not met, and on robots that they do not know."""

from collections.abc import Sequence
from functools import partial

from softrobot_env.benchmarks.generalization.cases import Row, cases, run_case
from softrobot_env.benchmarks.jobs import Progress, run_in_processes
from softrobot_env.evaluation.runner import Case


def run(quick: bool = False, progress: Progress | None = None) -> list[Row]:
    """Run all policies in all cases, one process per core.

    Args:
        quick: Fewer speeds, seeds, tasks and variations.
        progress: Called with (description, done, total), or None.

    Returns:
        Rows of the episodes. Policy times are those of cores that are all busy.
    """
    return run_cases(list(cases(quick)), progress)


def run_cases(
    wanted: Sequence[Case], progress: Progress | None = None, processes: int | None = None
) -> list[Row]:
    """Rows of cases in their order, run in `processes` processes, one per core unless given."""
    tasks = [(case.label, partial(run_case, case)) for case in wanted]
    return run_in_processes(tasks, progress, processes)
