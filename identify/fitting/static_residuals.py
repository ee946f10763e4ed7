"""The whitened residuals of static tests that a fit minimises, and their columns by one reverse pass per channel: then the priors."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from thermohyd.kept_programs import made_once
from thermohyd.valve import Valve

from .boxes import Box
from .least_squares import Residual
from .parameters import PARAMETERS, ParameterPlan
from .static_readings import (
    BALANCES,
    Rows,
    StaticData,
    group_rows,
    groups_of,
    predict,
    predict_balance,
    spread_over_rows,
    stacked,
    weighted_residuals,
    with_parameters,
)


class FitArgs(eqx.Module):
    """Data of the problem: the valve with its held parameters, the readings, and the priors of the free parameters."""

    valve: Valve
    data: StaticData
    prior_value: Float[Array, " free"]
    prior_weight: Float[Array, " free"]  # 1/standard deviation; 0 where there is no prior


def plain_residual(names: tuple[str, ...], values: Float[Array, " free"], args: FitArgs) -> Float[Array, " residuals"]:
    """Whitened residuals, then priors; differentiable in everything by the usual transformations."""
    own = own_entries(names)
    valve = with_parameters(args.valve, tuple(names[i] for i in own), values[np.array(own, dtype=int)])
    prior = (values - args.prior_value) * args.prior_weight
    found = predict(valve, args.data.conditions)
    given = {name: values[i] for i, name in enumerate(names)}
    return jnp.concatenate([weighted_residuals(found, args.data, given), prior])


def own_entries(names: tuple[str, ...]) -> list[int]:
    """Which of the parameters are the valve's; the others are those of sensors."""
    return [i for i, name in enumerate(names) if name in PARAMETERS]


@made_once
def residual_of(names: tuple[str, ...]) -> Residual:
    """The residual function of the named free parameters: one object per set of names, so that it compiles once.

    Its derivative is taken row by row: a reading depends on the parameters only through its own row, so one reverse
    pass over parameters that are spread over the rows gives every column at once, at a cost that does not grow with
    their number. Only derivatives with respect to the parameters are provided, not to `args`.
    """

    @jax.custom_jvp
    def residual(values: Float[Array, " free"], args: FitArgs) -> Float[Array, " residuals"]:
        return plain_residual(names, values, args)

    @residual.defjvp
    def pushforward(primals: tuple, tangents: tuple) -> tuple[Array, Array]:
        values, args = primals
        out, columns = residual_and_columns(names, values, args)
        return out, tangents[0] @ columns

    return residual


def residual_and_columns(
    names: tuple[str, ...], values: Float[Array, " free"], args: FitArgs
) -> tuple[Float[Array, " residuals"], Float[Array, "free residuals"]]:
    """The residuals and the columns of their Jacobian, by one reverse pass per channel that shares its rows with others."""
    data = args.data
    groups = groups_of(data.conditions, BALANCES)
    places = np.array(own_entries(names), dtype=int)
    own_names, own_values = tuple(names[i] for i in own_entries(names)), values[places]
    spread = spread_over_rows(own_values, data.conditions, groups)
    given = {name: values[i] for i, name in enumerate(names)}

    def of_rows(
        spread: dict[str, Rows],
    ) -> tuple[tuple[Float[Array, " padded"], ...], dict[int, dict[str, Array]]]:
        found: dict[str, dict[str, Array]] = {}
        for group, tests in groups.items():
            found |= predict_balance(with_parameters(args.valve, own_names, spread[group]), tests, data.conditions)
        parts, slopes = [], {}
        for i, c in enumerate(data.channels):
            reading = data.means(c.test, found[c.test][c.reads])
            if c.sensor is not None:
                reading, slopes[i] = c.sensor.readings(given, reading)
            parts.append((reading - c.value) * c.weight)
        return tuple(parts), slopes

    parts, pull, of_sensors = jax.vjp(of_rows, spread, has_aux=True)
    columns: dict[int, Array] = {}
    for layer in channel_layers(data):
        ones = tuple(jnp.ones_like(p) if i in layer else jnp.zeros_like(p) for i, p in enumerate(parts))
        slopes = stacked(pull(ones)[0])
        for i in layer:
            test = data.channels[i].test
            own = rows_of_test(slopes, test, groups, data)
            # Every node gave its own share of a mean's slope.
            columns[i] = own if test not in data.weights else jnp.sum(_by_node(own, data.weights[test]), axis=-1)
    if len(own_names) < len(names):
        for i, column in columns.items():
            whole = jnp.zeros((len(names), column.shape[1])).at[places].set(column)
            for name, slope in of_sensors.get(i, {}).items():
                whole = whole.at[names.index(name)].set(slope * data.channels[i].weight)
            columns[i] = whole
    prior = (values - args.prior_value) * args.prior_weight
    blocks = [columns[i] for i in range(len(parts))]
    return jnp.concatenate([*parts, prior]), jnp.concatenate([*blocks, jnp.diag(args.prior_weight)], axis=1)


def _by_node(
    values: Float[Array, "free rows"], weight: Float[Array, "padded nodes"]
) -> Float[Array, "free padded nodes"]:
    return values.reshape(values.shape[0], *weight.shape)


def channel_layers(data: StaticData) -> list[set[int]]:
    """Channels that can share a reverse pass: at most one of each test."""
    layers: list[set[int]] = []
    seen: dict[str, int] = {}
    for i, channel in enumerate(data.channels):
        depth = seen.get(channel.test, 0)
        seen[channel.test] = depth + 1
        if depth == len(layers):
            layers.append(set())
        layers[depth].add(i)
    return layers


def rows_of_test(
    slopes: dict[str, Float[Array, "free rows"]], test: str, groups: dict[str, tuple[str, ...]], data: StaticData
) -> Float[Array, "free own"]:
    """The columns of one test's rows (or nodes) among those of all groups."""
    for group, tests in groups.items():
        if test in tests:
            first = group_rows(data.conditions, tests[: tests.index(test)])
            return slopes[group][:, first : first + data.conditions[test].position.shape[0]]
    raise KeyError(test)


def prior_rows(plans: list[ParameterPlan]) -> tuple[Array, Array]:
    """(value, weight) of the priors, one per free parameter."""
    value = [plan.prior.value if plan.prior else plan.start for plan in plans]
    weight = [1.0 / plan.prior.std if plan.prior else 0.0 for plan in plans]
    return jnp.asarray(np.array(value, dtype=float)), jnp.asarray(np.array(weight, dtype=float))


def box_of(plan: ParameterPlan) -> Box:
    """How the solver sees a parameter: scaled linearly, because every lower limit (0 radius, overlap) can be reached."""
    return Box(plan.info.name, plan.start, plan.info.scale, plan.lower, plan.upper)
