"""Wear, overhauls and time to a limit on made-up lives of valves: do intervals hold the truth?

    fleet_life.py [--fleets 10] [--valves 200] [--first-seed 1]

Each fleet: valves of one type with 5 to 10 records over about six years, three quantities with errors, three valves in ten overhauled.
Small fleets too: --valves 5.
"""

import argparse
import sys
import time
from pathlib import Path

import numpy as np


sys.path.insert(0, str(Path(__file__).parent))

from _fleet_tables import QUANTITIES, fleet

from thermohyd.identify.fleet.overhauls import find_overhauls
from thermohyd.identify.fleet.remaining import crossing


LIMIT = 4.5e-6  # m, of the clearance: far for some, passed by none at the start


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--fleets", type=int, default=10)
    parser.add_argument("--valves", type=int, default=200)
    parser.add_argument("--first-seed", type=int, default=1)
    asked = parser.parse_args()
    held = {name: [0, 0] for name in QUANTITIES}
    found = real = wrong = without = 0
    crossed, finite, width = [0, 0], 0, []
    began = time.perf_counter()
    for seed in range(asked.first_seed, asked.first_seed + asked.fleets):
        made = fleet(seed, asked.valves)
        _, lines, points = find_overhauls(made.series)
        for name, line in lines.items():
            std = np.sqrt(line.covariance[:, 1, 1])
            held[name][0] += int((np.abs(line.mean[:, 1] - made.slopes[name]) <= 1.96 * std).sum())
            held[name][1] += asked.valves
        for i, before in enumerate(made.overhaul):
            mine = [point.before for point in points if point.valve == i]
            real += before is not None
            found += before is not None and before in mine
            without += before is None
            wrong += before is None and bool(mine)
        for i, series in enumerate(made.series["clearance"]):
            now = float(series.time[-1])
            truth = (LIMIT - made.levels["clearance"][i]) / made.slopes["clearance"][i]
            if made.slopes["clearance"][i] <= 0.0 or truth < 0.0:
                continue
            told = crossing(lines["clearance"], i, now, LIMIT, True, float(series.time[-1] - series.time[0]))
            crossed[0] += told.low <= truth <= told.high
            crossed[1] += 1
            finite += np.isfinite(told.high)
            if np.isfinite(told.high):
                width.append((told.high - told.low) / truth)
    seconds = time.perf_counter() - began
    last = asked.first_seed + asked.fleets - 1
    print(
        f"{asked.fleets} fleets of {asked.valves} valves, seeds {asked.first_seed} to {last}, {seconds / asked.fleets:.1f} s each\n"
    )
    for name, (inside, of) in held.items():
        print(f"wear rate of {name:24s} inside its 95 % interval: {inside} of {of} ({100 * inside / of:.1f} %)")
    print(f"overhauls found at their place: {found} of {real} ({100 * found / max(real, 1):.1f} %)")
    print(f"valves without one, said to have one: {wrong} of {without} ({100 * wrong / max(without, 1):.1f} %)")
    share = 100 * crossed[0] / max(crossed[1], 1)
    print(f"time to the limit inside its 95 % interval: {crossed[0]} of {crossed[1]} ({share:.1f} %)")
    print(
        f"   of finite length: {finite}; their width is {100 * float(np.median(width)):.0f} % of the time itself in the middle"
    )


if __name__ == "__main__":
    main()
