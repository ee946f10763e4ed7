import marimo


__generated_with = "0.25.2"
app = marimo.App(width="medium", app_title="A hidden effect")


@app.cell(hide_code=True)
def _():
    import marimo as mo

    mo.md("""
    # A hidden effect

    Record `bench_26` was made by a program of its own, with physics that the ideal valve does not have. The diagnosis names it; here
    the effect is added, and the curve that disagreed is drawn with and without it. It takes a minute or two.
    """)
    return (mo,)


@app.cell
def _():
    import jax

    jax.config.update("jax_enable_x64", True)  # before any array is made
    import matplotlib.pyplot as plt
    import numpy as np

    from thermohyd import identify
    from thermohyd.data import sample_record

    return identify, np, plt, sample_record


@app.cell
def _(identify, sample_record):
    record = identify.read_record(sample_record("seed_valve").parent / "hidden" / "bench_26")
    diagnosis = identify.diagnose(record)
    diagnosis
    return diagnosis, record


@app.cell
def _(diagnosis):
    for effect in diagnosis.effects:
        low, high = effect.ci95
        print(
            f"{effect.name}: {effect.value:.4g} {effect.unit}, 95 % {low:.4g} to {high:.4g}, rivals {len(effect.alternatives)}"
        )
    return


@app.cell(hide_code=True)
def _(mo):
    mo.md("""
    ## With the effect and without

    `diagnosis.model` is the valve with its named effects; without them it is another model, by the same parameters.
    """)
    return


@app.cell
def _(diagnosis, identify, record):
    from dataclasses import replace

    test = next(iter(diagnosis.where)).test
    channel = next(iter(diagnosis.where)).channel
    bare = replace(diagnosis.model, effects=dict.fromkeys(diagnosis.model.effects, 0.0))
    tables = {
        words: identify.predict(model, record).tables[test]
        for words, model in (("without", bare), ("with", diagnosis.model))
    }
    return channel, tables, test


@app.cell
def _(channel, np, plt, tables, test):
    figure, axes = plt.subplots(figsize=(7, 4), layout="constrained")
    for words, table in tables.items():
        read = next(name for name in table if name.startswith(channel) and "predicted" not in name)
        predicted = next(name for name in table if name.startswith(f"{channel}_predicted ["))
        place = next(name for name in table if name.startswith("spool_position"))
        gap = table[read] - table[predicted]
        axes.plot(table[place], gap, ".", ms=3, label=f"{words} the effect: rms {np.sqrt(np.mean(gap**2)):.3g}")
        print(f"{test}, {words} the effect: rms {np.sqrt(np.mean(gap**2)):.4g}, {read}")
    axes.set(xlabel=place, ylabel=f"measured less predicted, {read}")
    axes.legend()
    figure
    return


if __name__ == "__main__":
    app.run()
