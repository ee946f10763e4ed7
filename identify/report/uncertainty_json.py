"""`knowledge` of fit.json (docs/bench_format.md section 8.2), SI units; of a relative parameter in its own unit, as all its numbers."""

from collections.abc import Iterable
from typing import Any

from thermohyd.identify.fitting.result import FitResult
from thermohyd.identify.uncertainty.result import (
    CoverageOf,
    KnownParameter,
    Nested,
    Posterior,
    PosteriorOf,
    PredictedFigure,
    ProfileOf,
)


def knowledge_json(result: FitResult) -> dict[str, Any] | None:
    """None where nothing was asked."""
    known = result.knowledge
    if known is None:
        return None
    size = {name: 1.0 if (e := result.parameters[name]).relative is None else e.relative.size for name in known.rows}
    return {
        "profiled": known.profiled,
        "parameters": {name: _row(row, size[name]) for name, row in known.rows.items()},
        "posterior": None if known.posterior is None else _posterior(known.posterior),
        "faults": {} if known.posterior is None else _faults(known.posterior, known.rows),
        "simulated": known.simulated,
        "failed": known.failed,
        "seed": known.seed,
        "notes": known.notes,
        "predictions": [_prediction(figure) for figure in known.predictions],
    }


def _row(row: KnownParameter, size: float) -> dict[str, Any]:
    return {
        "value": row.value / size,
        "std": None if row.std is None else row.std / size,
        "ci95": None if row.ci95 is None else [end / size for end in row.ci95],
        "verdict": row.verdict,
        "why": row.why,
        "prior_share": row.prior_share,
        "bound": row.bound or None,
        "trades_with": None
        if row.trades_with is None
        else {"name": row.trades_with[0], "correlation": row.trades_with[1]},
        "profile": None if row.profile is None else _profile(row.profile, size),
        "posterior": None if row.posterior is None else _draws(row.posterior, size),
        "coverage": None if row.coverage is None else _coverage(row.coverage),
        "remedy": None if row.remedy is None else {"words": row.remedy.words, "std_factor": row.remedy.factor},
        "averaged_over": row.averaged,
    }


def _prediction(figure: PredictedFigure) -> dict[str, Any]:
    return {
        "name": figure.name,
        "test": figure.test,
        "temperature": figure.temperature,
        "supply_pressure": figure.supply_pressure,
        "value": figure.value,
        "unit": figure.unit,
        "std": figure.std,
        "ci95": figure.ci95,
        "profile95": {key: end for key, end in _nested(figure.profile, 1.0).items() if key != "level"},
    }


def _nested(interval: Nested, size: float) -> dict[str, Any]:
    return {
        "level": interval.level,
        "low": interval.low / size,
        "high": interval.high / size,
        "open_low": interval.open_low,
        "open_high": interval.open_high,
    }


def _profile(profile: ProfileOf, size: float) -> dict[str, Any]:
    return {
        "shape": profile.shape,
        "intervals": [_nested(interval, size) for interval in profile.intervals],
        "rises": profile.rises,
        "points": [{"value": p.value / size, "rise": p.rise, "at_limit": p.pressed} for p in profile.points],
    }


def _draws(of: PosteriorOf, size: float) -> dict[str, Any]:
    return {
        "mean": of.mean / size,
        "std": of.std / size,
        "intervals": [_nested(interval, size) for interval in of.intervals],
        "r_hat": of.r_hat,
        "ess_bulk": of.ess_bulk,
        "ess_tail": of.ess_tail,
    }


def _faults(drawn: Posterior, rows: Iterable[str]) -> dict[str, Any]:
    """Draws of what is no parameter of the valve: amounts of the bench's faults, SI."""
    return {name: _draws(of, 1.0) for name, of in drawn.parameters.items() if name not in rows}


def _coverage(of: CoverageOf) -> dict[str, Any]:
    return {"held": of.held, "records": of.records, "share": of.share, "ci95": [of.low, of.high]}


def _posterior(drawn: Posterior) -> dict[str, Any]:
    return {
        "method": "importance" if drawn.proposals else "no-u-turn",
        "chains": drawn.draws.shape[0],
        "draws": drawn.draws.shape[1],
        "warmup": drawn.warmup,
        "seed": drawn.seed,
        "target_acceptance": drawn.target,
        "tried": drawn.tried,
        "divergent": int(drawn.divergent.sum()),
        "proposals": drawn.proposals,
        "pareto_k": drawn.pareto_k,
        "trouble": drawn.trouble or None,
        "prior": drawn.prior,
        "file": "posterior.nc" if drawn.file else None,
    }
