"""The page of a fleet of made-up lives: fleet_page.py DIR [--valves 10000]. To be looked at; says how large and how long."""

import argparse
import sys
import time
from dataclasses import replace
from datetime import datetime, timedelta
from pathlib import Path


sys.path.insert(0, str(Path(__file__).parent))
sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))

import pyarrow as pa
from _fleet_tables import QUANTITIES, fleet
from helpers.fleet_records import stored_row

from thermohyd.identify.fleet.life import FleetLife, fleet_life
from thermohyd.identify.fleet.page import page_files
from thermohyd.identify.fleet.remaining import Limit
from thermohyd.identify.fleet.schema import RESULTS
from thermohyd.identify.fleet.store import Store, partition
from thermohyd.identify.report.files import write_all


TYPES = 10
UNITS = {"clearance": "m", "edge_radius": "m", "discharge_coefficient": "dimensionless"}
VERDICTS = (
    "fitted",
    "named",
    "consistent",
    "named",
    "consistent",
    "ambiguous",
    "consistent",
    "consistent",
    "consistent",
    "unexplained",
)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--valves", type=int, default=10_000)
    parser.add_argument(
        "--fitted", type=int, default=300, help="so many lives are fitted, the others are copies of them"
    )
    asked = parser.parse_args()
    store = Store(asked.folder / "store")
    for kind in range(TYPES):
        rows = rows_of(kind, asked.fitted // TYPES)
        where = store.folder / "results" / partition(rows[0]["type"], None) / f"together-{kind}.parquet"
        store._write(where, pa.Table.from_pylist(rows, RESULTS))
    began = time.perf_counter()
    life = fleet_life(store, {"*": {"clearance": Limit(None, "4.5 um")}})
    print(f"lives of {len(life.valves):,} valves of {TYPES} types: {time.perf_counter() - began:.1f} s", flush=True)
    copies = -(-asked.valves // len(life.valves))
    valves = [replace(valve, serial=f"{valve.serial}-{i:02d}") for valve in life.valves for i in range(copies)][
        : asked.valves
    ]
    began = time.perf_counter()
    written = write_all(asked.folder / "page", page_files(FleetLife(valves), {}, []))
    size = sum(path.stat().st_size for path in written)
    head = (asked.folder / "page" / "data" / "valves.js").stat().st_size
    seconds = time.perf_counter() - began
    print(
        f"pages of {len(valves):,} valves: {seconds:.1f} s, {size / 1e6:.1f} MB, of which {head / 1e6:.1f} come with the table"
    )


def rows_of(kind: int, valves: int) -> list[dict]:
    made = fleet(100 + kind, valves)
    rows = []
    for i in range(valves):
        for j, at in enumerate(made.series["clearance"][i].time):
            number = len(rows)
            parameters = []
            for name in QUANTITIES:
                one = made.series[name][i]
                known = {
                    "value": one.value[j],
                    "std": one.std[j],
                    "unit": UNITS[name],
                    "at_bound": False,
                    "fixed": False,
                }
                parameters.append({"name": name, **known})
            row = stored_row(
                number, parameters=parameters, effects=[], type=f"76-{101 + kind}", serial=f"{kind}{i:04d}"
            )
            row |= {
                "identity": f"{kind:08x}{number:024x}",
                "content": f"{kind} {number}",
                "path": f"/records/{kind}/{i:04d}_{j}",
            }
            row |= {"verdict": VERDICTS[(7 * i + 3 * j) % len(VERDICTS)], "operating_hours": 1000.0 * at}
            rows.append({**row, "date": datetime(2018, 1, 1) + timedelta(hours=4800.0 * at)})
    return rows


if __name__ == "__main__":
    main()
