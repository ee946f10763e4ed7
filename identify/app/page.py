"""The page: drop a folder, see what is read of it, say what is missing, run a fit or a diagnosis, look at its report.

Whatever stands in a user's file goes through `plain` before Streamlit reads it as Markdown.
"""

import streamlit as st

from thermohyd.data import oil_presets
from thermohyd.identify.bench.errors import BenchInputError
from thermohyd.identify.bench.read import NAME
from thermohyd.identify.checking.report import answer
from thermohyd.identify.checking.result import CheckResult

from .closing import close_with_session
from .columns_panel import files_panel, tests_panel
from .command_run import CommandRun
from .draft import VISCOSITY, Place, value_at, with_value
from .widgets import WORK, bound_text, current, plain, shown
from .work import JOBS, Work


SENT, REFUSED = "sent", "refused"  # keys of the session
POINTS = "own viscosity points"
CHOOSE = "choose one"
MOST_POINTS = 20  # to be typed; more of them are told in bench.toml
POINT = ("Temperature", "Kinematic viscosity")
EVERY = 0.5  # s, between two looks at a command that runs
REPORT_HEIGHT = 900
ACROSS = 3
# Place in bench.toml, what it is called, what it could be.
SIZES: dict[Place, tuple[str, str]] = {
    ("valve", "name"): ("Name of the valve", "MOOG 76-101, SN 17"),
    ("valve", "stroke"): ("Stroke, from null to full opening", "213 um"),
    ("valve", "slot_width"): ("Slot width of one edge, all slots", "12 mm"),
    ("valve", "rated_current"): ("Rated current, if a column is one", "25 mA"),
    ("conditions", "supply_pressure"): ("Supply pressure, if no column has it", "70 bar"),
    ("conditions", "return_pressure"): ("Return pressure, likewise", "0 bar"),
    ("conditions", "temperature"): ("Oil temperature, likewise", "40 degC"),
}


def page() -> None:
    """Everything, from top to bottom; Streamlit runs it again after every click."""
    st.set_page_config(page_title="thermohyd", layout="wide")
    st.title("thermohyd")
    st.markdown(
        "Servovalve models from test-bench curves. The computer that runs this page reads the files, and nothing goes on from there; "
        "what was dropped is removed two minutes after the page is closed."
    )
    _drop()
    if REFUSED in st.session_state:
        st.error(plain(st.session_state[REFUSED]))
    work: Work | None = st.session_state.get(WORK)
    if work is None:
        return
    if work.run is not None and work.running:
        _watch(work.run)
        return
    _left_out(work)
    found = work.check()
    _settings(work)
    files_panel(work)
    tests_panel(work, found)
    _by_hand(work)
    _what_a_check_says(work, found)
    _start(work, found)
    if work.run is not None:
        _outcome(work, work.run)


def _drop() -> None:
    kind = st.segmented_control(
        "What to drop",
        ["a folder", "files"],
        default="a folder",
        key="kind",
        required=True,
        disabled=WORK in st.session_state,
        label_visibility="collapsed" if WORK in st.session_state else "visible",  # a grey one is hard to read
    )
    st.file_uploader(
        "The folder of a bench record: bench.toml and a file per test"
        if kind == "a folder"
        else "The files of a bench record, with or without bench.toml",
        accept_multiple_files="directory" if kind == "a folder" else True,
        key="upload" if kind == "a folder" else "upload_files",
    )
    sent = st.session_state.get("upload" if kind == "a folder" else "upload_files") or []
    identity = tuple(file.file_id for file in sent)
    if identity == st.session_state.get(SENT, ()):
        return
    before: Work | None = st.session_state.pop(WORK, None)
    more = set(st.session_state.get(SENT, ())) <= set(identity)  # of the same record
    st.session_state[SENT] = identity
    st.session_state.pop(REFUSED, None)
    if sent:
        try:
            files = ((file.name, file.getvalue()) for file in sent)
            work = st.session_state[WORK] = Work(files, before if more else None)
            close_with_session(work)
        except BenchInputError as error:
            st.session_state[REFUSED] = str(error)
    if before is not None:
        before.close()


def _left_out(work: Work) -> None:
    names = work.uploaded.left_out
    if names:
        more = f" and {len(names) - 6} more" if len(names) > 6 else ""
        st.markdown(f"Not of this record: {plain(', '.join(names[:6]))}{more}")


def _settings(work: Work) -> None:
    st.header("Valve, oil and conditions")
    fields: list[tuple[Place, tuple[str, str]] | None] = [*SIZES.items(), None]  # the last one is the oil
    for first in range(0, len(fields), ACROSS):  # row by row: a phone shows them in this order
        for column, field in zip(st.columns(ACROSS), fields[first : first + ACROSS], strict=False):
            with column:
                if field is None:
                    _oil(work)
                else:
                    bound_text(work, field[0], *field[1])
    _points(work)


