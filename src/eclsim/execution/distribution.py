"""Distribution of tasks: in this process, on Dask (the extra `eclsim[dask]`), or as one of several shards."""

from __future__ import annotations

import importlib.util
import logging
import signal
import sys
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import contextmanager, nullcontext, suppress
from dataclasses import dataclass
from functools import lru_cache, partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any, TypeVar
from uuid import uuid4

from eclsim._version import __version__
from eclsim.arguments import Kind, WholeNumber, check_fields
from eclsim.execution.folder import ExecutionError, Format, TaskFolder
from eclsim.execution.tasks import (
    Progress,
    Results,
    Store,
    Tasks,
    announce,
    in_process,
    run_tasks,
    threads,
    using_threads,
)

if TYPE_CHECKING:
    from dask.distributed import Client, LocalCluster, as_completed

Argument = TypeVar("Argument")
Result = TypeVar("Result")
Combined = TypeVar("Combined")
_MOST_NAMED = 10
LOCAL = "local"
FIRST_WORKER_SECONDS = 60.0
"""Time that a scheduler without workers has to get the first."""
SECONDS_BETWEEN_LOOKS, LONGEST_PAUSE_SECONDS = 10.0, 600.0
"""Time between looks at whether workers are left; doubled while there are none, up to the second."""


class ShardDone(Exception):  # noqa: N818 - no error: the work of one shard ends here
    """A shard has stored its results in the folder; the other shards and the merge remain to be run."""

    def __init__(self, shard: Shard, unit: str, folder: Path):
        super().__init__(f"shard {shard}: its {unit} are in {folder}")


