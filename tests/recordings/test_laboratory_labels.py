"""Label lists as laboratories write them: each is taken for its own set, and what it leaves out is announced."""

import pytest

from stridelab.errors import NotEstimable
from stridelab.pipelines.com_inputs import require_marker_set
from stridelab.recordings import marker_sets
from stridelab.recordings.marker_sets import LANDMARKS, MarkerSet, identify, parse_marker_set
from support.recordings.label_lists import LEGS, LEGS_AND_TRUNK, LISTS


def labels_of(name: str) -> list[str]:
    return [label.replace("~", " ") for label in LISTS[name][1].split()]


@pytest.mark.parametrize("prefix", ["", "Subject 01:", "MarkerSet__"])
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


LEGS_OF_A_CLINIC = ["LASI", "RASI", "SACR", *(s + n for n in ("T1", "KNE", "S1", "ANK", "HEE", "TOE") for s in "LR")]


def test_trunk_labels_that_the_set_does_not_know_are_read_as_other_sets_read_them() -> None:
    match = identify([*LEGS_OF_A_CLINIC, "C7", "T10", "Clav", "STRN", "LSHO", "RSHO"])
    assert match.name == "cgm2-lower"
    upper = {name: label for name, label in match.landmarks.items() if label not in LEGS_OF_A_CLINIC}
    shoulders = {"l_acromion": "LSHO", "r_acromion": "RSHO"}
    assert upper == {"c7": "C7", "t10": "T10", "jugular_notch": "Clav", **shoulders}
    assert "trunk-missing" not in {remark.code for remark in match.degraded}


def test_common_labels_are_read_by_three_sets_or_more_and_never_otherwise() -> None:
    assert marker_sets.common_labels().keys() >= {"c7", "t10", "clav", "lsho", "relb"}
    assert not marker_sets.common_labels().keys() & {"strn", "sternum", "neck", "lasi", "lkne", "nose"}
    for label, landmark in marker_sets.common_labels().items():
        readings = [
            name for s in marker_sets.marker_sets().values() for name, seen in s.labels.items() if label in seen
        ]
        assert len(readings) >= 3
        assert set(readings) == {landmark}


def test_a_set_of_the_user_is_not_completed() -> None:
    legs = own_set("legs", asis="{s}ASI", knee_lateral="{s}KN", ankle_lateral="{s}AN", psis="{s}PS")
    labels = [label for known in legs.labels.values() for label in known]
    assert set(identify([*labels, "C7"], own_sets=[legs]).landmarks) == set(legs.labels)


@pytest.mark.parametrize(("side", "marked"), [("L", "right"), ("R", "left")])
def test_a_recording_of_one_leg_is_refused_by_that(side: str, marked: str) -> None:
    pelvis = ["LASI", "RASI", "LPSI", "RPSI"]
    labels = [label for label in (*LEGS_OF_A_CLINIC[3:], *pelvis) if label in pelvis or label[0] != side]
    with pytest.raises(NotEstimable, match=f"Only the {marked} leg is marked") as refusal:
        require_marker_set(identify(labels), labels)
    assert refusal.value.code == "unknown-marker-set"


def test_a_running_set_with_one_ball_of_the_foot_unmarked_is_recognised() -> None:
    labels = labels_of("bmclab-running")
    assert identify([label for label in labels if label != "L.MT1"]).name == "bmclab-running"
    assert identify([label for label in labels if label not in ("L.MT1", "L.MT5")]).name is None


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


@pytest.mark.parametrize("name", ["visual3d-hybrid", "lkn-clusters", "uwa-full", "ior dynamic", "patella-clusters"])
def test_knees_of_the_static_trial_alone_are_announced(name: str) -> None:
    assert identify(labels_of(name)).degraded[0].code == "static-trial-needed"


@pytest.mark.parametrize("name", ["openpose", "mediapipe", "skeleton", "hip-markers"])
def test_joint_names_as_labels_give_a_simplified_pelvis(name: str) -> None:
    assert "pelvis-simplified" in {remark.code for remark in identify(labels_of(name)).degraded}


def test_only_sets_that_share_a_marker_are_named_as_the_nearest() -> None:
    labels = ["ProgressionFrameO", "ProgressionFrameA"]
    match = identify(labels)
    with pytest.raises(NotEstimable, match="nearest: none") as refused:
        require_marker_set(match, labels)
    assert [fault.where for fault in refused.value.faults] == ["labels found"]


def test_metatarsals_of_gait2354_mark_the_feet() -> None:
    match = identify(labels_of("gait2354 with metatarsals"))
    feet = {name: match.landmarks[name] for name in ("l_mt1", "l_mt5", "r_mt1", "r_mt5")}
    assert feet == {"l_mt1": "L_MTP1", "l_mt5": "L_MTP5", "r_mt1": "R_MTP1", "r_mt5": "R_MTP5"}
    assert "foot-simplified" not in {remark.code for remark in match.degraded}
