"""A result's summary as named numbers with units."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from stridelab.schemas.jobs import JobResult
from stridelab_web.words import words


@dataclass(frozen=True)
class Fact:
    """One number of the summary; ``key`` is its name in the interface."""

    key: str
    name: str
    text: str


_UNITS = {"_m_s": "m/s", "_kg": "kg", "_hz": "Hz", "_nm": "N m", "_n": "N", "_s": "s", "_m": "m", "_rad": "rad"}
_NAMES = {
    "window_s": "Window",
    "rate_hz": "Rate",
    "method": "Method",
    "segment_table": "Segment table",
    "mass_kg": "Mass",
    "latency_s": "Force latency",
    "latency_sd_s": "Its standard deviation",
    "latency_applied_s": "Latency corrected",
    "rms_force_residual_n": "Force residual, RMS x, y, z",
    "bias_m": "Fused minus markers x, y, z",
    "speed_m_s": "Speed",
    "n_steps": "Steps",
}
_SHORT = {"_s": (1000, "ms", 1), "_m": (1000, "mm", 1)}
_IN_SHORT_UNITS = {"latency_s", "latency_sd_s", "latency_applied_s", "bias_m"}
_ELSEWHERE = {"warnings", "recording_id"}


def facts_of(result: JobResult) -> list[Fact]:
    """Every number and word of the summary; nested ones by their dotted name."""
    return [
        Fact(key, _NAMES.get(key, words(key.split(".")[-1]).capitalize() if "." not in key else _dotted(key)), text)
        for key, value in _flat(result.summary)
        if (text := _text(key, value)) is not None
    ]


def _flat(summary: Mapping[str, Any], prefix: str = "") -> list[tuple[str, Any]]:
    found: list[tuple[str, Any]] = []
    for key, value in summary.items():
        if key in _ELSEWHERE:
            continue
        if isinstance(value, Mapping):
            found += _flat(value, f"{prefix}{key}.")
        else:
            found.append((f"{prefix}{key}", value))
    return found


def _dotted(key: str) -> str:
    return ": ".join(words(part) for part in key.split(".")).capitalize()


def _text(key: str, value: Any) -> str | None:
    suffix, unit = next(((s, u) for s, u in _UNITS.items() if key.endswith(s)), ("", ""))
    factor, digits = 1.0, 2
    if key in _IN_SHORT_UNITS:
        factor, unit, digits = _SHORT[suffix]
    if value is None:
        return "not known"
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, str):
        return words(value)
    if isinstance(value, int | float):
        return f"{_number(value * factor, digits)} {unit}".strip()
    if isinstance(value, Sequence) and 0 < len(value) <= 6 and all(isinstance(v, int | float) for v in value):
        between = " to " if key == "window_s" else ", "
        return f"{between.join(_number(v * factor, digits) for v in value)} {unit}".strip()
    return None


def _number(value: float, digits: int) -> str:
    if isinstance(value, int):
        return str(value)
    return f"{value:.{digits}f}"
