"""Label lists as laboratories write them: each is taken for its own set, and what it leaves out is announced."""

import pytest

from stridelab.errors import NotEstimable
from stridelab.pipelines.com_inputs import require_marker_set
from stridelab.recordings import marker_sets
from stridelab.recordings.marker_sets import LANDMARKS, MarkerSet, identify, parse_marker_set
from support.recordings.label_lists import LEGS, LEGS_AND_TRUNK, LISTS


def labels_of(name: str) -> list[str]:
    return [label.replace("~", " ") for label in LISTS[name][1].split()]


@pytest.mark.parametrize("prefix", ["", "Subject 01:"])
@pytest.mark.parametrize("name", sorted(LISTS))
def test_a_list_of_a_laboratory_is_its_own_set(name: str, prefix: str) -> None:
    match = identify([prefix + label for label in labels_of(name)])
    assert match.name == name.split()[0]
    codes = {remark.code for remark in match.degraded}
    assert codes & {LEGS, LEGS_AND_TRUNK} == {LISTS[name][0]} - {""}


def written_labels(known: MarkerSet, which: int, *, required: bool) -> dict[str, str]:
    """Landmark by label of a recording with the first or last alternatives, of all landmarks or the required ones."""
    labels = {entry.split("|")[0] for entry in known.required} if required else set(known.labels)
    return {known.labels[name][which]: name for name in known.labels if name in labels}


@pytest.mark.parametrize("required", [False, True], ids=["all", "required"])
@pytest.mark.parametrize("which", [0, -1], ids=["first", "last"])
@pytest.mark.parametrize("name", sorted(marker_sets.marker_sets()))
def test_no_set_takes_the_labels_of_another_for_other_landmarks(name: str, which: int, required: bool) -> None:
    written = written_labels(marker_sets.marker_sets()[name], which, required=required)
    match = identify(list(written))
    assert match.name is not None
    assert {label: landmark for landmark, label in match.landmarks.items() if landmark in LANDMARKS} == {
        label: landmark for label, landmark in written.items() if landmark in LANDMARKS
    }
    assert required or match.name == name


def own_set(name: str, **labels: str) -> MarkerSet:
    paired = {landmark: [label] for landmark, label in labels.items()}
    return parse_marker_set(
        {"name": name, "title": name, "required": [f"*_{n}" for n in labels], "paired": paired}, name
    )


def test_sets_that_take_a_label_for_different_landmarks_are_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    inner = own_set("inner", asis="{s}1", knee_medial="{s}2", heel="{s}3")
    outer = own_set("outer", asis="{s}1", knee_lateral="{s}2", heel="{s}3")
    larger = own_set("larger", asis="{s}1", knee_lateral="{s}2", heel="{s}3", toe="{s}4")
    labels = [f"{s}{i}" for s in "LR" for i in (1, 2, 3)]
    monkeypatch.setattr(marker_sets, "marker_sets", lambda: {s.name: s for s in (inner, outer, larger)})
    match = identify(labels)
    assert match.name is None
    assert set(match.rivals) == {"inner", "outer"}
    with pytest.raises(NotEstimable, match=r"different landmarks: .*outer") as refusal:
        require_marker_set(match, labels)
    assert refusal.value.code == "unknown-marker-set"
    assert identify([*labels, "L4", "R4"]).name == "larger"


def test_a_set_may_name_its_sides_in_another_language() -> None:
    french = parse_marker_set(
        {"name": "f", "title": "f", "sides": ["G", "D"], "required": ["*_heel"], "paired": {"heel": ["CAL{s}"]}},
        "f.toml",
    )
    assert french.labels == {"l_heel": ("calg",), "r_heel": ("cald",)}


def test_numbers_before_labels_do_not_matter() -> None:
    labels = labels_of("hip-markers")
    match = identify([f"{i} - {label}" for i, label in enumerate(labels, start=1)])
    assert match.name == "hip-markers"
    assert match.landmarks["l_hip_centre"] == f"{labels.index('L_Hip') + 1} - L_Hip"


@pytest.mark.parametrize("name", ["visual3d-hybrid", "lkn-clusters", "uwa-full", "ior dynamic"])
def test_knees_of_the_static_trial_alone_are_announced(name: str) -> None:
    assert identify(labels_of(name)).degraded[0].code == "static-trial-needed"


@pytest.mark.parametrize("name", ["openpose", "mediapipe", "skeleton", "hip-markers"])
def test_joint_names_as_labels_give_a_simplified_pelvis(name: str) -> None:
    assert "pelvis-simplified" in {remark.code for remark in identify(labels_of(name)).degraded}
