"""Jobs, their inputs and their results, as in the HTTP contract."""

from datetime import datetime
from typing import Annotated, Any, Literal

from pydantic import Field, field_validator, model_validator

from stridelab.schemas.base import Contract, Interval, Problem, Remark
from stridelab.schemas.methods import Method
from stridelab.schemas.quality import Quality
from stridelab.schemas.sessions import LatencySource, SessionValues
from stridelab.schemas.verdicts import JobVerdict

JobState = Literal["queued", "running", "succeeded", "failed", "cancelled", "timed_out"]
FINAL_STATES: frozenset[JobState] = frozenset({"succeeded", "failed", "cancelled", "timed_out"})


class Progress(Contract):
    """How far a job is; ``fraction`` from 0 to 1."""

    fraction: float = 0.0
    message: str = ""


class Job(Contract):
    """A job of any kind; one that failed ``has_result`` where it kept what there was until then."""

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
    log_tail: str | None = None
    has_result: bool = False
    verdict: JobVerdict | None = Field(
        default=None,
        description="whether the result can be used; null until the job has succeeded, and where nothing was checked",
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
    sha256: str | None = Field(default=None, description="of the content; null for results of earlier versions")


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
    """How large the errors of a recording's inputs are, as standard deviations; null takes the usual size."""

    plate_force_n: Declared | None = Field(default=None, description="constant error of the total force; usual: 1 N")
    plate_moment_nm: Declared | None = Field(default=None, description="constant error of the moments; usual: 1 N m")
    mass_share: Annotated[float, Field(ge=0.0, le=0.5)] | None = Field(
        default=None, description="relative error of the body mass; usual: 0.01"
    )
    clock_s: Annotated[float, Field(ge=0.0, le=0.1)] | None = Field(
        default=None, description="what is left of the latency between force and markers; usual: 0.005 s"
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
        default=None, description="steps per second; null finds it in the vertical motion"
    )


class SmootherOptions(Contract):
    """What the smoother may be told; leave it out and it goes by usual sizes and the recording itself."""

    priors: StatedErrors = Field(default_factory=StatedErrors)
    learn: bool = Field(default=True, description="let the recording correct the sizes that it shows")
    segment_momentum: bool = Field(
        default=False, description="take the segments' angular momentum as known instead of guessing all of it"
    )


class EstimateComInput(Contract):
    """Input of ``estimate-com``."""

    recording_id: str
    method: Method | None = Field(
        default=None,
        description=(
            "null: the smoother, or the complementary filter where the smoother refuses the recording; what was taken "
            "is in the result. Stated cut-offs ask for the filter, and stated smoother options for the smoother"
        ),
    )
    latency: Literal["report", "apply"] | Annotated[float, Field(ge=-0.1, le=0.1)] = Field(
        default="apply",
        description=(
            "apply: take out the force's latency against the markers where it is significant; report: estimate it "
            "only; a number: seconds to take out (> 0: the force is late). What was done is a warning of the result"
        ),
    )
    segment_table: Literal["auto", "dumas2007", "deleva1996", "carried"] = "auto"
    cutoffs: Literal["auto", "thesis", "spectra"] | tuple[float, float] = Field(
        default="auto",
        description=(
            "low and high cut-off of the complementary filter in Hz (2.24-2.27); auto: 0.2 and 1; thesis: 0.4 and 4; "
            "spectra: those that the window's own spectra choose"
        ),
    )
    smoother: SmootherOptions | None = Field(default=None, description="only for the smoother")
    window_s: Interval | None = None

    @field_validator("smoother")
    @classmethod
    def _whose_options(cls, options: SmootherOptions | None, info: Any) -> SmootherOptions | None:
        method = info.data.get("method")
        if options is not None and method not in (None, "smoother"):
            raise ValueError(f"the {method} estimator has no use for them, only the smoother has")
        return options


class ComparedMass(Contract):
    """A body mass that was compared with the others, and its standard deviation."""

    source: Literal["stated", "file", "standing", "impulse", "whole_steps", "static", "session"] = Field(
        description="stated by the user; in the file; from the plates while standing, by the impulse of the vertical "
        "force, or over whole steps; from the plates while standing in the static trial; over all trials of the session"
    )
    mass_kg: float
    sd_kg: float


class EstimateComSummary(Contract):
    """Summary of ``estimate-com``."""

    window_s: Interval
    rate_hz: float
    method: str
    segment_table: str
    mass_kg: float | None = Field(description="null where none is known, which only the method geometry allows")
    mass_source: Literal["stated", "file", "force"] | None = Field(default="stated", description="null without a mass")
    mass_sd_kg: float | None = Field(default=None, description="standard deviation of the mass that is used")
    mass_from_force_kg: float | None = None
    masses: list[ComparedMass] = Field(default_factory=list, description="all masses that were known and compared")
    latency_s: float | None
    latency_sd_s: float | None
    latency_applied_s: float
    latency_source: LatencySource = "trial"
    latency_n_trials: int = Field(default=1, description="trials behind the latency")
    latency_trial_s: float | None = Field(default=None, description="what this trial says alone")
    latency_trial_sd_s: float | None = None
    session: SessionValues | None = Field(default=None, description="values of the session that were used")
    latency_along_s: float | None = Field(default=None, description="what the accelerations along the walk say alone")
    latency_lateral_s: float | None = Field(default=None, description="across the walk; reported, not used")
    latency_vertical_s: float | None = Field(default=None, description="what the vertical accelerations say alone")
    rms_force_residual_n: list[float]
    bias_m: list[float]
    observability: dict[str, Any]
    diagnostics: dict[str, float] = Field(
        default_factory=dict, description="numbers of the estimator, with their units"
    )
    quality: Quality | None = Field(default=None, description="null in results of versions that did not check")
    warnings: list[Remark]


class SimulationNoise(Contract):
    """Noise of a simulated recording; None or 0 switches a part off."""

    force_n: Annotated[float, Field(ge=0, le=200)] = 2.0
    moment_nm: Annotated[float, Field(ge=0, le=100)] = 1.0
    configuration_rad: Annotated[float, Field(ge=0, le=0.3)] = 0.0
    marker_m: Annotated[float, Field(ge=0, le=0.05)] = 0.0005
    mass_model: Annotated[float, Field(ge=0, le=0.5)] = 0.0
    latency_s: Annotated[float, Field(ge=-0.05, le=0.05)] = 0.0


class SimulateRecordingInput(Contract):
    """Input of ``simulate-recording``. Height, mass and sex are a person's and null for TALOS, which has its own."""

    robot: Literal["human", "talos"] = Field(default="human", description="who walks: a person, or the humanoid TALOS")
    gait: Literal["walking", "running"] = Field(default="walking", description="only TALOS runs, with flight phases")
    duration_s: Annotated[float, Field(ge=2.0, le=60.0)] = 6.0
    speed_m_s: Annotated[float, Field(ge=0.0, le=2.0)] = Field(
        default=1.2, description="unless stated, TALOS walks at 0.4 m/s and runs at 1 m/s"
    )
    height_m: Annotated[float, Field(ge=1.2, le=2.2)] | None = 1.71
    mass_kg: Annotated[float, Field(ge=25, le=200)] | None = 60.0
    sex: Literal["female", "male"] | None = "female"
    lab: Literal["walkway", "two_plates"] = Field(
        default="walkway",
        description="walkway: every footprint has a plate of its own; two_plates: two plates in a row, as in most labs",
    )
    noise: SimulationNoise = Field(default_factory=SimulationNoise)
    seed: Annotated[int, Field(ge=0, le=2**31 - 1)] = 0

    @model_validator(mode="before")
    @classmethod
    def _as_talos(cls, data: Any) -> Any:
        """What TALOS is unless stated: no person, and slower."""
        if not isinstance(data, dict) or data.get("robot") != "talos":
            return data
        speed_m_s = 1.0 if data.get("gait") == "running" else 0.4
        return {"speed_m_s": speed_m_s, "height_m": None, "mass_kg": None, "sex": None, **data}

    @field_validator("gait")
    @classmethod
    def _who_runs(cls, gait: str, info: Any) -> str:
        if gait == "running" and info.data.get("robot") == "human":
            raise ValueError("the simulated person walks; only TALOS runs")
        return gait

    @field_validator("height_m", "mass_kg", "sex")
    @classmethod
    def _whose_body(cls, value: float | str | None, info: Any) -> float | str | None:
        robot = info.data.get("robot")
        if robot == "talos" and value is not None:
            raise ValueError("TALOS has its own height and mass; leave this out")
        if robot == "human" and value is None:
            raise ValueError("a person needs a height, a mass and a sex")
        return value


class SimulateRecordingSummary(Contract):
    """Summary of ``simulate-recording``."""

    recording_id: str | None = None
    speed_m_s: float
    n_steps: int
    warnings: list[Remark] = Field(default_factory=list)
