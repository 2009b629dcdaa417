"""Tasks on a Dask cluster: the extra `eclsim[dask]`.

Local workers are single-threaded processes, started while the work is being planned. A fork server imports
eclsim once, and the workers are forked from it. The fork server itself computes nothing, so no threads are
lost in forking. Without a fork server (macOS, Windows), each worker starts and imports separately.
"""

from __future__ import annotations

import importlib.util
import sys
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from functools import lru_cache, partial
from typing import TYPE_CHECKING, TypeVar
from uuid import uuid4

from eclsim._version import __version__
from eclsim.execution.folder import ExecutionError
from eclsim.execution.tasks import Results, Tasks, threads, using_threads

if TYPE_CHECKING:
    from dask.distributed import Client, LocalCluster

Argument = TypeVar("Argument")
Result = TypeVar("Result")
LOCAL = "local"


@contextmanager
def on_dask(address: str, preload: Iterable[str] = ()) -> Iterator[Callable[..., Results]]:
    """Yield a function that runs tasks on the workers of a cluster.

    Args:
        address: address of the scheduler (`tcp://host:8786`), or "local" for workers on this machine.
        preload: modules to import in local workers before their first task.
    """
    if importlib.util.find_spec("distributed") is None:
        raise ExecutionError("--dask needs Dask: pip install 'eclsim[dask]'")
    if address != LOCAL:
        yield partial(_run, lambda: address)
        return
    method = _start_fork_server(["distributed", *preload])
    with ThreadPoolExecutor(1, thread_name_prefix="dask") as starter:
        starting = starter.submit(_local_cluster, threads(), method)
        try:
            yield partial(_run, starting.result)
        finally:
            starting.result().close()


def _start_fork_server(preload: list[str]) -> str:
    """Start a fork server that imports the modules, and return the start method; "spawn" except on Linux."""
    if sys.platform != "linux":
        return "spawn"
    from multiprocessing import forkserver

    forkserver.set_forkserver_preload(preload)
    forkserver.ensure_running()
    return "forkserver"


def _local_cluster(workers: int, method: str) -> LocalCluster:
    import dask.config
    from dask.distributed import LocalCluster

    settings = {
        "distributed.worker.multiprocessing-method": method,
        "distributed.worker.profile.enabled": False,
        "distributed.nanny.pre-spawn-environ": {},
    }
    with dask.config.set(settings):
        # No dashboard: Dask documents None for this, but its type annotation does not allow it.
        return LocalCluster(n_workers=workers, threads_per_worker=1, dashboard_address=None)  # pyright: ignore[reportArgumentType]


def _run(
    cluster: Callable[[], str | LocalCluster], tasks: Tasks[Argument, Result], numbers: Sequence[int]
) -> Results[Result]:
    if not numbers:
        return
    from dask.distributed import as_completed
    from distributed.scheduler import KilledWorker

    with _client(cluster()) as client:
        shared = client.scatter(tasks.compute, broadcast=True)
        # A shared scheduler returns a stored result for a key it knows, so each run has its own keys.
        run = uuid4().hex
        # In order of number, so that a run stopped early has completed the first tasks.
        futures = [
            client.submit(
                _on_worker, shared, tasks.arguments[number], number, __version__,
                key=f"{tasks.title}-{run}-{number}", pure=False, priority=-number,
            )
            for number in numbers
        ]  # fmt: skip
        try:
            for _, result in as_completed(futures, loop=client.loop, with_results=True):  # pyright: ignore[reportGeneralTypeIssues] - Dask's own types
                yield result
        except KilledWorker as error:
            raise ExecutionError(
                f"{tasks.title}: a worker died, perhaps for lack of memory: {error}"
            ) from None
        finally:
            client.cancel(futures, force=True)


def _client(cluster: str | LocalCluster) -> Client:
    from dask.distributed import Client

    try:
        # Not the default client, or other code in this process would use it after it is closed.
        return Client(cluster, set_as_default=False)
    except (OSError, ValueError) as error:
        text = str(error).splitlines()[0] if str(error) else type(error).__name__
        allowed = "allowed: local, tcp://HOST:PORT"
        raise ExecutionError(f"--dask {cluster}: no scheduler answers ({text}); {allowed}") from error


def _on_worker(
    compute: Callable[[Argument], Result], argument: Argument, number: int, version: str
) -> tuple[int, Result]:
    if version != __version__:
        raise ExecutionError(f"--dask: a worker has eclsim {__version__}; this is {version}")
    _keep_freed_memory()
    with using_threads(1):
        return number, compute(argument)


@lru_cache(maxsize=1)
def _keep_freed_memory() -> None:
    """Make the process keep a task's memory for the next one.

    Dask makes its workers return freed memory to the system at once (`MALLOC_TRIM_THRESHOLD_`); getting it
    back, page by page, costs a sixth of the processor time of a steady beat.
    """
    import ctypes

    trim_threshold, mmap_threshold = -1, -3
    try:
        library = ctypes.CDLL(None)
        library.mallopt(trim_threshold, 512 * 2**20)
        library.mallopt(mmap_threshold, 32 * 2**20)  # the largest value allowed
    except (AttributeError, OSError, TypeError):  # a C library other than glibc
        return