def _oil(work: Work) -> None:
    said = value_at(work.text, ("oil", "preset"))
    presets = list(oil_presets())
    points = value_at(work.text, ("oil", "viscosity"))
    options = [CHOOSE, *presets, *([str(said)] if said is not None and said not in presets else []), POINTS]
    st.session_state["oil"] = POINTS if points is not None else CHOOSE if said is None else str(said)
    st.selectbox("Oil", options, key="oil", on_change=_choose_oil)


def _points(work: Work) -> None:
    points = value_at(work.text, ("oil", "viscosity"))
    if isinstance(points, list) and all(isinstance(point, list) and len(point) == 2 for point in points):
        for i in range(min(len(points), MOST_POINTS)):  # a row each
            for j, (column, label) in enumerate(zip(st.columns(ACROSS)[:2], POINT, strict=True)):
                with column:
                    bound_text(work, ("oil", "viscosity", i, j), f"{label} of point {i + 1}", VISCOSITY[0][j])


def _choose_oil() -> None:
    work, chosen = current(), st.session_state["oil"]
    text = with_value(work.text, ("oil", "preset"), None if chosen in (CHOOSE, POINTS) else chosen)
    work.change(with_value(text, ("oil", "viscosity"), VISCOSITY if chosen == POINTS else None))


def _by_hand(work: Work) -> None:
    with st.expander(f"{NAME}, as it is read: everything else can be written here"):
        st.session_state["text"] = work.text
        st.text_area(NAME, key="text", height=320, on_change=_rewrite, label_visibility="collapsed")
    st.download_button(f"Download {NAME}", work.text, NAME, "text/plain", on_click="ignore", key="download_toml")


def _rewrite() -> None:
    current().change(st.session_state["text"])


def _what_a_check_says(work: Work, found: CheckResult | str) -> None:
    st.header("What a check says")
    if isinstance(found, str):
        st.error(shown(work, found))
        return
    (st.error if found.trouble else st.success)(shown(work, answer(found)))
    if "" in found.refused:  # about the record as a whole; each test's own stands beside the test
        st.error(shown(work, found.refused[""]))
    for warning in found.warnings:
        st.warning(shown(work, warning))
    if found.missing:
        with st.expander(f"What is missing ({len(found.missing)}), and what that costs"):
            for lacking in found.missing:
                st.markdown(f"- {shown(work, lacking.sentence)}")
    if found.tests and st.toggle("Show the curves", key="curves"):
        for picture in work.curves(found):
            st.image(picture)


def _start(work: Work, found: CheckResult | str) -> None:
    st.header("Run")
    ready = isinstance(found, CheckResult) and not found.trouble and not found.for_predictions_only
    fit, diagnose, rest = st.columns([1, 1, 3])
    with fit:
        st.button(
            "Fit", key="fit", disabled=not ready, on_click=work.start, args=("fit",), type="primary", width="stretch"
        )
    with diagnose:
        st.button(
            "Diagnose", key="diagnose", disabled=not ready, on_click=work.start, args=("diagnose",), width="stretch"
        )
    with rest:
        st.markdown(
            "Fit: the parameters of the valve with error bars. Diagnose: where bench and valve disagree, and which "
            "effect is missing; it takes several times as long."
        )


@st.fragment(run_every=EVERY)
def _watch(run: CommandRun) -> None:
    if run.status is not None:
        st.rerun()
    st.info(f"{run.arguments[0]}, {run.seconds:.0f} s: {plain(run.step())}")
    st.button("Stop", key="stop", on_click=run.stop)
    with st.expander("What it did so far"):
        st.text("\n".join(run.steps()) or "nothing yet")


def _outcome(work: Work, run: CommandRun) -> None:
    job = run.arguments[0]
    if run.stopped:
        st.warning(f"{job}: {plain(run.failure())}")
    elif run.failure():
        st.error(f"{job}: {plain(run.failure())}")
    report = work.result("report.html")
    if report is None:
        return
    st.header(f"Report of the {'fit' if job == 'fit' else 'diagnosis'}, {run.seconds:.0f} s")
    if work.text != work.ran_on:
        st.warning(f"{NAME} has changed since: this is the report of what it said before.")
    offered = {"report.html": "text/html", JOBS[job]: "application/json", "model.json": "application/json"}
    columns = st.columns(len(offered))
    for column, (file, kind) in zip(columns, offered.items(), strict=True):
        content = work.result(file)
        if content is not None:
            with column:
                st.download_button(
                    f"Download {file}",
                    content,
                    f"{work.record.name}-{file}",
                    kind,
                    on_click="ignore",
                    key=file,
                    width="stretch",
                )
    st.iframe(report.decode("utf-8"), height=REPORT_HEIGHT, alt="report")
