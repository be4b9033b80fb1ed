"""Errors of foot strikes and lift-offs, and the calibration of marker events by the events that plates time.

The difference of an event by markers from the same event by plates is

    late = s + r + e,    s ~ N(0, SESSION_SD_S^2), r ~ N(0, RECORDING_SD_S^2), e ~ N(0, own_s^2).

s is the constant of a session (placement of the markers, shoes, habit of the person), r that of a recording, e the
event's own error. The whole stances on plates of a recording and of the other recordings of its session inform s + r,
which is subtracted from the events by markers (``common_difference``). Recordings whose means scatter by more than is
stated count for less (``estimation.random_effects``).

A foot that lands flat or on its forefoot is timed worse, and its constant is not that of a heel strike. Such landings
neither inform nor follow other recordings of the session.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import fsum, hypot, sqrt
from typing import Final, Literal

from stridelab.estimation.random_effects import pool_measurements

EventKind = Literal["strike", "lift_off"]


@dataclass(frozen=True)
class EventError:
    """Standard deviations of one event: ``common_s`` is the same in all events of its kind, ``own_s`` its own."""

    common_s: float
    own_s: float


SESSION_SD_S: Final[Mapping[EventKind, float]] = {"strike": 0.0106, "lift_off": 0.0095}
RECORDING_SD_S: Final = 0.003
MARKER_ERROR: Final[Mapping[EventKind, EventError]] = {
    "strike": EventError(hypot(SESSION_SD_S["strike"], RECORDING_SD_S), 0.005),
    "lift_off": EventError(hypot(SESSION_SD_S["lift_off"], RECORDING_SD_S), 0.0065),
}
"""Errors of events by markers against plates, measured on people.

The common error of a strike is that of laboratories that did not inform its weights; the other sizes are of the sources
that did. ``scripts/make_event_calibration.py`` judges them on others.
"""
FLAT_STRIKE_ERROR: Final = EventError(MARKER_ERROR["strike"].common_s, 0.010)
"""Error of a strike by markers of a foot that lands flat or on its forefoot."""
MAX_SHIFT_S: Final = 0.05
"""Largest difference between plates and markers that shifts other events; larger ones are not of the same instant."""


@dataclass(frozen=True)
class PlateDifference:
    """Time of an event by markers minus that by plates, and the own error of the former in seconds."""

    late_s: float
    own_s: float
    lands_flat: bool = False


EventDifferences = Mapping[EventKind, Sequence[PlateDifference]]
"""Differences of the whole stances on plates of one recording, by kind of event."""


def common_difference(
    kind: EventKind, own: Sequence[PlateDifference], others: Sequence[Sequence[PlateDifference]] = ()
) -> tuple[float, float] | None:
    """How late the marker events of a recording are in common, and the standard deviation of what remains, in seconds.

    ``own`` are the differences of the recording, ``others`` those of each other recording of its session, without
    flat landings. None if no difference is below ``MAX_SHIFT_S``.
    """
    pooled = [mean for mean in map(_weighted_mean, others) if mean is not None]
    of_recording = _weighted_mean(own)
    if of_recording is None and not pooled:
        return None
    shift_s, variance = 0.0, SESSION_SD_S[kind] ** 2 + RECORDING_SD_S**2
    if pooled:
        session = pool_measurements([mean for mean, _ in pooled], [hypot(sd, RECORDING_SD_S) for _, sd in pooled])
        informed = SESSION_SD_S[kind] ** 2 / (SESSION_SD_S[kind] ** 2 + session.sd**2)
        shift_s = informed * session.mean
        variance = informed * session.sd**2 + RECORDING_SD_S**2 + session.excess_sd**2
    if of_recording is not None:
        mean_s, sd_s = of_recording
        informed = variance / (variance + sd_s**2)
        shift_s += informed * (mean_s - shift_s)
        variance *= 1.0 - informed
    return shift_s, sqrt(variance)


def mean_differences(differences: EventDifferences) -> dict[EventKind, list[PlateDifference]]:
    """The differences of a recording that inform its session, of each kind as one: their weighted mean, if any.

    Flat landings do not.
    """
    means = {kind: _weighted_mean([one for one in of if not one.lands_flat]) for kind, of in differences.items()}
    return {kind: [] if mean is None else [PlateDifference(*mean)] for kind, mean in means.items()}


def _weighted_mean(differences: Sequence[PlateDifference]) -> tuple[float, float] | None:
    """Mean of one recording weighted by the own errors, and its standard deviation; None without any to use."""
    used = [one for one in differences if abs(one.late_s) < MAX_SHIFT_S]
    if not used:
        return None
    precision = fsum(one.own_s**-2 for one in used)
    return fsum(one.late_s / one.own_s**2 for one in used) / precision, 1.0 / sqrt(precision)
