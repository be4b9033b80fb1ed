"""Parses the gait events and the subject data of a file.

Event names vary between programs, and their times count from the start of the original recording. The subject's name
is never read; placeholder and implausible values are dropped with a remark.

Recording date of a C3D file, from TRIAL:DATE or a DATE of the manufacturer.

BTS writes TRIAL:DATE as year, month and day. Texts are read in ISO 8601 order only: 05/06/2019 is ambiguous.

Units of length and moment in files, and a plausibility check of the stated unit of length.

``force_plates`` checks the stated unit of moment.

Selects the markers among a file's points: handles prefixes, unlabelled points, duplicates and model outputs.
"""

import math
import re
from collections import defaultdict
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from datetime import date
from typing import Final

import numpy as np

from stridelab.recordings.files.raw import Cloud
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


DATE_PARAMETERS: Final = (
    ("TRIAL", "DATE"),
    ("TRIAL", "RECORDING_DATE"),
    ("TRIAL", "CREATION_DATE"),
    ("MANUFACTURER", "DATE"),
    ("MANUFACTURER", "RECORDING_DATE"),
)
"""Groups and parameters in order of preference."""
FIRST_YEAR: Final = 1970
_ISO = re.compile(r"^(\d{4})[-/.]?(\d{2})[-/.]?(\d{2})(?!\d)")


def recorded_on(texts: Callable[[str, str], Sequence[str]], numbers: Callable[[str, str], Sequence[float]]) -> str:
    """Recording date as ``YYYY-MM-DD``; empty if absent or a placeholder (year 0, month 13).

    ``texts`` and ``numbers`` return the values of a parameter by its group and name, empty if it has none of the kind.
    """
    for group, name in DATE_PARAMETERS:
        for year, month, day in (*_date_in_text(texts(group, name)), *_date_in_numbers(numbers(group, name))):
            try:
                day_recorded = date(year, month, day)
            except (ValueError, OverflowError):
                continue
            if day_recorded.year >= FIRST_YEAR:
                return day_recorded.isoformat()
    return ""


def _date_in_text(texts: Sequence[str]) -> list[tuple[int, int, int]]:
    match = _ISO.match("".join(texts[:1]).strip())
    return [] if match is None else [(int(match[1]), int(match[2]), int(match[3]))]


def _date_in_numbers(numbers: Sequence[float]) -> list[tuple[int, int, int]]:
    if len(numbers) < 3 or not all(float(value).is_integer() for value in numbers[:3]):
        return []
    return [(int(numbers[0]), int(numbers[1]), int(numbers[2]))]


LENGTH_SCALE: Final = {
    "mm": 1e-3,
    "millimeters": 1e-3,
    "millimetres": 1e-3,
    "cm": 1e-2,
    "centimeters": 1e-2,
    "centimetres": 1e-2,
    "m": 1.0,
    "meters": 1.0,
    "metres": 1.0,
    "dm": 0.1,
    "in": 0.0254,
}
MOMENT_SCALE: Final = {"nmm": 1e-3, "nm": 1.0, "ncm": 1e-2, "nmeter": 1.0, "newtonmm": 1e-3}
_BODY_M = (0.3, 3.0)


def length_scale(stated: str, cloud: Cloud) -> tuple[float, tuple[Remark, ...]]:
    """Factor to metres, and a remark if the stated unit is implausible.

    A marker set spans 0.3 to 3 m of the body. If it does not in the stated unit (mm if none is stated) but does in
    another, the other one is used.
    """
    unit = stated.strip().lower()
    scale = LENGTH_SCALE.get(unit, 1e-3)
    extent = _body_extent(cloud)
    if np.isnan(extent) or cloud.shape[1] < 4 or _BODY_M[0] <= extent * scale <= _BODY_M[1]:
        return scale, ()
    other = unit_of_body(cloud)
    if other is not None:
        message = f"The file says its lengths are in {stated or 'no unit'}, but the markers span a body in {other}."
        return LENGTH_SCALE[other], (Remark("unit-corrected", message),)
    return scale, (Remark("unit-implausible", "The markers span no human body in any unit of length."),)


def unit_of_body(cloud: Cloud) -> str | None:
    """Unit among mm, m and cm in which the markers span 0.3 to 3 m; None if there is none, or fewer than 4 markers.

    The three ranges do not overlap.
    """
    extent = _body_extent(cloud)
    fits = [unit for unit in ("mm", "m", "cm") if _BODY_M[0] <= extent * LENGTH_SCALE[unit] <= _BODY_M[1]]
    return fits[0] if fits else None


def moment_scale(stated: str, metres_per_unit: float) -> float:
    """Factor to Nm from the stated unit of moment; if it is unknown, newtons times the file's unit of length."""
    return MOMENT_SCALE.get(stated.lower().replace(".", "").replace("*", "").replace(" ", ""), metres_per_unit)


