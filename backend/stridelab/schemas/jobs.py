"""Schemas of jobs, and inputs and results of the jobs on recordings."""

from datetime import datetime
from typing import Annotated, Any, Literal

from pydantic import Field, field_validator, model_validator

from stridelab.schemas.base import Contract, Interval, Problem, Remark
from stridelab.schemas.methods import Method
from stridelab.schemas.quality import Quality
from stridelab.schemas.recordings import TreadmillBelts
from stridelab.schemas.sessions import LatencySource, SessionValues

JobState = Literal["queued", "running", "succeeded", "failed", "cancelled", "timed_out"]
FINAL_STATES: frozenset[JobState] = frozenset({"succeeded", "failed", "cancelled", "timed_out"})


class Progress(Contract):
    """Progress of a job; ``fraction`` is from 0 to 1, ``message`` names stages as ``stage_times_s`` does."""

    fraction: float = 0.0
    message: str = ""
    text: str = Field(default="", description="the message in words for people")


VerdictCode = Literal[
    "certified",
    "not-certified",
    "replay-fell",
    "replay-not-completed",
    "replan-failed",
    "every-replan-solved",
    "sensors-agree",
    "sensors-doubtful",
    "sensors-contradict",
]


class JobVerdict(Contract):
    """Verdict on a result; `outcome` is that of the worst check."""

    outcome: Literal["passed", "doubtful", "failed"]
    code: VerdictCode = Field(description="code of the worst outcome")
    message: str = Field(description="explanation of the verdict, without a full stop")
    failed_checks: list[str] = Field(
        default_factory=list, description="names of the failed checks of the certificate or of the quality"
    )


class Job(Contract):
    """A job of any kind; a failed job with partial results has ``has_result`` true."""

    id: str
    kind: str
    state: JobState
    priority: int
    progress: Progress
    attempt: int
    created_at: datetime
    started_at: datetime | None = None
    finished_at: datetime | None = None
    error: Problem | None = None
    queue_position: int | None = None
    owner: str | None = None
    recording_id: str | None = None
    scenario_id: str | None = None
    n_recordings: int | None = Field(default=None, description="recordings of a job on several; null for other kinds")
    about: str | None = Field(
        default=None,
        description="what the job is about: the file name of its recording, or the name of its scenario, of a robot, a "
        "session, or an item of the reproduction",
    )
    log_tail: str | None = None
    has_result: bool = False
    verdict: JobVerdict | None = Field(
        default=None,
        description="validity of the result; null until the job has succeeded, and for results without checks",
    )


class JobEvent(Contract):
    """One server-sent event of a job; ``seq`` is the event id to resume from."""

    seq: int
    at: datetime
    state: JobState
    attempt: int
    progress: Progress


class Artifact(Contract):
    """A file of a result."""

    name: str
    media_type: str
    bytes: int
    sha256: str | None = Field(default=None, description="SHA-256 of the content; null for results of earlier versions")


class JobResult(Contract):
    """``GET /jobs/{id}/result``."""

    kind: str
    input: dict[str, Any]
    versions: dict[str, str]
    references: list[str]
    summary: dict[str, Any]
    artifacts: list[Artifact]


Declared = Annotated[float, Field(ge=0.0, le=1000.0)]
Sd = Annotated[float, Field(ge=1e-9, le=1000.0)]


class StatedErrors(Contract):
    """Standard deviations of the errors of a recording's inputs; null takes the usual value."""

    plate_force_n: Declared | None = Field(default=None, description="constant error of the total force; usual: 1 N")
    plate_moment_nm: Declared | None = Field(default=None, description="constant error of the moments; usual: 1 N m")
    mass_share: Annotated[float, Field(ge=0.0, le=0.5)] | None = Field(
        default=None, description="relative error of the body mass; usual: 0.01"
    )
    clock_s: Annotated[float, Field(ge=0.0, le=0.1)] | None = Field(
        default=None,
        description="residual latency between force and markers; usual: what their comparison states, at most 0.005 s",
    )
    marker_m: Sd | None = Field(default=None, description="noise of the geometric centre of mass")
    force_n: Sd | None = Field(default=None, description="noise of the force, per axis")
    moment_nm: Sd | None = Field(default=None, description="noise of the moment, per axis")
    table_varying_m: Sd | None = Field(
        default=None, description="part of the segment table's error that changes with the posture"
    )
    momentum_m_s: tuple[Sd, Sd] | None = Field(
        default=None, description="angular momentum over weight, RMS, about the walking and the lateral axis"
    )
    step_hz: Annotated[float, Field(ge=0.1, le=10.0)] | None = Field(
        default=None, description="steps per second; null estimates it from the vertical motion"
    )


