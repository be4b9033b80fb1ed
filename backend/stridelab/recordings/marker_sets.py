"""Identification of marker sets: map the marker labels of a laboratory to the landmarks of this project.

Among the sets whose ``required`` landmarks are all present, the one that matches the most markers is chosen; none if
another shipped set matches as many and takes a label for another landmark. Labels of trunk, head and arms that a
shipped set does not know are read as the sets that know them do, where these agree (``common_labels``). A user's
``marker_map`` (landmark to label) overrides and completes a set; if less than half of a set matches, a map that names
pelvis and legs is used on its own ("custom").

Marker set files: the possible labels of each landmark, read from a file or a request and validated.

Imports no numeric package. ``{s}`` in a label stands for the side letter, or for the words of ``sides``. Labels match
regardless of case, spaces, dots, underscores and hyphens, and without a prefix (``Subject:LASI``, ``MarkerSet__LASI``).

Landmarks are named ``asis``, ``knee_lateral``, ...; paired ones carry ``l_`` or ``r_``. Technical markers of a rigid
cluster are ``<segment>_t1``, ``<segment>_t2``, ...
"""

import itertools
import re
import tomllib
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache, lru_cache
from pathlib import Path
from typing import Any, Final

from stridelab.errors import Fault, InvalidInput, UnreadableFile
from stridelab.machine.models_folder import models_dir
from stridelab.recordings.remark import Remark

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

LOCOMOTION: Final = (
    *("l_asis|l_hip_centre", "r_asis|r_hip_centre", "l_psis|sacrum|l_hip_centre", "r_psis|sacrum|r_hip_centre"),
    *("l_knee_lateral|l_knee_centre", "r_knee_lateral|r_knee_centre"),
    *("l_ankle_lateral|l_ankle_centre", "r_ankle_lateral|r_ankle_centre"),
)
"""Landmarks of pelvis and legs: required of a user's map, and of a user's set that requires nothing else."""

PROPOSED: Final = "proposed"  # the name of a set that ``propose_marker_set`` made for one recording
WAYS_TO_NAME_MARKERS: Final = (
    "Name the markers on the page of the recording, with --marker or the field marker_map, or store a marker set for "
    "all recordings with these labels (--marker-set FILE, POST /marker-sets)."
)
"""What a user can do about an unknown marker set."""

_UPPER_BODY: Final = ("acromion", "shoulder", "elbow", "wrist", "mc", "upper_arm", "head", "trunk", "c7", "t1", "jug")
_AGREEING_SETS: Final = 3
_TECHNICAL: Final = re.compile(r"([lr]_)?(head|trunk|pelvis|upper_arm|forearm|thigh|shank|foot)_t\d")
_PREFIX: Final = re.compile(r"^(.*(:|[A-Za-z]__))?(\s*\d+\s+-\s+)?")  # Motive exports a colon as two underscores
_FIELDS: Final = frozenset({"name", "title", "required", "paired", "unpaired", "sides"})
_MAX_FILE_BYTES: Final = 200_000


@dataclass(frozen=True)
class MarkerSet:
    """One marker set: the possible labels of each landmark, normalised, and the landmarks that must be present.

    An entry of ``required`` may list alternatives separated by ``|``.
    """

    name: str
    title: str
    labels: Mapping[str, tuple[str, ...]]
    required: tuple[str, ...]

    def matching_labels(self, present: Mapping[str, str]) -> dict[str, str]:
        """Label of each landmark that is present; ``present`` maps normalised labels to labels (``labels_by_form``)."""
        hits = ((landmark, next((n for n in names if n in present), None)) for landmark, names in self.labels.items())
        return {landmark: present[name] for landmark, name in hits if name is not None}


@lru_cache(maxsize=8192)
def normalised_label(label: str) -> str:
    """Normal form of a label for comparison: no prefix, no number before it ("3 - "), no separators, lower case."""
    return re.sub(r"[\s._\-]", "", _PREFIX.sub("", label)).lower()


