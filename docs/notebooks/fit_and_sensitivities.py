import marimo


__generated_with = "0.25.2"
app = marimo.App(width="medium", app_title="A fit and its sensitivities")


@app.cell(hide_code=True)
def _():
    import marimo as mo

    mo.md("""
    # A fit and its sensitivities

    A sample record is fitted; then the fitted valve is asked what each of its numbers does to its leakage. Bench records are in
    SI units inside: metres, pascals, kelvins.
    """)
    return (mo,)


@app.cell
def _():
    import jax

    jax.config.update("jax_enable_x64", True)  # before any array is made
    import jax.numpy as jnp
    import matplotlib.pyplot as plt
    import numpy as np

    import thermohyd as th
    from thermohyd import identify
    from thermohyd.data import sample_record

    return identify, jax, jnp, np, plt, sample_record, th


@app.cell
def _(identify, sample_record):
    record = identify.read_record(sample_record("seed_valve"))
    result = identify.fit(record)
    result
    return record, result


@app.cell(hide_code=True)
def _(mo):
    mo.md("""
    ## The valve that was found

    The model of a result is plain numbers. As a `Valve` it is a tree of arrays: every function of it can be differentiated in
    all of them at once.
    """)
    return


@app.cell
def _(np, record, result, th):
    model = result.model
    valve = th.Valve(
        oil=th.oil_from_definition(model.oil),
        stroke=model.valve.stroke,
        slot_width=model.valve.slot_width,
        **model.parameters,
    )
    position = np.linspace(-60e-6, 60e-6, 121)
    sweep = th.operating_points(position, supply_pressure=70e5, temperature=313.15)
    print(record.name, {name: f"{value:.4g}" for name, value in model.parameters.items()})
    return position, sweep, valve


@app.cell
def _(jax, jnp, position, sweep, th, valve):
    leakage = th.leakage_flow(valve, sweep)
    slopes = jax.jacfwd(th.leakage_flow)(valve, sweep)  # the same tree, a column per number
    # What 1 % more of each does to the leakage, as a share of that at null.
    null = int(jnp.argmin(jnp.abs(position)))
    names = ("edge_radius", "clearance", "underlap", "discharge_coefficient", "transition_number")
    shares = {name: 0.01 * getattr(valve, name) * getattr(slopes, name) / leakage[null] for name in names}
    return leakage, names, null, shares


@app.cell
def _(leakage, position, plt, shares):
    figure, (above, below) = plt.subplots(2, 1, sharex=True, figsize=(7, 6), layout="constrained")
    above.plot(1e6 * position, 6e4 * leakage)
    above.set_ylabel("leakage flow [l/min]")
    for name, share in shares.items():
        below.plot(1e6 * position, 100 * share, label=name)
    below.set(xlabel="spool position [um]", ylabel="by 1 % more [% of null]")
    below.legend(fontsize="small")
    figure
    return


@app.cell
def _(names, null, result, shares):
    for own in names:
        known = result.parameters[own]
        error = "held" if known.std is None else f"known to {100 * known.std / known.value:.2f} %"
        print(f"{own:22} {100 * float(shares[own][null]):+6.2f} % at null, {error}")
    return


if __name__ == "__main__":
    app.run()
