"""A person beside a reference group, and the change between two groups of recordings of a person.

    z = (x - m) / s

with x the person's mean over all steps, and m and s the mean and the standard deviation (n - 1) of the means of the
people of the group: a person counts once, however many steps were recorded. For the change, a recording counts once,
and the 95 % interval is that of Welch (1947): steps of one recording are not independent of each other.
"""

import math
from collections.abc import Mapping, Sequence
from typing import Final

import numpy as np
from scipy.stats import t as student

from stridelab.measures.measure import CONFIDENCE, Measure
from stridelab.schemas.measures import ChangeValue, GaitMeasuresSummary, ReferenceValue

FEW_PEOPLE: Final = 5
"""People below which the report says that mean and standard deviation of the group mean little."""


def compare_with_people(person: GaitMeasuresSummary, people: Sequence[GaitMeasuresSummary]) -> list[ReferenceValue]:
    """Measures of the person, over both sides, that at least one of the people has, too."""
    others = [{one.name: one.mean for one in summary.measures if one.side is None} for summary in people]
    values = []
    for one in person.measures:
        known = np.array([other[one.name] for other in others if one.name in other])
        if one.side is None and len(known):
            sd = float(known.std(ddof=1)) if len(known) > 1 else None
            mean = float(known.mean())
            values.append(
                ReferenceValue(
                    name=one.name,
                    unit=one.unit,
                    value=one.mean,
                    n_people=len(known),
                    mean=mean,
                    between_sd=sd,
                    z=(one.mean - mean) / sd if sd else None,
                )
            )
    return values


def change_between(before: Sequence[Sequence[Measure]], after: Sequence[Sequence[Measure]]) -> list[ChangeValue]:
    """Change of every measure that both groups have; each of their elements are the measures of one recording."""
    units = {measure.name: measure.unit for recording in after for measure in recording}
    earlier, later = _recording_means(before), _recording_means(after)
    return [
        ChangeValue(
            name=name,
            unit=unit,
            before=float(np.mean(earlier[name])),
            after=float(np.mean(later[name])),
            n_before=len(earlier[name]),
            n_after=len(later[name]),
            change=float(np.mean(later[name]) - np.mean(earlier[name])),
            ci95=welch_interval(earlier[name], later[name]),
        )
        for name, unit in units.items()
        if name in earlier
    ]


def welch_interval(before: Sequence[float], after: Sequence[float]) -> tuple[float, float] | None:
    """95 % interval of ``mean(after) - mean(before)``; None without two values in each group or scatter."""
    if min(len(before), len(after)) < 2:
        return None
    parts = [float(np.var(group, ddof=1)) / len(group) for group in (before, after)]
    variance = sum(parts)
    if variance == 0.0:
        return None
    freedom = variance**2 / sum(part**2 / (len(group) - 1) for part, group in zip(parts, (before, after), strict=True))
    half = float(student.ppf(0.5 + CONFIDENCE / 2, freedom)) * math.sqrt(variance)
    change = float(np.mean(after) - np.mean(before))
    return change - half, change + half


def _recording_means(recordings: Sequence[Sequence[Measure]]) -> Mapping[str, list[float]]:
    """Mean over the steps of each recording that has the measure."""
    means: dict[str, list[float]] = {}
    for recording in recordings:
        values: dict[str, list[float]] = {}
        for measure in recording:
            values.setdefault(measure.name, []).append(measure.value)
        for name, given in values.items():
            means.setdefault(name, []).append(float(np.mean(given)))
    return means
