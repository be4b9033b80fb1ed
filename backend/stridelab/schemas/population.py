"""Input and result of ``study-population``, bulk uploads, and the subject table."""

from collections.abc import Sequence
from typing import Annotated, Literal

from pydantic import Field, model_validator

from stridelab.schemas.base import Contract, Remark
from stridelab.schemas.cycloid import FitCycloidTask
from stridelab.schemas.methods import Method
from stridelab.schemas.quality import Quality, TrialQuality
from stridelab.schemas.recordings import AgeYears, HeightM, MassKg, Recording, Sex

MAX_RECORDINGS = 500
Name = Annotated[str, Field(min_length=1, max_length=80, pattern=r"^[^\x00-\x1f\x7f]+$")]
Bounds = Annotated[tuple[float, float], Field(description="lower and upper end of a 95 % interval")]
GroupSource = Literal["stated", "age", "height", "unknown"]


class PersonFields(Contract):
    """Fields of the subject table for one recording; ``group`` takes precedence over age and height."""

    subject: Name | None = Field(default=None, description="a pseudonym; recordings with the same pseudonym are pooled")
    group: Name | None = None
    height_m: HeightM | None = None
    mass_kg: MassKg | None = None
    sex: Sex | None = None
    age_years: AgeYears | None = None


class SubjectOfRecording(PersonFields):
    """One row of the subject table."""

    recording_id: str


def refuse_repeated_recordings(recording_ids: Sequence[str], subjects: Sequence[SubjectOfRecording]) -> None:
    """Raise ``ValueError`` where a recording occurs twice or the subject table names a recording that is not given."""
    twice = sorted({i for i in recording_ids if recording_ids.count(i) > 1})
    if twice:
        raise ValueError(f"recording_ids: the same recording twice: {', '.join(twice)[:200]}")
    rows = [row.recording_id for row in subjects]
    twice = sorted({i for i in rows if rows.count(i) > 1})
    if twice:
        raise ValueError(f"subjects: two rows for one recording: {', '.join(twice)[:200]}")
    unknown = sorted(set(rows) - set(recording_ids))
    if unknown:
        raise ValueError(f"subjects: not among recording_ids: {', '.join(unknown)[:200]}")


class RefusedFile(Contract):
    """A rejected file of a bulk upload, with the reason."""

    filename: str
    code: str
    message: str


class RecordingBatch(Contract):
    """Response of ``POST /recordings/batch``; ``subjects`` has the form of ``subjects`` in ``study-population``.

    ``studied`` are the ids of all recordings except the static trials of the table.
    """

    recordings: list[Recording]
    studied: list[str]
    subjects: list[SubjectOfRecording]
    refused: list[RefusedFile]


class ReadBatchInput(Contract):
    """Input of ``read-batch``, a job that only ``POST /recordings/batch`` submits: the stored upload."""

    batch_id: Annotated[str, Field(pattern=r"^[0-9a-f]{32}$")]
    files: list[str] = Field(description="names of the stored files, assigned by the service")


class ReadBatchSummary(Contract):
    """Ids of the recordings of a bulk upload; the other fields are those of ``RecordingBatch``."""

    recording_ids: list[str]
    studied: list[str]
    subjects: list[SubjectOfRecording]
    refused: list[RefusedFile]


class StudyPopulationInput(Contract):
    """Input of ``study-population``; fields missing in ``subjects`` are taken from the recordings."""

    recording_ids: list[str] = Field(min_length=1, max_length=MAX_RECORDINGS)
    subjects: list[SubjectOfRecording] = Field(default_factory=list, max_length=MAX_RECORDINGS)
    method: Method | None = Field(
        default=None, description="estimator of the centre of mass; null selects it as in `estimate-com`"
    )
    steps: Literal["measured", "all"] = Field(default="measured", description="selection of steps, as in `fit-cycloid`")
    pooled: bool = Field(default=False, description="analyse all subjects together, in addition to each group")
    seed: Annotated[int, Field(ge=0, le=2**31 - 1)] = Field(
        default=0, description="random seed of the bootstrap intervals"
    )

    @model_validator(mode="after")
    def _check_ids(self) -> "StudyPopulationInput":
        refuse_repeated_recordings(self.recording_ids, self.subjects)
        return self


class SubjectResult(Contract):
    """Means and standard deviations over the steps of one subject; with a single step, the latter are null."""

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
    error_mean_mm: float = Field(
        description="distance between wheel and path: mean over the steps of the mean per step"
    )
    error_sd_mm: float | None = Field(description="mean over the steps of the standard deviation within each step")
    error_max_mm: float
    circumference_share: float | None = Field(description="2 pi R over the step length")
    double_support_start_error_s: float | None = Field(
        description="start by the rule of the thesis (3.3.3) minus the measured start"
    )
    double_support_start_error_sd_s: float | None
    double_support_end_error_s: float | None
    double_support_end_error_sd_s: float | None


class PartialCorrelation(Contract):
    """Partial correlation, controlling for the variable ``on``; the variance of atanh(r) is 1 / (n - 4)."""

    on: str
    n: int
    r: float
    p: float
    ci95: Bounds | None


class CorrelationResult(Contract):
    """Correlation between a parameter of the wheel and another variable, over the subjects of one group.

    ``p`` is for this pair alone, ``p_holm`` is corrected for all pairs of the group (Holm). ``ci95`` is Fisher's
    interval, ``bootstrap_ci95`` the bias-corrected and accelerated bootstrap over subjects. ``thesis`` is the
    coefficient in the thesis.
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
    partial_on_speed: float | None = Field(description="coefficient of `partial` that controls for the speed")
    left_out: list[str] = Field(description="subjects for which one of the two variables is unknown")
    thesis: float | None = None


class EffectResult(Contract):
    """A fixed effect of a mixed model, in the unit of the parameter per unit of the variable."""

    name: str
    value: float
    sd: float
    freedom: int
    p: float
    ci95: Bounds


class MixedModelResult(Contract):
    """Mixed model of a parameter over all steps, with a random intercept per subject (restricted likelihood).

    ``icc`` is the fraction of the variance between subjects (intraclass correlation); for the model without variables
    (``formula`` "1"), it measures how well one step represents its subject.
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
    """A recording without any fitted step, with the reason."""

    recording_id: str
    filename: str
    code: str
    message: str


class StudyPopulationSummary(Contract):
    """Rolling wheels of several subjects: means per subject, correlations per group, and mixed models."""

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
        description="worst value of each check over the recordings used; null in results of versions without this "
        "check",
    )
    trials: list[TrialQuality] = Field(
        default_factory=list, description="quality of each recording; contradicted ones are in `left_out`"
    )
    warnings: list[Remark]


class PopulationMember(Contract):
    """One recording of a population: its task, and the fields of the subject table."""

    recording_id: str
    folder: str = Field(description="folder inside the task's folder that holds its files")
    task: FitCycloidTask
    person: PersonFields = PersonFields()


class StudyPopulationTask(Contract):
    """Task of ``study-population``."""

    members: list[PopulationMember]
    pooled: bool = False
    seed: int = 0
