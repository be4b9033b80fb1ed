"""Input and result of ``gait-measures`` and ``gait-report``: measures per step, side and recording, as written."""

from collections.abc import Mapping
from dataclasses import dataclass
from datetime import date
from typing import Annotated, Final, Literal

from pydantic import Field, model_validator

from stridelab.schemas.base import Contract, Remark
from stridelab.schemas.methods import Method
from stridelab.schemas.population import MAX_RECORDINGS, LeftOut, refuse_repeated_recordings
from stridelab.schemas.quality import Quality, TrialQuality
from stridelab.schemas.recordings import EventDelays
from stridelab.schemas.service import Language
from stridelab.schemas.sessions import SessionId
from stridelab.schemas.tasks import EstimateComTask

Bounds = tuple[float, float]
BodySide = Literal["left", "right"]


class GaitMeasuresInput(Contract):
    """Input of ``gait-measures``: recordings of one person or condition, which are pooled."""

    recording_ids: Annotated[list[str], Field(min_length=1, max_length=MAX_RECORDINGS)]
    method: Method | None = Field(
        default=None, description="estimator of the centre of mass; null selects it as in `estimate-com`"
    )

    @model_validator(mode="after")
    def _check_ids(self) -> "GaitMeasuresInput":
        refuse_repeated_recordings(self.recording_ids, ())
        return self


class MeasureValue(Contract):
    """Mean of one measure over the steps of one side, or of both (`side` null)."""

    name: str
    unit: str
    side: BodySide | None
    n: int = Field(description="number of steps or strides")
    mean: float
    between_sd: float | None = Field(description="standard deviation between the steps; null for one step")
    error_sd: float | None = Field(description="median measurement error of one step; null if it is not known")
    ci95: Bounds | None = Field(description="95 % confidence interval of the mean; null if the error is not known")
    symmetry: float | None = Field(
        default=None, description="of a row over both sides: (left - right) / mean of the sides"
    )


class NotMeasured(Contract):
    """A measure that the recordings do not allow, and the reason."""

    name: str
    code: str
    message: str


class GaitMeasuresSummary(Contract):
    """Measures pooled over the recordings; `left_out` lists recordings without any."""

    steps: int = Field(description="whole steps in all recordings")
    sides: dict[BodySide, int] = Field(description="steps by the swinging foot")
    measures: list[MeasureValue]
    not_measured: list[NotMeasured]
    left_out: list[LeftOut]
    n_recordings: int
    method: Method | None = Field(description="null if the recordings have different ones")
    mass_kg: float | None
    height_m: float | None
    speed_m_s: float | None = Field(description="mean walking speed over the steps")
    quality: Quality
    trials: list[TrialQuality]
    warnings: list[Remark]


class GaitReportInput(Contract):
    """Input of ``gait-report``: the recordings of one person, or all walks of a session of the sender."""

    recording_ids: Annotated[list[str], Field(min_length=1, max_length=MAX_RECORDINGS)] | None = None
    session_id: SessionId | None = None
    reference_recording_ids: Annotated[list[str], Field(max_length=MAX_RECORDINGS)] = Field(
        default=[], description="recordings of other people, with whom the person is compared"
    )
    before_recording_ids: Annotated[list[str], Field(max_length=MAX_RECORDINGS)] = Field(
        default=[], description="earlier recordings of the person; the report states the change since then"
    )
    title: Annotated[str, Field(min_length=1, max_length=120, pattern=r"^[^\x00-\x1f\x7f]+$")] | None = Field(
        default=None, description="heading of the report; names of people appear only here and in file names"
    )
    method: Method | None = Field(
        default=None, description="estimator of the centre of mass; null selects it as in `estimate-com`"
    )
    language: Language = Field(default="en", description="language of the report; its tables are English")

    @model_validator(mode="after")
    def _check_ids(self) -> "GaitReportInput":
        if (self.recording_ids is None) == (self.session_id is None):
            raise ValueError("recording_ids: state either recording_ids or session_id")
        ids = [*(self.recording_ids or ()), *self.reference_recording_ids, *self.before_recording_ids]
        twice = sorted({i for i in ids if ids.count(i) > 1})
        if twice:
            raise ValueError(f"recording_ids: the same recording twice: {', '.join(twice)[:200]}")
        return self


FEW_PEOPLE: Final = 5
"""People below which intervals and scores beside a reference group mean nothing."""


