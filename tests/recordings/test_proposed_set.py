"""Sets proposed for simulated walks of unknown labels: named where labels and places agree, and refused elsewhere."""

from dataclasses import replace

import numpy as np
import pytest

from recordings.test_marker_proposal import WALKERS, relabelled, walk
from stridelab.recordings.marker_sets import PROPOSED, identify
from stridelab.recordings.proposed_set import MARKER_SET_PROPOSED, propose_marker_set
from stridelab.recordings.recording import Recording

WORDS = {
    "asis": "AsisPt",
    "psis": "PsisPt",
    "knee_lateral": "KneeLatPt",
    "ankle_lateral": "AnkleLatPt",
    "heel": "HeelPt",
    "mt2": "Metatarsal2",
    "acromion": "AcromionPt",
    "elbow_lateral": "ElbowLatPt",
    "wrist_radial": "WristRadPt",
    "c7": "NeckC7",
    "t10": "BackT10",
    "jugular_notch": "JugularPt",
    "xiphoid": "XiphoidPt",
}
"""Words of a laboratory that resemble known labels and are none."""
KNOWN_LABELS = {
    "asis": "IAS",
    "psis": "IPS",
    "knee_lateral": "FLE",
    "ankle_lateral": "FAL",
    "heel": "FCC",
    "mt2": "FM2",
    "acromion": "SHO",
}
"""Labels of several sets, which together are none of them."""
LEGS = ("asis", "psis", "knee_lateral", "ankle_lateral", "heel", "mt2")
TRUNK = ("acromion", "c7", "t10", "jugular_notch", "xiphoid")


def side_and_name(mark: str) -> tuple[str, str]:
    return (mark[0], mark[2:]) if mark[:2] in ("l_", "r_") else ("", mark)


def labels_of(recording: Recording) -> dict[str, str]:
    """Labels of no known set, such as ``KneeLatPt_Left``."""
    labels = {}
    for mark in recording.markers_m:
        side, name = side_and_name(mark)
        labels[mark] = WORDS[name] + {"l": "_Left", "r": "_Right", "": ""}[side]
    assert identify(list(labels.values())).name is None
    return labels


def keep_landmarks(recording: Recording, names: tuple[str, ...]) -> Recording:
    kept = {mark: track for mark, track in recording.markers_m.items() if side_and_name(mark)[1] in names}
    return replace(recording, markers_m=kept)


@pytest.mark.parametrize("name", WALKERS)
@pytest.mark.parametrize("turn_rad", [0.0, 2.0])
def test_labels_and_places_that_agree_name_the_markers(name: str, turn_rad: float) -> None:
    labels = labels_of(walk(name))
    match = propose_marker_set(relabelled(walk(name), labels, turn_rad=turn_rad))
    assert match is not None
    assert match.name == PROPOSED
    assert match.landmarks == {mark: labels[mark] for mark in match.landmarks}
    assert {f"{side}_{name}" for side in "lr" for name in LEGS} <= set(match.landmarks)
    first = match.degraded[0]
    assert first.code == MARKER_SET_PROPOSED
    assert "l_asis AsisPt_Left" in first.message
    assert first.message.endswith("Check them on the body.")


@pytest.mark.parametrize("name", WALKERS)
def test_places_alone_name_nothing(name: str) -> None:
    labels = {mark: f"M{k:03d}" for k, mark in enumerate(walk(name).markers_m)}
    assert propose_marker_set(relabelled(walk(name), labels)) is None


@pytest.mark.parametrize(("one", "other"), [("knee_lateral", "ankle_lateral"), ("asis", "knee_lateral")])
def test_labels_that_contradict_the_places_name_nothing(one: str, other: str) -> None:
    """The labels of two landmarks are exchanged on both sides: each says where its marker is not."""
    labels = labels_of(walk("adult"))
    for side in "lr":
        a, b = f"{side}_{one}", f"{side}_{other}"
        labels[a], labels[b] = labels[b], labels[a]
    assert propose_marker_set(relabelled(walk("adult"), labels)) is None


def on_platform(height_m: float) -> tuple[Recording, dict[str, str]]:
    """A walk on a platform, whose markers are higher than those of a walk on the floor; and its labels, all known."""
    recording = keep_landmarks(walk("adult"), tuple(KNOWN_LABELS))
    raised = {mark: track + np.array([0.0, 0.0, height_m]) for mark, track in recording.markers_m.items()}
    labels = {mark: f"{mark[0].upper()}_{KNOWN_LABELS[side_and_name(mark)[1]]}" for mark in raised}
    assert identify(list(labels.values())).name is None
    return replace(recording, markers_m=raised), labels


