"""Dask workers on this machine, each a process with one thread, started while the analysis is planned.

A fork server imports eclsim once; the workers are forks of it. It runs no JAX computation itself, so there
are no threads to lose. Where there is no fork server (Windows), each worker starts and imports on its own.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import contextmanager
from typing import Any

PRELOAD = ("distributed", "scipy.stats", "eclsim.outputs.evaluation", "eclsim.sensitivity.evaluation")
"""What a worker needs before its first block."""


@contextmanager
def local_workers() -> Iterator[Callable[[], Any]]:
    """Start one worker per processor (`ECLSIM_THREADS`); the function waits for their cluster."""
    from eclsim.beat.vectorisation import threads

    method = _start_fork_server()
    with ThreadPoolExecutor(1, thread_name_prefix="dask") as starter:
        starting: Future[Any] = starter.submit(_cluster, threads(), method)
        try:
            yield starting.result
        finally:
            starting.result().close()


def _start_fork_server() -> str:
    """How workers are started: from a fork server that is importing already, or anew."""
    if sys.platform != "linux":
        return "spawn"
    from multiprocessing import forkserver

    forkserver.set_forkserver_preload(list(PRELOAD))
    forkserver.ensure_running()
    return "forkserver"


def _cluster(workers: int, method: str) -> Any:
    import dask.config
    from dask.distributed import LocalCluster

    settings = {
        "distributed.worker.multiprocessing-method": method,
        "distributed.worker.profile.enabled": False,
        "distributed.nanny.pre-spawn-environ": {},
    }
    with dask.config.set(settings):
        options: dict[str, Any] = {"threads_per_worker": 1, "dashboard_address": None}
        return LocalCluster(n_workers=workers, **options)
