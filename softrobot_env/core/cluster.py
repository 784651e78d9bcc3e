"""Jobs on a Ray cluster, behind the interface that processes of this machine have.

Every node needs this package in the same version. A job whose worker or node ends is begun anew on
another one by Ray itself.
"""

import pickle
from collections.abc import Callable, Iterator
from concurrent.futures import Executor, Future
from contextlib import contextmanager
from socket import create_connection
from typing import Any

from . import __version__
from .extras import needed

#: How often Ray begins a job anew whose worker or node has ended.
_RETRIES = 5

#: [s] that the address of a cluster is waited for.
_PATIENCE = 10.0


def _call(version: str, work: bytes) -> Any:
    """Do a job on a node.

    Raises:
        RuntimeError: The node has another version of this package.
    """
    if version != __version__:
        raise RuntimeError(f"a node of the Ray cluster has softrobot_env {__version__}: {version}")
    function, args, kwargs = pickle.loads(work)  # from the driver, as all that Ray runs
    return function(*args, **kwargs)


class _RayFuture(Future):
    """A job; cancelling it stops it."""

    def __init__(self, stop: Callable[[], None]) -> None:
        super().__init__()
        self._stop = stop

    def cancel(self) -> bool:
        """Stop the job if it is not done."""
        if self.done() or not super().cancel():
            return False
        self._stop()
        return True


class RayExecutor(Executor):
    """A cluster that is connected.

    Args:
        ray: The module.
    """

    def __init__(self, ray: Any) -> None:
        self._ray = ray
        self._remote = ray.remote(num_cpus=1, max_retries=_RETRIES)(_call)
        self._begun: dict[Future, Any] = {}  # references of jobs that are not done

    def submit(self, fn: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future:
        """Begin a job as soon as a core is free; what can be pickled can be sent."""
        reference = self._remote.remote(__version__, pickle.dumps((fn, args, kwargs)))
        future = _RayFuture(lambda: self._ray.cancel(reference))
        self._begun[future] = reference

        def tell(inner: Future) -> None:
            self._begun.pop(future, None)
            if not future.set_running_or_notify_cancel():
                return
            error = inner.exception()
            if error is None:
                future.set_result(inner.result())
            else:  # what the job raised, without the traceback that Ray puts into its text
                said = str(error).strip().splitlines() or [type(error).__name__]
                given_up = RuntimeError(f"Ray gave a job up after {_RETRIES} tries anew: {said[0]}")
                future.set_exception(getattr(error, "cause", None) or given_up)

        reference.future().add_done_callback(tell)
        return future

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """End it: jobs that are under way are waited for, or stopped."""
        for future, reference in list(self._begun.items()):
            if cancel_futures:
                future.cancel()
            elif wait:
                self._ray.wait([reference])


@contextmanager
def connected(address: str, environment: dict[str, str], cores: int | None = None) -> Iterator[Any]:
    """The module `ray`, connected to a cluster, which is left at the end.

    Args:
        address: HOST:PORT, "auto" for the cluster that this machine belongs to, or "local" for one
            that is started here and ended afterwards. A connection that is there is kept.
        environment: Variables of all workers.
        cores: Of a cluster that is started here; all unless given.

    Raises:
        ImportError: Ray is not installed.
        ConnectionError: There is no cluster at this address.
    """
    with needed("Ray is missing", "cluster"):
        import ray
    own = not ray.is_initialized()
    if own:
        try:
            host, _, port = address.rpartition(":")
            if host:  # where nobody listens Ray itself would wait for minutes
                create_connection((host, int(port)), _PATIENCE).close()
            ray.init(
                address=address,
                runtime_env={"env_vars": environment},
                include_dashboard=False if address == "local" else None,
                num_cpus=cores,
                log_to_driver=False,
                logging_level="ERROR",
            )
        except (OSError, ValueError, RuntimeError) as error:
            reason = str(error).splitlines()[0]
            raise ConnectionError(f"no Ray cluster at {address!r}: {reason}") from None
    try:
        yield ray
    finally:
        if own:
            ray.shutdown()


@contextmanager
def ray_executor(address: str, environment: dict[str, str]) -> Iterator[RayExecutor]:
    """What jobs are submitted to; arguments and errors as of `connected`."""
    with connected(address, environment) as ray:
        executor = RayExecutor(ray)
        try:
            yield executor
        finally:
            executor.shutdown(cancel_futures=True)
