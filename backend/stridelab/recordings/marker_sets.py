"""Marker sets: map the marker labels of a laboratory to the landmarks of this project.

A set is a file in ``models/marker_sets/`` that lists the possible labels of each landmark; ``{s}`` stands for the side
letter. Labels match regardless of case, spaces, dots, underscores and hyphens, and without a prefix up to the last
colon (``Subject:LASI``); ``sides`` names other side words than l and r. Among the sets whose ``required`` landmarks are
all present, the one that matches the most markers is chosen, none if another one matches as many and takes a label for
another landmark. A user's ``marker_map`` (landmark to label) overrides and completes a set; if less than half of a set
matches, a map that names pelvis and legs is used on its own ("custom").

Landmarks are named ``asis``, ``knee_lateral``, ...; paired ones carry ``l_`` or ``r_``. Technical markers of a rigid
cluster are ``<segment>_t1``, ``<segment>_t2``, ...
"""

import itertools
import re
import tomllib
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache
from typing import Any, Final

from stridelab.errors import Fault, InvalidInput
from stridelab.recordings.recording import Remark
from stridelab.resources import models_dir

PAIRED: Final = (
    *("asis", "psis", "trochanter", "knee_lateral", "knee_medial", "fibula_head", "tibial_tuberosity"),
    *("ankle_lateral", "ankle_medial", "heel", "mt1", "mt2", "mt5", "toe", "clavicle", "acromion"),
    *("elbow_lateral", "elbow_medial", "wrist_radial", "wrist_ulnar", "mc2", "mc5"),
    *("head_front", "head_back", "head_side"),
    *("hip_centre", "knee_centre", "ankle_centre", "shoulder_centre", "elbow_centre", "wrist_centre"),
)
"""Landmarks that exist on both sides."""

UNPAIRED: Final = ("sacrum", "c7", "t8", "t10", "t12", "jugular_notch", "xiphoid", "head_top")
"""Landmarks in the median plane."""

LANDMARKS: Final = frozenset({*UNPAIRED, *(f"{side}_{name}" for side in "lr" for name in PAIRED)})
"""All anatomical landmarks that a set or a user's map may name."""

_TECHNICAL: Final = re.compile(r"([lr]_)?(head|trunk|pelvis|upper_arm|forearm|thigh|shank|foot)_t\d")
_LOCOMOTION: Final = (
    *("l_asis|l_hip_centre", "r_asis|r_hip_centre", "l_psis|sacrum|l_hip_centre", "r_psis|sacrum|r_hip_centre"),
    *("l_knee_lateral|l_knee_centre", "r_knee_lateral|r_knee_centre"),
    *("l_ankle_lateral|l_ankle_centre", "r_ankle_lateral|r_ankle_centre"),
)
"""Landmarks that a user's map must name to be used as a set of its own."""
KNEES: Final = ("l_knee_lateral|l_knee_centre", "r_knee_lateral|r_knee_centre")
"""Knee landmarks; without them a static trial that marks the knees is required."""

STATIC_TRIAL_NEEDED: Final = Remark(
    "static-trial-needed",
    "The knees are not marked in this trial: a static trial of the same person that marks them is needed.",
)


@dataclass(frozen=True)
class MarkerSet:
    """One marker set: the possible labels of each landmark, and the landmarks that must be present.

    An entry of ``required`` may list alternatives separated by ``|``.
    """

    name: str
    title: str
    labels: Mapping[str, tuple[str, ...]]
    required: tuple[str, ...]


@dataclass(frozen=True)
class Substitute:
    """Substitute for missing landmarks, with the error it adds to the whole-body CoM in millimetres.

    It applies to a recording that has none of the alternatives of an entry of ``landmarks``.
    """

    code: str
    message: str
    landmarks: tuple[str, ...]
    horizontal_mm: float
    vertical_mm: float
    hidden_by: tuple[str, ...] = ()

    @property
    def remark(self) -> Remark:
        """Remark for the user, including the added error."""
        cost = f"costs about {self.horizontal_mm:g} mm horizontally and {self.vertical_mm:g} mm vertically"
        return Remark(self.code, f"{self.message} ({cost}).")


