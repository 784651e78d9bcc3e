"""All policies on references that they have not met, and on robots that they do not know."""

from collections.abc import Sequence
from concurrent.futures import Future, as_completed

from softrobot_env.benchmarks.generalization.cases import Case, Row, cases, run_case
from softrobot_env.benchmarks.jobs import Progress
from softrobot_env.processes import worker_processes


def run(quick: bool = False, progress: Progress | None = None) -> list[Row]:
    """Run all policies in all cases, one process per core.

    Args:
        quick: Fewer speeds, seeds, tasks and variations.
        progress: Called with (description, done, total), or None.

    Returns:
        Rows of `evaluation.report.make_row` with part (one of `generalization_cases.PARTS`), speed
        [m/s] and path_seed of unseen tasks, seed of the episode, decision_period [s] and
        tension_max [N]. Policy times are those of cores that are all busy.
    """
    return run_cases(list(cases(quick)), progress)


def run_cases(
    wanted: Sequence[Case], progress: Progress | None = None, processes: int | None = None
) -> list[Row]:
    """Rows of cases in their order, run in `processes` processes, one per core unless given."""
    with worker_processes(processes) as pool:
        running = {pool.submit(run_case, case): case for case in wanted}
        _watch(running, progress)
        return [future.result() for future in running]


def _watch(running: dict[Future, Case], progress: Progress | None) -> None:
    """Tell what is done, and raise the first error."""
    for done, future in enumerate(as_completed(running), start=1):
        future.result()
        if progress is not None:
            progress(running[future].label, done, len(running))
