"""Tasks on a Dask cluster: the extra `eclsim[dask]`.

Workers of this machine are processes with one thread each, started while the work is planned. A fork server
imports eclsim once and the workers are forks of it. It computes nothing itself, so there are no threads to
lose. Where there is no fork server (macOS, Windows), each worker starts and imports on its own.
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
    """What sends tasks to the workers of a cluster.

    Args:
        address: of the scheduler (`tcp://host:8786`), or "local" for workers of this machine.
        preload: modules that local workers need before their first task.
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
    """How workers are started: from a fork server that is importing already, or anew."""
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
        # No dashboard: None is what Dask documents for it and its annotation leaves out.
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
        # A scheduler that several people use answers a name it knows with the result it has: no name twice.
        run = uuid4().hex
        # In order of number: stopped early, the tasks done are the first ones.
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
            raise ExecutionError(f"{tasks.title}: a worker died, for want of memory? {error}") from None
        finally:
            client.cancel(futures, force=True)


def _client(cluster: str | LocalCluster) -> Client:
    from dask.distributed import Client

    try:
        # Not everybody's: what else runs in this process would go to a client that is closed by then.
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
    """Let the process keep the memory of a task for the next one.

    Dask has its workers return freed memory to the system at once (`MALLOC_TRIM_THRESHOLD_`); fetching it
    back, page by page, costs a sixth of the processor time of a steady beat.
    """
    import ctypes

    trim_threshold, mmap_threshold = -1, -3
    try:
        library = ctypes.CDLL(None)
        library.mallopt(trim_threshold, 512 * 2**20)
        library.mallopt(mmap_threshold, 32 * 2**20)  # the largest that it takes
    except (AttributeError, OSError, TypeError):  # another C library than the GNU one
        return
