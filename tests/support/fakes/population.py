"""A study of a population as the interface gives it: six people in two groups, whose numbers are known."""

from typing import Any

from stridelab.schemas.base import Remark
from stridelab.schemas.jobs import Artifact, JobResult
from stridelab.schemas.population import (
    CorrelationResult,
    EffectResult,
    LeftOut,
    MixedModelResult,
    PartialCorrelation,
    StudyPopulationSummary,
    SubjectResult,
)

KIND = "study-population"
PEOPLE = (
    ("P01", "adults", 1.62, 0.100, 1.10), ("P02", "adults", 1.71, 0.104, 1.25), ("P03", "adults", 1.80, 0.101, 1.20),
    ("P04", "adults", 1.92, 0.110, 1.35),
    ("C01", "children", 1.20, 0.082, 1.00), ("C02", "children", None, 0.085, 1.05),
)  # fmt: skip
"""Name, group, height in metres, R in metres and speed in m/s."""


def summary() -> StudyPopulationSummary:
    """What the page shows."""
    return StudyPopulationSummary(
        subjects=[_subject(*person) for person in PEOPLE],
        correlations=[
            _pair("omega_rad_s", "height_m", -0.40, (-0.80, 0.27), 0.22, None),
            _pair("R_m", "speed_m_s", 0.34, (-0.33, 0.78), 0.31, None),
            _pair("R_m", "height_m", 0.66, (0.10, 0.90), 0.027, 0.67),
            _pair("z0_m", "height_m", 0.99, (0.95, 1.0), 1e-7, 0.87),
        ],
        mixed_models=[
            MixedModelResult(
                group="adults", parameter="R_m", formula="R_m ~ height_m", method="reml", subject_sd=0.004,
                step_sd=0.002, icc=0.8, n_people=4, n_steps=16, on_bound=False,
                effects=[EffectResult(name="height_m", value=0.03, sd=0.01, freedom=2, p=0.1, ci95=(-0.013, 0.073))],
            )
        ],
        left_out=[LeftOut(recording_id="r7", filename="turn.c3d", code="turning", message="The walk turns.")],
        n_recordings=7, n_steps=24, method=None, pooled=False,
        warnings=[Remark(code="groups-apart", message="The groups are analysed separately: adults (4), children (2).")],
    )  # fmt: skip


def result(given: dict[str, Any]) -> JobResult:
    """The result of a succeeded study."""
    names = [f"{stem}.{end}" for stem in ("subjects", "steps", "correlations") for end in ("parquet", "csv")]
    artifacts = [Artifact(name=name, media_type="application/x", bytes=2345) for name in names]
    return JobResult(
        kind=KIND, input=given, versions={"stridelab": "0.1.0"}, references=[],
        summary=summary().model_dump(mode="json"), artifacts=artifacts,
    )  # fmt: skip


def _subject(name: str, group: str, height_m: float | None, R_m: float, speed_m_s: float) -> SubjectResult:
    tall = height_m or 1.3
    return SubjectResult(
        subject=name, group=group, group_source="stated" if group == "adults" else "height", recordings=[f"{name}.c3d"],
        n_steps=4, height_m=height_m, leg_m=0.53 * tall, age_years=None, sex=None, mass_kg=None, speed_m_s=speed_m_s,
        step_length_m=0.4 * tall, R_m=R_m, R_sd_m=0.004, r_m=0.15 * R_m, r_sd_m=0.001, z0_m=0.55 * tall, z0_sd_m=0.002,
        omega_rad_s=12 - speed_m_s, omega_sd_rad_s=None, error_mean_mm=10 * (R_m - 0.02), error_sd_mm=0.3,
        error_max_mm=2.0, circumference_share=0.95, double_support_start_error_s=-0.08,
        double_support_start_error_sd_s=0.02, double_support_end_error_s=0.03, double_support_end_error_sd_s=None,
    )  # fmt: skip


def _pair(
    parameter: str, against: str, r: float, ci95: tuple[float, float], p: float, thesis: float | None
) -> CorrelationResult:
    partial = [PartialCorrelation(on="speed_m_s", n=4, r=0.5, p=0.3, ci95=(-0.2, 0.8))]
    return CorrelationResult(
        group="adults", parameter=parameter, against=against, n=4, r=r, p=p, p_holm=min(4 * p, 1.0), ci95=ci95,
        bootstrap_ci95=None, spearman=r - 0.05, spearman_p=p, spearman_ci95=ci95, spearman_bootstrap_ci95=None,
        partial=[] if against == "speed_m_s" else partial, partial_on_speed=None, left_out=[], thesis=thesis,
    )  # fmt: skip
