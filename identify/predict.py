"""What a model predicts at a record's operating points, with standard deviations from the parameters' covariance."""

from collections.abc import Callable, Iterator

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pandas as pd
from jaxtyping import Array, Float

from thermohyd.conditions import Conditions
from thermohyd.precision import require_float64
from thermohyd.valve import Valve

from .model_file import Model
from .record import BenchRecord, TestRecord
from .signs import reversed_channels, warning_of
from .static_model import base_valve, conditions_of, predict, with_parameters
from .units import from_si


# What a test reads where the record itself says nothing of it, and the bench unit to report it in.
READINGS = {
    "leakage": ("leakage_flow",),
    "pressure_gain": ("load_pressure",),
    "flow_gain": ("flow",),
    "load_flow": ("flow",),
}
BENCH_UNITS = {
    "leakage_flow": "l/min",
    "flow": "l/min",
    "load_pressure": "bar",
    "pressure_a": "bar",
    "pressure_b": "bar",
}
# Rows per evaluation: large logs are predicted piece by piece, so that memory stays flat.
CHUNK = 16384


@eqx.filter_jit
def readings_and_slopes(
    valve: Valve, names: tuple[str, ...], values: Float[Array, " free"], conditions: dict[str, Conditions]
) -> tuple[dict, dict]:
    """Every channel's readings, and their derivatives to the free parameters (one row per reading)."""

    def of(v: Float[Array, " free"]) -> dict:
        return predict(with_parameters(valve, names, v), conditions)

    if not names:
        found = predict(valve, conditions)
        return found, jax.tree.map(lambda a: a[:, None][:, :0], found)
    return of(values), jax.jacfwd(of)(values)


def _pieces(test: TestRecord) -> Iterator[tuple[slice, Conditions]]:
    whole = conditions_of(test)
    if test.rows <= CHUNK:
        yield slice(0, test.rows), whole
        return
    for first in range(0, test.rows, CHUNK):
        index = jnp.minimum(jnp.arange(first, first + CHUNK), test.rows - 1)
        yield slice(first, min(first + CHUNK, test.rows)), jax.tree.map(lambda a, index=index: a[index], whole)


def predict_test(model: Model, record: BenchRecord, test: TestRecord) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """{channel: (reading, standard deviation)} for each row of a test, SI units."""
    free = model.free if model.covariance is not None else ()
    covariance = np.zeros((0, 0)) if model.covariance is None else model.covariance
    of_model = BenchRecord(record.folder, record.name, model.valve, model.oil, record.tests)
    valve = base_valve(of_model, model.parameters, heat="heat_retention" in free)
    values = jnp.asarray([model.parameters[name] for name in free], dtype=float)
    channels = tuple(channel.name for channel in test.channels) or READINGS[test.name]
    out = {name: (np.empty(test.rows), np.empty(test.rows)) for name in channels}
    for rows, conditions in _pieces(test):
        found, slopes = readings_and_slopes(valve, free, values, {test.name: conditions})
        for name, (reading, std) in out.items():
            count = rows.stop - rows.start
            reading[rows] = np.asarray(found[test.name][name])[:count]
            jacobian = np.asarray(slopes[test.name][name])[:count]
            variance = np.einsum("ij,jk,ik->i", jacobian, covariance, jacobian)
            # Without a covariance nothing is known of the error, which is not the same as no error.
            std[rows] = np.sqrt(np.maximum(variance, 0.0)) if free else np.nan
    return out


def simulate_record(
    record: BenchRecord, model: Model, *, progress: Callable[[str], None] | None = None
) -> dict[str, pd.DataFrame]:
    """{test: the record's columns with `<reading>_predicted [unit]` and `<reading>_predicted_std [unit]` added}."""
    require_float64("simulate")
    tables: dict[str, pd.DataFrame] = {}
    for test in record.tests.values():
        if progress is not None:
            progress(f"simulating {test.name}: {test.rows:,} rows")
        turned = reversed_channels(test)
        if progress is not None:
            for channel in turned:
                progress(warning_of(test, channel))
        table = pd.DataFrame(index=range(test.rows)) if test.table is None else test.table.copy()
        for name, (reading, std) in predict_test(model, record, test).items():
            unit = BENCH_UNITS[name]
            # Beside a gauge that the record shows to be wired the other way round, the prediction turns with it.
            table[f"{name}_predicted [{unit}]"] = from_si(-reading if name in turned else reading, unit)
            table[f"{name}_predicted_std [{unit}]"] = from_si(std, unit)
        tables[test.name] = table
    return tables
