"""Gait events stored in a file: dialects of their names, contexts, and times counted from the original recording."""

import re
from collections.abc import Sequence

from stridelab.recordings.recording import Event, EventKind, Side

_STRIKE = re.compile(r"strike|contact|touch|\bon\b|^[lr]?(hs|fs|ic|fc)\d*$", re.IGNORECASE)
_OFF = re.compile(r"off|^[lr]?(to|fo)\d*$", re.IGNORECASE)
_SHORT = re.compile(r"^([lr])(hs|fs|ic|fc|to|fo)\d*$", re.IGNORECASE)


def event_kind(label: str) -> EventKind | None:
    """``Foot Strike1``, ``LHS``, ``Heel contact`` -> foot_strike; ``Foot Off``, ``RTO`` -> foot_off; else None."""
    name = label.strip()
    if _OFF.search(name):
        return "foot_off"
    return "foot_strike" if _STRIKE.search(name) else None


def event_side(label: str, context: str) -> Side | None:
    """Side from the context, else from the label (``Left Foot Strike``, ``LHS``)."""
    for text in (context.strip().lower(), label.strip().lower()):
        if text.startswith("left") or text == "l":
            return "left"
        if text.startswith("right") or text == "r":
            return "right"
    short = _SHORT.match(label.strip())
    if short is None:
        return None
    return "left" if short.group(1).lower() == "l" else "right"


def read_events(
    labels: Sequence[str], contexts: Sequence[str], times_s: Sequence[float], first_frame: int, rate_hz: float
) -> tuple[Event, ...]:
    """Foot strikes and foot offs in order of time.

    ``times_s`` count from the start of the original recording, of which frame ``first_frame`` (from 0) is this file's
    first; other events are left out.
    """
    offset_s = first_frame / rate_hz
    events: list[Event] = []
    for i, (label, time_s) in enumerate(zip(labels, times_s, strict=False)):
        kind = event_kind(label)
        if kind is not None:
            context = contexts[i] if i < len(contexts) else ""
            events.append(Event(time_s - offset_s, kind, event_side(label, context)))
    return tuple(sorted(events, key=lambda event: event.time_s))