@dataclass(frozen=True)
class MarkerSetMatch:
    """Result of ``identify``.

    ``landmarks`` maps a landmark to its label in the file. ``missing`` lists absent landmarks of a complete full-body
    set. ``nearest``, if no set matches, names the closest sets with the share of their required landmarks that are
    present; ``needed`` lists their absent required landmarks. ``degraded`` describes the substitutes and their errors.
    ``rivals`` are sets that match equally well and take a label for different landmarks.
    """

    name: str | None
    landmarks: Mapping[str, str]
    missing: tuple[str, ...] = ()
    nearest: tuple[tuple[str, float], ...] = ()
    degraded: tuple[Remark, ...] = ()
    needed: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    rivals: tuple[str, ...] = ()


def identify(labels: Sequence[str], marker_map: Mapping[str, str] | None = None) -> MarkerSetMatch:
    """Find the marker set that matches ``labels``; ``marker_map`` (landmark to label) overrides it.

    Raises ``InvalidInput`` (``marker-map-invalid``) if the map names an unknown landmark or a label that is not in the
    file.
    """
    present: dict[str, str] = {}
    for label in labels:
        present.setdefault(normalised_label(label), label)
    own = _checked_map(marker_map or {}, labels, present)
    labelled = {known.name: _matching_labels(known, present) for known in marker_sets().values()}
    matched = {name: landmarks | own for name, landmarks in labelled.items()}
    fitting = [
        s
        for s in marker_sets().values()
        if not _absent_landmarks(s.required, matched[s.name])
        and 2 * len(_absent_landmarks(s.required, labelled[s.name])) <= len(s.required)
    ]
    rivals: tuple[str, ...] = ()
    if fitting:
        best = max(fitting, key=lambda s: (len(matched[s.name]), -len(s.labels)))
        rivals = tuple(s.name for s in fitting if _contradicts(matched[s.name], matched[best.name]))
        if not rivals:
            return _match_result(best.name, matched[best.name])
        rivals = (best.name, *rivals)
    if not _absent_landmarks(_LOCOMOTION, own):
        return _match_result("custom", own)
    lacking = {s.name: _absent_landmarks(s.required, matched[s.name]) for s in marker_sets().values()}
    scores = {s.name: 1.0 - len(lacking[s.name]) / len(s.required) for s in marker_sets().values()}
    nearest = sorted(scores, key=lambda name: (scores[name], len(matched[name])), reverse=True)[:3]
    return MarkerSetMatch(
        name=None,
        landmarks=own,
        missing=_absent_landmarks(_full_body(), own),
        nearest=tuple((name, round(scores[name], 3)) for name in nearest),
        needed={name: lacking[name] for name in nearest},
        rivals=rivals,
    )


def normalised_label(label: str) -> str:
    """Normal form of a label for comparison: no prefix, no separators, lower case."""
    return re.sub(r"[\s._\-]", "", label.rsplit(":", 1)[-1]).lower()


def substitutes_for(landmarks: Iterable[str]) -> tuple[Substitute, ...]:
    """Substitutes that a recording with only these landmarks needs; a larger gap replaces the smaller ones in it."""
    there = frozenset(landmarks)
    needed = [s for s in all_substitutes().values() if _absent_landmarks(s.landmarks, there)]
    codes = {s.code for s in needed}
    return tuple(s for s in needed if not codes & set(s.hidden_by))


@cache
def marker_sets() -> Mapping[str, MarkerSet]:
    """All shipped sets by name."""
    files = sorted((models_dir() / "marker_sets").glob("*.toml"))
    sets = [
        parse_marker_set(tomllib.loads(path.read_text(encoding="utf-8")))
        for path in files
        if path.stem != "substitutes"
    ]
    return {known.name: known for known in sets}


