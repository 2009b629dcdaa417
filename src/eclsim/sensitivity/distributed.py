"""Blocks of a design on a Dask cluster: the extra `eclsim[dask]`."""

from __future__ import annotations

import importlib.util
from collections.abc import Callable, Generator, Iterator
from contextlib import contextmanager
from functools import lru_cache, partial
from typing import Any

from eclsim.sensitivity.design import Design
from eclsim.sensitivity.evaluation import Evaluated, Evaluator, evaluate_block
from eclsim.sensitivity.runner import Executor

LOCAL = "local"


class MissingDaskError(RuntimeError):
    """Dask is not installed."""

    def __init__(self) -> None:
        super().__init__("--dask needs Dask: pip install 'eclsim[dask]'")


class UnreachableError(RuntimeError):
    """No scheduler answers at the address."""

    def __init__(self, address: str, error: Exception) -> None:
        said = str(error).splitlines()[0] if str(error) else type(error).__name__
        super().__init__(f"--dask {address}: no scheduler answers ({said}); allowed: local, tcp://HOST:PORT")


@contextmanager
def on_dask(address: str) -> Iterator[Executor]:
    """An executor that sends blocks to the workers of a cluster.

    Enter it before the analysis is planned: local workers start meanwhile.

    Args:
        address: of the scheduler (`tcp://host:8786`), or "local" for one worker per processor of this
            machine (`ECLSIM_THREADS`).

    Raises:
        MissingDaskError: Dask is not installed.
    """
    if importlib.util.find_spec("distributed") is None:
        raise MissingDaskError
    if address == LOCAL:
        from eclsim.sensitivity.local_workers import local_workers

        with local_workers() as cluster:
            yield partial(_execute, cluster)
    else:
        yield partial(_execute, lambda: address)


def _execute(
    cluster: Callable[[], Any], design: Design, evaluator: Evaluator, blocks: list[int]
) -> Generator[tuple[int, Evaluated]]:
    if not blocks:
        return
    from dask.distributed import Client, as_completed

    with _client(Client, cluster()) as client:
        shared = client.scatter((design, evaluator), broadcast=True)
        # In order of number: stopped early, the blocks done are the first ones.
        futures = [
            client.submit(_on_worker, shared, b, key=f"block-{b}", pure=False, priority=-b) for b in blocks
        ]
        try:
            for _, result in as_completed(futures, with_results=True):  # pyright: ignore[reportGeneralTypeIssues]
                yield result
        finally:
            client.cancel(futures, force=True)


def _client(client: Any, cluster: Any) -> Any:
    try:
        return client(cluster)
    except (OSError, ValueError) as error:
        raise UnreachableError(str(cluster), error) from error


def _on_worker(shared: tuple[Design, Evaluator], block: int) -> tuple[int, Evaluated]:
    """Runs on the worker."""
    keep_freed_memory()
    return block, evaluate_block(*shared, block)


@lru_cache(maxsize=1)
def keep_freed_memory() -> None:
    """Let the process keep the memory of a beat for the next one.

    Dask has its workers return freed memory to the system at once (`MALLOC_TRIM_THRESHOLD_`); fetching it
    back, page by page, for every beat costs a sixth of the processor time.
    """
    import ctypes

    trim_threshold, mmap_threshold = -1, -3
    try:
        library = ctypes.CDLL(None)
        library.mallopt(trim_threshold, 512 * 2**20)
        library.mallopt(mmap_threshold, 32 * 2**20)  # the largest that it takes
    except (AttributeError, OSError, TypeError):  # another C library than the GNU one
        return
