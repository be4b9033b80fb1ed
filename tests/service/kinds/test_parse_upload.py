"""What an upload yields, on the shipped sample whose truth is known."""

import shutil
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest

from stridelab.errors import InvalidInput, UnreadableFile
from stridelab.schemas.recordings import PlateSwitch, RecordingFacts
from stridelab.schemas.tasks import ParseUploadTask, RecordingSource
from stridelab.service.kinds import parse_upload
from stridelab.service.processes.child import with_json
from support.command_line import SAMPLE, RecordedProgress, quiet

AXES = "xyz"


def parsed(folder: Path, **switches: object) -> RecordingFacts:
    folder.mkdir(exist_ok=True)
    shutil.copyfile(SAMPLE / "recording.c3d", folder / "trial")
    source = RecordingSource.model_validate({"file": "trial", "filename": "walk.c3d", **switches})
    outcome = parse_upload.run(ParseUploadTask(recording=source), folder, quiet)
    assert [a.name for a in outcome.artifacts] == ["tracks.parquet", "tracks.csv"]
    return RecordingFacts.model_validate(outcome.summary)


def columns(table: Path, *names: str) -> np.ndarray:
    read = pq.read_table(table)
    return np.column_stack([read[name].to_numpy() for name in names])


def test_facts_of_the_sample(tmp_path: Path) -> None:
    facts = parsed(tmp_path)
    assert (facts.n_frames, facts.marker_rate_hz, facts.force_rate_hz) == (400, 100.0, 1000.0)
    assert facts.subject.model_dump(exclude_none=True) == {"height_m": 1.71, "mass_kg": 60.0, "sex": "female"}
    assert [plate.index for plate in facts.plates] == [1, 2]
    assert all(len(plate.loaded_s) == 1 for plate in facts.plates)
    assert facts.walking_direction == pytest.approx([1, 0, 0], abs=0.05)
    assert set(facts.landmarks.values()) <= set(facts.labels)


def test_joint_centres_of_the_segment_model_are_stored_for_the_scene(tmp_path: Path) -> None:
    label_of = parsed(tmp_path).landmarks
    tracks = tmp_path / "tracks.parquet"

    def read_track(name: str) -> np.ndarray:
        return columns(tracks, *(f"{name}_{axis}_m" for axis in AXES))

    for side in "lr":
        outer, inner = (read_track(label_of[f"{side}_knee_{which}"]) for which in ("lateral", "medial"))
        np.testing.assert_allclose(read_track(f"joint_{side}_knee"), (outer + inner) / 2, atol=1e-5)
        thigh_m = np.linalg.norm(read_track(f"joint_{side}_hip") - read_track(f"joint_{side}_knee"), axis=1)
        assert 0.35 < np.median(thigh_m) < 0.5
        assert np.ptp(thigh_m) < 0.03


def test_inside_the_window_the_plates_add_up_to_the_true_wrench(tmp_path: Path) -> None:
    parsed(tmp_path)
    tracks, truth = tmp_path / "tracks.parquet", SAMPLE / "truth.parquet"
    time_s = columns(tracks, "time_s")[:, 0]
    complete = columns(tracks, "complete")[:, 0].astype(bool)
    force = sum(columns(tracks, *(f"plate{i}_f{a}_n" for a in AXES)) for i in (1, 2))
    moment = sum(columns(tracks, *(f"plate{i}_m{a}_nm" for a in AXES)) for i in (1, 2))
    # the sample's force is 12 ms late
    true_force, true_moment = (
        np.column_stack([np.interp(time_s - 0.012, time_s, track) for track in columns(truth, *names).T])
        for names in ([f"f{a}_n" for a in AXES], [f"m{a}_nm" for a in AXES])
    )
    assert complete.sum() > 60
    assert np.sqrt(np.mean((force - true_force)[complete] ** 2)) < 8.0
    assert np.sqrt(np.mean((moment - true_moment)[complete] ** 2)) < 12.0
    assert np.abs((force - true_force)[~complete]).max() > 100.0, "outside, the plates miss a foot"


def test_the_centre_of_pressure_lies_on_its_plate_and_is_missing_when_unloaded(tmp_path: Path) -> None:
    facts = parsed(tmp_path)
    for plate in facts.plates:
        cop = columns(tmp_path / "tracks.parquet", *(f"plate{plate.index}_cop{a}_m" for a in AXES))
        loaded = columns(tmp_path / "tracks.parquet", f"plate{plate.index}_fz_n")[:, 0] > 60.0
        corners = np.array(plate.corners_m)
        inside = (cop[loaded] > corners.min(axis=0) - 0.03) & (cop[loaded] < corners.max(axis=0) + 0.03)
        assert inside[:, :2].all()
        assert np.abs(cop[loaded][:, 2]).max() < 1e-6
        unloaded = columns(tmp_path / "tracks.parquet", f"plate{plate.index}_fz_n")[:, 0] < 10.0
        assert np.isnan(cop[unloaded]).all()


def test_switches_change_the_facts(tmp_path: Path) -> None:
    first_off = {1: PlateSwitch(use=False)}
    facts = parsed(tmp_path, plates=first_off)
    assert [plate.use for plate in facts.plates] == [False, True]
    assert facts.windows_s != parsed(tmp_path / "all").windows_s
    higher = parsed(tmp_path / "higher", plates={1: PlateSwitch(threshold_n=300.0)})
    assert higher.plates[0].threshold_n == 300.0
    assert higher.plates[0].loaded_s[0][0] > facts.plates[0].loaded_s[0][0]


def test_a_marker_map_that_does_not_fit_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InvalidInput) as refusal:
        parsed(tmp_path, marker_map={"l_asis": "NOBODY"})
    assert any("NOBODY" in f"{fault.where} {fault.message}" for fault in refusal.value.faults)


def test_a_truncated_file_is_refused_by_its_own_name(tmp_path: Path) -> None:
    whole = (SAMPLE / "recording.c3d").read_bytes()
    (tmp_path / "trial").write_bytes(whole[: len(whole) // 2])
    source = RecordingSource(file="trial", filename="cut off.c3d")
    with pytest.raises(UnreadableFile) as refusal:
        parse_upload.run(ParseUploadTask(recording=source), tmp_path, quiet)
    assert "trial" not in [fault.where for fault in refusal.value.faults]
    assert {path.name for path in tmp_path.iterdir()} == {"trial"}


def test_progress_reaches_the_end_and_the_child_speaks_json(tmp_path: Path) -> None:
    shutil.copyfile(SAMPLE / "recording.c3d", tmp_path / "trial")
    progress = RecordedProgress()
    source = RecordingSource(file="trial", filename="walk.c3d")
    task = ParseUploadTask(recording=source).model_dump(mode="json")
    outcome = with_json(parse_upload.run)(task, tmp_path, progress)
    RecordingFacts.model_validate(outcome["summary"])
    assert progress.fractions[-1] == 1.0
