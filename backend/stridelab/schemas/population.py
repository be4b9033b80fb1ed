"""Input and result of ``study-population``, and the table that says who is who."""

from typing import Annotated, Literal

from pydantic import Field, model_validator

from stridelab.schemas.base import Contract, Remark
from stridelab.schemas.methods import Method
from stridelab.schemas.quality import Quality, TrialQuality
from stridelab.schemas.recordings import AgeYears, HeightM, MassKg, Recording, Sex

MAX_RECORDINGS = 500
Name = Annotated[str, Field(min_length=1, max_length=80, pattern=r"^[^\x00-\x1f\x7f]+$")]
Bounds = Annotated[tuple[float, float], Field(description="lower and upper end of a 95 % interval")]
GroupSource = Literal["stated", "age", "height", "unknown"]


class PersonFields(Contract):
    """What a subject table says of the person on a recording; ``group`` overrules what age and height would say."""

    subject: Name | None = Field(default=None, description="a pseudonym; the same one on several recordings pools them")
    group: Name | None = None
    height_m: HeightM | None = None
    mass_kg: MassKg | None = None
    sex: Sex | None = None
    age_years: AgeYears | None = None


class SubjectOfRecording(PersonFields):
    """One row of the subject table."""

    recording_id: str


class RefusedFile(Contract):
    """A file of a bulk upload of which nothing is kept, and why."""

    filename: str
    code: str
    message: str


class RecordingBatch(Contract):
    """Answer of ``POST /recordings/batch``; ``subjects`` is what ``study-population`` takes under that name.

    ``studied`` are the ids of all but the static trials that the table names.
    """

    recordings: list[Recording]
    studied: list[str]
    subjects: list[SubjectOfRecording]
    refused: list[RefusedFile]


class ReadBatchInput(Contract):
    """Input of ``read-batch``, a job that only ``POST /recordings/batch`` submits: where the received files lie."""

    batch_id: Annotated[str, Field(pattern=r"^[0-9a-f]{32}$")]
    files: list[str] = Field(description="names of the stored files, which are ours and not the user's")


class ReadBatchSummary(Contract):
    """The recordings of a bulk upload by their ids; the other fields are those of the direct answer."""

    recording_ids: list[str]
    studied: list[str]
    subjects: list[SubjectOfRecording]
    refused: list[RefusedFile]


class StudyPopulationInput(Contract):
    """Input of ``study-population``; what ``subjects`` does not say is taken from the recordings."""

    recording_ids: list[str] = Field(min_length=1, max_length=MAX_RECORDINGS)
    subjects: list[SubjectOfRecording] = Field(default_factory=list, max_length=MAX_RECORDINGS)
    method: Method | None = Field(
        default=None, description="estimator of the centre of mass; null takes the best, as in `estimate-com`"
    )
    steps: Literal["measured", "all"] = Field(default="measured", description="which steps count, as in `fit-cycloid`")
    pooled: bool = Field(default=False, description="also look at everybody together, beside the groups apart")
    seed: Annotated[int, Field(ge=0, le=2**31 - 1)] = Field(default=0, description="of the bootstrap intervals")

    @model_validator(mode="after")
    def _each_once(self) -> "StudyPopulationInput":
        twice = sorted({i for i in self.recording_ids if self.recording_ids.count(i) > 1})
        if twice:
            raise ValueError(f"recording_ids: the same recording twice: {', '.join(twice)[:200]}")
        rows = [row.recording_id for row in self.subjects]
        twice = sorted({i for i in rows if rows.count(i) > 1})
        if twice:
            raise ValueError(f"subjects: two rows for one recording: {', '.join(twice)[:200]}")
        unknown = sorted(set(rows) - set(self.recording_ids))
        if unknown:
            raise ValueError(f"subjects: not among recording_ids: {', '.join(unknown)[:200]}")
        return self


class SubjectResult(Contract):
    """Means and standard deviations (over steps) of one person; an sd of one step is null."""

    subject: str
    group: str
    group_source: GroupSource
    recordings: list[str] = Field(description="file names")
    n_steps: int
    height_m: float | None
    leg_m: float | None = Field(description="hip to ankle, from the joint centres")
    age_years: float | None
    sex: Sex | None
    mass_kg: float | None
    speed_m_s: float | None
    step_length_m: float | None
    R_m: float
    R_sd_m: float | None
    r_m: float
    r_sd_m: float | None
    z0_m: float
    z0_sd_m: float | None
    omega_rad_s: float
    omega_sd_rad_s: float | None
    error_mean_mm: float = Field(description="distance between wheel and path: mean over the steps of their means")
    error_sd_mm: float | None = Field(description="mean over the steps of the standard deviation within a step")
    error_max_mm: float
    circumference_share: float | None = Field(description="2 pi R over the step length")
    double_support_start_error_s: float | None = Field(description="the thesis' rule (3.3.3) minus the measured start")
    double_support_start_error_sd_s: float | None
    double_support_end_error_s: float | None
    double_support_end_error_sd_s: float | None


class PartialCorrelation(Contract):
    """The correlation with another number held fixed; the variance of atanh(r) is 1 / (n - 4)."""

    on: str
    n: int
    r: float
    p: float
    ci95: Bounds | None


class CorrelationResult(Contract):
    """One parameter of the wheel against one other number, over the people of one group.

    ``p`` is for this pair alone, ``p_holm`` for having looked at all pairs of the group. ``ci95`` is Fisher's,
    ``bootstrap_ci95`` the bias-corrected and accelerated one over people. ``thesis`` is the thesis' coefficient.
    """

    group: str
    parameter: str
    against: str
    n: int
    r: float
    p: float
    p_holm: float
    ci95: Bounds | None
    bootstrap_ci95: Bounds | None
    spearman: float | None
    spearman_p: float | None
    spearman_ci95: Bounds | None
    spearman_bootstrap_ci95: Bounds | None
    partial: list[PartialCorrelation]
    partial_on_speed: float | None = Field(description="the coefficient of `partial` with the speed held fixed")
    left_out: list[str] = Field(description="people of whom one of the two is not known")
    thesis: float | None = None


class EffectResult(Contract):
    """A coefficient of a mixed model, in the parameter's unit per unit of the variable."""

    name: str
    value: float
    sd: float
    freedom: int
    p: float
    ci95: Bounds


class MixedModelResult(Contract):
    """A parameter over all steps with a random level per person (restricted likelihood).

    ``icc`` is the share of the variance that lies between people; of the model without variables (``formula`` "1") it
    tells how well one step represents its person.
    """

    group: str
    parameter: str
    formula: str
    method: Literal["reml", "ml"]
    effects: list[EffectResult]
    subject_sd: float
    step_sd: float
    icc: float
    n_people: int
    n_steps: int
    on_bound: bool


class LeftOut(Contract):
    """A recording in which nothing could be fitted, and why."""

    recording_id: str
    filename: str
    code: str
    message: str


class StudyPopulationSummary(Contract):
    """The wheels of many people: means per person, correlations per group with intervals, and mixed models."""

    subjects: list[SubjectResult]
    correlations: list[CorrelationResult]
    mixed_models: list[MixedModelResult]
    left_out: list[LeftOut]
    n_recordings: int
    n_steps: int
    method: str | None
    pooled: bool
    quality: Quality | None = Field(
        default=None,
        description="the worst value of every check over the recordings that were used; null in results of versions "
        "that did not check",
    )
    trials: list[TrialQuality] = Field(
        default_factory=list, description="every recording's own quality; a contradicted one is in `left_out`"
    )
    warnings: list[Remark]