def labels_by_form(labels: Iterable[str]) -> dict[str, str]:
    """The labels by their normal form; of equal ones the first."""
    present: dict[str, str] = {}
    for label in labels:
        present.setdefault(normalised_label(label), label)
    return present


def is_landmark(name: str) -> bool:
    """Whether ``name`` is an anatomical landmark or a technical marker of a segment."""
    return name in LANDMARKS or _TECHNICAL.fullmatch(name) is not None


def absent_landmarks(required: Iterable[str], landmarks: Iterable[str]) -> tuple[str, ...]:
    """Entries of ``required``, each with alternatives separated by ``|``, that ``landmarks`` do not satisfy."""
    there = frozenset(landmarks)
    return tuple(entry for entry in required if not there & set(entry.split("|")))


def both_sides(entries: Iterable[str]) -> tuple[str, ...]:
    """Expand ``*_name`` to both sides."""
    return tuple(entry.replace("*", side) for entry in entries for side in ("lr" if "*" in entry else "l"))


@cache
def marker_sets() -> Mapping[str, MarkerSet]:
    """All shipped sets by name."""
    files = sorted((models_dir() / "marker_sets").glob("*.toml"))
    sets = [read_marker_set(path) for path in files if path.stem != "substitutes"]
    return {known.name: known for known in sets}


@cache
def common_labels() -> Mapping[str, str]:
    """Landmark by normalised label of trunk, head or arms that at least three shipped sets read, and all alike.

    STRN is none: the xiphoid process to some laboratories, the jugular notch to others.
    """
    readings: dict[str, list[str]] = {}
    for landmark, labels in (entry for known in marker_sets().values() for entry in known.labels.items()):
        for label in labels:
            readings.setdefault(label, []).append(landmark)
    alike = {label: read[0] for label, read in readings.items() if read.count(read[0]) == len(read) >= _AGREEING_SETS}
    return {label: name for label, name in alike.items() if re.sub("^[lr]_", "", name).startswith(_UPPER_BODY)}


def read_marker_set(path: Path) -> MarkerSet:
    """Read a marker set file (TOML, as in ``models/marker_sets``).

    Raises ``UnreadableFile`` (``file-not-readable``, ``marker-set-not-toml``) and as ``parse_marker_set``.
    """
    try:
        with path.open("rb") as file:
            content = file.read(_MAX_FILE_BYTES + 1)
    except OSError as error:
        why = error.strerror or "not readable"
        raise UnreadableFile("file-not-readable", f"Cannot read {path}: {why}.", [Fault(str(path), why)]) from error
    try:
        if len(content) > _MAX_FILE_BYTES:
            raise ValueError(f"larger than {_MAX_FILE_BYTES // 1000} kB")
        data = tomllib.loads(content.decode("utf-8-sig"))
    except ValueError as error:  # of TOML, or of its encoding
        message = f"The marker set file {path.name} is not a TOML file: {error}."
        raise UnreadableFile("marker-set-not-toml", message, [Fault(path.name, str(error))]) from error
    return parse_marker_set(data, path.name)


def parse_marker_set(data: Mapping[str, Any], where: str) -> MarkerSet:
    """Validate the content of one set file; ``where`` names the file in messages.

    Raises ``InvalidInput`` (``marker-set-invalid``) with one fault per invalid entry.
    """
    faults = [Fault(key, f"not a field of a marker set; there are: {', '.join(sorted(_FIELDS))}") for key in
              sorted(set(data) - _FIELDS)]  # fmt: skip
    name, title, required = data.get("name", ""), data.get("title", ""), data.get("required", [])
    if not isinstance(name, str) or not name.strip():
        faults.append(Fault("name", "a name in quotes is missing"))
    if not isinstance(title, str):
        faults.append(Fault("title", "not a text"))
    if not _is_list_of_texts(required):
        faults.append(Fault("required", "not a list of landmarks"))
    landmarks: dict[str, Sequence[str]] = {}
    side_words = data.get("sides", ["l", "r"])
    if not _is_list_of_texts(side_words) or len(side_words) != 2:
        faults.append(Fault("sides", "not two texts, those of left and right"))
        side_words = ["l", "r"]
    for table, sides in (("unpaired", {"": ""}), ("paired", dict(zip(("l_", "r_"), side_words, strict=True)))):
        entries = data.get(table, {})
        if not isinstance(entries, Mapping):
            faults.append(Fault(table, "not a table of landmarks"))
            continue
        for landmark, labels in entries.items():
            if not _is_list_of_texts(labels):
                faults.append(Fault(f"{table}.{landmark}", "not a list of labels in quotes"))
                continue
            for side, word in sides.items():
                landmarks[side + landmark] = [label.replace("{s}", word) for label in labels]
    if faults:
        raise _invalid_set(where, faults)
    return marker_set_of_labels(name.strip(), landmarks, both_sides(required), title=title, where=where)


