import pytest

from stridelab.errors import InvalidInput
from stridelab.recordings import marker_sets
from stridelab.recordings.marker_sets import identify, normalised_label

LABELS = {
    "isb": """
        L_IAS L_IPS R_IPS R_IAS L_FTC L_FLE L_FME L_FAX L_TTC L_FAL L_TAM L_FCC L_FM1 L_FM2 L_FM5 R_FTC R_FLE R_FME
        R_FAX R_TTC R_FAL R_TAM R_FCC R_FM1 R_FM2 R_FM5 CV7 TV10 SXS SJN L_SAE L_HLE L_HME L_RSP L_UHE L_HM2
        L_HM5 R_SAE R_HLE R_HME R_RSP R_UHE R_HM2 R_HM5""",
    "opencap": """
        C7 R_Shoulder L_Shoulder R_Sternum L_Sternum R.ASIS L.ASIS R.PSIS L.PSIS R_knee L_knee R_mknee L_mknee
        R_ankle L_ankle R_mankle L_mankle R_toe L_toe R_5meta L_5meta R_calc L_calc R_elbow_lat L_elbow_lat
        R_elbow_med L_elbow_med R_wrist_radius L_wrist_radius R_wrist_ulna L_wrist_ulna R_HJC L_HJC""",
    "opencap video": """
        C7_study r_shoulder_study L_shoulder_study r.ASIS_study L.ASIS_study r.PSIS_study L.PSIS_study
        r_knee_study L_knee_study r_ankle_study L_ankle_study r_lelbow_study L_lelbow_study""",
}
ISB = LABELS["isb"].split()


def all_labels(known):
    return [labels[0] for labels in known.labels.values()]


@pytest.mark.parametrize("name", sorted(marker_sets.marker_sets()))
def test_a_set_recognises_its_own_labels(name):
    known = marker_sets.marker_sets()[name]
    match = identify(all_labels(known))
    assert match.name == name
    assert set(match.landmarks) == set(known.labels)
    assert match.nearest == ()


@pytest.mark.parametrize("name", sorted(marker_sets.marker_sets()))
def test_no_label_of_a_set_means_two_landmarks(name):
    known = marker_sets.marker_sets()[name]
    labels = [label for labels in known.labels.values() for label in labels]
    assert len(labels) == len(set(labels))


def test_all_required_sets_are_shipped():
    shipped = set(marker_sets.marker_sets())
    assert {"isb", "isb-head", "plug-in-gait", "gait2354", "rajagopal", "opencap-lab", "cgm2-lower"} <= shipped
    assert "davis-lower" in shipped


@pytest.mark.parametrize(
    "dressed", [str.lower, str.upper, lambda x: f"Anna: {x}", lambda x: x.replace("_", " ."), "a:b:{}".format]
)
def test_labels_match_regardless_of_case_prefix_and_separators(dressed):
    labels = [dressed(label) for label in ISB]
    match = identify(labels)
    assert match.name == "isb"
    assert match.landmarks["l_asis"] == labels[0]


def test_the_first_of_two_equal_labels_counts():
    match = identify(["one:L_IAS", *ISB])
    assert match.landmarks["l_asis"] == "one:L_IAS"
    assert normalised_label("one:L_IAS") == normalised_label("l ias")


@pytest.mark.parametrize("labels", ["opencap", "opencap video"])
def test_opencap_marker_based_and_video_labels(labels):
    match = identify(LABELS[labels].split())
    assert match.name == "opencap-lab"
    assert "head-missing" in {remark.code for remark in match.degraded}


def test_missing_landmarks_are_listed_with_their_cost():
    match = identify(ISB)
    assert [remark.code for remark in match.degraded] == ["head-missing"]
    assert "mm" in match.degraded[0].message
    assert all("head" in entry for entry in match.missing)


def test_a_lower_body_hides_the_smaller_gaps_inside_the_large_one():
    names = ("ASI", "PSI", "KNE", "ANK", "HEE", "TOE", "TIB", "THI")
    match = identify([side + name for side in "LR" for name in names])
    assert match.name == "cgm2-lower"
    codes = {remark.code for remark in match.degraded}
    assert "trunk-missing" in codes
    assert not {"head-missing", "arms-missing", "hands-missing", "trunk-simplified"} & codes


def test_knees_that_only_the_static_trial_marks_are_announced():
    known = marker_sets.marker_sets()["gait2354"]
    labels = [labels[0] for landmark, labels in known.labels.items() if "knee" not in landmark]
    match = identify(labels)
    assert match.name == "gait2354"
    assert match.degraded[0].code == "static-trial-needed"


def test_an_unknown_set_names_the_nearest_ones_and_what_they_lack():
    labels = [label for label in ISB if label not in ("CV7", "SJN", "L_FLE")]
    match = identify(labels)
    assert match.name is None
    assert match.landmarks == {}
    nearest, score = match.nearest[0]
    assert nearest == "isb"
    assert 0.5 < score < 1.0
    assert set(match.needed["isb"]) == {"c7", "jugular_notch", "l_knee_lateral"}
    assert [s for _, s in match.nearest] == sorted((s for _, s in match.nearest), reverse=True)


def test_without_labels_no_set_matches():
    match = identify([])
    assert match.name is None
    assert all(score == 0.0 for _, score in match.nearest)


def test_a_marker_map_overrules_the_set():
    match = identify([*ISB, "myC7"], {"c7": "MY C7"})
    assert match.landmarks["c7"] == "myC7"


def test_a_marker_map_completes_a_set():
    labels = ["neck" if label == "CV7" else label for label in ISB]
    assert identify(labels).name is None
    assert identify(labels, {"c7": "neck"}).name == "isb"


def test_a_marker_map_alone_can_be_a_set():
    names = ("asis", "psis", "knee_lateral", "ankle_lateral")
    own = {f"{side}_{name}": f"{side}{name}" for side in "lr" for name in names}
    match = identify(list(own.values()), own)
    assert match.name == "custom"
    assert match.landmarks == own
    assert "trunk-missing" in {remark.code for remark in match.degraded}


def test_a_marker_map_that_does_not_fit_names_every_fault():
    with pytest.raises(InvalidInput) as refusal:
        identify(ISB, {"l_tail": "L_IAS", "c7": "nowhere", "t8": "CV7"})
    assert refusal.value.code == "marker-map-invalid"
    assert [fault.where for fault in refusal.value.faults] == ["marker_map.l_tail", "marker_map.c7"]


def test_a_set_file_with_a_landmark_that_does_not_exist_is_refused():
    base = {"name": "own", "title": "own", "required": ["c7"], "unpaired": {"c7": ["C7"]}}
    assert marker_sets.parse_marker_set(base, "own.toml").required == ("c7",)
    with pytest.raises(InvalidInput, match="tail"):
        marker_sets.parse_marker_set(base | {"unpaired": {"c7": ["C7"], "tail": ["T"]}}, "own.toml")
    with pytest.raises(InvalidInput, match="sacrum"):
        marker_sets.parse_marker_set(base | {"required": ["sacrum"]}, "own.toml")


def test_substitutes_refer_to_each_other_and_to_landmarks():
    known = marker_sets.all_substitutes()
    for substitute in known.values():
        assert set(substitute.hidden_by) <= set(known)
        for entry in substitute.landmarks:
            assert set(entry.split("|")) <= marker_sets.LANDMARKS | {"l_shoulder_centre"}
        assert substitute.horizontal_mm > 0
        assert substitute.vertical_mm > 0
