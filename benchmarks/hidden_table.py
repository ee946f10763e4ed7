"""Records with a hidden effect: is it found, named, and its gap closed? `make hidden`, or `make hidden SET=2`.

The records come from the reference simulator (tests/reference/hidden_records.py, fixed seeds); their truth lies in a file
outside every record. Set 1 is for development; sets 2 and 3 (faint effects, and none) are looked at once, when nothing changes any more.
"""

import argparse
import json
import sys
from pathlib import Path


sys.path.insert(0, str(Path(__file__).parent))

from _hidden_run import WORK, answers, records_of_set
from _hidden_scores import Case
from _hidden_tables import table


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--set", type=int, choices=(1, 2, 3), default=1, help="1: development; 2, 3: looked at once")
    parser.add_argument("--processes", type=int, default=1, help="records diagnosed at a time")
    parser.add_argument("--only", nargs="*", default=[], metavar="RECORD", help="these records, such as bench_07")
    parser.add_argument("--no-baselines", action="store_true", help="leave out AIC, BIC, stepwise and correlation")
    parser.add_argument("--any-version", action="store_true", help="keep answers of an earlier state of the program")
    parser.add_argument("--show", action="store_true", help="only the table of the answers so far, of any version")
    arguments = parser.parse_args()
    truth = json.loads((records_of_set(arguments.set) / "truth.json").read_text(encoding="utf-8"))
    found = answers(
        arguments.set,
        arguments.only,
        arguments.processes,
        any_version=arguments.any_version or arguments.show,
        with_baselines=not (arguments.no_baselines or arguments.show),
        ask_more=not arguments.show,
    )
    failed = {name: answer["error"] for name, answer in found.items() if "error" in answer}
    cases = [Case(truth[name], answer) for name, answer in found.items() if name not in failed]
    text = f"# Hidden-effect records, set {arguments.set}\n\n" + table(cases, failed)
    (WORK / f"set{arguments.set}" / "table.md").write_text(text, encoding="utf-8")
    print(text)


if __name__ == "__main__":
    main()