class SmootherOptions(Contract):
    """Options of the smoother; by default, it uses usual error sizes and estimates them from the recording."""

    priors: StatedErrors = Field(default_factory=StatedErrors)
    learn: bool = Field(default=True, description="estimate the observable error sizes from the recording")
    segment_momentum: bool = Field(
        default=False,
        description="always use the angular momentum of the body segments; false uses it in walking where the "
        "recording is more probable with it",
    )


class EstimateComInput(Contract):
    """Input of ``estimate-com``."""

    recording_id: str
    method: Method | None = Field(
        default=None,
        description=(
            "null: the smoother, or the complementary filter if the smoother rejects the recording; the result names "
            "the method. Explicit cut-offs select the filter, explicit smoother options the smoother"
        ),
    )
    latency: Literal["report", "apply"] | Annotated[float, Field(ge=-0.1, le=0.1)] = Field(
        default="apply",
        description=(
            "apply: compensate the latency of the force with respect to the markers if it is significant; report: only "
            "estimate it; a number: latency in seconds to compensate (> 0: the force is late). A warning of the result "
            "reports what was done"
        ),
    )
    segment_table: Literal["auto", "dumas2007", "deleva1996", "carried"] = "auto"
    cutoffs: Literal["auto", "thesis", "spectra"] | tuple[float, float] = Field(
        default="auto",
        description=(
            "low and high cut-off frequency of the complementary filter in Hz (2.24-2.27); auto: 0.2 and 1; thesis: "
            "0.4 and 4; spectra: chosen from the spectra of the window"
        ),
    )
    smoother: SmootherOptions | None = Field(default=None, description="only for the smoother")
    window_s: Interval | None = None

    @field_validator("smoother")
    @classmethod
    def _check_options(cls, options: SmootherOptions | None, info: Any) -> SmootherOptions | None:
        method = info.data.get("method")
        if options is not None and method not in (None, "smoother"):
            raise ValueError(f"the {method} estimator does not use them, only the smoother does")
        return options


class ComparedMass(Contract):
    """A body mass from one source, with its standard deviation."""

    source: Literal["stated", "file", "standing", "impulse", "whole_steps", "static", "session"] = Field(
        description="stated by the user; in the file; from the plates: while standing, from the impulse of the "
        "vertical force, or over whole steps; while standing in the static trial; pooled over the session"
    )
    mass_kg: float
    sd_kg: float


class RecordingSummary(Contract):
    """Base of the summaries of jobs that estimate the centre of mass of one recording."""

    window_s: Interval
    rate_hz: float
    segment_table: str
    latency_s: float | None
    latency_applied_s: float
    latency_source: LatencySource = "trial"
    latency_n_trials: int = Field(default=1, description="number of trials that the latency is estimated from")
    session: SessionValues | None = Field(
        default=None, description="values of the session that were used in the computation"
    )
    treadmill: TreadmillBelts | None = Field(default=None, description="null for a walk over ground")
    proposed_names: dict[str, str] = Field(
        default_factory=dict,
        description="label of each landmark where no marker set and no user named the markers; to be checked",
    )
    quality: Quality | None = Field(default=None, description="null in results of versions without this check")
    warnings: list[Remark]


