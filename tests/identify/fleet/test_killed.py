"""kill -9 of a worker, of the scheduler, of the client, of the process that computes: the store is that of an undisturbed run.

Real processes, each ended by its own id.
"""

import logging
import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import psutil
import pytest
from helpers.fleet_records import write_fleet

from thermohyd.identify.fleet.clusters import client_of
from thermohyd.identify.fleet.identity import Settings
from thermohyd.identify.fleet.run import Summary, run_fleet
from thermohyd.identify.fleet.schema import OF_THE_RUN
from thermohyd.identify.fleet.store import Store


TESTS = Path(__file__).resolve().parents[2]
ENVIRONMENT = os.environ | {"PYTHONPATH": str(TESTS), "DASK_DISTRIBUTED__WORKER__MEMORY__TERMINATE": "False"}
JOB = Settings("helpers.fleet_records:slowly")
COUNT = 20


@pytest.fixture(scope="module")
def fleet(tmp_path_factory) -> Path:
    return write_fleet(tmp_path_factory.mktemp("fleet") / "records", COUNT)


@pytest.fixture(scope="module")
def undisturbed(fleet, tmp_path_factory) -> list[dict]:
    store = Store(tmp_path_factory.mktemp("fleet") / "undisturbed")
    assert run_fleet(store, fleet, JOB, workers=3).done == COUNT
    return content(store)


def content(store: Store) -> list[dict]:
    rows = store.results().to_pylist()
    return [{key: value for key, value in row.items() if key not in OF_THE_RUN} for row in rows]


@contextmanager
def processes(*commands: list[str], folder: Path) -> Iterator[list[subprocess.Popen]]:
    started = []
    with (folder / "log").open("w") as log:
        try:
            for command in commands:
                started.append(
                    subprocess.Popen([sys.executable, "-P", *command], env=ENVIRONMENT, stdout=log, stderr=log)
                )
            yield started
        finally:
            for process in started:
                process.kill()
                process.wait()


def scheduler(file: Path) -> list[str]:
    return [
        "-m",
        "distributed.cli.dask_scheduler",
        "--port",
        "0",
        "--no-dashboard",
        "--no-show",
        "--scheduler-file",
        str(file),
    ]


def worker(file: Path) -> list[str]:
    return [
        "-m",
        "distributed.cli.dask_worker",
        "--scheduler-file",
        str(file),
        "--nthreads",
        "1",
        "--no-nanny",
        "--no-dashboard",
    ]


def until(what: Callable[[], object], seconds: float = 60.0) -> None:
    deadline = time.monotonic() + seconds
    while not what():
        assert time.monotonic() < deadline
        time.sleep(0.02)


def in_a_thread(store: Store, fleet: Path, cluster: Path | str) -> tuple[threading.Thread, list[Summary]]:
    summaries: list[Summary] = []
    run = lambda: summaries.append(run_fleet(store, fleet, JOB, cluster=str(cluster)))
    thread = threading.Thread(target=run)
    thread.start()
    return thread, summaries


@pytest.mark.nightly  # a fleet that is killed
def test_kill_a_worker_then_the_scheduler(fleet, undisturbed, tmp_path):
    file = tmp_path / "scheduler.json"
    with processes(scheduler(file), folder=tmp_path) as (head,):
        until(file.exists)
        with processes(worker(file), worker(file), folder=tmp_path) as workers:
            store = Store(tmp_path / "one")
            thread, summaries = in_a_thread(store, fleet, file)
            until(lambda: len(store.files()) >= 3)
            computing = [psutil.Process(w.pid).children() for w in workers]
            os.kill(workers[0].pid, signal.SIGKILL)
            thread.join(60)
            (summary,) = summaries
            assert (summary.left, summary.failed, summary.trouble) == (0, {}, "")
            assert content(store) == undisturbed
            until(lambda: not any(child.is_running() for child in computing[0]))  # it outlives no worker

            store = Store(tmp_path / "two")
            thread, summaries = in_a_thread(store, fleet, file)
            until(lambda: len(store.files()) >= 3)
            os.kill(head.pid, signal.SIGKILL)
            thread.join(90)
            (summary,) = summaries
            assert summary.trouble == "the connection to the scheduler is lost"
            assert summary.left > 0
    assert run_fleet(store, fleet, JOB, workers=2).left == 0
    assert content(store) == undisturbed