class ReferenceValue(Contract):
    """A measure of the person beside that of a reference group; each person of the group counts once."""

    name: str
    unit: str
    value: float
    n_people: int
    mean: float
    between_sd: float | None = Field(description="standard deviation between the people; null for one person")
    difference: float | None = Field(
        default=None,
        description="of the person to the group: fixed effect of a mixed model over all steps, else value - mean",
    )
    ci95: Bounds | None = Field(
        default=None,
        description="95 % interval of the difference; contains zero for 95 % of the people of such a group; without "
        "meaning below five people, null for one",
    )
    z: float | None = Field(description="(value - mean) / between_sd; null without a deviation")
    z_ci95: Bounds | None = Field(default=None, description="95 % interval of z; without meaning below five people")


class ChangeValue(Contract):
    """Change of a measure between two groups of recordings of one person; each recording counts once."""

    name: str
    unit: str
    before: float
    after: float
    n_before: int
    n_after: int
    change: float = Field(
        description="after - before, of a mixed model over all steps with a random intercept per recording; without "
        "repeated steps, or with one recording in a group, of the means of the recordings"
    )
    ci95: Bounds | None = Field(
        description="95 % interval of the change: of the mixed model, else Welch's; null with one recording in a group"
    )


class GaitReportSummary(GaitMeasuresSummary):
    """The numbers of the report: those of ``gait-measures``, the reference group and the change."""

    reference: list[ReferenceValue] = Field(default_factory=list)
    reference_people: int = 0
    changes: list[ChangeValue] = Field(default_factory=list)


MEASURE_TITLES: Final[Mapping[str, str]] = {
    "walking_speed": "Walking speed",
    "step_length": "Step length",
    "step_width": "Step width",
    "step_time": "Step time",
    "cadence": "Cadence",
    "double_support_share": "Double support, share of the step time",
    "stride_length": "Stride length",
    "stride_time": "Stride time",
    "stance_share": "Stance, share of the stride time",
    "swing_share": "Swing, share of the stride time",
    "margin_of_stability_ml_min": "Margin of stability sideways, minimum over single support",
    "margin_of_stability_ml_contact": "Margin of stability sideways, at the strike",
    "margin_of_stability_ap_contact": "Margin of stability ahead, at the strike",
    "capture_point_offset_ap": "Foot ahead of the capture point",
    "capture_point_offset_ml": "Foot outwards of the capture point",
    "com_vertical_excursion": "Vertical excursion of the centre of mass",
    "com_lateral_excursion": "Lateral excursion of the centre of mass",
    "com_speed": "Speed of the centre of mass over a stride",
    "energy_recovery": "Recovery of mechanical energy",
    "external_work": "External work per stride",
    "step_energy_recovery": "Recovery of mechanical energy in a step",
    "step_external_work": "External work per step",
    "limb_work_left_positive": "Positive work of the left leg",
    "limb_work_left_negative": "Negative work of the left leg",
    "limb_work_right_positive": "Positive work of the right leg",
    "limb_work_right_negative": "Negative work of the right leg",
    "angular_momentum_range_x": "Range of the angular momentum about the axis ahead",
    "angular_momentum_range_y": "Range of the angular momentum about the lateral axis",
    "angular_momentum_range_z": "Range of the angular momentum about the vertical axis",
    "cycloid_wheel_radius": "Rolling wheel, radius R",
    "cycloid_point_radius": "Rolling wheel, distance r of the centre of mass from the hub",
    "cycloid_hub_height": "Rolling wheel, height z0 of the hub above the floor",
    "cycloid_angular_speed": "Rolling wheel, angular speed",
    "foot_placement_gain_position": "Foot placement, gain of the position",
    "foot_placement_gain_velocity": "Foot placement, gain of the velocity",
    "foot_placement_residual": "Foot placement, residual",
    "foot_placement_explained": "Foot placement, share of the variance explained",
    "local_dynamic_stability": "Local dynamic stability (largest Lyapunov exponent)",
}
"""Titles of the measures, in the order of the table; others follow under their names."""

_METRES: Final = frozenset({"step_length", "stride_length"})
"""Lengths shown in metres; the others are in millimetres."""
_PERCENT: Final = frozenset(
    {
        "double_support_share",
        "stance_share",
        "swing_share",
        "energy_recovery",
        "step_energy_recovery",
        "foot_placement_explained",
    }
)
"""Ratios shown in percent; the others are plain numbers."""


