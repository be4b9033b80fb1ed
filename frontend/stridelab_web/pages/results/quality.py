"""Agreement of the sensors of a recording, as the pages show it above any number."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Final

from stridelab.schemas.quality import Quality, QualityCheck, check_value_text
from stridelab.translations.catalogue import ENGLISH, current_language, gettext

NAMES: Final[Mapping[str, str]] = {
    "force_tilt": "Tilt of the mean force from the vertical",
    "normalised_innovations": "Consistency of sensors with the model (1 = as expected)",
    "force_residual": "Force residual of the result",
    "acceleration_difference": "Force residual of the markers alone",
    "channel_gain": "Gain of a force channel from 1 (1 = half or twice the force)",
    "channel_exchange": "Fit of the horizontal channels exchanged, over their fit as they are",
    "horizontal_bias": "Fused from markers, horizontally",
    "vertical_bias": "Fused from markers, vertically",
    "largest_difference": "Fused from markers, at any one time",
    "mass_from_motion": "Mass, from force and motion",
    "mass_from_standing": "Mass, from the static trial",
    "mass_uncertainty": "Standard deviation of the mass",
    "flight_acceleration": "Acceleration in flight from that of gravity",
    "pressure_from_feet": "Centre of pressure from the feet",
    "pressure_off_plate": "Centre of pressure off its plate",
    "force_clipped": "Time at which a plate is overloaded",
    "body_axis": "Axis of the body from the vertical",
    "outside_body": "Centre of mass outside the body",
    "leg_length_change": "Change of a leg's length",
    "body_proportions": "Thigh over trunk, from a person's (logarithm)",
    "proposed_names": "Marker names that are not checked (1 = yes)",
    "model_leg_mass": "Legs' share of the model's mass, from a person's",
}
TITLES: Final[Mapping[str, str]] = {
    "good": "The sensors agree",
    "doubtful": "Not every check passes",
    "contradicted": "The sensors contradict each other: do not use these numbers",
}
VERDICTS: Final = ("good", "doubtful", "contradicted")
"""The verdicts as words in a table."""


@dataclass(frozen=True)
class Row:
    """One check as text; ``mark`` is "" where it passes, "doubtful" or "contradicted" where it does not."""

    key: str
    name: str
    value: str
    limit: str
    mark: str
    message: str


@dataclass(frozen=True)
class ShownQuality:
    """The verdict with its title, the reasons against the result, all checks, and those that were not possible."""

    verdict: str
    title: str
    reasons: tuple[str, ...]
    rows: tuple[Row, ...]
    not_checked: tuple[tuple[str, str], ...]


def shown_quality(summary: Mapping[str, Any]) -> ShownQuality | None:
    """The quality of a result; None for results without a recording, and of versions without checks."""
    if summary.get("quality") is None:
        return None
    quality = Quality.model_validate(summary["quality"])
    rows = tuple(_check_row(check) for check in quality.checks)
    return ShownQuality(
        verdict=quality.verdict,
        title=gettext(TITLES[quality.verdict]),
        reasons=tuple(row.message for mark in ("contradicted", "doubtful") for row in rows if row.mark == mark),
        rows=rows,
        not_checked=tuple((gettext(NAMES.get(name, name)), why) for name, why in quality.not_checked.items()),
    )


def _check_row(check: QualityCheck) -> Row:
    mark = "" if check.passed else "contradicted" if check.value > check.contradicted_above else "doubtful"
    name = gettext(NAMES.get(check.name, check.name))
    value, limit = check_value_text(check, check.value), check_value_text(check, check.limit)
    return Row(check.name, name, value, limit, mark, _finding(check, name, value, limit))


def _finding(check: QualityCheck, name: str, value: str, limit: str) -> str:
    """The sentence of the service; in other languages than its own, the check with its value and its limit."""
    if current_language() == ENGLISH:
        return check.message
    return gettext("%(check)s: %(value)s, at most %(limit)s expected.", check=name, value=value, limit=limit)
