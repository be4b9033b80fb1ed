"""CAST: knees and ankles that only the static trial marks follow clusters with names of the laboratory's own."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from stridelab.errors import NotEstimable
from stridelab.pipelines.com_inputs import prepare_com_inputs
from stridelab.recordings.files.c3d_writer import write_c3d
from stridelab.recordings.gap_filling import rigid_motion
from stridelab.recordings.marker_sets import identify
from stridelab.recordings.recording import Recording
from stridelab.recordings.technical_clusters import rigid_subset, technical_landmarks
from stridelab.schemas.jobs import EstimateComInput
from stridelab.schemas.tasks import EstimateComTask, RecordingSource
from stridelab.simulation.human.walker import HumanWalker
from stridelab.simulation.human_recording import record
from stridelab.simulation.noise import MeasurementNoise
from support.command_line import quiet

BONES = {
    "thigh": ("trochanter", "knee_lateral", "knee_medial"),
    "shank": ("fibula_head", "tibial_tuberosity", "ankle_lateral"),
}
PLATE_M = np.array([[0.0, 0.0, 0.0], [0.05, 0.02, 0.0], [0.0, 0.05, 0.03], [0.04, 0.0, 0.05]])
JOINTS = tuple(f"{s}_{joint}_{kind}" for s in "lr" for joint in ("knee", "ankle") for kind in ("lateral", "medial"))


@pytest.fixture(scope="module")
def walk() -> Recording:
    """A walk whose thighs and shanks carry clusters of four markers, QLTH1 to QRSH4."""
    made = record(HumanWalker(mass_kg=64.0, duration_s=2.0, seed=11).walk(), MeasurementNoise(), 11, lab="two_plates")
    recording = replace(made.recording, carried={})
    landmarks = identify(tuple(recording.markers_m)).landmarks
    markers = dict(recording.markers_m)
    for side in "lr":
        for segment, names in BONES.items():
            tracks = np.stack([recording.markers_m[landmarks[f"{side}_{name}"]] for name in names], axis=1)
            R, t = rigid_motion(tracks[0], tracks)
            middle = tracks[0].mean(axis=0)
            for k, offset in enumerate(PLATE_M, start=1):
                markers[f"Q{side.upper()}{segment[:2].upper()}{k}"] = np.asarray(R @ (middle + offset) + t)
    return replace(recording, markers_m=markers)


def static_of(recording: Recording) -> Recording:
    held = {label: np.repeat(track[:1], 60, axis=0) for label, track in recording.markers_m.items()}
    return replace(recording, markers_m=held, plates=(), events=(), walking_direction=None)


def without(recording: Recording, names: tuple[str, ...]) -> Recording:
    landmarks = identify(tuple(recording.markers_m)).landmarks
    hidden = {landmarks[name] for name in names}
    return replace(recording, markers_m={k: track for k, track in recording.markers_m.items() if k not in hidden})


def com_m(folder: Path, trial: Recording, static: Recording | None) -> tuple[np.ndarray, dict[str, str]]:
    folder.mkdir()
    write_c3d(folder / "trial", trial)
    source = None
    if static is not None:
        write_c3d(folder / "static-trial", static)
        source = RecordingSource(file="static-trial", filename="static.c3d")
    task = EstimateComTask(
        recording=RecordingSource(file="trial", filename="walk.c3d"),
        static=source,
        input=EstimateComInput(recording_id="r", method="geometry"),
    )
    prepared = prepare_com_inputs(task, folder, quiet, needs_force=False)
    return prepared.geometric.com_m, {remark.code: remark.message for remark in prepared.all_remarks}


def test_clusters_carry_the_joints_that_only_the_static_trial_marks(walk: Recording, tmp_path: Path) -> None:
    """The walk alone is of no known set; with its static trial the centre of mass is that of all markers."""
    clusters = without(walk, (*JOINTS, "l_trochanter", "r_trochanter"))
    with pytest.raises(NotEstimable) as refused:
        com_m(tmp_path / "alone", clusters, None)
    assert refused.value.code == "unknown-marker-set"
    whole, _ = com_m(tmp_path / "whole", walk, None)
    result, codes = com_m(tmp_path / "cast", clusters, static_of(walk))
    assert np.nanmax(np.abs(result - whole)) < 0.001
    assert "isb" in codes["named-by-static"]
    assert "QLTH1 (l_thigh_t1)" in codes["technical-clusters"]
    assert "l_knee_lateral" in codes["markers-rebuilt"]


def test_each_marker_belongs_to_the_segment_it_moves_with(walk: Recording) -> None:
    named = identify(tuple(walk.markers_m)).landmarks
    left = {name: label for name, label in named.items() if name not in JOINTS}
    few = ("fibula_head", "tibial_tuberosity", "trochanter")
    left = {name: label for name, label in left.items() if name[2:] not in few}
    result = technical_landmarks(without(walk, JOINTS), left, static_of(walk), {k: named[k] for k in (*left, *JOINTS)})
    assert len([name for name in result if "_thigh_" in name or "_shank_" in name]) == len(result) == 16
    for name, label in result.items():
        assert label.startswith((f"Q{name[0].upper()}{name[2:4].upper()}", *named.values()))


def test_markers_of_the_foot_do_not_carry_the_ankle(walk: Recording) -> None:
    """Three markers on the heel bone lie within 15 cm of the shank and are rigid, but they move with the foot."""
    named = identify(tuple(walk.markers_m)).landmarks
    tracks = np.stack([walk.markers_m[named[f"l_{name}"]] for name in ("heel", "mt1", "mt5")], axis=1)
    R, t = rigid_motion(tracks[0], tracks)
    heel = tracks[0][0] + np.array([[0.01, 0.02, 0.02], [0.01, -0.03, 0.0], [0.03, 0.0, 0.03]])
    more = dict(walk.markers_m) | {f"QCA{k}": np.asarray(R @ point + t) for k, point in enumerate(heel)}
    hidden = [k for k in walk.markers_m if k.startswith("Q")]
    both = replace(walk, markers_m={k: v for k, v in more.items() if k not in hidden})
    ankle = ("l_ankle_lateral", "l_ankle_medial", "l_fibula_head", "l_tibial_tuberosity")
    seen = {name: label for name, label in named.items() if name not in ankle}
    result = technical_landmarks(both, seen, static_of(both), seen | {k: named[k] for k in ankle[:2]})
    assert set(result.values()) == {named[name] for name in ankle[2:]}, "the shank's own markers, without a name here"


def test_a_marker_that_moves_within_its_cluster_is_left_out(walk: Recording) -> None:
    loose = dict(walk.markers_m)
    loose["QLTH2"] = loose["QLTH2"] + 0.03 * np.sin(7.0 * walk.time_s)[:, None]
    moving = replace(walk, markers_m=loose)
    labels = [f"QLTH{k}" for k in range(1, 5)]
    assert rigid_subset(labels, moving, static_of(walk)) == ["QLTH1", "QLTH3", "QLTH4"]
    assert rigid_subset(labels, walk, static_of(walk)) == labels


def test_a_walk_that_marks_its_joints_needs_no_cluster(walk: Recording) -> None:
    named = identify(tuple(walk.markers_m)).landmarks
    assert technical_landmarks(walk, named, static_of(walk), named) == {}
