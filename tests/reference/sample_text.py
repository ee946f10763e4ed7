"""The texts that the sample records share: the label, the CSV layout, the table of the truth."""

from reference.valve import Valve


LABEL = "# synthetic: made by the reference simulator, not measured"


def csv_text(comments: list[str], columns: dict[str, list[str]]) -> str:
    """A CSV with the label, comment lines, a header and ready-made fields."""
    lines = [LABEL, *(f"# {c}" for c in comments), ",".join(columns)]
    lines += [",".join(fields) for fields in zip(*columns.values(), strict=True)]
    return "\n".join(lines) + "\n"


def truth_table(valve: Valve) -> str:
    """The README's list of the parameters behind a record, in bench units."""
    rows = [
        ("edge_radius", f"{valve.edge_radius * 1e6:g} um"),
        ("clearance", f"{valve.clearance * 1e6:g} um"),
        ("underlap", f"{valve.underlap * 1e6:g} um"),
        ("discharge_coefficient", f"{valve.discharge_coefficient:g}"),
        ("transition_number", f"{valve.transition_number:g}"),
        ("null_bias", f"{valve.null_bias * 1e6:g} um"),
    ]
    head = "The truth, which the program never reads:\n\n| parameter | value |\n|---|---|\n"
    return head + "".join(f"| {name} | {value} |\n" for name, value in rows)
