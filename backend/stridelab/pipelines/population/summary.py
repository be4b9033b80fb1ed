"""Converts the results of a population study to the models of the contract."""

import math
from collections.abc import Mapping, Sequence
from typing import Final

from stridelab.pipelines.population.subjects import StudySubject
from stridelab.schemas.population import (
    CorrelationResult,
    EffectResult,
    MixedModelResult,
    PartialCorrelation,
    SubjectResult,
)
from stridelab.walking.population.mixed_model import MixedModel
from stridelab.walking.population.population import Pair, Population, SubjectMean

THESIS_CORRELATIONS: Final[Mapping[tuple[str, str], float]] = {
    ("R_m", "height_m"): 0.67,
    ("r_m", "height_m"): 0.61,
    ("z0_m", "height_m"): 0.87,
}
"""Coefficients of figures 3.7 and 3.8; for omega (fig. 3.9) the thesis gives p >= 0.83 and no coefficient."""


_WITH_DEVIATIONS: Final = (
    *(("R", "m"), ("r", "m"), ("z0", "m"), ("omega", "rad_s")),
    *(("double_support_start_error", "s"), ("double_support_end_error", "s")),
)
"""Quantities, with their units, of which a subject has a mean and a standard deviation."""
_MEANS: Final = (
    *(f"{name}_{unit}" for name, unit in _WITH_DEVIATIONS),
    *("speed_m_s", "step_length_m", "error_mean_mm", "error_sd_mm", "error_max_mm", "circumference_share"),
)


def subject_results(
    subjects: Sequence[SubjectMean], subjects_by_name: Mapping[str, StudySubject]
) -> list[SubjectResult]:
    """One row per subject with steps."""
    return [_subject_result(one, subjects_by_name[one.person.name]) for one in subjects]


def _subject_result(one: SubjectMean, subject: StudySubject) -> SubjectResult:
    return SubjectResult.from_object(
        one.person,
        subject=one.person.name,
        recordings=list(subject.recordings),
        n_steps=one.n_steps,
        age_years=subject.fields.age_years,
        sex=subject.fields.sex,
        mass_kg=subject.fields.mass_kg,
        **{name: _finite_or_none(one.mean[name]) for name in _MEANS},
        **{f"{name}_sd_{unit}": _finite_or_none(one.sd[f"{name}_{unit}"]) for name, unit in _WITH_DEVIATIONS},
    )


def correlation_results(population: Population) -> list[CorrelationResult]:
    """One row per pair, with the coefficient of the thesis where there is one."""
    return [_correlation_result(one) for one in population.pairs]


def _correlation_result(one: Pair) -> CorrelationResult:
    ranks, on_speed = one.spearman, one.partial_on.get("speed_m_s")
    return CorrelationResult.from_object(
        one.pearson,
        group=one.group,
        parameter=one.parameter,
        against=one.against,
        p_holm=one.p_holm,
        spearman=ranks.r if ranks else None,
        spearman_p=ranks.p if ranks else None,
        spearman_ci95=ranks.ci95 if ranks else None,
        spearman_bootstrap_ci95=ranks.bootstrap_ci95 if ranks else None,
        partial=[PartialCorrelation.from_object(partial, on=held) for held, partial in one.partial_on.items()],
        partial_on_speed=on_speed.r if on_speed else None,
        left_out=list(one.left_out),
        thesis=THESIS_CORRELATIONS.get((one.parameter, one.against)),
    )


def mixed_results(population: Population) -> list[MixedModelResult]:
    """Mixed models of the variance between subjects and steps, then those with height and speed."""
    return [
        _mixed_model_result(*key, one)
        for models in (population.spreads, population.models)
        for key, one in models.items()
    ]


def _mixed_model_result(group: str, parameter: str, one: MixedModel) -> MixedModelResult:
    names = [effect.name for effect in one.effects[1:]]
    return MixedModelResult.from_object(
        one,
        group=group,
        parameter=parameter,
        formula=" + ".join(["1", *names, "(1 | subject)"]),
        effects=[EffectResult.from_object(effect) for effect in one.effects],
    )


def _finite_or_none(value: float) -> float | None:
    return value if math.isfinite(value) else None
