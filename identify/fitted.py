"""A fit before it is put into words: what was fitted, with which noise, and where the solver ended."""

from dataclasses import dataclass

from .channel_noise import ChannelNoise
from .fit_result import StartOutcome
from .least_squares import LeastSquaresResult
from .parameters import ParameterPlan
from .record import BenchRecord, TestRecord


Key = tuple[str, str]  # test, channel


@dataclass(frozen=True)
class Fitted:
    """The end of `run_fit`; `tests` are the reduced ones, `free` the fitted parameters in the order of the solution."""

    record: BenchRecord
    tests: dict[str, TestRecord]
    plans: dict[str, ParameterPlan]
    free: tuple[str, ...]
    noise: dict[Key, ChannelNoise]
    solution: LeastSquaresResult
    starts: tuple[StartOutcome, ...]
    warnings: tuple[str, ...]
