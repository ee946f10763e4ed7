"""New folders appear in the store; half-written ones wait."""

import os
import threading

from helpers.fleet_records import write_fleet

from thermohyd.identify.fleet.identity import Settings
from thermohyd.identify.fleet.store import Store
from thermohyd.identify.fleet.watch import Watched, watch


def test_half_written_folders_wait(tmp_path):
    watched = Watched(settle=10.0)
    assert watched.whole(tmp_path / "nowhere", 0.0) == []
    folder = write_fleet(tmp_path / "drop", 1) / "r000"
    times = {path: 1000.0 for path in folder.iterdir()}
    for path, at in times.items():
        os.utime(path, (at, at))
    table = folder / "leakage.csv"
    text = table.read_text()

    def state(now: float) -> tuple[list, str]:
        return watched.whole(tmp_path / "drop", now), watched.waiting.get(folder, "")

    table.unlink()
    assert state(2000.0) == ([], "leakage.csv is missing")
    assert state(2001.0) == ([], "leakage.csv is missing")
    table.write_text(text[:40])
    os.utime(table, (2002.0, 2002.0))
    assert state(2003.0) == ([], "is being written")
    assert state(2004.0) == ([], "is being written")  # at rest for two seconds of ten
    table.write_text(text)
    os.utime(table, (2013.0, 2013.0))
    assert state(2100.0) == ([], "is being written")  # it changed since the last look, whatever its clock says
    assert state(2101.0) == ([folder], "")
    watched.taken[folder] = watched.signatures[folder]
    assert state(2102.0) == ([], "")
    table.write_text(text + "2,down,-10,0.1\n")  # changed: taken again
    os.utime(table, (2200.0, 2200.0))
    state(2300.0)
    assert state(2301.0) == ([folder], "")


def test_a_new_folder_appears_in_the_store(tmp_path):
    drop = tmp_path / "drop"
    write_fleet(drop, 2)
    (drop / "r001" / "bench.toml").write_text("[valve\n")
    store, stop = Store(tmp_path / "store"), threading.Event()
    seen: list[int] = []

    def after() -> None:
        seen.append(len(store.files()))
        if len(seen) == 1:
            (drop / "r001").rename(drop / "_aside")
            write_fleet(tmp_path / "later", 3)
            (tmp_path / "later" / "r002").rename(drop / "r002")
        else:
            stop.set()

    outcomes = watch(store, drop, Settings("read"), every=0.05, settle=0.0, after=after, stop=stop)
    assert [outcome.state for outcome in outcomes] == ["done", "failed", "done"]
    assert seen == [1, 2]
    assert [row["path"] for row in store.failures()] == [str(drop / "r001")]
