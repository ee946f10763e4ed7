"""Write a template record to fill in: a commented bench.toml and three small synthetic CSV files that fit as is."""

from importlib.resources import files
from pathlib import Path

from thermohyd.identify.bench.errors import BenchInputError
from thermohyd.identify.report.files import write_all


FILES = ("bench.toml", "leakage.csv", "pressure_gain.csv", "flow_gain.csv")


def write_template(folder: Path) -> list[Path]:
    """Make the folder and write the template into it, whole or not at all; returns the paths.

    Raises BenchInputError where the folder already holds something, or is a file.
    """
    folder = Path(folder)
    try:
        if folder.exists() and not folder.is_dir():
            raise BenchInputError("is a file; name a new folder", file=folder)
        if folder.is_dir() and any(folder.iterdir()):
            raise BenchInputError("is not empty; name a new folder, so that nothing is overwritten", file=folder)
        templates = files("thermohyd.identify") / "templates"
        return write_all(folder, {name: (templates / name).read_bytes() for name in FILES})
    except (OSError, ValueError) as error:
        raise BenchInputError(f"cannot be written ({getattr(error, 'strerror', None) or error})", file=folder) from None
