"""Where a study's valve comes from: a bench record, a model.json, both, or the seed paper. Read before JAX starts."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from ..errors import BenchInputError
from ..record import BenchRecord
from .settings import Settings, read_settings


if TYPE_CHECKING:
    from thermohyd.actuator import Actuator

    from ..fit_result import FitResult
    from .subject import Subject


@dataclass(frozen=True)
class Source:
    """What a command was given, read and checked; `model_file` is read when JAX runs, which effects in it need."""

    settings: Settings
    record: BenchRecord | None = None
    model_file: Path | None = None

    def subject(self, say: Callable[[str], None] = lambda _: None) -> "Subject":
        """The study's subject; a record with readings and without a model is fitted.

        Raises BenchInputError, and RuntimeError where the fit does not converge.
        """
        from ..model_file import load_model, nominal_model
        from .subject import seed_model, subject_of_fit, subject_of_model, subject_of_record

        model = None if self.model_file is None else load_model(self.model_file)
        if self.record is not None and not self.record.tests:
            raise BenchInputError(
                "holds dynamic tests only; sensitivity studies a valve at the conditions of its static tests",
                file=self.record.folder,
            )
        if self.record is None:
            return subject_of_model(seed_model() if model is None else model, self.settings)
        if model is not None:
            return subject_of_record(self.record, model, self.settings)
        if not all(test.channels for test in self.record.tests.values()):
            return subject_of_record(self.record, nominal_model(self.record), self.settings)
        return subject_of_fit(fitted(self.record, say), self.settings)


def fitted(record: BenchRecord, say: Callable[[str], None]) -> "FitResult":
    """The fit that a study starts from. Raises RuntimeError where it does not converge."""
    from ..fit import fit

    result = fit(record, progress=say)
    if not result.converged:
        raise RuntimeError(f"the fit did not converge: {result.message}; name a model with --model")
    return result


def actuator_of(subject: "Subject", settings: Settings) -> "Actuator | None":
    """The actuator that the settings describe, on the valve's own rated current; None where they describe none."""
    if not settings.actuator:
        return None
    from thermohyd.actuator import Actuator

    current = subject.model.valve.rated_current
    return Actuator(**settings.actuator, **({} if current is None else {"rated_current": current}))


def read_source(
    source: Path | None, model: Path | None, settings: Path | None, say: Callable[[str], None] = lambda _: None
) -> Source:
    """Read what was named on the command line. Raises BenchInputError."""
    own = Settings() if settings is None else read_settings(settings)
    if source is None or source.suffix == ".json":
        if source is not None and model is not None:
            raise BenchInputError("is a model already; give --model only with a record", file=source)
        chosen = model if source is None else source
        if chosen is not None and not chosen.is_file():
            raise BenchInputError("there is no such file", file=chosen)
        return Source(own, model_file=chosen)
    from ..read_record import read_record

    say(f"reading {source}")
    return Source(own, read_record(source, readings_required=False), model)
