"""Consistency of the sensors of a recording; part of every result of a recording."""

from typing import Final, Literal

from pydantic import Field

from stridelab.schemas.base import Contract

Verdict = Literal["good", "doubtful", "contradicted"]


class QualityCheck(Contract):
    """One consistency check: a value, its limit, and a message that names the sensors compared."""

    name: str
    value: float
    unit: str = Field(description='"m", or "1" for a ratio')
    limit: float = Field(description="maximum value that passes")
    contradicted_above: float = Field(description="above this value, the sensors contradict each other")
    passed: bool
    message: str


SHARES: Final = frozenset(
    {
        "force_residual",
        "acceleration_difference",
        "mass_from_motion",
        "mass_from_standing",
        "mass_uncertainty",
        "flight_acceleration",
        "pressure_off_plate",
        "force_clipped",
        "leg_length_change",
        "force_tilt",
        "model_leg_mass",
    }
)
"""Checks whose ratios are shown in percent."""


def check_value_text(check: QualityCheck, value: float) -> str:
    """``value`` or the limit of ``check`` with its unit, as people read it."""
    if check.unit == "m":
        return f"{1000.0 * value:.0f} mm" if value < 10.0 else f"{value:.1f} m"
    if check.unit == "deg":
        return f"{value:.0f}\N{DEGREE SIGN}"
    return f"{100.0 * value:.1f} %" if check.name in SHARES else f"{value:.2f}"


class Quality(Contract):
    """Verdict: `good` if every check passes, `contradicted` if the sensors contradict each other in one of them."""

    verdict: Verdict
    checks: list[QualityCheck]
    not_checked: dict[str, str] = Field(description="checks that were not possible, with the reason")


class TrialQuality(Contract):
    """Quality of one of several recordings."""

    recording_id: str
    filename: str
    quality: Quality
