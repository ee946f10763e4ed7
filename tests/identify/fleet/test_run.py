"""A fleet through local workers: what is computed, what is not computed twice, what a bad record does."""

import threading
from pathlib import Path

import pytest
from helpers.bench_folder import write_record
from helpers.fleet_records import no_room, write_fleet

from thermohyd.identify.bench.errors import BenchInputError
from thermohyd.identify.fleet.chunks import Deal, in_chunks
from thermohyd.identify.fleet.computer import Care
from thermohyd.identify.fleet.identity import Found, Settings, find_records, look_at
from thermohyd.identify.fleet.run import run_fleet
from thermohyd.identify.fleet.store import Store


def own(name: str, **options) -> Settings:
    return Settings(f"helpers.fleet_records:{name}", options)


def test_every_record_once_and_the_bad_one_named(tmp_path):
    fleet = write_fleet(tmp_path / "records", 8)
    (fleet / "r003" / "bench.toml").write_text("[valve\n")
    write_record(fleet / ".arriving")
    write_record(
        fleet / "copy",
        (fleet / "r000" / "bench.toml").read_text(),
        leakage=(fleet / "r000" / "leakage.csv").read_text(),
    )
    store = Store(tmp_path / "store")
    words: list[str] = []
    first = run_fleet(store, fleet, Settings("read"), workers=2, progress=words.append)
    assert (first.records, first.doubles, first.done, first.left) == (9, 1, 7, 0)
    assert list(first.failed) == [str(fleet / "r003")]
    assert "is not valid TOML" in first.failed[str(fleet / "r003")]
    assert any("of 8 records" in said and "an hour" in said for said in words)
    rows = store.results(["path", "serial", "type", "operating_hours", "verdict", "year"]).to_pylist()
    assert {"serial": "S1", "type": "T1", "operating_hours": 100.0, "verdict": "read", "year": 2021}.items() <= next(
        row for row in rows if row["path"].endswith("r001")
    ).items()
    again = run_fleet(store, fleet, Settings("read"))
    assert (again.done, again.known, again.given_up, again.failed) == (0, 7, 1, {})
    # repaired: another content, so it is tried, and its failure is past
    (fleet / "r003" / "bench.toml").write_text((fleet / "r002" / "bench.toml").read_text())
    repaired = run_fleet(store, fleet, Settings("read"))
    assert (repaired.done, repaired.failed, store.failures()) == (1, {}, [])


def test_other_settings_or_another_version_is_another_result(tmp_path):
    found = look_at(write_record(tmp_path / "r"))
    plain = Settings("diagnose", {"without": ["a"]}, "1")
    assert found.identity(plain) == found.identity(Settings("diagnose", {"without": ["a"]}, "1"))
    others = [
        Settings("fit", {"without": ["a"]}, "1"),
        Settings("diagnose", {}, "1"),
        Settings("diagnose", {"without": ["a"]}, "2"),
    ]
    assert len({found.identity(settings) for settings in (plain, *others)}) == 4
    (tmp_path / "r" / "leakage.csv").write_text("other")
    assert look_at(tmp_path / "r").content != found.content
    (tmp_path / "r" / "remarks.txt").write_text("which no test names")
    assert look_at(tmp_path / "r").content == look_at(tmp_path / "r").content


def test_where_records_are(tmp_path):
    fleet = write_fleet(tmp_path / "2026", 3)
    write_record(fleet / "r000" / "inside")  # a record holds no records
    assert [path.name for path in find_records(tmp_path)] == ["r000", "r001", "r002"]
    assert [path.name for path in find_records(f"{tmp_path}/*/r00[12]")] == ["r001", "r002"]
    assert find_records([fleet / "r000", fleet]) == find_records(fleet)
    for nowhere in (tmp_path / "none", f"{tmp_path}/x*"):
        with pytest.raises(BenchInputError):
            find_records(nowhere)


@pytest.mark.nightly  # a fleet whose processes die
@pytest.mark.parametrize(
    ("job", "care", "kind", "words"),
    [
        (
            own("dies", serial="S1"),
            Care(),
            "crashed",
            "its process ended by signal 11; 3 processes that computed it ended so",
        ),
        (own("hangs", serial="S1"), Care(seconds=6.0, strikes=1), "too long", "took longer than 6 s"),
        (
            own("grows", serial="S1", size=400 << 20),
            Care(memory=3e8, strikes=1),
            "too much memory",
            "needed more than 0.3 GB",
        ),
        (own("raises", serial="S1"), Care(), "failed", "ZeroDivisionError: no flow at all"),
    ],
)
def test_a_record_that_breaks_things_stops_no_fleet(tmp_path, job, care, kind, words):
    fleet = write_fleet(tmp_path / "records", 4)
    store = Store(tmp_path / "store")
    summary = run_fleet(store, fleet, job, care=care)
    assert (summary.done, summary.left, list(summary.failed)) == (3, 0, [str(fleet / "r001")])
    (failure,) = store.failures()
    assert (failure["kind"], failure["path"]) == (kind, str(fleet / "r001"))
    assert failure["reason"].startswith(words)
    assert kind != "failed" or len(summary.memory) == 1  # what a record raises ends no process