@dataclass(frozen=True)
class MeasureScale:
    """How a measure is written: the factor to ``unit`` and the number of decimals."""

    factor: float
    unit: str
    digits: int

    def number(self, value: float) -> str:
        """``value`` without its unit."""
        return f"{self.factor * value:z.{self.digits}f}"

    def signed(self, value: float) -> str:
        """``value`` without its unit, with a sign unless it is rounded to zero."""
        text = self.number(value)
        return f"+{text}" if float(text) > 0.0 else text

    def interval(self, bounds: Bounds | None) -> str:
        """``bounds`` without their unit; empty if they are not known."""
        return "" if bounds is None else f"{self.number(bounds[0])} to {self.number(bounds[1])}"


_SCALES: Final[Mapping[str, MeasureScale]] = {
    "m": MeasureScale(1000.0, "mm", 0),
    "s": MeasureScale(1.0, "s", 3),
    "m/s": MeasureScale(1.0, "m/s", 2),
    "J/kg": MeasureScale(1.0, "J/kg", 2),
    "1/min": MeasureScale(1.0, "1/min", 1),
    "rad/s": MeasureScale(1.0, "rad/s", 2),
    "1": MeasureScale(1.0, "", 3),
}


def measure_scale(name: str, unit: str) -> MeasureScale:
    """Factor, unit and decimals of a measure, the same for all its values."""
    if unit == "m" and name in _METRES:
        return MeasureScale(1.0, "m", 3)
    if name in _PERCENT:
        return MeasureScale(100.0, "%", 0)
    return _SCALES.get(unit, MeasureScale(1.0, unit, 3))


REASON_OF: Final[Mapping[str, str]] = {
    "cadence": "step_time",
    "double_support_share": "step_time",
    "stride_time": "stride_length",
    "stance_share": "stride_length",
    "swing_share": "stride_length",
    "com_vertical_excursion": "stride_length",
    "com_lateral_excursion": "stride_length",
    "com_speed": "stride_length",
    "margin_of_stability_ml_contact": "margin_of_stability_ml_min",
    "margin_of_stability_ap_contact": "margin_of_stability_ml_min",
    "capture_point_offset_ap": "margin_of_stability_ml_min",
    "capture_point_offset_ml": "margin_of_stability_ml_min",
    "external_work": "energy_recovery",
    "limb_work_left_negative": "limb_work_left_positive",
    "limb_work_right_negative": "limb_work_right_positive",
    "angular_momentum_range_y": "angular_momentum_range_x",
    "angular_momentum_range_z": "angular_momentum_range_x",
    "cycloid_point_radius": "cycloid_wheel_radius",
    "cycloid_hub_height": "cycloid_wheel_radius",
    "cycloid_angular_speed": "cycloid_wheel_radius",
    "foot_placement_gain_position": "foot_placement_residual",
    "foot_placement_gain_velocity": "foot_placement_residual",
    "foot_placement_explained": "foot_placement_residual",
}
"""The measure of ``not_measured`` that has the reason of a measure without an entry of its own."""


def measure_title(name: str) -> str:
    """Title of a measure; of one without an entry in ``MEASURE_TITLES``, its name in words."""
    return MEASURE_TITLES.get(name, name.replace("_", " ").capitalize())


class MeasuresMember(Contract):
    """One recording of ``gait-measures``: its task and the sub-folder that holds its files."""

    recording_id: str
    folder: str
    task: EstimateComTask
    session_id: str | None = Field(
        default=None, description="recordings with the same one calibrate each other's events by markers"
    )
    session_delays: list[EventDelays] = Field(
        default_factory=list,
        description="of the session's recordings that are no members, without the latency of the force",
    )


class GaitMeasuresTask(Contract):
    """Task of ``gait-measures``."""

    members: list[MeasuresMember]


class ReferencePerson(Contract):
    """All recordings of one person of the reference group of ``gait-report``."""

    members: list[MeasuresMember]


class GaitReportTask(GaitMeasuresTask):
    """Task of ``gait-report``; ``members`` are the recordings of the person, ``before`` the earlier ones."""

    input: GaitReportInput
    before: list[MeasuresMember] = Field(default_factory=list)
    reference: list[ReferencePerson] = Field(default_factory=list)
    created_on: date = Field(description="the only date in the report beside those of the recordings")
    lab_name: str = ""
    logo: str | None = Field(default=None, description="file name inside the task's folder")
