"""Which packages does an optional part of the program need, and what installs it? Every message and help text asks here."""

# The names of pyproject.toml, and the packages as they are imported.
PARTS: dict[str, tuple[str, ...]] = {
    "parquet": ("pyarrow",),
    "matlab": ("h5py",),
    "tdms": ("nptdms",),
    "fleet": ("distributed", "duckdb", "psutil", "pyarrow"),
    "posterior": ("blackjax", "arviz_base", "arviz_stats", "h5netcdf", "h5py"),
    "app": ("streamlit", "tomlkit"),
    "docs": ("zensical",),
}


def install(part: str) -> str:
    """The command that installs a part, and where it works: no index of packages has thermohyd. Raises KeyError."""
    if part not in PARTS:
        raise KeyError(part)
    return f"pip install -c constraints.txt '.[{part}]' in the source folder of thermohyd"
