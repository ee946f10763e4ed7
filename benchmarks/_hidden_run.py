"""Diagnose the records of a set, one after the other in long-lived processes, and keep every answer as it comes.

Answers go to a file of JSON lines; a run that was interrupted goes on where it stopped, as long as the program is the
same (a hash of its source is in every line).
"""

import argparse
import hashlib
import json
import math
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Collection, Iterator
from pathlib import Path
from typing import Any

from _processes import answers_of


PATIENCE = 900  # s, for one record, compiling included
ROOT = Path(__file__).parents[1]
WORK = ROOT / "build" / "hidden"


def folder_of_set(seed_set: int, generator: str = "hidden_records") -> Path:
    """Where records, answers and table of a set are kept; generator: the module of tests/reference that makes its records."""
    return WORK / (f"set{seed_set}" if generator == "hidden_records" else f"{generator}_{seed_set}")


def records_of_set(seed_set: int, generator: str = "hidden_records") -> Path:
    """Folder of the set's records and truth, made if it is not there or if the generator has changed."""
    folder = folder_of_set(seed_set, generator) / "records"
    mark = source_hash(ROOT / "tests" / "reference")
    made = folder / "generator"
    if not made.is_file() or made.read_text(encoding="utf-8") != mark:
        command = [sys.executable, "-m", f"reference.{generator}", str(folder), "--set", str(seed_set)]
        subprocess.run(command, cwd=ROOT / "tests", check=True, stdout=sys.stderr)
        made.write_text(mark, encoding="utf-8")
    return folder


def sets_of(generator: str = "hidden_records") -> tuple[int, ...]:
    """The sets that there are seeds for; the last one was made last."""
    sys.path.insert(0, str(ROOT / "tests"))
    from reference import hidden_plan, real_bench_plan

    return tuple((hidden_plan if generator == "hidden_records" else real_bench_plan).SEEDS)


def source_hash(*folders: Path) -> str:
    digest = hashlib.sha256()
    for folder in folders:
        for file in sorted(folder.rglob("*.py")):
            digest.update(file.relative_to(ROOT).as_posix().encode() + file.read_bytes())
    return digest.hexdigest()[:16]


def answers(
    seed_set: int,
    only: Collection[str],
    processes: int,
    *,
    any_version: bool,
    with_baselines: bool,
    ask_more: bool = True,
    generator: str = "hidden_records",
) -> dict[str, dict[str, Any]]:
    """{record: answer} of a set, or of `only` some of its records, in that order; what is answered is not asked again.

    any_version: answers of an earlier state of the program count too. ask_more: else only what is already there.
    """
    folder = records_of_set(seed_set, generator)
    names = [n for n in only or sorted(p.name for p in folder.iterdir()) if (folder / n).is_dir()]
    return kept(
        folder_of_set(seed_set, generator) / "answers.jsonl",
        source_hash(ROOT / "thermohyd", ROOT / "identify"),
        {n: (folder / n, with_baselines) for n in names},
        ask,
        processes,
        any_version=any_version,
        ask_more=ask_more,
        enough=lambda answer: "baselines" in answer or not with_baselines,
    )


