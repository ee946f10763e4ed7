"""What would petab_select name, the field's own tool for model selection, on the same records and fits? `make petab-select`.

Forward selection and FAMoS, each by AICc and BIC, ask for models of the library's effects; our engine fits them (`_petab_answers`),
and petab_select compares them and says which to fit next. Beside its choice stands the diagnosis's own answer, where `make hidden-bench`
(`make hidden` with --generator hidden_records) has left one. Faults of the bench are no candidates. Oil stored at the ports is one,
though its programs take minutes to compile (--no-storage leaves it out). An exact rival of the truth counts as right, since
petab_select lists no alternatives; the diagnosis does, and a truth among them counts as inside. Which sets are for development:
`hidden_bench_table`, `hidden_table`.
"""

import argparse
import importlib.metadata
import json
import sys
from pathlib import Path


sys.path.insert(0, str(Path(__file__).parent))

from _hidden_bench_scores import BenchCase
from _hidden_run import ROOT, answers, folder_of_set, kept, records_of_set, sets_of, source_hash
from _petab_answers import ask_petab_select
from _petab_select import tool
from _petab_tables import as_case, table
from hidden_bench_table import shortest_first, state


GENERATORS = ("real_bench_records", "hidden_records")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--set", type=int, default=1, help="of the records' generator")
    parser.add_argument("--generator", choices=GENERATORS, default=GENERATORS[0], help="which records")
    parser.add_argument("--processes", type=int, default=1, help="records at a time")
    parser.add_argument("--only", nargs="*", default=[], metavar="RECORD", help="these records, such as bench_07")
    parser.add_argument("--per-kind", type=int, metavar="N", help="of each kind the N records with the fewest rows")
    parser.add_argument("--budget", type=int, default=400, help="models that one search of one record may ask for")
    parser.add_argument("--no-storage", action="store_true", help="oil stored at the ports is no candidate")
    parser.add_argument("--any-version", action="store_true", help="keep answers of an earlier state of the program")
    parser.add_argument("--show", action="store_true", help="only the table of the answers so far, of any version")
    arguments = parser.parse_args()
    if arguments.set not in sets_of(arguments.generator):
        parser.error(
            f"{arguments.generator} has no set {arguments.set}; it has {', '.join(map(str, sets_of(arguments.generator)))}"
        )
    tool()
    truth = json.loads((records_of_set(arguments.set, arguments.generator) / "truth.json").read_text(encoding="utf-8"))
    names = arguments.only or shortest_first(truth, arguments.per_kind)
    folder = folder_of_set(arguments.set, arguments.generator)
    asked = f"budget {arguments.budget}, {'without' if arguments.no_storage else 'with'} storage"
    found = kept(
        folder / "petab_select.jsonl",
        f"{source_hash(ROOT / 'thermohyd', ROOT / 'identify')}, {asked}",
        {n: (folder / "records" / n, arguments.budget, not arguments.no_storage) for n in names},
        ask_petab_select,
        arguments.processes,
        any_version=arguments.any_version or arguments.show,
        ask_more=not arguments.show,
    )
    failed = {name: answer["error"] for name, answer in found.items() if "error" in answer}
    found = {name: answer for name, answer in found.items() if name not in failed}
    ours = answers(
        arguments.set,
        list(found),
        1,
        any_version=True,
        with_baselines=False,
        ask_more=False,
        generator=arguments.generator,
    )
    choices = {
        search: {name: as_case(truth[name], answer["searches"][search]["effects"]) for name, answer in found.items()}
        for search in next(iter(found.values()), {"searches": {}})["searches"]
    }
    diagnosed = {name: BenchCase(truth[name], answer) for name, answer in ours.items()}
    version = importlib.metadata.version("petab_select")
    text = f"# petab_select {version} beside the diagnosis: {arguments.generator}, set {arguments.set}\n\n"
    text += f"petab_select: {state(found.values())}\n\n"
    text += f"The diagnosis: {state(ours.values())}\n\n" if ours else "No answers of the diagnosis to compare with.\n\n"
    text += table(choices, diagnosed, found, failed)
    (folder / "petab_select.md").write_text(text, encoding="utf-8")
    print(text)


if __name__ == "__main__":
    main()