@pytest.mark.parametrize("height_m", [0.0, 0.3, 0.4])
def test_labels_that_sets_know_name_markers_at_unusual_places(height_m: float) -> None:
    recording, labels = on_platform(height_m)
    match = propose_marker_set(relabelled(recording, labels))
    assert match is not None
    assert match.landmarks == {mark: labels[mark] for mark in match.landmarks}
    assert {f"{side}_{name}" for side in "lr" for name in (*LEGS[:4], "acromion")} <= set(match.landmarks)


def test_on_a_platform_labels_that_resemble_known_ones_do_not_suffice() -> None:
    recording, _ = on_platform(0.3)
    assert propose_marker_set(relabelled(recording, labels_of(recording))) is None


@pytest.mark.parametrize("height_m", [0.0, 0.3])
def test_known_labels_that_contradict_the_places_name_nothing(height_m: float) -> None:
    recording, labels = on_platform(height_m)
    for side in "lr":
        knee, ankle = f"{side}_knee_lateral", f"{side}_ankle_lateral"
        labels[knee], labels[ankle] = labels[ankle], labels[knee]
    assert propose_marker_set(relabelled(recording, labels)) is None


def test_one_knee_without_a_name_names_nothing() -> None:
    labels = labels_of(walk("adult"))
    labels["r_knee_lateral"] = "QX17"
    assert propose_marker_set(relabelled(walk("adult"), labels)) is None


def test_a_marked_trunk_without_names_is_not_taken_for_an_unmarked_one() -> None:
    """Legs alone are named; with unnamed markers on the trunk an upright one must not stand in for it."""
    legs = keep_landmarks(walk("adult"), LEGS)
    named = propose_marker_set(relabelled(legs, labels_of(legs)))
    assert named is not None
    assert "trunk-missing" in {remark.code for remark in named.degraded}
    both = keep_landmarks(walk("adult"), LEGS + TRUNK)
    labels = labels_of(both)
    unnamed = {mark: f"QX{k}" for k, mark in enumerate(labels) if side_and_name(mark)[1] in TRUNK}
    assert propose_marker_set(relabelled(both, labels | unnamed)) is None


@pytest.mark.parametrize(("share", "is_named"), [(1.0, True), (0.8, True), (0.4, False)])
@pytest.mark.parametrize("back", ["psis", "sacrum"])
def test_markers_inside_the_iliac_spines_name_nothing(back: str, share: float, is_named: bool) -> None:
    """The front of a pelvis is marked narrower than it is: the hips would be placed too far forward."""
    recording, labels = on_platform(0.0)
    markers = dict(recording.markers_m)
    middle = (markers["l_asis"] + markers["r_asis"]) / 2.0
    for mark in ("l_asis", "r_asis"):
        markers[mark] = middle + share * (markers[mark] - middle)
    if back == "sacrum":
        markers["sacrum"] = (markers.pop("l_psis") + markers.pop("r_psis")) / 2.0
        labels = {mark: label for mark, label in labels.items() if "psis" not in mark} | {"sacrum": "VSAC"}
    match = propose_marker_set(relabelled(replace(recording, markers_m=markers), labels))
    assert (match is not None) is is_named


def test_few_markers_and_hidden_ones_name_nothing() -> None:
    recording = walk("adult")
    labels = labels_of(recording)
    few = keep_landmarks(recording, ("asis", "psis"))
    assert propose_marker_set(relabelled(few, labels_of(few))) is None
    hidden = dict(relabelled(recording, labels).markers_m)
    hidden[labels["l_knee_lateral"]] = np.full_like(hidden[labels["l_knee_lateral"]], np.nan)
    assert propose_marker_set(replace(recording, markers_m=hidden)) is None


@pytest.mark.filterwarnings("error")
def test_one_visible_marker_of_many_has_no_heading_and_names_nothing() -> None:
    recording = walk("adult")
    early = np.arange(recording.n_frames)[:, None] < 5
    hidden = {mark: np.where(early, track, np.nan) for mark, track in recording.markers_m.items() if mark != "c7"}
    markers = {"c7": recording.markers_m["c7"], **hidden}
    assert propose_marker_set(replace(recording, markers_m=markers, walking_direction=None)) is None


def test_a_cloud_of_points_is_not_compared_with_a_body() -> None:
    recording = walk("adult")
    points = {f"point{k}": recording.markers_m["c7"] for k in range(300)}
    named = relabelled(recording, labels_of(recording))
    assert propose_marker_set(replace(named, markers_m={**named.markers_m, **points})) is None