def _body_extent(cloud: Cloud) -> float:
    """Median over the frames of the longest side of the marker cloud; NaN without frames with at least 4 markers."""
    seen = (~np.isnan(cloud[:, :, 0])).sum(axis=1) >= 4
    if not seen.any():
        return float("nan")
    frames = cloud[seen]
    return float(np.median((np.nanmax(frames, axis=1) - np.nanmin(frames, axis=1)).max(axis=1)))


_NOT_A_POSITION = re.compile(r"(angles?|power|force|moment|grf|index|archheight|ang)(rot)?$", re.IGNORECASE)
_UNLABELLED = re.compile(r"^(\*\d*|[uU]nlabell?ed\W*\d*|)$")
_COMPUTED = re.compile(r"^(centreofmass(floor)?|centerofmass(floor)?|[lr][hkaesw]jc)$", re.IGNORECASE)
_OXFORD_FOOT = re.compile(r"^[LR](AJC|D1M0|(FOF|HDF|HLX)\d|HE1|PROXFF|TIB\d)$")
"""Points that the Oxford Foot Model computes; ``LTIB1`` is one of them only beside its hindfoot frame ``LHDF0``."""
_FRAME_SUFFIXES = ("O", "A", "L", "P")


@dataclass(frozen=True)
class LabelSelection:
    """``column`` maps each selected label to its column in the file; ``outputs`` are those of computed positions."""

    column: dict[str, int]
    outputs: frozenset[str]
    remarks: tuple[Remark, ...]


def without_prefix(label: str) -> str:
    """``Subject:LASI`` -> ``LASI``; the prefix is often a person's name and is never stored."""
    return label.rsplit(":", 1)[-1].strip()


def model_frames(labels: Iterable[str]) -> frozenset[str]:
    """Points of segment frames: four labels that share three letters and end in O, A, L and P (``PELO`` ...)."""
    present = set(labels)
    stems = {label[:-1] for label in present if len(label) == 4 and label.endswith("O")}
    complete = [stem for stem in stems if all(stem + end in present for end in _FRAME_SUFFIXES)]
    return frozenset(stem + end for stem in complete for end in _FRAME_SUFFIXES)


def select_labels(
    labels: Sequence[str], visible: Sequence[int], not_positions: Iterable[str], modelled: Iterable[str]
) -> LabelSelection:
    """Select one column per marker.

    ``visible`` counts the frames in which each point is visible; ``not_positions`` are the names that the file lists as
    angles, powers, forces, moments or scalars, ``modelled`` those that it lists as modelled markers. Of several
    subjects in one file, and of several columns of one name, the one visible in the most frames is used.
    """
    remarks: list[Remark] = []
    listed = {without_prefix(name).lower() for name in not_positions}
    unlabelled = [i for i, label in enumerate(labels) if _UNLABELLED.match(without_prefix(label))]
    dropped = set(unlabelled)
    if unlabelled:
        n = len(unlabelled)
        message = "1 point without a name was left out." if n == 1 else f"{n} points without a name were left out."
        remarks.append(Remark("unlabelled-points", message))
    other = _other_subjects(labels, visible, dropped)
    if other:
        dropped |= other
        remarks.append(
            Remark(
                "several-subjects",
                f"The file has markers of several subjects; the most visible one is used, {len(other)} were left out.",
            )
        )
    column: dict[str, int] = {}
    doubled: set[str] = set()
    for i, label in enumerate(labels):
        name = without_prefix(label)
        if i in dropped or name.lower() in listed or _NOT_A_POSITION.search(name):
            continue
        if name in column:
            doubled.add(name)
            if visible[i] <= visible[column[name]]:
                continue
        column[name] = i
    if doubled:
        names = ", ".join(sorted(doubled))
        remarks.append(Remark("duplicate-labels", f"These labels occur twice; the more visible is used: {names}."))
    computed = {without_prefix(name) for name in modelled} | model_frames(column)
    if {"LHDF0", "RHDF0"} & set(column):
        computed |= {name for name in column if _OXFORD_FOOT.match(name)}
    outputs = frozenset(name for name in column if name in computed or _COMPUTED.match(name))
    return LabelSelection(column, outputs, tuple(remarks))


def _other_subjects(labels: Sequence[str], visible: Sequence[int], dropped: set[int]) -> set[int]:
    """Columns of all prefixes except the most visible one, if they share a marker name with it."""
    columns: dict[str, list[int]] = defaultdict(list)
    names: dict[str, set[str]] = defaultdict(set)
    for i, label in enumerate(labels):
        if ":" in label and i not in dropped:
            prefix = label.rsplit(":", 1)[0]
            columns[prefix].append(i)
            names[prefix].add(without_prefix(label))
    if len(columns) < 2:
        return set()
    seen = {prefix: sum(visible[i] for i in indices) for prefix, indices in columns.items()}
    best = max(seen, key=lambda prefix: seen[prefix])
    return {i for prefix, indices in columns.items() if prefix != best and names[prefix] & names[best] for i in indices}
