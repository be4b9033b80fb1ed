"""Parses the gait events and the subject data of a file.

Event names vary between programs, and their times count from the start of the original recording. The subject's name
is never read; placeholder and implausible values are dropped with a remark.
"""

import math
import re
from collections.abc import Mapping, Sequence

from stridelab.recordings.recording import Event, EventKind, Remark, Sex, Side, Subject

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
    """Foot strikes and foot offs in order of time; other events are ignored.

    ``times_s`` count from the start of the original recording, of which frame ``first_frame`` (from 0) is this file's
    first.
    """
    offset_s = first_frame / rate_hz
    events: list[Event] = []
    for i, (label, time_s) in enumerate(zip(labels, times_s, strict=False)):
        kind = event_kind(label)
        if kind is not None:
            context = contexts[i] if i < len(contexts) else ""
            events.append(Event(time_s - offset_s, kind, event_side(label, context)))
    return tuple(sorted(events, key=lambda event: event.time_s))


HEIGHT_RANGE_M = (0.4, 2.6)
MASS_RANGE_KG = (2.0, 400.0)
WIDTH_RANGE_M = (0.03, 0.25)
WIDTH_JOINTS = ("knee", "ankle", "elbow")
AGE_RANGE_YEARS = (0.5, 98.0)
"""Several programs write 99 years for an unknown age."""


def read_subject(stated: Mapping[str, float]) -> tuple[Subject, tuple[Remark, ...]]:
    """Subject from the file's values: height, mass (or weight, bodymass), age, gender; any case, any unit of length.

    Heights above 3 are read as centimetres (below 300) or millimetres. ``gender`` is 0 for a woman, 1 for a man.
    """
    values = {key.lower().replace(" ", "").replace("_", ""): value for key, value in stated.items()}
    remarks: list[Remark] = []

    def first_valid(names: tuple[str, ...], what: str, limits: tuple[float, float]) -> float | None:
        for name in names:
            value = values.get(name)
            if value is None or math.isnan(value):
                continue
            if what == "height" and value > 3.0:
                value = value / 100.0 if value < 300.0 else value / 1000.0
            if limits[0] <= value <= limits[1]:
                return round(value, 4)
            remarks.append(
                Remark("filler-in-subject", f"The {what} in the file ({value:g}) is no real value; it is not used.")
            )
        return None

    height_m = first_valid(("height", "bodyheight"), "height", HEIGHT_RANGE_M)
    mass_kg = first_valid(("weight", "bodymass", "mass", "bodyweight"), "mass", MASS_RANGE_KG)
    age_years = first_valid(("age",), "age", AGE_RANGE_YEARS)
    gender = values.get("gender", values.get("sex"))
    sex: Sex | None = None
    if gender is not None and gender in (0.0, 1.0):
        sex = "male" if gender == 1.0 else "female"
    return Subject(height_m, mass_kg, sex, age_years), tuple(remarks)


def read_joint_widths_m(stated: Mapping[str, float]) -> dict[str, float]:
    """Calliper widths of a Plug-in Gait file ("LKneeWidth" in mm) as {"l_knee": metres}, without implausible ones."""
    values = {key.lower(): value for key, value in stated.items()}
    widths_m = {
        f"{side}_{joint}": values.get(f"{side}{joint}width", math.nan) / 1000.0
        for side in "lr"
        for joint in WIDTH_JOINTS
    }
    return {name: width for name, width in widths_m.items() if WIDTH_RANGE_M[0] <= width <= WIDTH_RANGE_M[1]}
