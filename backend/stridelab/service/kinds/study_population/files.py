"""The tables of ``study-population``: ``subjects``, ``steps`` and ``correlations``, as Parquet and CSV."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np

from stridelab.schemas.cycloid import FittedStep
from stridelab.schemas.population import CorrelationResult, StudyPopulationSummary
from stridelab.service.kinds.base import ArtifactFile
from stridelab.service.kinds.result_tables import write_table
from stridelab.walking.population.population import COVARIATES, StepRow

STEP_FIELDS: Final = (
    "t0_s", "t1_s", "side", "source", "measured", "R_m", "r_m", "z0_m", "omega_rad_s", "theta0_rad", "error_mean_mm",
    "error_sd_mm", "error_max_mm", "step_length_m", "speed_m_s", "circumference_share",
)  # fmt: skip
INTERVALS: Final = ("ci95", "bootstrap_ci95", "spearman_ci95", "spearman_bootstrap_ci95")

Row = dict[str, Any]


def write_population(
    folder: Path, summary: StudyPopulationSummary, steps: Sequence[tuple[StepRow, FittedStep, str, bool]]
) -> tuple[ArtifactFile, ...]:
    """Write all tables into ``folder``; ``steps`` include the subject's group and whether the step was used."""
    about = {"summary": summary.model_dump(mode="json", include={"n_recordings", "n_steps", "method", "pooled"})}
    tables = {
        "subjects": [_join_lists(one.model_dump(mode="json")) for one in summary.subjects],
        "steps": [_step_row(*step) for step in steps],
        "correlations": [_correlation_row(one) for one in summary.correlations],
    }
    names = {"correlations": list(_correlation_row(_EMPTY_CORRELATION))}
    files: list[ArtifactFile] = []
    for stem, rows in tables.items():
        columns = list(rows[0]) if rows else names[stem]
        files += write_table(
            folder, stem, {name: _column_array([row[name] for row in rows]) for name in columns}, about
        )
    return tuple(files)


def _step_row(step: StepRow, fitted: FittedStep, group: str, used: bool) -> Row:
    row: Row = {"subject": step.person, "group": group, "recording": step.recording, "used": used}
    row |= {name: getattr(fitted, name) for name in STEP_FIELDS}
    (start_s, end_s), (model_start_s, model_end_s) = fitted.double_support_s, fitted.double_support_model_s
    row |= {"double_support_start_s": start_s, "double_support_end_s": end_s}
    row |= {"double_support_model_start_s": model_start_s, "double_support_model_end_s": model_end_s}
    return row | {"flags": " ".join(fitted.flags)}


def _correlation_row(one: CorrelationResult) -> Row:
    row = one.model_dump(exclude={*INTERVALS, "partial", "partial_on_speed", "left_out"})
    for name in INTERVALS:
        row |= _interval_columns(name, getattr(one, name))
    held = {partial.on: partial for partial in one.partial}
    for against in COVARIATES:
        name = f"partial_on_{against.removesuffix('_m_s').removesuffix('_m')}"  # a coefficient has no unit
        partial = held.get(against)
        row |= {name: partial.r if partial else None, f"{name}_people": partial.n if partial else None}
        row |= {
            f"{name}_p": partial.p if partial else None,
            **_interval_columns(name, partial.ci95 if partial else None),
        }
    return row | {"left_out": "; ".join(one.left_out)}


def _interval_columns(name: str, bounds: tuple[float, float] | None) -> Row:
    low, high = bounds or (None, None)
    return {f"{name}_low": low, f"{name}_high": high}


def _join_lists(row: Row) -> Row:
    return {name: "; ".join(value) if isinstance(value, list) else value for name, value in row.items()}


def _column_array(values: list[Any]) -> np.ndarray:
    """Column of numbers (missing: NaN), of booleans, or of text (missing: empty)."""
    known = [value for value in values if value is not None]
    if known and all(isinstance(value, bool) for value in known):
        return np.array(values, dtype=bool)
    if any(isinstance(value, str) for value in known):
        return np.array(["" if value is None else value for value in values], dtype=object)
    return np.array([np.nan if value is None else value for value in values], dtype=float)


_EMPTY_CORRELATION: Final = CorrelationResult(
    group="", parameter="", against="", n=4, r=0.0, p=1.0, p_holm=1.0, ci95=None, bootstrap_ci95=None, spearman=None,
    spearman_p=None, spearman_ci95=None, spearman_bootstrap_ci95=None, partial=[], partial_on_speed=None, left_out=[],
)  # fmt: skip
"""Defines the columns of a table without rows."""
