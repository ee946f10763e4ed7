"""The first half of two runs of a sample servo, without its pressures: less to compute."""

import shutil
from pathlib import Path

from thermohyd.data import sample_record


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
