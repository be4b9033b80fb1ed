"""A result's summary as sentences, and as named numbers with units."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

from stridelab.schemas.jobs import JobResult
from stridelab.translations.catalogue import gettext, ngettext, translate_sentence
from stridelab_web.formatting import code_words
from stridelab_web.pages.terms.results import result_term
from stridelab_web.pages.terms.term import Term


@dataclass(frozen=True)
class Fact:
    """One number of the summary; ``key`` is its name in the interface."""

    key: str
    name: str
    text: str

    @property
    def explained(self) -> Term | None:
        """What the value means, if that is known."""
        return result_term(self.key)


_UNITS = {
    "_mm": "mm",
    "_nms": "N m s",
    "_m_s": "m/s",
    "_kg": "kg",
    "_hz": "Hz",
    "_nm": "N m",
    "_n": "N",
    "_s": "s",
    "_m": "m",
    "_rad": "rad",
}
"""Unit by the suffix of a key; the first match counts."""
NAMES = {
    "window_s": "Window",
    "method": "Method",
    "segment_table": "Segment table",
    "mass_kg": "Mass",
    "mass_sd_kg": "Standard deviation of the mass",
    "mass_from_force_kg": "Mass from force",
    "mass_source": "Mass taken from",
    "latency_s": "Force latency",
    "latency_sd_s": "Standard deviation of the latency",
    "latency_applied_s": "Latency corrected",
    "latency_source": "Latency taken from",
    "latency_n_trials": "Trials used for the latency",
    "latency_trial_s": "Latency of this trial alone",
    "latency_trial_sd_s": "Standard deviation of this trial's latency",
    "session.latency_excess_s": "Scatter of the latency between the trials",
    "session.mass_kg": "Mass from force, of the session",
    "session.mass_sd_kg": "Standard deviation of the session's mass",
    "session.mass_n_trials": "Trials used for the session's mass",
    "latency_along_s": "Latency along the walk",
    "latency_lateral_s": "Latency across the walk",
    "latency_vertical_s": "Latency, vertical",
    "treadmill.left_m_s": "Belt under the left foot",
    "treadmill.right_m_s": "Belt under the right foot",
    "treadmill.source": "Belt speeds taken from",
    "treadmill.frame": "Frame of the positions",
    "rms_force_residual_n": "Force residual, RMS x, y, z",
    "bias_m": "Fused minus markers x, y, z",
    "rate_hz": "Rate",
    "speed_m_s": "Speed",
    "n_steps": "Steps",
    "diagnostics.marker_mm": "Markers, noise of the CoM",
    "diagnostics.table_varying_mm": "Segment table, varying error",
    "diagnostics.momentum_about_walk_nms": "Angular momentum about the walk",
    "diagnostics.momentum_about_side_nms": "Angular momentum about the side",
    "diagnostics.step_hz": "Steps",
    "diagnostics.speed_m_s": "Walking speed",
    "diagnostics.low_hz": "Low cut-off",
    "diagnostics.high_hz": "High cut-off",
    "diagnostics.normalised_innovations": "Consistency of sensors with the model (1 = as expected)",
    "diagnostics.plate_bias_statistic": "Plate bias statistic",
    "diagnostics.samples_used": "Samples used",
    "observability.rank_force": "Rank of the observability from the force (of 9)",
    "observability.rank_with_geometry": "Rank of the observability with the markers (of 12)",
    "observability.unobservable": "Unobservable direction x, y, z",
    "observability.tilt_rad": "Largest angle of the force to the vertical",
    "observability.turn_rad": "Largest angle of the force to its mean",
    "observability.flight_s": "In flight",
}
"""Names of the usual values, in the order in which they are shown; others follow under their keys."""
VALUES: Final = (
    "smoother",
    "complementary",
    "rts",
    "kalman",
    "geometry",
    "session",
    "trial",
    "stated",
    "file",
    "force",
)
"""Usual values that are words."""
_IN_THOUSANDTHS = {
    **dict.fromkeys(("latency_s", "latency_sd_s", "latency_applied_s"), "ms"),
    **dict.fromkeys(("latency_along_s", "latency_lateral_s", "latency_vertical_s"), "ms"),
    **dict.fromkeys(("latency_trial_s", "latency_trial_sd_s", "session.latency_excess_s"), "ms"),
    "bias_m": "mm",
}
_COUNTS = {"diagnostics.samples_used"}
_ELSEWHERE = {"warnings", "quality", "recording_id", "sd_m", "observability.sentence", "walking_direction"} | {
    f"session.{name}" for name in ("session_id", "latency_s", "latency_sd_s", "latency_n_trials", "static_recording_id")
}
_OMITTED_IF_NULL = {"treadmill"}
"""Values that most recordings do not have."""
MAX_LIST_LENGTH = 6


_MAIN_FACTS: Final = frozenset({"window_s", "method", "mass_kg", "latency_applied_s", "bias_m", "rms_force_residual_n"})
"""Values of ``estimate-com`` that stay visible; the others are folded."""
_QUANTILE_95: Final = 1.96
_ALONG_AN_AXIS: Final = 0.97
"""Cosine of the largest angle, 14 degrees, between a walk and the axis whose error is called that ahead."""


def main_and_other_facts(result: JobResult, facts: Sequence[Fact]) -> tuple[list[Fact], list[Fact]]:
    """The values that a result shows at once, and those behind a fold: all are shown at once unless it has a band."""
    if not result.summary.get("sd_m"):
        return list(facts), []
    main = [fact for fact in facts if fact.key in _MAIN_FACTS]
    return main, [fact for fact in facts if fact.key not in _MAIN_FACTS]


def headline_of(result: JobResult) -> str | None:
    """How well the centre of mass is known, as one sentence; None for results without a band."""
    sd_m = result.summary.get("sd_m")
    if not sd_m:
        return None
    x, y, z = (f"{1000 * _QUANTILE_95 * value:.0f} mm" for value in sd_m)
    direction = result.summary.get("walking_direction")
    if direction is not None and max(map(abs, direction)) >= _ALONG_AN_AXIS:
        along, across = (x, y) if abs(direction[0]) >= _ALONG_AN_AXIS else (y, x)
        return gettext(
            "Centre of mass known to ±%(along)s ahead, ±%(across)s sideways and ±%(z)s in height (95 %%).",
            along=along,
            across=across,
            z=z,
        )
    return gettext(
        "Centre of mass known to ±%(x)s along x, ±%(y)s along y and ±%(z)s in height (95 %%).", x=x, y=y, z=z
    )


def sentences_of(result: JobResult) -> list[str]:
    """The main sentences of a result: what the recording cannot determine, and the latency of its force."""
    summary = result.summary
    observability = summary.get("observability")
    sentence = observability.get("sentence") if isinstance(observability, Mapping) else None
    sentences = [translate_sentence(sentence) or sentence] if isinstance(sentence, str) and sentence else []
    if summary.get("latency_s") is not None:
        trials = summary.get("latency_n_trials", 1) if summary.get("latency_source") == "session" else None
        applied_s = summary.get("latency_applied_s", 0.0)
        sentences.append(_latency_sentence(summary["latency_s"], summary.get("latency_sd_s"), applied_s, trials))
    return sentences


def _latency_sentence(latency_s: float, sd_s: float | None, applied_s: float, trials: int | None) -> str:
    late_ms = f"{1000 * abs(latency_s):.1f}" + ("" if sd_s is None else f" ± {1000 * sd_s:.1f}")
    if latency_s >= 0:
        difference = gettext("The force comes %(late_ms)s ms later than the markers", late_ms=late_ms)
    else:
        difference = gettext("The force comes %(early_ms)s ms earlier than the markers", early_ms=late_ms)
    if trials is not None:
        difference += ngettext(
            ", as %(num)s trial of its session says", ", as %(num)s trials of its session say", trials
        )
    if applied_s == 0.0:
        correction = gettext("this was not corrected")
    elif abs(applied_s - latency_s) < 1e-9:
        correction = gettext("this was corrected")
    else:
        correction = gettext("%(shift_ms)s ms were corrected, as requested", shift_ms=f"{1000 * applied_s:z.1f}")
    return gettext("%(difference)s; %(correction)s.", difference=difference, correction=correction)


def facts_of(result: JobResult) -> list[Fact]:
    """All values of the summary; nested ones by their dotted key."""
    order = list(NAMES)
    flat = sorted(_flatten(result.summary), key=lambda item: order.index(item[0]) if item[0] in NAMES else len(order))
    named = ((key, _fact_name(key), _fact_text(key, value)) for key, value in flat)
    return [Fact(key, name, text) for key, name, text in named if text is not None]


def _flatten(summary: Mapping[str, Any], prefix: str = "") -> list[tuple[str, Any]]:
    items: list[tuple[str, Any]] = []
    for key, value in summary.items():
        if f"{prefix}{key}" in _ELSEWHERE or (value is None and key in _OMITTED_IF_NULL):
            continue
        if isinstance(value, Mapping):
            items += _flatten(value, f"{prefix}{key}.")
        else:
            items.append((f"{prefix}{key}", value))
    return items


def _fact_name(key: str) -> str:
    bare = key.removesuffix(_unit_suffix(key))
    if key in NAMES:
        return gettext(NAMES[key])
    return ": ".join(code_words(part) for part in bare.split(".")).capitalize()


def _unit_suffix(key: str) -> str:
    return next((suffix for suffix in _UNITS if key.endswith(suffix)), "")


def _fact_text(key: str, value: Any) -> str | None:
    """The value with its unit, or None for what is not a number, a word or a short list of numbers."""
    unit = _IN_THOUSANDTHS.get(key) or _UNITS.get(_unit_suffix(key), "")
    if value is None:
        return gettext("not known")
    if isinstance(value, bool):
        return gettext("yes") if value else gettext("no")
    if isinstance(value, str):
        return gettext(code_words(value))
    values = [value] if isinstance(value, int | float) else value
    if not isinstance(values, Sequence) or not 0 < len(values) <= MAX_LIST_LENGTH:
        return None
    if not all(isinstance(v, int | float) for v in values):
        return None
    between = gettext(" to ") if key == "window_s" else ", "
    return f"{between.join(_number_text(key, v) for v in values)} {unit}".strip()


def _number_text(key: str, value: float) -> str:
    if key in _IN_THOUSANDTHS:
        return f"{1000 * value:z.1f}"
    return f"{value:.0f}" if isinstance(value, int) or key in _COUNTS else f"{value:z.2f}"
