from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from stridelab.body import segment_tables
from stridelab.body.segment_model import SegmentModel, segment_frames
from stridelab.errors import InvalidInput, NotEstimable
from stridelab.recordings.marker_sets import marker_sets
from support.recordings.walks import landmarks, mirrored_tracks, recording

TABLES = ("dumas2007", "deleva1996")
angles = st.floats(-3.0, 3.0)
vectors = st.tuples(angles, angles, angles).map(np.array)


def com(tracks, table="dumas2007", static=None, **fields):
    trial = recording(tracks, **fields)
    same = {name: name for name in tracks}
    still = None if static is None else recording(static)
    return SegmentModel(table).com(trial, same, subject=trial.subject, static=still)


def without(tracks, *names):
    return {name: track for name, track in tracks.items() if not name.endswith(names)}


@settings(max_examples=25, deadline=None)
@given(vectors, vectors)
@pytest.mark.parametrize("table", TABLES)
def test_moving_all_markers_rigidly_moves_the_com_alike(table, rotation_vector, shift):
    R = Rotation.from_rotvec(rotation_vector).as_matrix()
    tracks = landmarks()
    moved = com({name: track @ R.T + shift for name, track in tracks.items()}, table)
    np.testing.assert_allclose(moved.com_m, com(tracks, table).com_m @ R.T + shift, atol=1e-9)


@settings(max_examples=15, deadline=None)
@given(angles, vectors)
def test_a_substituted_trunk_turns_with_the_body_about_the_vertical(yaw, shift):
    R = Rotation.from_euler("z", yaw).as_matrix()
    legs = without(landmarks(), "acromion", "c7", "notch", "clavicle", "lateral_elbow", "elbow_lateral", "elbow_medial")
    legs = without(legs, "head_front", "head_back", "head_top", "wrist_radial", "wrist_ulnar", "mc2", "mc5", "xiphoid")
    moved = com({name: track @ R.T + shift for name, track in legs.items()})
    assert "trunk-missing" in {remark.code for remark in moved.remarks}
    np.testing.assert_allclose(moved.com_m, com(legs).com_m @ R.T + shift, atol=1e-9)


def _without_midline_offsets(name):
    table = segment_tables.load_table(name, "male")
    rows = {
        segment: row if segment[1] == "_" else replace(row, com=(row.com[0], row.com[1], 0.0))
        for segment, row in table.segments.items()
    }
    return segment_tables.to_json(replace(table, segments=rows))


@pytest.mark.parametrize(
    "hidden", [(), ("medial",), ("head_front", "head_back", "head_top"), ("c7",), ("mc2", "mc5", "heel")]
)
@pytest.mark.parametrize("name", TABLES)
def test_the_mirror_image_of_a_body_has_the_mirror_image_of_its_com(name, hidden):
    carried = {"segment_table": _without_midline_offsets(name)}
    tracks = without(landmarks(), *hidden)
    tracks = {key: track + np.array([0.0, 0.002 * i, 0.003 * i]) for i, (key, track) in enumerate(tracks.items())}
    com_m = com(tracks, "carried", carried=carried).com_m
    in_mirror = com(mirrored_tracks(tracks), "carried", carried=carried).com_m
    np.testing.assert_allclose(in_mirror, com_m * [1.0, -1.0, 1.0], atol=1e-9)


@pytest.mark.parametrize("table", TABLES)
def test_the_segments_sum_to_the_body(table):
    whole = com(landmarks(), table)
    assert sum(part.mass_fraction for part in whole.segments.values()) == pytest.approx(1.0, abs=1e-12)
    summed = sum(part.mass_fraction * part.com_m for part in whole.segments.values())
    np.testing.assert_allclose(whole.com_m, summed, atol=1e-12)
    for part in whole.segments.values():
        assert np.isfinite(part.com_m).all()


@pytest.mark.parametrize("table", TABLES)
def test_a_plain_standing_body_has_its_com_where_people_have_it(table):
    result = com(landmarks(1), table)
    x, y, z = result.com_m[0]
    assert 0.52 < z / 1.75 < 0.58
    assert abs(x) < 0.06
    assert abs(y) < 0.002  # the published tables have millimetres of sideways asymmetry in the midline
    assert result.remarks == ()
    assert result.sd_m == pytest.approx(segment_tables.load_table(table, "male").sd_m)
    assert result.table == table


def test_frames_are_right_handed_and_face_the_way_they_say():
    from stridelab.body.joint_centres import joint_centres
    from stridelab.body.segment_tables import load_anthropometry

    p, body = landmarks(3), load_anthropometry("female")
    for name, frame in segment_frames(p, joint_centres(p, body, {}), body).items():
        axes = np.stack([frame.X, frame.Y, frame.Z], axis=2)
        np.testing.assert_allclose(axes.transpose(0, 2, 1) @ axes, np.broadcast_to(np.eye(3), axes.shape), atol=1e-9)
        assert np.linalg.det(axes) == pytest.approx(1.0), name
        if not name.endswith(("forearm", "hand")):  # their thumbs point forwards, not outwards
            assert (frame.Z[:, 1] < -0.3).all(), name  # rightwards is -y
        assert (frame.Y[:, 2] > 0.3).all() or name.endswith("foot"), name
        assert frame.length_m > 0.05, name