def marker_set_of_labels(
    name: str,
    landmarks: Mapping[str, Sequence[str]],
    required: Iterable[str] = (),
    *,
    title: str = "",
    where: str | None = None,
) -> MarkerSet:
    """A marker set from the possible labels of each landmark; ``where`` (default: the name) is used in messages.

    Without ``required``, pelvis, knees and ankles are (``LOCOMOTION``). Raises ``InvalidInput``
    (``marker-set-invalid``) naming each unknown landmark, empty or repeated label, and required landmark without one.
    """
    faults: list[Fault] = []
    landmark_of: dict[str, str] = {}
    for landmark, labels in landmarks.items():
        if not is_landmark(landmark):
            faults.append(Fault(f"landmarks.{landmark}", f"{landmark!r} is not a landmark"))
        if not labels:
            faults.append(Fault(f"landmarks.{landmark}", "has no label"))
        for label in labels:
            other = landmark_of.setdefault(normalised_label(label), landmark)
            if not normalised_label(label):
                faults.append(Fault(f"landmarks.{landmark}", f"the label {label!r} is empty"))
            elif other != landmark:
                faults.append(Fault(f"landmarks.{landmark}", f"the label {label!r} already stands for {other}"))
    needed = tuple(required) or LOCOMOTION
    for entry in needed:
        unknown = [name for name in entry.split("|") if not is_landmark(name)]
        if unknown:
            faults.append(Fault("required", f"{unknown[0]!r} is not a landmark"))
        elif not set(entry.split("|")) & set(landmarks):
            faults.append(Fault("required", f"no label is given for {entry.replace('|', ' or ')}, which is required"))
    if faults:
        raise _invalid_set(where or name, faults)
    forms = {landmark: tuple(dict.fromkeys(map(normalised_label, labels))) for landmark, labels in landmarks.items()}
    return MarkerSet(name, title or name, forms, needed)


def _invalid_set(where: str, faults: Sequence[Fault]) -> InvalidInput:
    listed = "; ".join(f"{fault.where}: {fault.message}" for fault in faults[:3])
    more = f"; and {len(faults) - 3} more" if len(faults) > 3 else ""
    return InvalidInput("marker-set-invalid", f"The marker set {where} is not valid: {listed}{more}.", faults)


def _is_list_of_texts(value: object) -> bool:
    return isinstance(value, list) and all(isinstance(item, str) for item in value)


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
            unread = {form: label for form, label in present.items() if label not in matched[best].values()}
            common = {} if best < n_own else {common_labels().get(form, ""): unread[form] for form in unread}
            common.pop("", None)
            return match_of_landmarks(sets[best].name, common | matched[best])
        rivals = (sets[best].name, *rivals)
    if not absent_landmarks(LOCOMOTION, own):
        return match_of_landmarks("custom", own)
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


def match_of_landmarks(name: str, landmarks: Mapping[str, str], remarks: tuple[Remark, ...] = ()) -> MarkerSetMatch:
    """The match of a set that names ``landmarks``; ``remarks`` come before those of the substitutes."""
    remarks = (*remarks, *(substitute.remark for substitute in substitutes_for(landmarks)))
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