def answers_of_seeds(
    description: str, noun: str, count: int, work: Path, digits: int, ask: Callable[[Any], dict[str, Any]]
) -> tuple[int, dict[str, dict[str, Any]]]:
    """(the seed, {name: answer}) of what a command line asks of numbered records or pairs, which `ask` makes of (seed, number)."""
    parser = argparse.ArgumentParser(description=description, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument(f"--{noun}s", type=int, default=count, dest="count", metavar="N")
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--seed", type=int, default=1, help="1: development; others are looked at once")
    parser.add_argument("--processes", type=int, default=1)
    parser.add_argument("--any-version", action="store_true", help="keep answers of an earlier state of the program")
    parser.add_argument("--show", action="store_true", help="only the table of the answers so far, of any version")
    options = parser.parse_args()
    work.mkdir(parents=True, exist_ok=True)
    numbers = range(options.first, options.first + options.count)
    return options.seed, kept(
        work / f"seed{options.seed}.jsonl",
        source_hash(ROOT / "thermohyd", ROOT / "identify"),
        {f"{noun}_{number:0{digits}d}": (options.seed, number) for number in numbers},
        ask,
        options.processes,
        any_version=options.any_version or options.show,
        ask_more=not options.show,
    )


def all_answered(
    store: Path, jobs: dict[str, Any], ask: Callable[[Any], dict[str, Any]], processes: int, *, any_version: bool
) -> dict[str, dict[str, Any]]:
    """`kept` answers to all `jobs`, in their order, by the program as it is; ends the process with the reasons where one has none."""
    store.parent.mkdir(parents=True, exist_ok=True)
    version = source_hash(ROOT / "thermohyd", ROOT / "identify")
    found = kept(store, version, jobs, ask, processes, any_version=any_version)
    if failed := [f"{name}: {answer['error']}" for name, answer in found.items() if "error" in answer]:
        sys.exit("; ".join(failed))
    return {name: found[name] for name in jobs}


def kept(
    store: Path,
    version: str,
    jobs: dict[str, Any],
    ask: Callable[[Any], dict[str, Any]],
    processes: int,
    *,
    any_version: bool,
    ask_more: bool = True,
    enough: Callable[[dict[str, Any]], bool] = lambda answer: True,
) -> dict[str, dict[str, Any]]:
    """{record: answer} of `jobs` {record: what `ask` takes}; what `store` has is not asked again, the others are added as they come.

    enough: whether an answer kept from an earlier run says all that is wanted.
    """
    known = {a["record"]: a for a in stored(store) if any_version or a["version"] == version}
    known = {n: a for n, a in known.items() if n in jobs and "error" not in a and enough(a)}
    left = [n for n in jobs if n not in known] if ask_more else []
    began = time.monotonic()
    with store.open("a", encoding="utf-8") as out:
        for done, answer in enumerate(answers_of(ask, [jobs[n] for n in left], processes), start=1):
            answer["version"] = version
            out.write(json.dumps(answer) + "\n")
            out.flush()
            known[answer["record"]] = answer
            took, words = time.monotonic() - began, answer.get("error") or answer["headline"]
            print(f"{done}/{len(left)} {took:.0f} s  {answer['record']}: {words[:110]}", file=sys.stderr, flush=True)
    return dict(sorted(known.items()))


def stored(store: Path) -> Iterator[dict[str, Any]]:
    if store.is_file():
        for line in store.read_text(encoding="utf-8").splitlines():
            try:
                yield json.loads(line)
            except ValueError:  # the last line of an interrupted run
                continue


def ask(job: tuple[Path, bool]) -> dict[str, Any]:
    """One record's diagnosis."""
    folder, with_baselines = job
    return answer_within(PATIENCE, folder, lambda record: _diagnosed(record, with_baselines))


def answer_within(patience: int, folder: Path, asked: Callable[[Path], dict[str, Any]]) -> dict[str, Any]:
    """What is asked of the record in a folder, as plain JSON; a failure is an answer too. patience: s."""
    from thermohyd.identify.cli.jax_setup import keep_memory_flat, set_up_jax

    def too_long(*_: Any) -> None:
        raise TimeoutError(f"no answer in {patience} s")

    set_up_jax()
    signal.signal(signal.SIGALRM, too_long)
    signal.alarm(patience)
    try:
        return plain(asked(folder))
    except Exception as error:
        return {"record": folder.name, "error": f"{type(error).__name__}: {error}"}
    finally:
        signal.alarm(0)
        keep_memory_flat()


def _diagnosed(folder: Path, with_baselines: bool) -> dict[str, Any]:
    from thermohyd.identify.bench.read import read_record
    from thermohyd.identify.diagnosis.diagnose import diagnose_case, open_case

    began = time.perf_counter()
    case = open_case(read_record(folder))
    result = diagnose_case(case)
    answer = {**answer_of(folder.name, result), "seconds": time.perf_counter() - began}
    if with_baselines:
        from _hidden_baselines import baselines

        answer["baselines"] = baselines(case.problem, case.base)
    return answer


def answer_of(name: str, result: Any) -> dict[str, Any]:
    """What the scores need of a DiagnosisResult, as plain JSON."""
    held = result.held_out
    return {
        "record": name,
        "verdict": result.verdict,
        "headline": result.headline,
        "gap_before": result.gap_before,
        "gap_after": result.gap_after,
        "left_over_p": result.left_over_p,
        "seconds": result.seconds,
        "absorbed": list(result.absorbed),
        "faults": result.to_dict()["faults"],
        "effects": [
            {
                **{k: getattr(e, k) for k in ("name", "value", "std", "p_value", "strength", "gap_closed", "at_bound")},
                "ci95": e.ci95,
                "alternatives": [{"name": a.name, "value": a.value, "chi2_more": a.chi2_more} for a in e.alternatives],
            }
            for e in result.effects
        ],
        "held_out": held
        and {
            k: getattr(held, k)
            for k in ("rows", "before", "after", "reduced_chi2_before", "reduced_chi2_after", "gap_closed", "exchange")
        },
        "parameters": {
            n: {"value": p.value, "std": p.std, "ci95": p.ci95, "at_bound": p.at_bound}
            for n, p in result.after.parameters.items()
        },
        "scores": {c.name: {"state": c.state, "z": c.z} for c in result.candidates},
        "where": [
            {"test": r.test, "channel": r.channel, "limits": r.limits, "share": r.share} for r in result.where[:3]
        ],
        "variations": [
            {"quantity": v.quantity, "variable": v.variable, "gap_closed": v.gap_closed} for v in result.variations[:3]
        ],
        "noise": {f"{n.test} {n.channel}": [n.std, n.correlation] for n in result.noise},
    }


def plain(value: Any) -> Any:
    """NumPy numbers as Python's, what is not finite as null."""
    if isinstance(value, dict):
        return {str(k): plain(v) for k, v in value.items()}
    if isinstance(value, (list, tuple)):
        return [plain(v) for v in value]
    if hasattr(value, "item"):
        value = value.item()
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value
