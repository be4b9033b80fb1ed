"""Identification of marker sets: map the marker labels of a laboratory to the landmarks of this project.

Among the sets whose ``required`` landmarks are all present, the one that matches the most markers is chosen; none if
another shipped set matches as many and takes a label for another landmark. A user's
``marker_map`` (landmark to label) overrides and completes a set; if less than half of a set matches, a map that names
pelvis and legs is used on its own ("custom").
"""

import itertools
import tomllib
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache
from typing import Final

from stridelab.errors import Fault, InvalidInput
from stridelab.recordings.marker_set_files import (
    LANDMARKS,
    LOCOMOTION,
    MarkerSet,
    absent_landmarks,
    both_sides,
    is_landmark,
    labels_by_form,
    marker_sets,
    normalised_label,
)
from stridelab.recordings.recording import Remark
from stridelab.resources import models_dir

KNEES: Final = ("l_knee_lateral|l_knee_centre", "r_knee_lateral|r_knee_centre")
"""Knee landmarks; without them a static trial that marks the knees is required."""

STATIC_TRIAL_NEEDED: Final = Remark(
    "static-trial-needed",
    "The knees are not marked in this trial: a static trial of the same person that marks them is needed.",
)


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


def identify(
    labels: Sequence[str],
    marker_map: Mapping[str, str] | None = None,
    own_sets: Sequence[MarkerSet] = (),
    *,
    shipped: bool = True,
) -> MarkerSetMatch:
    """Find the marker set that matches ``labels``; ``marker_map`` (landmark to label) overrides it.

    ``own_sets`` are sets of users, the preferred ones first: one of them is chosen unless a shipped set matches more
    markers. Without ``shipped`` only they are considered. Raises ``InvalidInput`` (``marker-map-invalid``) if the map
    names an unknown landmark or a label that is not in the file.
    """
    present = labels_by_form(labels)
    own = _checked_map(marker_map or {}, labels, present)
    sets = [*own_sets, *(marker_sets().values() if shipped else ())]
    labelled = [known.matching_labels(present) for known in sets]
    matched = [landmarks | own for landmarks in labelled]
    fitting = [
        k
        for k, known in enumerate(sets)
        if not absent_landmarks(known.required, matched[k])
        and 2 * len(absent_landmarks(known.required, labelled[k])) <= len(known.required)
    ]
    rivals: tuple[str, ...] = ()
    if fitting:
        n_own = len(own_sets)
        best = max(fitting, key=lambda k: (len(matched[k]), k < n_own, 0 if k < n_own else -len(sets[k].labels)))
        others = [] if best < n_own else [k for k in fitting if k >= n_own]
        rivals = tuple(sets[k].name for k in others if _contradicts(matched[k], matched[best]))
        if not rivals:
            return _match_result(sets[best].name, matched[best])
        rivals = (sets[best].name, *rivals)
    if not absent_landmarks(LOCOMOTION, own):
        return _match_result("custom", own)
    lacking = [absent_landmarks(known.required, matched[k]) for k, known in enumerate(sets)]
    scores = [1.0 - len(lacking[k]) / len(known.required) for k, known in enumerate(sets)]
    nearest = sorted(range(len(sets)), key=lambda k: (scores[k], len(matched[k])), reverse=True)[:3]
    return MarkerSetMatch(
        name=None,
        landmarks=own,
        missing=absent_landmarks(_full_body(), own),
        nearest=tuple((sets[k].name, round(scores[k], 3)) for k in nearest),
        needed={sets[k].name: lacking[k] for k in nearest},
        rivals=rivals,
    )


def substitutes_for(landmarks: Iterable[str]) -> tuple[Substitute, ...]:
    """Substitutes that a recording with only these landmarks needs; a larger gap replaces the smaller ones in it."""
    there = frozenset(landmarks)
    needed = [s for s in all_substitutes().values() if absent_landmarks(s.landmarks, there)]
    codes = {s.code for s in needed}
    return tuple(s for s in needed if not codes & set(s.hidden_by))


@cache
def all_substitutes() -> Mapping[str, Substitute]:
    """All shipped substitutes by code."""
    path = models_dir() / "marker_sets" / "substitutes.toml"
    entries = tomllib.loads(path.read_text(encoding="utf-8"))["substitutes"]
    return {
        code: Substitute(
            code=code,
            message=entry["message"],
            landmarks=both_sides(entry["landmarks"]),
            horizontal_mm=float(entry["horizontal_mm"]),
            vertical_mm=float(entry["vertical_mm"]),
            hidden_by=tuple(entry.get("hidden_by", ())),
        )
        for code, entry in entries.items()
    }


def _match_result(name: str, landmarks: Mapping[str, str]) -> MarkerSetMatch:
    remarks = tuple(substitute.remark for substitute in substitutes_for(landmarks))
    if absent_landmarks(KNEES, landmarks):
        remarks = (STATIC_TRIAL_NEEDED, *remarks)
    return MarkerSetMatch(name, landmarks, missing=absent_landmarks(_full_body(), landmarks), degraded=remarks)


def _contradicts(landmarks: Mapping[str, str], best: Mapping[str, str]) -> bool:
    """Whether as many landmarks are matched as in ``best``, and one of its labels is another anatomical landmark."""
    meaning = {label: name for name, label in best.items() if name in LANDMARKS}
    differs = any(meaning.get(label, name) != name for name, label in landmarks.items() if name in LANDMARKS)
    return len(landmarks) == len(best) and differs


def _full_body() -> tuple[str, ...]:
    return tuple(dict.fromkeys(itertools.chain.from_iterable(s.landmarks for s in all_substitutes().values())))


def _checked_map(marker_map: Mapping[str, str], labels: Sequence[str], present: Mapping[str, str]) -> dict[str, str]:
    exact, faults, checked = set(labels), [], {}
    for landmark, label in marker_map.items():
        actual = label if label in exact else present.get(normalised_label(label))
        if not is_landmark(landmark):
            faults.append(Fault(f"marker_map.{landmark}", f"{landmark!r} is not a landmark this service knows."))
        elif actual is None:
            faults.append(Fault(f"marker_map.{landmark}", f"The file has no marker {label!r}."))
        else:
            checked[landmark] = actual
    if faults:
        raise InvalidInput("marker-map-invalid", "The marker map does not fit this recording.", faults)
    return checked
