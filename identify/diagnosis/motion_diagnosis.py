"""One diagnosis of a record with dynamic tests: the static part first, then motion with what it gave."""

from collections.abc import Callable
from dataclasses import replace

from ..dynamic.both_fits import joined
from ..record import BenchRecord
from .case import Case, Progress
from .motion_case import open_motion
from .result import DiagnosisResult, Verdict


ORDER: tuple[Verdict, ...] = ("consistent", "named", "ambiguous", "unexplained")
Conclude = Callable[[Case], DiagnosisResult]


def diagnose_motion(
    record: BenchRecord, static: DiagnosisResult | None, conclude: Conclude, say: Progress = lambda _: None
) -> DiagnosisResult:
    """conclude: what follows an opened case (`diagnose.diagnose_case`). static: the diagnosis of the static tests, if any."""
    if static is None:
        return in_words_of_motion(conclude(open_motion(record, say)))
    found = {effect.name: effect.value for effect in static.effects}
    motion = in_words_of_motion(conclude(open_motion(record, say, static.after, found)))
    return _both(record, static, motion)


def in_words_of_motion(result: DiagnosisResult) -> DiagnosisResult:
    """The headline speaks of the actuator."""
    return replace(
        result, headline=result.headline.replace("The ideal valve explains", "The actuator's model explains")
    )


def _both(record: BenchRecord, static: DiagnosisResult, motion: DiagnosisResult) -> DiagnosisResult:
    verdict = max(static.verdict, motion.verdict, key=ORDER.index)
    lead = static.headline if static.verdict == motion.verdict == "consistent" else f"Static tests: {static.headline}"
    end = motion.headline if static.verdict == motion.verdict == "consistent" else f"Dynamic tests: {motion.headline}"
    seen = {c.name for c in motion.candidates}
    after, before = joined(static.after, motion.after), joined(static.before, motion.before)
    extra = {e.name: motion.after.parameters[e.name] for e in motion.effects}
    return replace(
        static,
        record=record,
        verdict=verdict,
        headline=f"{lead} {end}",
        sentences=(*static.sentences, *motion.sentences),
        where=(*static.where, *motion.where),
        where_after=(*static.where_after, *motion.where_after),
        effects=(*static.effects, *motion.effects),
        candidates=(*(c for c in static.candidates if c.name not in seen), *motion.candidates),
        absorbed=tuple(dict.fromkeys((*static.absorbed, *motion.absorbed))),
        gap_before=before.reduced_chi2,
        gap_after=after.reduced_chi2,
        held_out=motion.held_out if motion.effects or not static.effects else static.held_out,
        next_test=static.next_test or motion.next_test,
        before=before,
        after=replace(after, parameters={**after.parameters, **extra}),
        shifts=(*static.shifts, *motion.shifts),
        variations=(*static.variations, *motion.variations),
        evidence=(*static.evidence, *motion.evidence),
        noise=(*static.noise, *motion.noise),
        left_over_p=min(static.left_over_p, motion.left_over_p),
        notes=tuple(dict.fromkeys((*static.notes, *motion.notes))),
        warnings=tuple(dict.fromkeys((*static.warnings, *motion.warnings))),
    )
