"""Force plates that are overloaded: a channel stays at its limit. Such times are found, named and not used."""

from pathlib import Path

import ezc3d
import numpy as np
import pytest

from stridelab.errors import NotEstimable
from stridelab.machine.models_folder import models_dir
from stridelab.recordings.clipped_force import FORCE_CLIPPED, clipped_frames, clipped_intervals_s
from stridelab.recordings.force_windows import find_windows, require_windows
from stridelab.recordings.marker_sets import identify
from stridelab.recordings.plate_contacts import low_pass
from stridelab.recordings.reader import read_recording
from stridelab.schemas.jobs import EstimateComInput
from stridelab.schemas.tasks import EstimateComTask, RecordingSource
from stridelab.service.kinds.estimate_com import run as estimate_com
from support.recordings.c3d_files import PlateChannels, write_file

RATE_HZ = 1000.0
SAMPLE = models_dir() / "recordings" / "sample-walk" / "recording.c3d"


def stance_n(noise_n: float, digit_n: float = 0.0, *, flat: bool = False) -> np.ndarray:
    """Vertical force of a step with two peaks, or of a slow one that is level to 3 % for half of its time."""
    t = np.linspace(0.0, 1.0, 700)
    load = 800.0 * (np.sin(np.pi * t) + 0.35 * np.sin(3.0 * np.pi * t))
    if flat:
        load = 800.0 * np.sin(0.5 * np.pi * np.minimum(1.0, 4.0 * np.minimum(t, 1.0 - t))) + 12.0 * np.sin(
            4.0 * np.pi * t
        )
    force = np.concatenate([np.zeros(300), load, np.zeros(300)])
    force = force + noise_n * np.random.default_rng(3).normal(size=len(force))
    return np.round(force / digit_n) * digit_n if digit_n else force


def times_s(force_n: np.ndarray, **ranges: np.ndarray) -> tuple[tuple[float, float], ...]:
    return clipped_intervals_s(force_n[:, None], force_n > 50.0, RATE_HZ, **ranges)


# -- one channel


@pytest.mark.parametrize("noise_n", [0.0, 0.5, 3.0])
@pytest.mark.parametrize("digit_n", [0.0, 0.1, 1.0, 2.5])
@pytest.mark.parametrize("limit_n", [300.0, 600.0])
def test_a_channel_at_its_limit_is_found_from_its_first_to_its_last_sample(
    noise_n: float, digit_n: float, limit_n: float
) -> None:
    force = stance_n(noise_n, digit_n)
    above = np.flatnonzero(force > limit_n)
    for clipped in (np.minimum(force, limit_n), np.maximum(-force, -limit_n)):
        spans = clipped_intervals_s(clipped[:, None], force > 50.0, RATE_HZ)
        assert spans[0][0] == pytest.approx(above[0] / RATE_HZ, abs=0.012)
        assert spans[-1][1] == pytest.approx(above[-1] / RATE_HZ, abs=0.012)
        found = np.zeros(len(force), dtype=bool)
        for start_s, end_s in spans:
            found[round(start_s * RATE_HZ) : round(end_s * RATE_HZ) + 1] = True
        assert not found[np.abs(clipped) < limit_n].any()


@pytest.mark.parametrize("noise_n", [0.0, 0.2, 1.0, 5.0])
@pytest.mark.parametrize("digit_n", [0.0, 0.1, 1.0, 2.5, 5.0, 10.0])
@pytest.mark.parametrize("flat", [False, True])
def test_a_channel_within_its_range_is_not_taken_for_clipped(noise_n: float, digit_n: float, flat: bool) -> None:
    """Coarse digits without noise have long runs of equal samples, at the peak above all."""
    force = stance_n(noise_n, digit_n, flat=flat)
    assert times_s(force) == ()
    assert times_s(np.where(force < 20.0, 0.0, force)) == ()


def test_an_empty_channel_a_constant_one_and_a_thresholded_one_are_not_at_a_limit() -> None:
    force = stance_n(0.0)
    loaded = force > 50.0
    for channel in (np.zeros_like(force), np.full_like(force, -700.0), np.where(loaded, 700.0, 0.0), -force * loaded):
        assert clipped_intervals_s(channel[:, None], loaded, RATE_HZ) == ()


def test_two_samples_at_the_end_of_the_stated_range_suffice() -> None:
    force = stance_n(3.0)
    limit = np.partition(force, -3)[-3]
    clipped = np.minimum(force, limit)
    assert times_s(clipped) == ()
    ranges = np.array([[-limit, limit]])
    in_a_row = np.diff(np.flatnonzero(clipped == limit)).min() == 1
    assert bool(times_s(clipped, ranges=ranges)) == in_a_row
    force[600:602] = 900.0
    assert times_s(np.minimum(force, 850.0), ranges=np.array([[-850.0, 850.0]])) == ((0.6, 0.601),)
    assert times_s(np.minimum(force, 850.0), ranges=np.array([[-900.0, 900.0]])) == ()


def test_a_filter_hides_that_a_channel_was_clipped() -> None:
    """What cannot be found: docs/theory/windows-and-mass.md says so."""
    clipped = np.minimum(stance_n(1.0), 600.0)
    smooth = low_pass(np.column_stack([clipped] * 3), RATE_HZ)[:, 0]
    assert times_s(clipped)
    assert times_s(smooth) == ()