@dataclass(frozen=True)
class Shard:
    """One of several runs that share the tasks, for example on several machines.

    Args:
        number: number of this shard, from 1.
        count: number of shards.
    """

    number: int
    count: int

    def __post_init__(self) -> None:
        check_fields(self, number=WholeNumber(1), count=WholeNumber(1))
        if self.number > self.count:
            raise ExecutionError(f"shard {self}: allowed: a number from 1 to {self.count}")

    @classmethod
    def parse(cls, text: str) -> Shard:
        """Parse a shard written as "3/16"."""
        number, _, count = text.partition("/")
        if not (text.isascii() and number.isdigit() and count.isdigit() and 1 <= int(number) <= int(count)):
            raise ExecutionError(f"--shard {text}: allowed: k/n with k from 1 to n, such as 3/16")
        return cls(int(number), int(count))

    def __str__(self) -> str:
        return f"{self.number}/{self.count}"

    def numbers(self, total: int) -> range:
        """Return the numbers of this shard's tasks, out of `total` tasks."""
        return range((self.number - 1) * total // self.count, self.number * total // self.count)


@dataclass(frozen=True)
class Distribution:
    """Where tasks run, which of them, and whether earlier results are kept. It does not change any result.

    Args:
        workers: number of threads, or of Dask workers on this machine; None for `ECLSIM_THREADS`, else all
            processors.
        dask: "local", or the address of a scheduler (`tcp://host:8786`).
        shard: run only this shard and leave its results in the folder.
        merge: run nothing and combine the results that the shards left.
        resume: continue from the results in the folder.
        force: delete the results in the folder first.
        merged_shards: number of shards that a merge combines, to name those that are missing.
        remark: called with remarks on the distribution, such as shards that have nothing to do.
    """

    workers: int | None = None
    dask: str | None = None
    shard: Shard | None = None
    merge: bool = False
    resume: bool = False
    force: bool = False
    merged_shards: int | None = None
    remark: Callable[[str], object] | None = None

    def __post_init__(self) -> None:
        check_fields(
            self, workers=WholeNumber(None), shard=Kind(Shard, "eclsim.Shard(1, 16), the first of 16"),
            merged_shards=WholeNumber(1),
        )  # fmt: skip
        if self.force and self.resume:
            raise ExecutionError("--resume keeps what is there and --force throws it away: give one of them")
        if self.force and self.shard is not None:
            raise ExecutionError(
                "--shard keeps what the others did and --force throws it away: give one of them"
            )
        if self.workers is not None and self.workers < 1:
            raise ExecutionError(f"--workers {self.workers}: allowed: 1, 2, 3 ...")

    @property
    def continues(self) -> bool:
        """Whether existing results are kept."""
        return self.resume or self.merge or self.shard is not None

    def numbers(self, total: int) -> range:
        """Return the numbers of the tasks to run: those of the shard, or all without one."""
        return range(total) if self.shard is None else self.shard.numbers(total)

    def remark_on_shards(self, tasks: Tasks[Any, Any]) -> None:
        """Remark on it if there are more shards than tasks."""
        total, shard = len(tasks.arguments), self.shard
        if self.remark is None or shard is None or shard.count <= total:
            return
        idle = shard.count - total
        self.remark(
            f"{tasks.title}: more shards ({shard.count}) than {tasks.unit} ({total}): {idle} of the shards "
            f"{'has' if idle == 1 else 'have'} nothing to do{'' if shard.numbers(total) else ', as this one'}"
        )

    @contextmanager
    def running(self, preload: Iterable[str] = ()) -> Iterator[Executor]:
        """Yield the executor.

        Enter this context before planning tasks, so that local Dask workers start meanwhile.

        Args:
            preload: modules to import in local workers before their first task.
        """
        with using_threads(self.workers):
            if self.dask is None or self.merge:
                yield Executor(self, partial(_run_nothing, self.merged_shards) if self.merge else in_process)
                return
            with on_dask(self.dask, preload) as run:
                yield Executor(self, run)


@dataclass(frozen=True)
class Executor:
    """Executor of tasks; by default it runs all of them in this process.

    Args:
        distribution: which tasks to run and whether earlier results are kept.
        run: function that runs tasks, in this process or on Dask.
    """

    distribution: Distribution = Distribution()
    run: Callable[..., Results] = in_process

    def complete(
        self,
        tasks: Tasks[Argument, Result],
        folder: Path | None,
        format: Format[Result],
        progress: Progress | None = None,
    ) -> list[Result]:
        """Run the tasks and return all results, in order.

        Args:
            tasks: the tasks.
            folder: folder in which results are stored; None for a temporary one.
            format: file format of the results.
            progress: called whenever a task is done.

        Raises:
            ExecutionError: the folder does not fit, a result is missing, or the workers cannot be reached.
            ShardDone: this run was a shard; its results are now in the folder.
        """
        results = self.completed_by_this_shard(tasks, folder, format, progress)
        if (shard := self.distribution.shard) is not None and folder is not None:
            raise ShardDone(shard, tasks.unit, folder)
        return list(results.values())

    def completed_by_this_shard(
        self,
        tasks: Tasks[Argument, Result],
        folder: Path | None,
        format: Format[Result],
        progress: Progress | None = None,
    ) -> dict[int, Result]:
        """Run the tasks of the shard, or all, and return results by number; arguments as in `complete`."""
        if folder is None and self.distribution.continues:
            raise ExecutionError(f"{tasks.title}: --resume, --shard and merge need a folder, --out DIR")
        self.distribution.remark_on_shards(tasks)
        numbers = self.distribution.numbers(len(tasks.arguments))
        with nullcontext(folder) if folder else TemporaryDirectory(prefix="eclsim-") as place:
            store = TaskFolder(Path(place), tasks.inputs, format)
            self.open(store, numbers)
            run_tasks(tasks, store, numbers, self.run, progress)
            return {number: store.load(number) for number in numbers}

    def run_each(self, works: Iterable[Callable[[], Combined]]) -> list[Combined]:
        """Call functions in turn and return their results; a shard calls all of them before it ends.

        Raises:
            ShardDone: these were shards; their results are now in their folders.
        """
        results, ended = [], None
        for work in works:
            try:
                results.append(work())
            except ShardDone as done:
                ended = done
        if ended is not None:
            raise ended
        return results

    def run_shard(
        self, tasks: Tasks[Argument, Result], store: Store[Result], folder: Path, progress: Progress | None
    ) -> None:
        """Run the tasks of the shard and raise `ShardDone`; do nothing if this run is not a shard."""
        if (shard := self.distribution.shard) is not None:
            self.distribution.remark_on_shards(tasks)
            run_tasks(tasks, store, self.distribution.numbers(len(tasks.arguments)), self.run, progress)
            raise ShardDone(shard, tasks.unit, folder)

    def open(self, store: TaskFolder[Result], numbers: range) -> None:
        """Open a folder as the distribution requires; damaged results raise before anything is computed."""
        chosen = self.distribution
        if chosen.merge and not store.file.exists():
            raise ExecutionError(f"{store.file.parent}: holds no shards ({store.file.name} is missing)")
        store.open(resume=chosen.continues, force=chosen.force)
        for number in store.finished().intersection(numbers):
            store.load(number)


def complete_in(
    folder: Path | None,
    subfolder: str,
    tasks: Tasks[Argument, Result],
    format: Format[Result],
    executor: Executor | None = None,
    progress: Progress | None = None,
) -> list[Result]:
    """Run the tasks of a study and return all results, in order; errors as of `Executor.complete`.

    Args:
        folder: folder of the study; None keeps the results in memory only.
        subfolder: folder in it that stores the results.
        tasks: the tasks.
        format: file format of the results.
        executor: runs the tasks; None runs them in this process.
        progress: called whenever a task is done.
    """
    place = None if folder is None else folder / subfolder
    return (executor or Executor()).complete(tasks, place, format, progress)


def as_executor(given: Executor | None) -> Executor | None:
    """Check an executor given by the user; None stands for this process.

    Raises:
        TypeError: It is not an executor.
    """
    if given is not None:
        Kind(Executor, "what `with eclsim.Distribution(...).running() as executor` gives")("executor", given)
    return given


def _run_nothing(
    shards: int | None, tasks: Tasks[Argument, Result], numbers: Sequence[int]
) -> Results[Result]:
    """Run nothing, for a merge: raise an error that names the missing tasks, or their shards if known."""
    if numbers:
        total = len(tasks.arguments)
        each = [Shard(k, shards) for k in range(1, shards + 1)] if shards else []
        those = [str(shard) for shard in each if {*shard.numbers(total)} & {*numbers}]
        names = list(map(str, numbers)) if not those else [f"--shard {shard}" for shard in those]
        named = ", ".join(names[:_MOST_NAMED]) + (" ..." if len(names) > _MOST_NAMED else "")
        text = f"{len(numbers)} of {total} {tasks.unit} are missing ({named})"
        raise ExecutionError(f"{tasks.title}: {text}; run their shards, or --resume without --shard")
    yield from ()


# --- on a Dask cluster ------------------------------------------------------------------------------

# Local workers are single-threaded processes, started while the work is being planned. A fork server imports
# eclsim once, and the workers are forked from it. The fork server itself computes nothing, so no threads are
# lost in forking. Without a fork server (macOS, Windows), each worker starts and imports separately.


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
        _client(address).close()  # before minutes of planning, not after them
        yield partial(_run, lambda: address)
        return
    method = _start_fork_server(["distributed", *preload])
    with ThreadPoolExecutor(1, thread_name_prefix="dask") as starter:
        starting = starter.submit(_local_cluster, threads(), method)
        try:
            yield partial(_run, partial(_started, starting))
        finally:
            if starting.exception() is None:
                starting.result().close()


def _start_fork_server(preload: list[str]) -> str:
    """Start a fork server that imports the modules, and return the start method; "spawn" except on Linux.

    Ctrl-C reaches all processes of a terminal; server and workers leave it to this one, which closes them.
    """
    if sys.platform != "linux":
        return "spawn"
    from multiprocessing import forkserver, resource_tracker

    forkserver.set_forkserver_preload(preload)
    resource_tracker.ensure_running()  # it would unblock the signal
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        forkserver.ensure_running()
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)
    return "forkserver"


