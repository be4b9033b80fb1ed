"""Population study of the wheel (section 3.3.2): means and deviations per subject, and their correlates.

    steps -> SubjectMean per subject -> Correlation per group -> MixedModel for repeated steps

The unit of the statistics is the subject, not the step: steps are averaged per subject before correlations are
computed. Children and adults are separate groups unless pooled on request, because the height difference between the
groups would inflate the coefficients.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Final, Literal

import numpy as np
from jaxtyping import Float

from stridelab.conventions import Series
from stridelab.errors import NotEstimable
from stridelab.recordings.recording import Remark
from stridelab.walking.population.correlations import (
    MIN_SUBJECTS,
    Correlation,
    bootstrap_indices,
    holm_correction,
    partial_correlation,
    pearson,
    spearman,
)
from stridelab.walking.population.mixed_model import MixedModel, fit_mixed_model

PARAMETERS: Final = ("R_m", "r_m", "z0_m", "omega_rad_s")
SUBJECT_VARIABLES: Final = ("height_m", "leg_m")
STEP_VARIABLES: Final = ("speed_m_s", "step_length_m")
COVARIATES: Final = (*SUBJECT_VARIABLES, *STEP_VARIABLES)
"""Variables correlated with every parameter, and control variables of the partial correlations."""
POOLED_GROUP: Final = "all"
"""Name of the optional group of all subjects."""
UNKNOWN: Final = "unknown"
ADULT_YEARS: Final = 18.0
CHILD_BELOW_M: Final = 1.45
"""Without an age, shorter subjects count as children, with a remark; taller ones may be children or adults."""

GroupSource = Literal["stated", "age", "height", "unknown"]


@dataclass(frozen=True, kw_only=True)
class Person:
    """One subject; ``leg_m`` is the height of the hip above the floor. None if unknown."""

    name: str
    group: str
    height_m: float | None = None
    leg_m: float | None = None
    group_source: GroupSource = "stated"


@dataclass(frozen=True)
class StepRow:
    """Values of one step (names with units, NaN if unknown) of a subject in a recording."""

    person: str
    recording: str
    values: Mapping[str, float]


@dataclass(frozen=True)
class SubjectMean:
    """Mean and standard deviation (n - 1) over all steps of a subject; NaN if unknown, sd NaN for one step."""

    person: Person
    n_steps: int
    n_recordings: int
    mean: Mapping[str, float]
    sd: Mapping[str, float]

    def value(self, name: str) -> float:
        """Value of the subject, or mean over the steps; NaN if unknown."""
        if name in SUBJECT_VARIABLES:
            known = self.person.height_m if name == "height_m" else self.person.leg_m
            return float("nan") if known is None else known
        return self.mean.get(name, float("nan"))


@dataclass(frozen=True)
class Pair:
    """One parameter against one variable in one group; ``left_out`` are the subjects with a missing value.

    ``partial_on`` holds the correlations controlled for another variable, if there are enough subjects. ``p_holm`` is
    corrected for all pairs of the group.
    """

    group: str
    parameter: str
    against: str
    pearson: Correlation
    spearman: Correlation | None
    partial_on: Mapping[str, Correlation]
    left_out: tuple[str, ...]
    p_holm: float


@dataclass(frozen=True)
class Population:
    """Subject means, correlated pairs, and the mixed models and variance components per group and parameter."""

    subjects: tuple[SubjectMean, ...]
    pairs: tuple[Pair, ...]
    models: Mapping[tuple[str, str], MixedModel] = field(default_factory=dict)
    spreads: Mapping[tuple[str, str], MixedModel] = field(default_factory=dict)
    remarks: tuple[Remark, ...] = ()


def assign_group(stated: str | None, age_years: float | None, height_m: float | None) -> tuple[str, GroupSource]:
    """The stated group, else children or adults by age (18 years), else children by height (1.45 m).

    Taller subjects of unknown age are "unknown", because they may be children.
    """
    if stated:
        return stated, "stated"
    if age_years is not None:
        return ("children" if age_years < ADULT_YEARS else "adults"), "age"
    if height_m is not None and height_m < CHILD_BELOW_M:
        return "children", "height"
    return UNKNOWN, "unknown"


def subject_means(people: Sequence[Person], steps: Sequence[StepRow]) -> tuple[SubjectMean, ...]:
    """One mean per subject with steps, in the order of ``people``; all recordings of a subject are combined."""
    means = []
    for person in people:
        own = [step for step in steps if step.person == person.name]
        if not own:
            continue
        names = dict.fromkeys(name for step in own for name in step.values)
        table = {name: np.array([step.values.get(name, np.nan) for step in own]) for name in names}
        known = {name: values[np.isfinite(values)] for name, values in table.items()}
        means.append(
            SubjectMean(
                person=person,
                n_steps=len(own),
                n_recordings=len({step.recording for step in own}),
                mean={name: float(v.mean()) if len(v) else float("nan") for name, v in known.items()},
                sd={name: float(v.std(ddof=1)) if len(v) > 1 else float("nan") for name, v in known.items()},
            )
        )
    return tuple(means)


def study(people: Sequence[Person], steps: Sequence[StepRow], *, pooled: bool = False, seed: int = 0) -> Population:
    """Means, correlations and mixed models of all groups; ``pooled`` adds a group of all subjects.

    Too few subjects do not raise an error but give a remark.
    """
    subjects = subject_means(people, steps)
    groups: dict[str, list[SubjectMean]] = {}
    for subject in subjects:
        groups.setdefault(subject.person.group, []).append(subject)
    remarks = _group_remarks(groups, pooled=pooled)
    if pooled and len(groups) > 1:
        groups = {**groups, POOLED_GROUP: list(subjects)}
    pairs: list[Pair] = []
    models, spreads = {}, {}
    for group, members in groups.items():
        if len(members) < MIN_SUBJECTS:
            remarks.append(_too_few(group, len(members)))
        else:
            pairs += _correlate_pairs(group, members, seed)
        names = {subject.person.name for subject in members}
        own = [step for step in steps if step.person in names]
        for parameter in PARAMETERS:
            spread = _mixed_model_or_none(parameter, (), members, own)
            if spread is not None:
                spreads[group, parameter] = spread
            model = _mixed_model_or_none(parameter, ("height_m", "speed_m_s"), members, own)
            if model is not None:
                models[group, parameter] = model
    remarks += _height_remarks(groups)
    return Population(subjects, tuple(pairs), models, spreads, tuple(remarks))


def _correlate_pairs(group: str, members: list[SubjectMean], seed: int) -> list[Pair]:
    columns = {name: np.array([s.value(name) for s in members]) for name in (*PARAMETERS, *COVARIATES)}
    pairs = []
    for parameter in PARAMETERS:
        for against in COVARIATES:
            known = np.isfinite(columns[parameter]) & np.isfinite(columns[against])
            x, y = columns[parameter][known], columns[against][known]
            draws = bootstrap_indices(len(x), seed=seed) if len(x) >= MIN_SUBJECTS else None
            plain = pearson(x, y, draws=draws)
            if plain is None:
                continue
            left_out = tuple(s.person.name for s, is_known in zip(members, known, strict=True) if not is_known)
            partials = _partial_correlations(columns, parameter, against)
            ranks = spearman(x, y, draws=draws)
            pairs.append(Pair(group, parameter, against, plain, ranks, partials, left_out, plain.p))
    corrected = holm_correction(np.array([pair.pearson.p for pair in pairs])) if pairs else np.zeros(0)
    return [replace(pair, p_holm=float(p)) for pair, p in zip(pairs, corrected, strict=True)]


def _partial_correlations(columns: Mapping[str, Series], parameter: str, against: str) -> dict[str, Correlation]:
    partials = {}
    for held in COVARIATES:
        if held == against:
            continue
        table: Float[np.ndarray, "n 3"] = np.column_stack([columns[name] for name in (parameter, against, held)])
        table = table[np.isfinite(table).all(axis=1)]
        one = partial_correlation(table[:, 0], table[:, 1], table[:, 2:]) if len(table) >= MIN_SUBJECTS else None
        if one is not None:
            partials[held] = one
    return partials


def _mixed_model_or_none(
    parameter: str, names: tuple[str, ...], members: list[SubjectMean], steps: list[StepRow]
) -> MixedModel | None:
    """Mixed model over all steps with complete values; None if it cannot be fitted."""
    of = {subject.person.name: (i, subject) for i, subject in enumerate(members)}
    rows = []
    for step in steps:
        i, subject = of[step.person]
        values = [step.values.get(n, np.nan) if n in STEP_VARIABLES else subject.value(n) for n in names]
        rows.append([float(i), step.values.get(parameter, np.nan), *values])
    table = np.array(rows)
    table = table[np.isfinite(table).all(axis=1)]
    effects = {name: table[:, 2 + k] for k, name in enumerate(names)}
    try:
        return fit_mixed_model(table[:, 1], effects, table[:, 0].astype(np.int64))
    except NotEstimable:
        return None


def _group_remarks(groups: Mapping[str, Sequence[SubjectMean]], *, pooled: bool) -> list[Remark]:
    remarks = []
    held = ", ".join(f"{name} ({len(members)})" for name, members in groups.items())
    if len(groups) > 1 and pooled:
        sentence = f"All subjects are also pooled, as requested: {held}. Differences between groups count as trends."
        remarks.append(Remark("groups-pooled", sentence))
    elif len(groups) > 1:
        remarks.append(Remark("groups-apart", f"The groups are analysed separately: {held}."))
    guessed = [s.person.name for members in groups.values() for s in members if s.person.group_source == "height"]
    if guessed:
        who = ", ".join(guessed)
        sentence = f"The age is unknown, and subjects shorter than {CHILD_BELOW_M:g} m count as children: {who}."
        remarks.append(Remark("group-from-height", sentence))
    nowhere = [s.person.name for members in groups.values() for s in members if s.person.group_source == "unknown"]
    if nowhere:
        who = ", ".join(nowhere)
        sentence = f"Group and age are unknown, so these subjects are neither children nor adults: {who}."
        remarks.append(Remark("group-unknown", sentence))
    return remarks


def _height_remarks(groups: Mapping[str, Sequence[SubjectMean]]) -> list[Remark]:
    without = dict.fromkeys(s.person.name for m in groups.values() for s in m if s.person.height_m is None)
    if not without:
        return []
    who = ", ".join(without)
    return [Remark("height-missing", f"The height is unknown, so it is not analysed for these subjects: {who}.")]


def _too_few(group: str, n: int) -> Remark:
    subjects = "1 subject" if n == 1 else f"{n} subjects"
    sentence = f"The group {group} has {subjects}; a correlation needs at least {MIN_SUBJECTS}."
    return Remark("too-few-subjects", sentence)
