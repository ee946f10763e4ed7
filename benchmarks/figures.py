"""Every figure of the documentation, written by the command that measured it: `make figures`, or PARTS="start-up hidden-1".

Each part runs one benchmark and keeps what it printed in docs/figures/PART.md, under a line with commit, date, machine and command, whole
or not at all; a part that fails keeps its last page, which says how old it is. Other pages show the blocks that they mark with
`<!-- figures: PART -->`, and a test holds that they are those of the pages. Without PARTS only what takes minutes; `all` takes a day.
"""

import argparse
import re
import subprocess
import sys
from datetime import UTC, datetime
from importlib.metadata import version
from pathlib import Path

from _commit import commit
from _hidden_run import sets_of
from _peers import machine

from thermohyd.identify.report.files import write_all


ROOT = Path(__file__).parents[1]
PAGES = ROOT / "docs" / "figures"
# What each part runs, and whether that takes minutes rather than an hour or more.
PARTS: dict[str, tuple[str, bool]] = {
    "start-up": ("start_up.py", True),
    "fit-speed": ("fit_speed.py", True),
    "simulation-speed": ("simulation_speed.py", True),
    "sensitivity-speed": ("sensitivity_speed.py", True),
    "dynamics-speed": ("dynamics_speed.py", True),
    "diagnosis-speed": ("diagnosis_speed.py", True),
    "diagnosis-row": ("diagnosis_row.py --records 40", False),
    "real-valve": ("real_valve.py --out build/real_valve", True),
    "real-valve-diagnosed": ("real_valve.py --diagnose", True),
    "real-valve-without-storage": ("real_valve.py --diagnose --without port_compliance_a,port_compliance_b", True),
    "hanging-load": ("hanging_load.py", True),
    "hanging-load-diagnosed": ("hanging_load.py build/hanging_load diagnose", True),
    "hanging-load-without-leak": ("hanging_load.py build/hanging_load diagnose jack_leakage", True),
    "hidden-1": ("hidden_table.py --set 1 --processes 2", False),
    "hidden-2": ("hidden_table.py --set 2 --processes 2", False),
    **{
        f"hidden-bench-{n}": (f"hidden_bench_table.py --set {n} --processes 2", False)
        for n in sets_of("real_bench_records")
    },
    "compare-pairs-4": ("compare_pairs.py --seed 4 --processes 2", False),
    "plan-rates-2": ("plan_rates.py --records 84 --seed 2 --processes 2", False),
    "hidden-dynamic-1": ("hidden_dynamic_table.py --set 1 --processes 2", False),
    "hidden-dynamic-2": ("hidden_dynamic_table.py --set 2 --processes 2", False),
    "leave-one-out-4": ("leave_one_out.py --set 4 --processes 2", False),
    "leave-one-out-search-9": ("leave_one_out.py --set 9 --search --processes 2", False),
    "nothing-wrong-6": ("leave_one_out.py --set 6 --search --processes 2", False),
    "leave-one-out-real-9": ("leave_one_out.py --set 9 --real --processes 2", False),
    "leave-one-out-search-real-13": ("leave_one_out.py --set 13 --real --search --processes 2", False),
    "leave-one-out-motion-5": ("leave_one_out_motion.py --set 5", False),
    "leave-one-out-motion-search-5": ("leave_one_out_motion.py --set 5 --search --processes 2", False),
    "same-answer": ("same_answer.py --set 9 --every 8 --processes 2", False),
    "raw-logs-fitted": ("hidden_raw_logs.py fit", False),
    "leakage-alone": ("hidden_raw_logs.py leakage --seeds 80", False),
    "nuisances": ("nuisances.py --brief --records 200 --first 14001", False),
    "nuisances-diagnosed": ("nuisances.py --diagnose --records 90 --first 15001", False),
    "raw-logs-diagnosed": ("hidden_raw_logs.py diagnose", False),
    "petab-select-9": ("petab_select_baseline.py --set 9 --per-kind 1 --no-storage --processes 2", False),
    "petab-select-1": ("petab_select_baseline.py --set 1 --processes 2", False),
    "joint-coverage": ("joint_coverage.py --processes 2", False),
    "law-coverage": ("law_coverage.py --processes 2", False),
    "recovery": ("recovery.py --processes 2", False),
    "fleet-whole": ("fleet_whole.py", False),
    "mangled-records": ("mangled_records.py --records 100000", False),
}
# What a part draws, and its name beside the pages.
PICTURES = {"plan-rates-2": ("build/plan_rates/seed2.png", "plan-rates.png")}
BLOCK = re.compile(r"(<!-- figures: ([\w-]+) -->\n).*?(<!-- end of figures -->)", re.DOTALL)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("parts", nargs="*", metavar="PART", help=f"{', '.join(PARTS)}, or all")
    asked = parser.parse_args().parts or [name for name, (_, quick) in PARTS.items() if quick]
    unknown = [name for name in asked if name not in PARTS and name != "all"]
    if unknown:
        parser.error(f"there is no part {', '.join(unknown)}; there are: {', '.join(PARTS)}, all")
    failed = [name for name in (PARTS if "all" in asked else asked) if not measured(name)]
    for shown in with_figures():
        write_all(shown.parent, {shown.name: with_blocks(shown.read_text(encoding="utf-8"), PAGES)})
    if failed:
        sys.exit(f"no new figures of {', '.join(failed)}: see above")


def with_figures() -> list[Path]:
    """The pages that show blocks of figures."""
    pages = [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md"))]
    return [page for page in pages if BLOCK.search(page.read_text(encoding="utf-8"))]


def measured(part: str) -> bool:
    """Whether a part ran to its end; its page is then new."""
    script, *arguments = PARTS[part][0].split()
    print(f"== {part}: {PARTS[part][0]}", file=sys.stderr, flush=True)
    command = [sys.executable, str(ROOT / "benchmarks" / script), *arguments]
    before = commit("--", "thermohyd", "identify", "benchmarks")
    run = subprocess.run(command, cwd=ROOT, stdout=subprocess.PIPE, text=True)
    if run.returncode or not run.stdout.strip():
        return False
    drawn, name = PICTURES.get(part, ("", ""))
    pictures: dict[str, bytes | str] = {name: (ROOT / drawn).read_bytes()} if drawn else {}
    write_all(PAGES, {f"{part}.md": page(part, run.stdout, before), **pictures})
    return True


def page(part: str, printed: str, at: str) -> str:
    """A part's page: what was printed, as a table where it is one, under where and when."""
    said = f"benchmarks/{PARTS[part][0]}, commit {at}, {datetime.now(UTC):%Y-%m-%d}; {machine()}, jax {version('jax')}"
    body = printed.strip("\n")
    if not re.search(r"^(#|\|)", body, re.MULTILINE):
        body = f"```\n{body}\n```"
    return f"<!-- written by `make figures PARTS={part}` -->\nMeasured by {said}.\n\n{body}\n"


def with_blocks(text: str, pages: Path) -> str:
    """A page with its blocks of figures as the parts' pages have them, without their title and up to the first heading in them."""

    def block(found: re.Match[str]) -> str:
        source = pages / f"{found[2]}.md"
        if not source.is_file():
            return f"{found[1]}Not measured.\n{found[3]}"
        shown = source.read_text(encoding="utf-8").split("\n", 1)[1].split("\n## ")[0].rstrip("\n")
        shown = re.sub(r"^# .*\n\n?", "", shown, flags=re.MULTILINE)
        return f"{found[1]}{shown}\n{found[3]}"

    return BLOCK.sub(block, text)


if __name__ == "__main__":
    main()
