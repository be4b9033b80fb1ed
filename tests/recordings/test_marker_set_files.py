"""Marker sets of users: files are validated with specific errors, and compete with the shipped sets."""

from pathlib import Path

import pytest

from stridelab.errors import InvalidInput, UnreadableFile
from stridelab.recordings.marker_sets import identify, marker_set_of_labels, marker_sets, read_marker_set

LEGS = """
name = "lab"
[paired]
asis = ["{s} hip front"]
psis = ["{s} hip back"]
knee_lateral = ["{s} knee out", "{s} knee"]
ankle_lateral = ["{s} ankle out"]
"""
LABELS = [f"{side} {place}" for side in "LR" for place in ("hip front", "hip back", "knee", "ankle out")]


def test_a_file_without_required_needs_pelvis_knees_and_ankles(tmp_path: Path) -> None:
    known = read_marker_set(_written(tmp_path, LEGS))
    match = identify(LABELS, own_sets=[known])
    assert match.name == "lab"
    assert match.landmarks["r_knee_lateral"] == "R knee"
    lacking = identify(LABELS[1:], own_sets=[known])
    assert lacking.name is None
    assert lacking.needed["lab"] == ("l_asis|l_hip_centre",)


def _written(folder: Path, text: str) -> Path:
    path = folder / "own.toml"
    path.write_text(text, encoding="utf-8")
    return path


@pytest.mark.parametrize(
    ("text", "where", "message"),
    [
        (LEGS.replace('name = "lab"', ""), "name", "missing"),
        (LEGS + "[unpaired]\ntail = ['T']", "landmarks.tail", "not a landmark"),
        (LEGS + "[unpaired]\nc7 = 'C7'", "unpaired.c7", "list of labels"),
        (LEGS + "[unpaired]\nc7 = []", "landmarks.c7", "no label"),
        (LEGS + "[unpaired]\nc7 = [' ']", "landmarks.c7", "empty"),
        (LEGS + "[unpaired]\nc7 = ['L-hip_front']", "landmarks.l_asis", "already stands for c7"),
        (LEGS.replace("ankle_lateral", "heel"), "required", "l_ankle_lateral or l_ankle_centre"),
        ("required = ['tail']" + LEGS, "required", "'tail' is not a landmark"),
        ("required = 'c7'" + LEGS, "required", "not a list"),
        ("markers = 3" + LEGS, "markers", "not a field"),
        ("paired = 3\nname = 'lab'", "paired", "not a table"),
    ],
)
def test_an_invalid_file_is_refused_naming_the_entry(tmp_path: Path, text: str, where: str, message: str) -> None:
    with pytest.raises(InvalidInput, match=r"own\.toml") as refusal:
        read_marker_set(_written(tmp_path, text))
    assert refusal.value.code == "marker-set-invalid"
    assert any(fault.where == where and message in fault.message for fault in refusal.value.faults)


def test_an_unreadable_file_is_refused_with_the_reason(tmp_path: Path) -> None:
    with pytest.raises(UnreadableFile, match=r"own\.toml.*line 1") as broken:
        read_marker_set(_written(tmp_path, "name = \n"))
    assert broken.value.code == "marker-set-not-toml"
    with pytest.raises(UnreadableFile, match="missing"):
        read_marker_set(tmp_path / "missing.toml")


def test_a_shipped_set_wins_only_if_it_fits_better() -> None:
    shipped = marker_sets()["isb-head"]
    labels = [names[0] for names in shipped.labels.values()]
    own = {landmark: list(names) for landmark, names in shipped.labels.items()}
    as_good = marker_set_of_labels("own", own)
    worse = marker_set_of_labels("own", {k: v for k, v in own.items() if k != "c7"})
    assert identify(labels, own_sets=[as_good]).name == "own"
    assert identify(labels, own_sets=[worse]).name == "isb-head"
    assert identify(labels, own_sets=[worse], shipped=False).name == "own"
    second = marker_set_of_labels("second", own)
    assert identify(labels, own_sets=[as_good, second]).name == "own", "the first of equal ones is preferred"