class EstimateComSummary(RecordingSummary):
    """Summary of ``estimate-com``."""

    method: str
    mass_kg: float | None = Field(description="null if unknown, which only the method geometry allows")
    mass_source: Literal["stated", "file", "force"] | None = Field(default="stated", description="null without a mass")
    mass_sd_kg: float | None = Field(default=None, description="standard deviation of the mass that is used")
    mass_from_force_kg: float | None = None
    masses: list[ComparedMass] = Field(
        default_factory=list, description="body masses from all sources, which are compared"
    )
    latency_sd_s: float | None
    latency_trial_s: float | None = Field(default=None, description="latency estimated from this trial alone")
    latency_trial_sd_s: float | None = None
    latency_along_s: float | None = Field(
        default=None, description="latency from the accelerations along the walk alone"
    )
    latency_lateral_s: float | None = Field(
        default=None, description="latency from lateral accelerations; reported only"
    )
    latency_vertical_s: float | None = Field(default=None, description="latency from the vertical accelerations alone")
    rms_force_residual_n: list[float]
    bias_m: list[float]
    sd_m: list[float] = Field(
        default_factory=list, description="standard deviation of the position, x, y, z: median over the window"
    )
    walking_direction: tuple[float, float] | None = Field(
        default=None, description="unit vector in x and y of the travel over the window; null where the body stays"
    )
    observability: dict[str, Any]
    diagnostics: dict[str, float] = Field(
        default_factory=dict, description="diagnostic values of the estimator; names end in the unit"
    )


class SimulationNoise(Contract):
    """Noise of a simulated recording; 0 disables a component."""

    force_n: Annotated[float, Field(ge=0, le=200)] = 2.0
    moment_nm: Annotated[float, Field(ge=0, le=100)] = 1.0
    configuration_rad: Annotated[float, Field(ge=0, le=0.3)] = 0.0
    marker_m: Annotated[float, Field(ge=0, le=0.05)] = 0.0005
    mass_model: Annotated[float, Field(ge=0, le=0.5)] = 0.0
    latency_s: Annotated[float, Field(ge=-0.05, le=0.05)] = 0.0


class SimulateRecordingInput(Contract):
    """Input of ``simulate-recording``. Height, mass and sex describe the person and are null for a robot."""

    robot: Annotated[str, Field(min_length=1, max_length=60)] = Field(
        default="human", description="walker: human, or a robot on two legs of six joints each, by its name"
    )
    gait: Literal["walking", "running"] = Field(
        default="walking", description="running, with flight phases, is available for TALOS only"
    )
    duration_s: Annotated[float, Field(ge=2.0, le=60.0)] = 6.0
    speed_m_s: Annotated[float, Field(ge=0.0, le=2.0)] = Field(
        default=1.2, description="default for robots: 0.4 m/s walking, 1 m/s running"
    )
    height_m: Annotated[float, Field(ge=1.2, le=2.2)] | None = 1.71
    mass_kg: Annotated[float, Field(ge=25, le=200)] | None = 60.0
    sex: Literal["female", "male"] | None = "female"
    lab: Literal["walkway", "two_plates"] = Field(
        default="walkway",
        description="walkway: one plate per footprint; two_plates: two plates in a row, as in most laboratories",
    )
    noise: SimulationNoise = Field(default_factory=SimulationNoise)
    seed: Annotated[int, Field(ge=0, le=2**31 - 1)] = 0

    @model_validator(mode="before")
    @classmethod
    def _set_robot_defaults(cls, data: Any) -> Any:
        """Set the defaults for robots: lower speed, and no height, mass and sex."""
        if not isinstance(data, dict) or data.get("robot", "human") == "human":
            return data
        speed_m_s = 1.0 if data.get("gait") == "running" else 0.4
        return {"speed_m_s": speed_m_s, "height_m": None, "mass_kg": None, "sex": None, **data}

    @field_validator("gait")
    @classmethod
    def _check_gait(cls, gait: str, info: Any) -> str:
        if gait == "running" and info.data.get("robot") != "talos":
            raise ValueError("only TALOS runs; its flight phases are balanced with gains of its own")
        return gait

    @field_validator("height_m", "mass_kg", "sex")
    @classmethod
    def _check_body(cls, value: float | str | None, info: Any) -> float | str | None:
        robot = info.data.get("robot")
        if robot not in ("human", None) and value is not None:
            raise ValueError("a robot has its own height and mass; leave this out")
        if robot == "human" and value is None:
            raise ValueError("a person needs a height, a mass and a sex")
        return value


class SimulateRecordingSummary(Contract):
    """Summary of ``simulate-recording``."""

    recording_id: str | None = None
    speed_m_s: float
    n_steps: int
    warnings: list[Remark] = Field(default_factory=list)