def _started(starting: Future[LocalCluster]) -> LocalCluster:
    try:
        return starting.result()
    except (OSError, RuntimeError) as error:
        reason = str(error).splitlines()[0] if str(error) else type(error).__name__
        raise ExecutionError(
            f"--dask {LOCAL}: workers cannot be started ({reason}): give fewer --workers, or leave --dask out"
        ) from error


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
    from dask.distributed import CancelledError, as_completed
    from distributed.comm.core import CommClosedError
    from distributed.scheduler import KilledWorker

    with _without_tracebacks(), _client(cluster()) as client:
        _wait_for_workers(client)
        # The function travels with each task: scattered, it would be lost with the worker that holds it.
        # A shared scheduler returns a stored result for a key it knows, so each run has its own keys.
        run = uuid4().hex
        # In order of number, so that a run stopped early has completed the first tasks.
        futures = [
            client.submit(
                _on_worker, tasks.compute, tasks.arguments[number], number, __version__,
                key=f"{tasks.title}-{run}-{number}", pure=False, priority=-number,
            )
            for number in numbers
        ]  # fmt: skip
        try:
            done = as_completed(futures, loop=client.loop, with_results=True)
            for _, result in _watched(done, client):  # pyright: ignore[reportGeneralTypeIssues] - Dask's own types
                if isinstance(result, CancelledError):  # Dask returns it instead of raising it
                    raise result
                yield result
        except KilledWorker as error:
            raise ExecutionError(
                f"{tasks.title}: a worker died, perhaps for lack of memory: {error}"
            ) from None
        except (CancelledError, CommClosedError):
            raise ExecutionError(
                f"{tasks.title}: the scheduler ended, or its connection was lost; finished {tasks.unit} are "
                "kept in --out: start it again, and repeat the command with --resume"
            ) from None
        finally:
            if client.status == "running":
                client.cancel(futures, force=True)


