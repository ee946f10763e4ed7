"""Small bench records on disk, for tests to read and to spoil."""

from pathlib import Path


TOML = """[valve]
name = "test valve"
stroke = "200 um"
slot_width = "12 mm"
rated_current = "25 mA"
polarity = -1

[oil]
preset = "mil-prf-5606"

[conditions]
supply_pressure = "70 bar"
temperature = "40 degC"

[tests.leakage]
file = "leakage.csv"
"""

LEAKAGE = """# a comment
time [s],run,spool_position [um],leakage_flow [l/min]
0,up,-10,0.1
1,up,0,0.3
# another
2,up,10,0.1

0,down,10,0.1
1,down,0,0.3
"""


def write_record(folder: Path, toml: str = TOML, **tables: str | bytes) -> Path:
    """A record in `folder`; keyword arguments are CSV files by name without .csv, the leakage table always there."""
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "bench.toml").write_text(toml, encoding="utf-8", newline="")
    for name, content in ({"leakage": LEAKAGE} | tables).items():
        data = content.encode() if isinstance(content, str) else content
        (folder / f"{name}.csv").write_bytes(data)
    return folder
