"""The processes that fit: Dask's, on this machine or on others."""

from __future__ import annotations

import logging
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

from facestage.contract.errors import InputError
from facestage.contract.files.reading import GIB

WORKER_GIB = 2.5  # what the fit of a photo of usual size takes at most, with libraries and model
MEMORY_SHARE = 0.9  # of the machine's, for all workers together
CONNECT_SECONDS = 15
# Workers hold next to no data of Dask's: to write it to the disk, or to pause them, would free
# nothing. One that grows beyond its limit is ended, and another takes its place.
SETTINGS = {
    "distributed.worker.memory.target": False,
    "distributed.worker.memory.spill": False,
    "distributed.worker.memory.pause": False,
    "distributed.worker.memory.terminate": 0.98,
    "distributed.worker.profile.enabled": False,
    "distributed.worker.preload": ["facestage.batch.worker"],
    "distributed.admin.tick.limit": "1h",  # a busy worker answers late, which nobody need read
}


@dataclass(frozen=True)
class Pool:
    """Where the fits run. Raises InputError for what cannot be."""

    scheduler: str | None = None  # address of a running one; None: a cluster on this machine
    workers: int | None = None  # None: as many as cores and memory allow
    memory_gib: float | None = None  # of each worker; None: its share of the machine's
    retries: int = 2  # how often a row is tried again when its worker dies

    def __post_init__(self) -> None:
        if self.scheduler is not None and (self.workers, self.memory_gib) != (None, None):
            raise InputError(
                "Another machine's scheduler has its own workers; leave out --workers and "
                "--memory, or --scheduler."
            )
        if self.workers is not None and not 1 <= self.workers <= 1024:
            raise InputError(f"--workers is {self.workers}; expected 1 to 1024.")
        if self.memory_gib is not None and not 1 <= self.memory_gib <= 4096:
            raise InputError(f"--memory is {self.memory_gib:g}; expected 1 to 4096 GiB.")
        if not 0 <= self.retries <= 100:
            raise InputError(f"--retries is {self.retries}; expected 0 to 100.")


@dataclass(frozen=True)
class Connection:
    """Dask's client, and what was agreed on."""

    client: Any
    workers: int
    threads: int  # of each worker's renderer
    dashboard: str


@contextmanager
def connected(pool: Pool, rows: int) -> Iterator[Connection]:
    """A connection for ``rows`` fits; a cluster of our own ends with it. Raises InputError where
    Dask is missing, or nobody answers.
    """
    try:
        import cryptography as cryptography
        import dask
        import distributed
    except ImportError as error:
        raise InputError(
            f"facestage batch needs Dask, which is not installed ({error}); run: pip install "
            "'facestage[batch]'."
        ) from error
    logging.getLogger("distributed").setLevel(logging.CRITICAL)
    settings = SETTINGS | {"distributed.scheduler.allowed-failures": pool.retries}
    with dask.config.set(settings):
        if pool.scheduler is not None:
            with _client(distributed, pool.scheduler) as client:
                count = len(client.scheduler_info(n_workers=-1)["workers"])
                yield Connection(client, count, 1, client.dashboard_link)
            return
        cores, memory = dask.system.CPU_COUNT, distributed.system.MEMORY_LIMIT
        count = pool.workers or default_workers(cores, memory, rows)
        limit = int(
            MEMORY_SHARE * memory / count if pool.memory_gib is None else pool.memory_gib * GIB
        )
        with (
            distributed.LocalCluster(
                n_workers=count,
                threads_per_worker=1,
                processes=True,
                memory_limit=limit,
                # What comes over a connection is unpickled: without keys, whoever has an account
                # here could have us run anything.
                security=True,
                host="127.0.0.1",
                dashboard_address="127.0.0.1:0",
                silence_logs=logging.CRITICAL,
            ) as cluster,
            distributed.Client(cluster) as client,
        ):
            yield Connection(client, count, max(1, cores // count), cluster.dashboard_link)


def default_workers(cores: int, memory: int, rows: int) -> int:
    """As many as there are cores, memory (bytes) and rows for; at least one."""
    return max(1, min(cores, int(MEMORY_SHARE * memory / (WORKER_GIB * GIB)), rows))


def _client(distributed: Any, address: str) -> Any:
    try:
        return distributed.Client(address, timeout=CONNECT_SECONDS)
    except (OSError, TimeoutError, ValueError) as error:
        raise InputError(
            f"No Dask scheduler answers at '{address}' ({error}); start one with dask scheduler, "
            "and give its address, as in tcp://192.168.1.5:8786."
        ) from error