def _watched(done: as_completed, client: Client) -> Iterator[Any]:
    """Yield futures with their results; announce when no worker is left, for which Dask waits silently."""
    looked, pause = time.monotonic(), SECONDS_BETWEEN_LOOKS
    while not done.is_empty():
        if done.has_ready():
            yield next(done)
        elif time.monotonic() - looked < pause:
            time.sleep(0.1)
        else:
            looked, lost = time.monotonic(), False
            with suppress(OSError):  # of a scheduler that ended: its futures say so
                lost = not client.nthreads()
            pause = min(2.0 * pause, LONGEST_PAUSE_SECONDS) if lost else SECONDS_BETWEEN_LOOKS
            if lost:
                announce(f"no worker is left, waiting for others (dask worker {_address(client)})")


def _address(client: Client) -> object:
    return client.scheduler.address if client.scheduler else "ADDRESS"


@contextmanager
def _without_tracebacks() -> Iterator[None]:
    """Silence Dask's own traceback of a lost connection, which ends in a message of ours."""
    logger = logging.getLogger("distributed.client")
    level = logger.level
    logger.setLevel(logging.CRITICAL)
    try:
        yield
    finally:
        logger.setLevel(level)


def _wait_for_workers(client: Client) -> None:
    """Wait until there is a worker; without this, Dask waits as long and then reports a write error."""
    try:
        client.wait_for_workers(1, timeout=FIRST_WORKER_SECONDS)
    except TimeoutError:
        address = _address(client)
        raise ExecutionError(
            f"--dask {address}: the scheduler has no workers after {FIRST_WORKER_SECONDS:g} s: start some "
            f"(dask worker {address}), or --dask local"
        ) from None


def _client(cluster: str | LocalCluster) -> Client:
    from dask.distributed import Client

    try:
        # Not the default client, or other code in this process would use it after it is closed.
        return Client(cluster, set_as_default=False)
    except (OSError, ValueError) as error:
        text = str(error).splitlines()[0] if str(error) else type(error).__name__
        wanted = "start one (dask scheduler, dask worker tcp://HOST:PORT), or correct the address"
        allowed = "allowed: local, tcp://HOST:PORT"
        raise ExecutionError(
            f"--dask {cluster}: no scheduler answers ({text}): {wanted}; {allowed}"
        ) from error


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
