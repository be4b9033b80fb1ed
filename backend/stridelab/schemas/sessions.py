"""What a session of trials says together: one clock, one body mass, and the static trial."""

from typing import Annotated, Literal

from pydantic import Field

from stridelab.schemas.base import Contract

SessionId = Annotated[
    str, Field(min_length=1, max_length=64, pattern=r"^[A-Za-z0-9._-]+$", description="letters, digits, . _ and -")
]

LatencySource = Annotated[
    Literal["session", "trial"], Field(description="session: pooled over its trials; trial: of this recording alone")
]


class SessionTrial(Contract):
    """What one trial of a session says; null where it says nothing."""

    recording_id: str
    filename: str
    latency_s: float | None = None
    latency_sd_s: float | None = None
    latency_weight: float | None = Field(default=None, description="share of this trial in the session's latency")
    mass_kg: float | None = Field(default=None, description="weight on the plates over g")
    mass_sd_kg: float | None = None
    mass_weight: float | None = Field(default=None, description="share of this trial in the session's mass")


class SessionValues(Contract):
    """The values of a session that a result was computed with; with them the result can be computed again."""

    session_id: str
    latency_s: float | None = Field(default=None, description="latency of the force, pooled over the trials")
    latency_sd_s: float | None = None
    latency_excess_s: float | None = Field(
        default=None, description="standard deviation between the trials beyond their own"
    )
    latency_n_trials: int = 0
    mass_kg: float | None = Field(default=None, description="body mass from the plates, pooled over the trials")
    mass_sd_kg: float | None = None
    mass_n_trials: int = 0
    static_recording_id: str | None = Field(default=None, description="the session's static trial, where it was used")
    trials: list[SessionTrial] = Field(default_factory=list)
