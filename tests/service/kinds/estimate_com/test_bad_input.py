"""What makes no sense is refused by the job, and the refusal names the field that it is about."""

from pathlib import Path

import ezc3d
import numpy as np
import pytest
from pydantic import ValidationError

from stridelab.errors import InvalidInput, NotEstimable, StridelabError
from stridelab.schemas.jobs import EstimateComInput, EstimateComSummary
from stridelab.schemas.recordings import SubjectFields
from stridelab.service.kinds.estimate_com import run as estimate_com
from support.command_line import SAMPLE, estimate_task, quiet

TRIAL = SAMPLE / "recording.c3d"


def refusal_of(folder: Path, kind: type[StridelabError], file: Path = TRIAL, **options: object) -> StridelabError:
    with pytest.raises(kind) as refusal:
        estimate_com.run(estimate_task(file, folder, method="complementary", **options), folder, quiet)
    return refusal.value


@pytest.mark.parametrize(
    ("options", "code", "field"),
    [
        ({"cutoffs": (4.0, 0.4)}, "cutoffs-out-of-range", "cutoffs"),
        ({"cutoffs": (1.0, 1.0)}, "cutoffs-out-of-range", "cutoffs"),
        ({"cutoffs": (0.2, 60.0)}, "cutoffs-out-of-range", "cutoffs"),
        ({"cutoffs": (-0.2, 1.0)}, "cutoffs-out-of-range", "cutoffs"),
        ({"window_s": (5.0, 6.0)}, "window-outside-recording", "window_s"),
        ({"window_s": (-1.0, 1.0)}, "window-outside-recording", "window_s"),
        ({"window_s": (0.0, 1.0)}, "window-not-measured", "window_s"),
        ({"subject": SubjectFields(mass_kg=150.0)}, "mass-contradicts-force", "mass_kg"),
    ],
)
def test_a_number_that_makes_no_sense_is_refused_by_its_field(
    tmp_path: Path, options: dict[str, object], code: str, field: str
) -> None:
    refusal = refusal_of(tmp_path, InvalidInput, **options)
    assert refusal.code == code
    assert field in {fault.where for fault in refusal.faults}


@pytest.mark.parametrize("latency", [5.0, -0.2, float("nan"), float("inf"), "always"])
def test_an_absurd_latency_is_refused_by_its_field(latency: object) -> None:
    with pytest.raises(ValidationError) as refusal:
        EstimateComInput.model_validate({"recording_id": "r", "latency": latency})
    assert {error["loc"][0] for error in refusal.value.errors()} == {"latency"}


@pytest.mark.parametrize(("stated_kg", "share"), [(68.0, "-12%"), (53.0, "+13%")])
def test_a_mass_that_the_plates_contradict_is_not_used_and_both_masses_are_reported(
    tmp_path: Path, stated_kg: float, share: str
) -> None:
    """The impulse of the vertical force has an error of 1 %, so that a tenth is significant; the truth is 60 kg."""
    task = estimate_task(TRIAL, tmp_path, method="complementary", subject=SubjectFields(mass_kg=stated_kg))
    summary = EstimateComSummary.model_validate(estimate_com.run(task, tmp_path, quiet).summary)
    (message,) = (warning.message for warning in summary.warnings if warning.code == "mass-disagrees-with-force")
    assert f"{stated_kg:g} kg" in message
    assert f"{summary.mass_from_force_kg:.1f} ± " in message
    assert share in message
    assert summary.mass_source == "force"
    assert summary.mass_kg == pytest.approx(60.0, rel=0.005)


def test_forces_that_are_measured_when_no_marker_is_seen_are_refused_with_both_times(tmp_path: Path) -> None:
    content = ezc3d.c3d(str(TRIAL))
    points, residuals = content["data"]["points"], content["data"]["meta_points"]["residuals"]
    empty = points.shape[2] * 7 // 8
    points[:3, :, :empty] = np.nan
    residuals[:, :, :empty] = -1.0
    analogs = content["data"]["analogs"]
    analogs[..., analogs.shape[2] * 3 // 4 :] = 0.0
    content.write(str(tmp_path / "apart.c3d"))
    refusal = refusal_of(tmp_path / "task", NotEstimable, tmp_path / "apart.c3d")
    assert refusal.code == "forces-and-markers-apart"
    assert [fault.where for fault in refusal.faults] == ["plates", "markers"]
