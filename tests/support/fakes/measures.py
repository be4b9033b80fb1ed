"""Measures of gait as the interface gives them: two recordings of a person, whose numbers are known."""

from typing import Any

from stridelab.schemas.base import Remark
from stridelab.schemas.jobs import Artifact, JobResult
from stridelab.schemas.measures import GaitMeasuresSummary, MeasureValue, NotMeasured
from stridelab.schemas.population import LeftOut
from stridelab.schemas.quality import Quality, TrialQuality

KIND = "gait-measures"
GOOD = Quality(verdict="good", checks=[], not_checked={})


def value(
    name: str, unit: str, means: tuple[float, float, float], half: float | None, symmetry: float | None = None
) -> list[MeasureValue]:
    """Rows of one measure: over both sides, left and right; ``half`` is that of the 95 % interval."""
    return [
        MeasureValue(
            name=name, unit=unit, side=side, n=n, mean=mean, between_sd=None, error_sd=None,
            ci95=None if half is None else (mean - half, mean + half), symmetry=None if side else symmetry,
        )
        for side, n, mean in zip((None, "left", "right"), (7, 4, 3), means, strict=True)
    ]  # fmt: skip


def summary() -> GaitMeasuresSummary:
    """Numbers, of which the pages show the first six main ones above the table."""
    return GaitMeasuresSummary(
        steps=7, sides={"left": 4, "right": 3},
        measures=[
            *value("step_length", "m", (0.6781, 0.672, 0.684), 0.0192, -0.0177),
            *value("step_width", "m", (0.105, 0.107, 0.103), 0.0065),
            *value("walking_speed", "m/s", (1.212, 1.214, 1.210), 0.0103, 0.0033),
            *value("double_support_share", "1", (0.25, 0.24, 0.26), 0.1, -0.08),
            *value("step_time", "s", (0.5683, 0.571, 0.566), 0.0515, 0.009),
            *value("margin_of_stability_ml_min", "m", (0.0728, 0.0719, 0.0737), 0.0263, -0.0255),
            *value("margin_of_stability_ap_contact", "m", (-0.0004, 0.011, -0.012), 0.0398),
            *value("energy_recovery", "1", (0.55, 0.56, 0.54), None, 0.036),
            *value("angular_momentum_range_x", "1", (0.0138, 0.0139, 0.0137), 0.0027, 0.0146),
            MeasureValue(
                name="foot_placement_residual", unit="m", side=None, n=1, mean=0.0142, between_sd=None, error_sd=0.001,
                ci95=(0.0122, 0.0162),
            ),
        ],
        not_measured=[NotMeasured(name="limb_work_left_positive", code="no-separate-forces", message="One plate.")],
        left_out=[
            LeftOut(recording_id="r3", filename="turn.c3d", code="not-walking", message="The walk turns."),
            LeftOut(recording_id="r4", filename="off.c3d", code="contradicted", message="Sentence of the plates."),
        ],
        n_recordings=2, method="smoother", mass_kg=60.0, height_m=None, speed_m_s=1.212, quality=GOOD,
        trials=[TrialQuality(recording_id=f"r{k}", filename=f"walk {k}.c3d", quality=GOOD) for k in (1, 2)],
        warnings=[Remark(code="gaps-filled", message="C7 is hidden.")],
    )  # fmt: skip


def result(given: dict[str, Any]) -> JobResult:
    """The result of succeeded measures."""
    names = [f"{stem}.{end}" for stem in ("measures", "xcom", "stability") for end in ("parquet", "csv")]
    artifacts = [Artifact(name=name, media_type="application/x", bytes=2345) for name in names]
    return JobResult(
        kind=KIND, input=given, versions={"stridelab": "0.1.0"}, references=["hof2005"],
        summary=summary().model_dump(mode="json"), artifacts=artifacts,
    )  # fmt: skip
