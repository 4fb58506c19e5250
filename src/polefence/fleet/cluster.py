"""Dask clusters as workers, existing ones or of this machine; the extra ``polefence[cluster]``."""

from __future__ import annotations

from collections.abc import Iterator
from concurrent.futures import Executor
from contextlib import ExitStack, contextmanager
from functools import partial
from typing import Any

from polefence.base.errors import MissingExtraError
from polefence.base.explained import explained
from polefence.base.processors import processors, share_processors, small_matrices
from polefence.base.workers import start_quiet_tracker
from polefence.fleet.engine import Work
from polefence.fleet.workers import Workers

LOCAL = "local"
PATIENCE = 10  # [s] for a scheduler, each time that it is looked for


@explained
def dask(address: str = LOCAL) -> Workers:
    """Return the workers of a Dask cluster.

    Parameters
    ----------
    address : str
        Of its scheduler, ``tcp://host:8786``; "local": one is started here, with a process a
        processor.

    Raises
    ------
    MissingExtraError
        If Dask is not installed.
    OutputError
        If no scheduler answers there.
    """
    distributed = _distributed()
    from distributed.comm.core import CommClosedError
    from distributed.scheduler import KilledWorker

    count = processors()
    if address != LOCAL:
        with _connected(distributed, address) as client:
            count = max(1, len(client.scheduler_info()["workers"]))
    lost = (KilledWorker, CommClosedError, OSError)
    return Workers(partial(_opened, address, count), count, lost, alone)


def alone(work: Work, task: Any) -> Any:
    """Do a task in a worker that shares its machine with others: with one thread."""
    share_processors()
    with small_matrices():
        return work(task)


@contextmanager
def _opened(address: str, count: int) -> Iterator[Executor]:
    distributed = _distributed()
    from dask import config

    if address != LOCAL:
        with _connected(distributed, address) as client:
            yield client.get_executor(pure=False)
        return
    start_quiet_tracker()
    options = {"n_workers": count, "threads_per_worker": 1, "dashboard_address": None}
    with ExitStack() as stack:
        # the profiler stops workers a hundred times a second
        stack.enter_context(config.set({"distributed.worker.profile.enabled": False}))
        cluster = stack.enter_context(distributed.LocalCluster(**options))
        client = stack.enter_context(distributed.Client(cluster))
        yield client.get_executor(pure=False)


@contextmanager
def _connected(distributed: Any, address: str) -> Iterator[Any]:
    client = distributed.Client(address, timeout=PATIENCE, set_as_default=False)
    try:
        yield client
    finally:
        client.close(timeout=PATIENCE)


def _distributed() -> Any:
    try:
        import distributed
    except ImportError as error:
        raise MissingExtraError(
            "a cluster needs Dask, which is not installed; pip install 'polefence[cluster]'"
        ) from error
    return distributed