def test_a_hidden_marker_costs_only_its_own_frames():
    tracks = landmarks(6)
    lone = without(tracks, "l_mt1", "l_mt5", "l_mt2", "l_trochanter")  # leaves the left heel without neighbours
    for name in ("l_elbow_lateral", "l_elbow_medial", "l_wrist_radial", "l_wrist_ulnar"):
        lone[name] = lone[name].copy()
        lone[name][2] = np.nan
    result = com(lone)
    assert np.isnan(result.com_m[2]).all()
    assert np.isfinite(np.delete(result.com_m, 2, axis=0)).all()


def test_a_gap_in_a_cluster_is_bridged_with_a_remark():
    tracks = landmarks(6)
    tracks["l_asis"] = tracks["l_asis"].copy()
    whole = com(tracks).com_m
    tracks["l_asis"][3:5] = np.nan
    result = com(without(tracks, "nothing"))
    np.testing.assert_allclose(result.com_m, whole, atol=1e-9)
    assert [remark.code for remark in result.remarks] == ["markers-rebuilt"]


def test_a_marker_that_is_hardly_ever_seen_counts_as_not_marked():
    tracks = landmarks(9)
    for side in "lr":
        for name in ("head_front", "head_back"):
            tracks[f"{side}_{name}"] = np.where(np.arange(9)[:, None] < 2, tracks[f"{side}_{name}"], np.nan)
    result = com(without(tracks, "head_top"))
    assert "head-missing" in {remark.code for remark in result.remarks}
    assert np.isfinite(result.com_m).all()


def test_missing_medial_markers_come_from_the_static_trial():
    whole = landmarks()
    walk = without(whole, "medial")
    labels = {name: names[0] for name, names in marker_sets()["isb-head"].labels.items()}
    standing = {labels[name]: track for name, track in landmarks(1).items() if name in labels}
    guessed, rebuilt = com(walk), com(walk, static=standing)
    assert {"knee-medial-missing", "ankle-medial-missing"} <= {remark.code for remark in guessed.remarks}
    codes = {remark.code for remark in rebuilt.remarks}
    assert "markers-rebuilt" in codes
    assert not {"knee-medial-missing", "ankle-medial-missing"} & codes
    truth = com(whole).com_m
    assert np.abs(rebuilt.com_m - truth).max() < np.abs(guessed.com_m - truth).max()
    assert max(rebuilt.sd_m) <= max(guessed.sd_m)


def test_a_calliper_width_places_the_knee():
    walk = without(landmarks(), "knee_medial")
    widths = {"l_knee": 0.086, "r_knee": 0.086}  # with a marker's radius on both sides this is the body's 100 mm
    result = com(without(walk, "fibula_head", "tuberosity"), joint_widths_m=widths)
    truth = com(landmarks())
    assert np.abs(result.joint_centres_m["l_knee"] - truth.joint_centres_m["l_knee"]).max() < 0.004


def test_a_centre_in_the_file_is_taken_as_it_is():
    tracks = landmarks()
    tracks["l_hip_centre"] = tracks["l_asis"] + [-0.03, -0.03, -0.10]
    np.testing.assert_array_equal(com(tracks).joint_centres_m["l_hip"], tracks["l_hip_centre"])


@pytest.mark.parametrize(("degrees", "share"), [(0.0, 0.0), (90.0, 1.0), (45.0, 0.5), (180.0, 0.0)])
def test_the_error_of_a_table_turns_with_the_body(degrees: float, share: float) -> None:
    """A table errs more forwards than sideways; along a diagonal the world's axes share both."""
    angle = np.deg2rad(degrees)
    turn = np.array([[np.cos(angle), -np.sin(angle), 0.0], [np.sin(angle), np.cos(angle), 0.0], [0.0, 0.0, 1.0]])
    forwards, sideways, up = segment_tables.load_table("dumas2007", "male").sd_m
    assert sideways < forwards
    x, y, z = com({name: track @ turn.T for name, track in landmarks(1).items()}, "dumas2007").sd_m
    assert x**2 == pytest.approx(forwards**2 * (1 - share) + sideways**2 * share)
    assert x**2 + y**2 == pytest.approx(forwards**2 + sideways**2)
    assert z == up


@pytest.mark.parametrize("table", ["auto", "carried"])
def test_a_carried_table_is_used_as_it_is(table):
    rows = {"pelvis": segment_tables.SegmentRow(1.0 - 1e-13, (0.0, -0.5, 0.0))}
    own = segment_tables.SegmentTable("of the simulated walker", rows, sd_m=(0.001, 0.002, 0.003))
    result = com(landmarks(), table, carried={"segment_table": segment_tables.to_json(own)})
    assert result.table == "carried"
    assert result.sd_m == pytest.approx((0.001, 0.002, 0.003))
    assert set(result.segments) == {"pelvis"}


