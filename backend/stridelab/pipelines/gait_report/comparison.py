"""A person beside a reference group, and the change between two groups of recordings of a person.

    z = (x - m) / s

with x the person's mean over all steps, and m and s the mean and the standard deviation (n - 1) of the means of the
people of the group: a person counts once, however many steps were recorded. Its interval is that of a single case
(Crawford and Garthwaite 2002): z sqrt(n) has a noncentral t distribution with n - 1 degrees of freedom.

Steps of one person, or of one recording, are not independent of each other. The difference between the person and the
group, and the change between recordings before and after, are the fixed effect of a mixed model over all steps,

    y_ij = b_0 + b_1 g_i + u_i + e_ij,    u ~ N(0, tau^2),    e ~ N(0, sigma^2)

with g_i = 1 for the person (for the recordings after) and i the person (the recording). Where steps do not repeat, the
means are compared: the person with the people (Crawford and Howell 1998), the recordings by Welch (1947).
"""

import math
from collections.abc import Mapping, Sequence
from typing import Final

import numpy as np
from scipy.special import nctdtrinc
from scipy.stats import t as student

from stridelab.errors import NotEstimable
from stridelab.measures.measure import CONFIDENCE, Measure
from stridelab.schemas.measures import ChangeValue, ReferenceValue
from stridelab.walking.population.mixed_model import MixedModel, fit_mixed_model

_TAIL: Final = 0.5 + CONFIDENCE / 2
Bounds = tuple[float, float]


def compare_with_people(person: Sequence[Measure], people: Sequence[Sequence[Measure]]) -> list[ReferenceValue]:
    """Measures of the person, over both sides, that at least one of the people has, too."""
    own, others = _values(person), [_values(one) for one in people]
    units = {measure.name: measure.unit for measure in person}
    values = []
    for name, given in own.items():
        group = [other[name] for other in others if name in other]
        if not group:
            continue
        means = np.array([np.mean(one) for one in group])
        value, mean = float(np.mean(given)), float(means.mean())
        sd = float(means.std(ddof=1)) if len(means) > 1 else None
        model = _two_groups(group, [given])
        values.append(
            ReferenceValue(
                name=name,
                unit=units[name],
                value=value,
                n_people=len(group),
                mean=mean,
                between_sd=sd,
                difference=value - mean if model is None else model.effect("second").value,
                ci95=single_case_interval(value, means.tolist()) if model is None else model.effect("second").ci95,
                z=(value - mean) / sd if sd else None,
                z_ci95=z_interval((value - mean) / sd, len(group)) if sd else None,
            )
        )
    return values


def change_between(before: Sequence[Sequence[Measure]], after: Sequence[Sequence[Measure]]) -> list[ChangeValue]:
    """Change of every measure that both groups have; each of their elements are the measures of one recording."""
    units = {measure.name: measure.unit for recording in after for measure in recording}
    earlier, later = ([_values(recording) for recording in group] for group in (before, after))
    changes = []
    for name, unit in units.items():
        steps = [[recording[name] for recording in group if name in recording] for group in (earlier, later)]
        if not steps[0]:
            continue
        means = [[float(np.mean(values)) for values in group] for group in steps]
        model = _two_groups(*steps) if min(map(len, steps)) > 1 else None
        level = float(np.mean(means[0])) if model is None else model.effect("level").value
        change = float(np.mean(means[1])) - level if model is None else model.effect("second").value
        changes.append(
            ChangeValue(
                name=name,
                unit=unit,
                before=level,
                after=level + change,
                n_before=len(means[0]),
                n_after=len(means[1]),
                change=change,
                ci95=welch_interval(*means) if model is None else model.effect("second").ci95,
            )
        )
    return changes


def welch_interval(before: Sequence[float], after: Sequence[float]) -> Bounds | None:
    """95 % interval of ``mean(after) - mean(before)``; None without two values in each group or scatter."""
    if min(len(before), len(after)) < 2:
        return None
    parts = [float(np.var(group, ddof=1)) / len(group) for group in (before, after)]
    variance = sum(parts)
    if variance == 0.0:
        return None
    freedom = variance**2 / sum(part**2 / (len(group) - 1) for part, group in zip(parts, (before, after), strict=True))
    half = float(student.ppf(_TAIL, freedom)) * math.sqrt(variance)
    change = float(np.mean(after) - np.mean(before))
    return change - half, change + half


def single_case_interval(value: float, group: Sequence[float]) -> Bounds | None:
    """95 % interval of the difference of one person to the people of a group (Crawford and Howell 1998, equation 1).

    It contains zero in 95 % of the people of the group itself. None without two people or scatter between them.
    """
    n = len(group)
    sd = float(np.std(group, ddof=1)) if n > 1 else 0.0
    if sd == 0.0:
        return None
    half = float(student.ppf(_TAIL, n - 1)) * sd * math.sqrt(1.0 + 1.0 / n)
    difference = value - float(np.mean(group))
    return difference - half, difference + half


def z_interval(z: float, n: int) -> Bounds:
    """95 % interval of the score of a person whose own value is exact, beside ``n`` people."""
    low, high = (float(nctdtrinc(n - 1, share, z * math.sqrt(n))) / math.sqrt(n) for share in (_TAIL, 1.0 - _TAIL))
    return low, high


def _two_groups(first: Sequence[Sequence[float]], second: Sequence[Sequence[float]]) -> MixedModel | None:
    """Mixed model of the steps of two groups of clusters; its effect ``second`` is the second group minus the first.

    None where steps do not repeat, or without more clusters than groups.
    """
    clusters = [*first, *second]
    cluster = np.repeat(np.arange(len(clusters)), [len(one) for one in clusters])
    steps = np.concatenate([np.asarray(one, dtype=float) for one in clusters])
    try:
        model = fit_mixed_model(steps, {"second": (cluster >= len(first)).astype(float)}, cluster)
    except NotEstimable:
        return None
    return model if model.effect("second").sd > 0.0 else None


def _values(measures: Sequence[Measure]) -> Mapping[str, list[float]]:
    """Values of all steps by the name of the measure."""
    values: dict[str, list[float]] = {}
    for measure in measures:
        values.setdefault(measure.name, []).append(measure.value)
    return values