def command(store: Path, fleet: Path) -> list[str]:
    run = ["fleet", "run", str(store), "--records", str(fleet), "--job", JOB.job, "--workers", "2"]
    return ["-m", "thermohyd.identify", *run]


@pytest.mark.nightly  # a fleet that is killed
def test_kill_the_client_and_what_computes(fleet, undisturbed, tmp_path):
    folder = tmp_path / "store"
    with processes(command(folder, fleet), folder=tmp_path) as (client,):
        until(lambda: len(list(folder.glob("results/*/*/*.parquet"))) >= 3)
        computing = [
            child for child in psutil.Process(client.pid).children() if "spawn_main" in " ".join(child.cmdline())
        ]
        assert len(computing) == 2
        os.kill(client.pid, signal.SIGKILL)
        until(lambda: not any(child.is_running() for child in computing))
    assert 3 <= len(Store(folder).done()) < COUNT
    # the second run, one of whose processes is killed once: the record is tried again
    store = Store(folder)
    have = len(store.done())
    thread, summaries = in_a_thread(store, fleet, "local")
    until(lambda: len(store.done()) > have)
    mine = [child for child in psutil.Process().children() if "spawn_main" in " ".join(child.cmdline())]
    os.kill(mine[0].pid, signal.SIGKILL)
    thread.join(60)
    (summary,) = summaries
    assert (summary.left, summary.failed) == (0, {})
    assert content(store) == undisturbed


@pytest.mark.nightly  # a fleet that is killed
def test_interrupt_finishes_and_says_what_is_left(fleet, tmp_path):
    folder = tmp_path / "store"
    prelude = "import signal; signal.signal(signal.SIGINT, signal.default_int_handler)"
    code = f"{prelude}; import sys; sys.argv[1:] = {command(folder, fleet)[2:]!r}; from thermohyd.identify.__main__ import main; main()"
    with processes(["-c", f"if __name__ == '__main__':\n    {code}"], folder=tmp_path) as (client,):
        until(lambda: len(list(folder.glob("results/*/*/*.parquet"))) >= 2)
        client.send_signal(signal.SIGINT)
        assert client.wait(60) == 130
    said = (tmp_path / "log").read_text()
    left = COUNT - len(Store(folder).done())
    assert f"thermohyd: interrupted; {left} records are left, and the same command goes on with them" in said
    assert "Traceback" not in said


def test_what_closes_after_the_cluster_is_not_told():
    """A connection that a worker writes to as it closes is told with its traceback, once LocalCluster has ended its own silence."""
    with client_of("local", 1):
        pass
    assert not logging.getLogger("distributed.batched").isEnabledFor(logging.INFO)
    assert logging.getLogger("distributed.batched").isEnabledFor(logging.WARNING)


@pytest.mark.skipif(sys.platform != "linux", reason="asks /proc what listens")
def test_nothing_listens_beyond_this_machine():
    with client_of("local", 2):
        ours = {os.readlink(link) for link in Path("/proc/self/fd").iterdir() if link.is_symlink()}
        rows = [line.split() for name in ("tcp", "tcp6") for line in lines_of(Path("/proc/self/net") / name)]
        listening = [row[1].split(":")[0] for row in rows if row[3] == "0A" and f"socket:[{row[9]}]" in ours]
    assert listening
    assert set(listening) == {"0100007F"}  # 127.0.0.1


def lines_of(path: Path) -> list[str]:
    return path.read_text().splitlines()[1:] if path.exists() else []
