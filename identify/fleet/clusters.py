"""Where a fleet is computed: workers on this machine, or a dask scheduler that somebody started, named by address or by file."""

import logging
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

from thermohyd.identify.bench.errors import BenchInputError


if TYPE_CHECKING:
    from distributed import Client

CONNECT = 30.0  # s
LOOPBACK = "127.0.0.1:0"


@contextmanager
def client_of(cluster: str, workers: int) -> Iterator["Client"]:
    """A client of "local" (workers: how many), of an address such as tcp://head:8786, or of the file that
    `dask scheduler --scheduler-file` writes.

    A local worker is a thread of this process, for it only watches the process that computes; nothing of it listens beyond this
    machine. Raises BenchInputError where there is no such scheduler.
    """
    from dask import config
    from distributed import Client, LocalCluster

    if cluster == "local":
        # LocalCluster silences dask only until it is closed, and what its threads still write then, a traceback of a
        # connection that closes among it, comes later and means nothing to who interrupted a run.
        logging.getLogger("distributed").setLevel(logging.WARNING)
        # dask starts a server of HTTP for each of them, without an address where every other machine reaches it: no dashboard, no
        # pages, and at any free port, since another cluster of this machine may have the usual one.
        settings: dict[str, Any] = {
            "dashboard_address": None,
            "worker_dashboard_address": LOOPBACK,
            "scheduler_kwargs": {"dashboard": False, "dashboard_address": LOOPBACK},
            "memory_limit": 0,
        }
        no_pages = {f"distributed.{part}.http.routes": [] for part in ("scheduler", "worker")}
        with (
            config.set(no_pages),
            LocalCluster(n_workers=workers, threads_per_worker=1, processes=False, **settings) as local,
            Client(local, timeout=CONNECT) as client,
        ):
            yield client
        return
    named = Path(cluster)
    if "://" not in cluster and not named.is_file():
        raise BenchInputError(
            '--cluster takes "local", the address of a scheduler such as tcp://head:8786, or the file that `dask scheduler '
            "--scheduler-file` wrote; there is no such file",
            file=named,
        )
    try:
        made = (
            Client(cluster, timeout=CONNECT) if "://" in cluster else Client(scheduler_file=str(named), timeout=CONNECT)
        )
    except (OSError, TimeoutError, ValueError) as error:
        raise BenchInputError(f"no scheduler answers at {cluster} ({error})") from None
    with made as client:
        yield client


def addresses(client: "Client", wait: float = 0.0) -> list[str]:
    """Of the workers that are there, after waiting for the first one up to `wait` seconds."""
    if wait and not client.scheduler_info(n_workers=-1)["workers"]:
        from contextlib import suppress

        with suppress(TimeoutError):
            client.wait_for_workers(1, timeout=wait)
    return list(client.scheduler_info(n_workers=-1)["workers"])
