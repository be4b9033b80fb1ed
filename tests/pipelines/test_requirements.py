"""Every refusal names what is missing."""

from pathlib import Path

import numpy as np
import pytest

from stridelab.errors import InvalidInput, NotEstimable
from stridelab.pipelines.com_inputs import require_marker_set, require_method, require_windows
from stridelab.pipelines.estimate_com import build_estimator
from stridelab.pipelines.trial import Trial
from stridelab.recordings.marker_sets import identify
from stridelab.recordings.recording import Plate, Recording, Subject, Window
from stridelab.schemas.jobs import EstimateComInput
from stridelab.schemas.methods import METHODS, Method

CORNERS = np.array([[0.3, 0.2, 0.0], [-0.3, 0.2, 0.0], [-0.3, -0.2, 0.0], [0.3, -0.2, 0.0]])


def plate(force_n: float, *, use: bool = True) -> Plate:
    force = np.zeros((1000, 3))
    force[:, 2] = force_n
    return Plate(1, 2, CORNERS, force, np.zeros((1000, 3)), np.zeros(3), use=use)


def trial(*plates: Plate, windows: tuple[Window, ...] = (), n_frames: int = 100) -> Trial:
    recording = Recording(
        markers_m={"A": np.zeros((n_frames, 3))},
        marker_rate_hz=100.0,
        force_rate_hz=1000.0,
        plates=plates,
        subject=Subject(),
        events=(),
        up_axis="+z",
        walking_direction=None,
    )
    return Trial(recording, identify(["A"]), windows, (), ())


@pytest.mark.parametrize("method", METHODS)
def test_every_method_of_the_contract_is_an_estimator_of_that_name(method: Method) -> None:
    assert require_method(method) == method
    assert build_estimator(method, EstimateComInput(recording_id="any", method=method)).name == method


def test_a_method_that_is_not_there_names_what_is() -> None:
    with pytest.raises(NotEstimable) as refusal:
        require_method("magic")
    assert refusal.value.code == "method-unavailable"
    assert all(name in refusal.value.message for name in METHODS)
    assert refusal.value.faults[0].where == "method"


def test_unknown_labels_are_listed_with_the_nearest_set() -> None:
    labels = ["LASI", "RASI", "LSHO", "LELB", "CLAV", "foo", "bar"]
    with pytest.raises(NotEstimable) as refusal:
        require_marker_set(identify(labels), labels)
    assert refusal.value.code == "unknown-marker-set"
    assert "plug-in-gait" in refusal.value.message
    assert [f.message for f in refusal.value.faults if f.where == "labels found"] == [", ".join(labels)]
    assert any("missing" in f.message and f.where.startswith("nearest set") for f in refusal.value.faults)


@pytest.mark.parametrize(
    ("given", "code"),
    [
        (trial(n_frames=1), "single-frame"),
        (trial(), "no-plates"),
        (trial(plate(700.0, use=False)), "plates-switched-off"),
        (trial(plate(3.0)), "plates-unloaded"),
    ],
)
def test_no_force_is_refused_by_its_reason(given: Trial, code: str) -> None:
    with pytest.raises(NotEstimable) as refusal:
        require_windows(given, None, needs_force=True)
    assert refusal.value.code == code
    assert require_windows(given, None, needs_force=False) == ()


MEASURED = (Window(0.2, 0.6), Window(0.7, 0.9))


@pytest.mark.parametrize("asked", [(0.2, 0.6), (0.25, 0.5), (0.195, 0.5), (0.7, 0.8)])
def test_an_interval_inside_a_measured_window_is_taken(asked: tuple[float, float]) -> None:
    assert require_windows(trial(windows=MEASURED), asked, needs_force=True) == (Window(*asked),)


@pytest.mark.parametrize("asked", [(0.1, 0.5), (0.3, 0.8), (0.65, 0.68), (0.15, 0.95)])
def test_any_other_interval_is_refused_and_the_measured_ones_listed(asked: tuple[float, float]) -> None:
    with pytest.raises(InvalidInput) as refusal:
        require_windows(trial(windows=MEASURED), asked, needs_force=True)
    assert refusal.value.code == "window-not-measured"
    assert "0.20 to 0.60 s, 0.70 to 0.90 s" in refusal.value.message
    assert refusal.value.faults[0].where == "window_s"


@pytest.mark.parametrize("asked", [(0.5, 0.3), (0.4, 0.4), (5.0, 6.0), (-0.5, 0.5), (0.3, 1.2)])
@pytest.mark.parametrize("needs_force", [True, False])
def test_an_interval_that_the_recording_does_not_have_is_refused_with_its_length(
    asked: tuple[float, float], needs_force: bool
) -> None:
    with pytest.raises(InvalidInput) as refusal:
        require_windows(trial(windows=MEASURED), asked, needs_force=needs_force)
    assert refusal.value.code == "window-outside-recording"
    assert "from 0 to 1.00 s" in refusal.value.message
    assert refusal.value.faults[0].where == "window_s"


def test_errors_name_the_uploaded_file_not_its_copy(tmp_path: Path) -> None:
    from stridelab.errors import UnreadableFile
    from stridelab.pipelines.trial import read_source
    from stridelab.schemas.tasks import RecordingSource

    (tmp_path / "trial").write_bytes(b"")
    with pytest.raises(UnreadableFile) as refusal:
        read_source(RecordingSource(file="trial", filename="walk 03.c3d"), tmp_path)
    assert refusal.value.code == "empty-file"
    assert refusal.value.faults[0].where == "walk 03.c3d"
