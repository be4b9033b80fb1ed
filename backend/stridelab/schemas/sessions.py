"""Values shared by the trials of a session: latency, body mass, and the static trial."""

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
    """Estimates from one trial of a session; null if not available."""

    recording_id: str
    filename: str
    latency_s: float | None = None
    latency_sd_s: float | None = None
    latency_weight: float | None = Field(default=None, description="share of this trial in the session's latency")
    mass_kg: float | None = Field(default=None, description="weight on the plates over g")
    mass_sd_kg: float | None = None
    mass_weight: float | None = Field(default=None, description="share of this trial in the session's mass")


class SessionValues(Contract):
    """Values of a session that were used for a result, sufficient to reproduce it."""

    session_id: str
    latency_s: float | None = Field(default=None, description="latency of the force, pooled over the trials")
    latency_sd_s: float | None = None
    latency_excess_s: float | None = Field(
        default=None, description="standard deviation between trials in excess of their own"
    )
    latency_n_trials: int = 0
    mass_kg: float | None = Field(default=None, description="body mass from the plates, pooled over the trials")
    mass_sd_kg: float | None = None
    mass_n_trials: int = 0
    plate_zeros: dict[int, list[float]] = Field(
        default_factory=dict,
        description="force (N) and moment (Nm, about the origin) that plates read unloaded in other trials of the "
        "session, by the index of the plate; only of plates that are never unloaded in this one",
    )
    static_recording_id: str | None = Field(default=None, description="static trial of the session, if it was used")
    trials: list[SessionTrial] = Field(default_factory=list)
