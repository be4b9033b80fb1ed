"""Converts the results of a population study to the models of the contract."""

import math
from collections.abc import Mapping, Sequence
from typing import Final

from stridelab.schemas.population import (
    CorrelationResult,
    EffectResult,
    MixedModelResult,
    PartialCorrelation,
    SubjectResult,
)
from stridelab.service.kinds.study_population.subjects import Someone
from stridelab.walking.population.correlations import Correlation
from stridelab.walking.population.mixed_model import MixedModel
from stridelab.walking.population.population import Pair, Population, SubjectMean

THESIS: Final[Mapping[tuple[str, str], float]] = {
    ("R_m", "height_m"): 0.67,
    ("r_m", "height_m"): 0.61,
    ("z0_m", "height_m"): 0.87,
}
"""Coefficients of figures 3.7 and 3.8; for omega (fig. 3.9) the thesis gives p >= 0.83 and no coefficient."""


def subject_results(subjects: Sequence[SubjectMean], known: Mapping[str, Someone]) -> list[SubjectResult]:
    """One row per subject with steps."""
    return [_subject(one, known[one.person.name]) for one in subjects]


def _subject(one: SubjectMean, known: Someone) -> SubjectResult:
    def mean(name: str) -> float | None:
        return _finite(one.mean[name])

    def sd(name: str) -> float | None:
        return _finite(one.sd[name])

    return SubjectResult(
        subject=one.person.name,
        group=one.person.group,
        group_source=one.person.group_source,
        recordings=list(known.recordings),
        n_steps=one.n_steps,
        height_m=one.person.height_m,
        leg_m=one.person.leg_m,
        age_years=known.fields.age_years,
        sex=known.fields.sex,
        mass_kg=known.fields.mass_kg,
        speed_m_s=mean("speed_m_s"),
        step_length_m=mean("step_length_m"),
        R_m=one.mean["R_m"],
        R_sd_m=sd("R_m"),
        r_m=one.mean["r_m"],
        r_sd_m=sd("r_m"),
        z0_m=one.mean["z0_m"],
        z0_sd_m=sd("z0_m"),
        omega_rad_s=one.mean["omega_rad_s"],
        omega_sd_rad_s=sd("omega_rad_s"),
        error_mean_mm=one.mean["error_mean_mm"],
        error_sd_mm=mean("error_sd_mm"),
        error_max_mm=one.mean["error_max_mm"],
        circumference_share=mean("circumference_share"),
        double_support_start_error_s=mean("double_support_start_error_s"),
        double_support_start_error_sd_s=sd("double_support_start_error_s"),
        double_support_end_error_s=mean("double_support_end_error_s"),
        double_support_end_error_sd_s=sd("double_support_end_error_s"),
    )


def correlation_results(found: Population) -> list[CorrelationResult]:
    """One row per pair, with the coefficient of the thesis where there is one."""
    return [_pair(one) for one in found.pairs]


def _pair(one: Pair) -> CorrelationResult:
    ranks, on_speed = one.spearman, one.partial_on.get("speed_m_s")
    return CorrelationResult(
        group=one.group,
        parameter=one.parameter,
        against=one.against,
        n=one.pearson.n,
        r=one.pearson.r,
        p=one.pearson.p,
        p_holm=one.p_holm,
        ci95=one.pearson.ci95,
        bootstrap_ci95=one.pearson.bootstrap_ci95,
        spearman=ranks.r if ranks else None,
        spearman_p=ranks.p if ranks else None,
        spearman_ci95=ranks.ci95 if ranks else None,
        spearman_bootstrap_ci95=ranks.bootstrap_ci95 if ranks else None,
        partial=[_partial(held, partial) for held, partial in one.partial_on.items()],
        partial_on_speed=on_speed.r if on_speed else None,
        left_out=list(one.left_out),
        thesis=THESIS.get((one.parameter, one.against)),
    )


def _partial(held: str, one: Correlation) -> PartialCorrelation:
    return PartialCorrelation(on=held, n=one.n, r=one.r, p=one.p, ci95=one.ci95)


def mixed_results(found: Population) -> list[MixedModelResult]:
    """Mixed models of the variance between subjects and steps, then those with height and speed."""
    return [_model(*key, one) for models in (found.spreads, found.models) for key, one in models.items()]


def _model(group: str, parameter: str, one: MixedModel) -> MixedModelResult:
    names = [effect.name for effect in one.effects[1:]]
    return MixedModelResult(
        group=group,
        parameter=parameter,
        formula=" + ".join(["1", *names, "(1 | subject)"]),
        method=one.method,
        effects=[
            EffectResult(name=e.name, value=e.value, sd=e.sd, freedom=e.freedom, p=e.p, ci95=e.ci95)
            for e in one.effects
        ],
        subject_sd=one.subject_sd,
        step_sd=one.step_sd,
        icc=one.icc,
        n_people=one.n_people,
        n_steps=one.n_steps,
        on_bound=one.on_bound,
    )


def _finite(value: float) -> float | None:
    return value if math.isfinite(value) else None
