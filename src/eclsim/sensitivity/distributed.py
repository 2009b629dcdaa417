"""Blocks of a design on a Dask cluster: the extra `eclsim[dask]`."""

from __future__ import annotations

import os
from collections.abc import Generator
from typing import Any

from eclsim.sensitivity.design import Design
from eclsim.sensitivity.evaluation import Evaluated, Evaluator, evaluate_block
from eclsim.sensitivity.runner import Executor

LOCAL = "local"


class MissingDaskError(RuntimeError):
    """Dask is not installed."""

    def __init__(self) -> None:
        super().__init__("--dask needs Dask: pip install 'eclsim[dask]'")


def on_dask(address: str) -> Executor:
    """An executor that sends blocks to the workers of a cluster.

    Args:
        address: of the scheduler (`tcp://host:8786`), or "local" for one worker per processor of this
            machine.
    """
    try:
        from dask.distributed import Client, LocalCluster, as_completed
    except ImportError as error:
        raise MissingDaskError from error

    def execute(design: Design, evaluator: Evaluator, blocks: list[int]) -> Generator[tuple[int, Evaluated]]:
        if not blocks:
            return
        with _cluster(LocalCluster, address) as cluster, Client(cluster) as client:
            shared = client.scatter((design, evaluator), broadcast=True)
            futures = [client.submit(_on_worker, shared, b, key=f"block-{b}", pure=False) for b in blocks]
            try:
                for _, result in as_completed(futures, with_results=True):  # pyright: ignore[reportGeneralTypeIssues]
                    yield result
            finally:
                client.cancel(futures, force=True)

    return execute


class _Address:
    """A cluster that somebody else started, as a context like one of our own."""

    def __init__(self, address: str):
        self.address = address

    def __enter__(self) -> str:
        return self.address

    def __exit__(self, *error: object) -> None:
        return None


def _cluster(local_cluster: Any, address: str) -> Any:
    if address != LOCAL:
        return _Address(address)
    from eclsim.solver.lanes import threads

    return local_cluster(n_workers=threads(), threads_per_worker=1, dashboard_address=None)


def _on_worker(shared: tuple[Design, Evaluator], block: int) -> tuple[int, Evaluated]:
    """Runs on the worker: each block in one thread, so that it gives the same bits as here."""
    os.environ["ECLSIM_THREADS"] = "1"
    return block, evaluate_block(*shared, block)
