"""What ships with the package: oil presets, and sample records to try the commands on. No JAX here."""

import difflib
import functools
import tomllib
from importlib.resources import files
from pathlib import Path

from thermohyd.oil_definition import OilDefinition


__all__ = ["oil_preset", "oil_presets", "sample_record"]


@functools.cache
def _oils() -> dict[str, OilDefinition]:
    table = tomllib.loads(files(__name__).joinpath("oils.toml").read_text(encoding="utf-8"))
    return {name: OilDefinition(name=name, **values) for name, values in table.items()}


def oil_presets() -> dict[str, OilDefinition]:
    """Every preset by name (docs/physics.md section 2, sources in oils.toml), SI units."""
    return dict(_oils())


def oil_preset(name: str) -> OilDefinition:
    """The preset of that name; capitals, spaces and underscores do not matter. Raises ValueError with one sentence."""
    wanted = "-".join(name.lower().replace("_", " ").replace("-", " ").split())
    if wanted in _oils():
        return _oils()[wanted]
    raise ValueError(f'no oil preset "{name[:60]}"; {_closest(wanted, list(_oils()))}')


def sample_record(name: str) -> Path:
    """Folder of a bench record that ships with the package, such as "seed_valve". Raises ValueError."""
    here = Path(str(files(__name__)))
    names = sorted(path.parent.name for path in here.glob("*/bench.toml"))
    if name in names:
        return here / name
    raise ValueError(f'no sample record "{name[:60]}"; {_closest(name, names)}')


def _closest(name: str, names: list[str]) -> str:
    close = difflib.get_close_matches(name[:60], names, n=1)
    return f'did you mean "{close[0]}"?' if close else f"known: {', '.join(names)}"