def test_a_missing_or_invalid_carried_table_is_refused():
    with pytest.raises(InvalidInput) as refusal:
        com(landmarks(), "carried")
    assert refusal.value.code == "segment-table-not-carried"
    text = '{"name": "own", "segments": {"tail": {"mass_fraction": 0.999, "com": [0, 0, 0]}}}'
    with pytest.raises(InvalidInput, match="tail"):
        com(landmarks(), "carried", carried={"segment_table": text})


def test_auto_prefers_dumas_and_an_unstated_sex_is_remarked_and_widens_the_band():
    tracks = landmarks()
    trial = recording(tracks)
    known = com(tracks, "auto")
    unknown = SegmentModel().com(trial, {n: n for n in tracks}, subject=replace(trial.subject, sex=None))
    assert known.table == unknown.table == "dumas2007"
    assert [remark.code for remark in unknown.remarks] == ["sex-unknown"]
    assert all(wide > narrow for wide, narrow in zip(unknown.sd_m, known.sd_m, strict=True))


@pytest.mark.parametrize(
    ("hidden", "code", "where"),
    [
        (("l_asis",), "pelvis-markers-missing", "l_asis"),
        (("psis", "sacrum"), "pelvis-markers-missing", "l_psis"),
        (("r_knee_lateral",), "knee-markers-missing", "r_knee_lateral"),
        (("ankle_lateral", "heel"), "ankle-markers-missing", "l_ankle_lateral"),
    ],
)
def test_without_pelvis_or_legs_there_is_no_estimate(hidden, code, where):
    with pytest.raises(NotEstimable) as refusal:
        com(without(landmarks(), *hidden))
    assert refusal.value.code == code
    assert where in [fault.where for fault in refusal.value.faults]


def swapped(tracks, *names):
    """The left and right tracks of these landmarks interchanged."""
    pairs = {f"{s}_{name}": f"{o}_{name}" for name in names for s, o in ("lr", "rl")}
    return {name: tracks[pairs.get(name, name)] for name in tracks}


@pytest.mark.parametrize(
    ("wrong", "where"),
    [
        ({name: track * [1.0, -1.0, 1.0] for name, track in landmarks().items()}, "l_asis"),
        (swapped(landmarks(), *(name[2:] for name in landmarks() if name.startswith("l_"))), "l_asis"),
        (swapped(landmarks(), "acromion"), "r_acromion"),
        (swapped(landmarks(), "knee_lateral", "knee_medial"), "r_knee"),
        (without(swapped(landmarks(), "asis", "psis"), "acromion"), "l_asis"),
    ],
    ids=["axes mirrored", "all labels", "shoulders", "knees", "pelvis"],
)
def test_swapped_sides_are_refused(wrong, where):
    with pytest.raises(NotEstimable) as refusal:
        com(wrong)
    assert refusal.value.code == "sides-swapped"
    assert where in [fault.where for fault in refusal.value.faults]


@pytest.mark.parametrize("degrees", [-50.0, 60.0, 90.0])
def test_a_bent_or_turned_trunk_is_no_swapped_side(degrees):
    tracks = landmarks()
    upper = Rotation.from_euler("zy", [degrees, degrees], degrees=True).as_matrix()
    high = {name for name in tracks if tracks[name][0, 2] > 1.05}
    bent = {n: (t - [0.0, 0.0, 1.1]) @ upper.T + [0.0, 0.0, 1.1] if n in high else t for n, t in tracks.items()}
    assert np.isfinite(com(bent).com_m).all()


@pytest.mark.parametrize("lean_deg", [0.0, 40.0])
def test_a_pelvis_placed_from_hip_centres_follows_the_trunk(lean_deg):
    tracks = landmarks()
    whole = com(tracks)
    centres = {f"{s}_hip_centre": whole.joint_centres_m[f"{s}_hip"] for s in "lr"}
    video = without({**tracks, **centres}, "asis", "psis", "sacrum", "trochanter")
    R = Rotation.from_euler("y", lean_deg, degrees=True).as_matrix()
    placed, leaning = com(video), com({name: track @ R.T for name, track in video.items()})
    assert {remark.code for remark in placed.remarks} == {"pelvis-simplified"}
    np.testing.assert_allclose(placed.com_m, whole.com_m, atol=0.012)
    np.testing.assert_allclose(leaning.com_m, placed.com_m @ R.T, atol=1e-9)


def test_markers_that_are_never_visible_together_are_refused():
    tracks = without(
        landmarks(8), "heel", "mt1", "mt2", "mt5", "toe", "trochanter", "fibula_head", "tuberosity", "medial"
    )
    early = np.arange(8)[:, None] < 4
    tracks["l_knee_lateral"] = np.where(early, tracks["l_knee_lateral"], np.nan)
    tracks["r_knee_lateral"] = np.where(early, np.nan, tracks["r_knee_lateral"])
    with pytest.raises(NotEstimable) as refusal:
        com(tracks)
    assert refusal.value.code == "markers-never-together"


def test_instants_are_those_of_the_markers():
    result = com(landmarks(4))
    np.testing.assert_allclose(result.time_s, [0.0, 0.01, 0.02, 0.03])
    assert {"dumas2007", "dumas2018"} <= set(result.references)
