"""One value of a measure, and the summary of its values over steps.

The mean over n steps has the standard deviation

    sqrt(s^2 / n + e^2)

with s the standard deviation between the steps and e the median error of one step: errors of the segment table are the
same in all steps of a recording, so they do not average out.
"""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from scipy.stats import t as student

from stridelab.recordings.recording import Side

CONFIDENCE: Final = 0.95


@dataclass(frozen=True)
class Measure:
    """One value: of the step ``step`` (from 0 in order of strikes) and its ``side``, or of the recording if None.

    ``sd`` is the standard deviation of the measurement error, None if it is not known. ``unit`` is "m", "s", "m/s",
    "J/kg", "1/min", "rad/s" or "1". ``events_sd`` is the part of ``sd`` from events and from markers of the feet,
    which no factor of ``stated_errors`` scales.
    """

    name: str
    value: float
    sd: float | None
    unit: str
    side: Side | None = None
    step: int | None = None
    events_sd: float = 0.0


@dataclass(frozen=True)
class MeasureSummary:
    """Mean of ``n`` values of one measure, of one side or (None) of both.

    ``between_sd`` is the standard deviation between the steps (n - 1), None for one step; ``error_sd`` the median error
    of one value, None if unknown. ``ci95`` contains the mean with 95 % confidence; None if the error is unknown, since
    the scatter between the steps alone would promise too much.
    """

    name: str
    unit: str
    side: Side | None
    n: int
    mean: float
    between_sd: float | None
    error_sd: float | None
    ci95: tuple[float, float] | None


def summarise(measures: Iterable[Measure]) -> tuple[MeasureSummary, ...]:
    """Summaries per measure: over both sides, then left, then right."""
    values = list(measures)
    summaries = []
    for name in dict.fromkeys(measure.name for measure in values):
        named = [measure for measure in values if measure.name == name]
        sides: tuple[Side | None, ...] = (None, "left", "right")
        for side in sides:
            chosen = [measure for measure in named if side in (None, measure.side)]
            if chosen:
                summaries.append(_summary(chosen, side))
    return tuple(summaries)


def symmetry_index(left: float, right: float) -> float | None:
    """Symmetry index of Robinson et al. (1987): ``(left - right) / (0.5 (left + right))``; None if the mean is zero."""
    mean = 0.5 * (left + right)
    return None if math.isclose(mean, 0.0, abs_tol=1e-12) else (left - right) / mean


def _summary(measures: Sequence[Measure], side: Side | None) -> MeasureSummary:
    values = np.array([measure.value for measure in measures])
    errors = [measure.sd for measure in measures if measure.sd is not None]
    n, mean = len(values), float(values.mean())
    between = float(values.std(ddof=1)) if n > 1 else None
    error = float(np.median(errors)) if errors else None
    half = None
    if error is not None:
        scatter = 0.0 if between is None else float(student.ppf(0.5 + CONFIDENCE / 2, n - 1)) * between / math.sqrt(n)
        half = math.hypot(scatter, 1.96 * error)
    ci95 = None if half is None else (mean - half, mean + half)
    return MeasureSummary(measures[0].name, measures[0].unit, side, n, mean, between, error, ci95)
