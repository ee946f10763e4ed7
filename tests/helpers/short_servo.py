"""The first half of two runs of a sample servo, without its pressures: less to compute."""

import functools
import shutil
import tempfile
from pathlib import Path

from thermohyd.data import sample_record
from thermohyd.identify.bench.read import read_record
from thermohyd.identify.bench.test_record import TestRecord
from thermohyd.identify.fitting.library import NOTHING
from thermohyd.identify.fitting.motion_readings import require_actuator
from thermohyd.identify.fitting.parameters import plan_motion
from thermohyd.identify.fitting.problem import Problem
from thermohyd.identify.fitting.readings import white_noise
from thermohyd.identify.noise.level import initial_noises


HIDDEN = sample_record("seed_actuator").parent / "hidden_dynamic"


def write_short_servo(folder: Path) -> Path:
    """servo_2 into `folder`, which is returned."""
    shutil.copy(HIDDEN / "servo_2" / "bench.toml", folder)
    lines = (HIDDEN / "servo_2" / "step.csv").read_text().splitlines()
    head = lines[1].split(",")
    keep = [i for i, name in enumerate(head) if not name.startswith("pressure")]
    rows = [line.split(",") for line in lines[2:]]
    rows = [row for row in rows if row[1] in ("1", "2") and float(row[0]) <= 0.16]
    table = [[row[i] for i in keep] for row in (head, *rows)]
    (folder / "step.csv").write_text("\n".join(",".join(row) for row in table) + "\n")
    return folder


@functools.cache
def short_servo_problem() -> Problem:
    """Of that record, all oil at one temperature; one problem for every module of a process, whose programs are compiled once."""
    with tempfile.TemporaryDirectory() as there:
        folder = write_short_servo(Path(there))
        toml = (folder / "bench.toml").read_text().replace('heat = "adiabatic"', 'heat = "isothermal"')
        (folder / "bench.toml").write_text(toml)
        record = read_record(folder)
    plans = plan_motion(record.valve, require_actuator(record), record.start)
    tests: dict[str, TestRecord] = {**record.dynamic_tests}
    return Problem(record, tests, plans, NOTHING, white_noise(initial_noises(record.dynamic_tests.values())))