def test_a_full_disk_ends_the_run_and_the_next_one_completes_it(tmp_path):
    """The system itself refuses, in the middle of writing the first result."""
    fleet = write_fleet(tmp_path / "records", 6)
    store = Store(tmp_path / "store")
    full = run_fleet(store, fleet, Settings("read"), care=Care(prepare=no_room))
    assert "the store cannot be written (File too large)" in full.trouble
    assert "free some space" in full.trouble
    assert (full.done, full.failed, full.left) == (0, {}, 6)
    assert [path for path in (store.folder / "results").rglob("*") if path.is_file()] == []
    assert run_fleet(store, fleet, Settings("read")).done == 6


def test_a_process_is_replaced_before_it_grows(tmp_path):
    fleet = write_fleet(tmp_path / "records", 2)
    summary = run_fleet(Store(tmp_path / "store"), fleet, Settings("read"), care=Care(recycle=1.0))
    assert (summary.done, len(summary.memory)) == (2, 2)


def test_stopping_finishes_what_is_computed(tmp_path):
    fleet = write_fleet(tmp_path / "records", 12)
    store, stop = Store(tmp_path / "store"), threading.Event()

    def after_the_first(words: str) -> None:
        stop.set()

    settings = own("slowly", seconds=0.05)
    stopped = run_fleet(store, fleet, settings, progress=after_the_first, stop=stop)
    assert stopped.interrupted
    assert 1 <= stopped.done < 12
    assert stopped.left == 12 - stopped.done == 12 - len(store.results())
    assert not list(store.folder.glob(".stop-*"))
    assert run_fleet(store, fleet, settings).done == stopped.left


def test_records_that_change_while_they_are_read_wait(tmp_path, monkeypatch):
    from thermohyd.identify.fleet import work

    folder = write_record(tmp_path / "records" / "r")
    store = Store(tmp_path / "store")
    task = work.Task(str(store.folder), look_at(folder), Settings("read"))
    (folder / "leakage.csv").write_bytes((folder / "leakage.csv").read_bytes() + b"2,down,-10,0.1\n")
    assert work.compute(task).state == "changed"
    assert (store.done(), store.failures()) == (set(), [])


def test_no_threads_but_one_in_the_process_that_computes(tmp_path):
    from thermohyd.identify.fleet.computer import ONE_THREAD, Computer

    fleet = write_fleet(tmp_path / "records", 1)
    store = Store(tmp_path / "store")
    computer = Computer(Care())
    try:
        computer.compute(work_of(store, fleet / "r000"))
        environment = Path(f"/proc/{computer._process}/environ").read_bytes().decode().split("\0")
        assert {f"{name}=1" for name in ONE_THREAD} <= set(environment)
    finally:
        computer.close()
    assert computer.started == 1


def test_how_a_process_ended_is_told_although_another_thread_was_told_first():
    from thermohyd.identify.fleet.computer import Computer

    class EndedUnnoticed:
        """As a process looks to a thread while another one, which the system told how it ended, has not written that down yet."""

        looks = 0

        def join(self, timeout: float) -> None: ...

        @property
        def exitcode(self) -> int | None:
            self.looks += 1
            return -11 if self.looks > 3 else None

    computer = Computer(Care())
    computer._processes = [EndedUnnoticed()]  # pyright: ignore[reportAttributeAccessIssue]
    assert computer._how_it_ended() == "by signal 11"


def work_of(store: Store, folder: Path):
    from thermohyd.identify.fleet.work import Task

    return Task(str(store.folder), look_at(folder), Settings("read"))


def test_chunks_go_to_workers_by_shape():
    shapes = {"a": (("leakage", 64),), "b": (("leakage", 128),)}
    records = [Found(f"{kind}{i}", f"{kind}{i}", shapes[kind]) for i in range(20) for kind in shapes]
    chunks = in_chunks(records, 2)
    assert all(len({found.shape for found in chunk}) == 1 for chunk in chunks)
    assert {len(chunk) for chunk in chunks} == {5}
    deal = Deal(chunks)
    given = {worker: [] for worker in ("one", "other")}
    for _ in range(4):
        for worker in given:
            chunk = deal.next_for(worker)
            assert chunk is not None
            given[worker].append(chunk[0].shape)
    assert [len(set(of)) for of in given.values()] == [1, 1]
    assert given["one"][0] != given["other"][0]
    assert (deal.next_for("one"), len(deal), deal.records()) == (None, 0, [])