# -- files


def clipped_sample(folder: Path, limit: float, *, channel: int = 2) -> Path:
    """The shipped walk with one channel of its first plate clipped at ``limit`` (N or Nmm)."""
    content = ezc3d.c3d(str(SAMPLE))
    k = int(np.asarray(content["parameters"]["FORCE_PLATFORM"]["CHANNEL"]["value"])[channel, 0]) - 1
    content["data"]["analogs"][0, k] = np.clip(content["data"]["analogs"][0, k], -limit, limit)
    path = folder / "clipped.c3d"
    content.write(str(path))
    return path


def estimated(path: Path, folder: Path, method: str | None = None) -> dict[str, object]:
    (folder / "trial").write_bytes(path.read_bytes())
    source = RecordingSource(file="trial", filename=path.name)
    request = EstimateComInput.model_validate({"recording_id": "r", "method": method})
    return estimate_com.run(EstimateComTask(recording=source, input=request), folder, lambda *_: None).summary


def test_the_walk_of_a_plate_clipped_at_600_n_is_not_good_and_the_times_are_named(tmp_path: Path) -> None:
    recording = read_recording(clipped_sample(tmp_path, 600.0))
    plate = recording.plates[0]
    assert recording.plates[1].clipped_s == ()
    truth = read_recording(SAMPLE)
    assert truth.plates[0].clipped_s == ()
    lost_n = np.abs(truth.plates[0].force_n[:, 2] - plate.force_n[:, 2])
    (message,) = [remark.message for remark in recording.remarks if remark.code == FORCE_CLIPPED]
    assert message.startswith(f"Plate 1 is overloaded at {plate.clipped_s[0][0]:.2f} to ")
    landmarks = identify(list(recording.markers_m)).landmarks
    unusable = clipped_frames(recording)
    for window in find_windows(recording, landmarks).windows:
        i, j = round(window.start_s * recording.marker_rate_hz), round(window.end_s * recording.marker_rate_hz)
        assert not unusable[i : j + 1].any()
        a, b = (round(t * recording.force_rate_hz) for t in (window.start_s, window.end_s))
        assert lost_n[a : b + 1].max() < 10.0
    quality = estimated(tmp_path / "clipped.c3d", tmp_path)["quality"]
    assert isinstance(quality, dict)
    assert quality["verdict"] == "doubtful"
    (check,) = [check for check in quality["checks"] if check["name"] == "force_clipped"]
    assert "Plate 1 is overloaded for" in check["message"]
    good = estimated(SAMPLE, tmp_path)["quality"]
    assert isinstance(good, dict)
    assert "force_clipped" not in {*good["not_checked"], *(check["name"] for check in good["checks"])}


def test_a_clipped_moment_channel_is_found_too(tmp_path: Path) -> None:
    recording = read_recording(clipped_sample(tmp_path, 30_000.0, channel=4))
    assert recording.plates[0].clipped_s


def test_a_plate_that_is_overloaded_throughout_refuses_with_the_reason(tmp_path: Path) -> None:
    content = ezc3d.c3d(str(clipped_sample(tmp_path, 150.0)))
    k = int(np.asarray(content["parameters"]["FORCE_PLATFORM"]["CHANNEL"]["value"])[2, 1]) - 1
    content["data"]["analogs"][0, k] = np.clip(content["data"]["analogs"][0, k], -150.0, 150.0)
    content.write(str(tmp_path / "clipped.c3d"))
    recording = read_recording(tmp_path / "clipped.c3d")
    with pytest.raises(NotEstimable, match="Plate 1 is overloaded at") as refused:
        require_windows(recording, identify(list(recording.markers_m)).landmarks)
    assert refused.value.code == "no-measured-window"
    with pytest.raises(NotEstimable, match="Plate 2 is overloaded at"):
        estimated(tmp_path / "clipped.c3d", tmp_path)
    geometry = estimated(tmp_path / "clipped.c3d", tmp_path, "geometry")["quality"]
    assert isinstance(geometry, dict)
    assert geometry["verdict"] == "good"


def test_the_range_of_a_converter_follows_from_its_bits_and_the_scale(tmp_path: Path) -> None:
    """12 bits of 0.5 N: -1024.0 to 1023.5 N; the peak is cut for three samples."""
    force = -stance_n(3.0, 0.5)
    force[500:503] = -1200.0
    signals = np.zeros((len(force), 6))
    signals[:, 2] = np.clip(force, -1024.0, 1023.5) / 0.5
    signals[:, 3:5] = np.outer(force, [10.0, -5.0])
    points = {f"M{i}": np.random.default_rng(i).normal(900.0, 300.0, (130, 3)) for i in range(4)}
    plates = [PlateChannels(2, signals)]
    path = write_file(tmp_path / "bits.c3d", points, plates=plates, parameters={("ANALOG", "BITS"): [12]})
    content = ezc3d.c3d(str(path))
    content["parameters"]["ANALOG"]["SCALE"]["value"] = np.array([1.0, 1.0, 0.5, 1.0, 1.0, 1.0])
    content["data"]["analogs"][0, 2] *= 0.5
    content.write(str(path))
    (plate,) = read_recording(path).plates
    assert plate.clipped_s == ((0.5, 0.502),)