@cache
def all_substitutes() -> Mapping[str, Substitute]:
    """All shipped substitutes by code."""
    path = models_dir() / "marker_sets" / "substitutes.toml"
    entries = tomllib.loads(path.read_text(encoding="utf-8"))["substitutes"]
    return {
        code: Substitute(
            code=code,
            message=entry["message"],
            landmarks=_both_sides(entry["landmarks"]),
            horizontal_mm=float(entry["horizontal_mm"]),
            vertical_mm=float(entry["vertical_mm"]),
            hidden_by=tuple(entry.get("hidden_by", ())),
        )
        for code, entry in entries.items()
    }


def parse_marker_set(data: Mapping[str, Any]) -> MarkerSet:
    """Validate the content of one set file; raises ``InvalidInput`` (``marker-set-invalid``) for an invalid entry."""
    labels: dict[str, tuple[str, ...]] = {}
    left, right = data.get("sides", ("l", "r"))
    for landmark, patterns in {**data.get("unpaired", {}), **data.get("paired", {})}.items():
        sides = {"l": left, "r": right} if landmark in data.get("paired", {}) else {"": ""}
        for side, written in sides.items():
            name = f"{side}_{landmark}" if side else landmark
            if name not in LANDMARKS and not _TECHNICAL.fullmatch(name):
                raise InvalidInput("marker-set-invalid", f"{data['name']}: {name!r} is not a landmark.")
            labels[name] = tuple(normalised_label(pattern.replace("{s}", written)) for pattern in patterns)
    required = _both_sides(data["required"])
    unknown = [entry for entry in required if not set(entry.split("|")) <= set(labels)]
    if unknown or not required:
        raise InvalidInput("marker-set-invalid", f"{data['name']} requires what it does not label: {unknown}.")
    return MarkerSet(data["name"], data["title"], labels, required)


def _match_result(name: str, landmarks: Mapping[str, str]) -> MarkerSetMatch:
    remarks = tuple(substitute.remark for substitute in substitutes_for(landmarks))
    if _absent_landmarks(KNEES, landmarks):
        remarks = (STATIC_TRIAL_NEEDED, *remarks)
    return MarkerSetMatch(name, landmarks, missing=_absent_landmarks(_full_body(), landmarks), degraded=remarks)


def _matching_labels(known: MarkerSet, present: Mapping[str, str]) -> dict[str, str]:
    hits = ((landmark, next((n for n in names if n in present), None)) for landmark, names in known.labels.items())
    return {landmark: present[name] for landmark, name in hits if name is not None}


def _contradicts(landmarks: Mapping[str, str], best: Mapping[str, str]) -> bool:
    """Whether as many landmarks are matched as in ``best``, and one of its labels is another anatomical landmark."""
    meaning = {label: name for name, label in best.items() if name in LANDMARKS}
    differs = any(meaning.get(label, name) != name for name, label in landmarks.items() if name in LANDMARKS)
    return len(landmarks) == len(best) and differs


def _absent_landmarks(required: Iterable[str], landmarks: Iterable[str]) -> tuple[str, ...]:
    there = frozenset(landmarks)
    return tuple(entry for entry in required if not there & set(entry.split("|")))


def _full_body() -> tuple[str, ...]:
    return tuple(dict.fromkeys(itertools.chain.from_iterable(s.landmarks for s in all_substitutes().values())))


def _both_sides(entries: Iterable[str]) -> tuple[str, ...]:
    """Expand ``*_name`` to both sides."""
    return tuple(entry.replace("*", side) for entry in entries for side in ("lr" if "*" in entry else "l"))


def _checked_map(marker_map: Mapping[str, str], labels: Sequence[str], present: Mapping[str, str]) -> dict[str, str]:
    exact, faults, checked = set(labels), [], {}
    for landmark, label in marker_map.items():
        actual = label if label in exact else present.get(normalised_label(label))
        if landmark not in LANDMARKS and not _TECHNICAL.fullmatch(landmark):
            faults.append(Fault(f"marker_map.{landmark}", f"{landmark!r} is not a landmark this service knows."))
        elif actual is None:
            faults.append(Fault(f"marker_map.{landmark}", f"The file has no marker {label!r}."))
        else:
            checked[landmark] = actual
    if faults:
        raise InvalidInput("marker-map-invalid", "The marker map does not fit this recording.", faults)
    return checked
