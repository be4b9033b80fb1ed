"""``estimate-com`` on the zip of an OpenSim model: every estimator against the closed form of a rocking human."""

from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest

from stridelab.schemas.jobs import EstimateComSummary
from stridelab.schemas.methods import METHODS
from stridelab.schemas.recordings import RecordingFacts, SubjectFields
from stridelab.schemas.tasks import ParseUploadTask, RecordingSource
from stridelab.service.estimable import estimate_offers
from stridelab.service.kinds import parse_upload
from stridelab.service.kinds.estimate_com import run as estimate_com
from support.command_line import estimate_task, quiet
from support.recordings.body_model_files import (
    MASS_KG,
    human_links,
    model_text,
    rocking_com_m,
    rocking_members,
    write_zip,
)

MEMBERS = rocking_members()


def truth_m(time_s: np.ndarray) -> np.ndarray:
    """Closed form in the world frame, z up."""
    com = rocking_com_m(time_s)
    return np.column_stack([com[:, 0], -com[:, 2], com[:, 1]])


@pytest.mark.parametrize("method", METHODS)
def test_every_estimator_takes_the_centre_of_mass_of_the_model(tmp_path: Path, method: str) -> None:
    trial = write_zip(tmp_path / "trial.zip", MEMBERS)
    folder = tmp_path / "job"
    outcome = estimate_com.run(estimate_task(trial, folder, method=method), folder, quiet)
    summary = EstimateComSummary.model_validate(outcome.summary)
    table = pq.read_table(folder / "com.parquet").to_pydict()
    com = np.column_stack([table[f"{axis}_m"] for axis in "xyz"])
    error = np.abs(com - truth_m(np.array(table["time_s"])))
    assert error.max() < 0.005
    sd = np.column_stack([table[f"sd_{axis}_m"] for axis in "xyz"])
    assert (error < 2.0 * sd).all()
    assert (summary.method, summary.segment_table) == (method, "carried")
    assert summary.quality.verdict == "good"
    assert "body-model" in {remark.code for remark in summary.warnings}
    if method != "geometry":
        assert summary.mass_kg == pytest.approx(MASS_KG)


def test_a_wrong_force_contradicts_the_mass_of_the_model(tmp_path: Path) -> None:
    heavy = MEMBERS["subject.osim"].replace("<mass>32.0</mass>", "<mass>60.0</mass>")
    trial = write_zip(tmp_path / "trial.zip", MEMBERS | {"subject.osim": heavy})
    outcome = estimate_com.run(estimate_task(trial, tmp_path / "job"), tmp_path / "job", quiet)
    assert outcome.summary["quality"]["verdict"] != "good"


def model_without(*bodies: str) -> str:
    return model_text([link for link in human_links() if link.body not in bodies])


@pytest.mark.parametrize(
    ("bodies", "lacks"),
    [
        (("torso",), "the trunk"),
        (tuple(link.body for link in human_links() if link.body[-2:] in ("_r", "_l")), "a leg"),
    ],
)
def test_a_model_of_a_part_of_a_body_contradicts_a_person(tmp_path: Path, bodies: tuple[str, ...], lacks: str) -> None:
    trial = write_zip(tmp_path / "trial.zip", MEMBERS | {"subject.osim": model_without(*bodies)})
    task = estimate_task(trial, tmp_path / "job", method="geometry")
    summary = EstimateComSummary.model_validate(estimate_com.run(task, tmp_path / "job", quiet).summary)
    assert summary.quality.verdict == "contradicted"
    (check,) = [check for check in summary.quality.checks if not check.passed]
    assert check.name == "model_leg_mass"
    assert f"lack {lacks}" in check.message


@pytest.mark.parametrize("renamed", [False, True])
def test_the_upload_offers_every_method_whatever_the_bodies_are_called(tmp_path: Path, renamed: bool) -> None:
    members = MEMBERS
    if renamed:
        text = members["subject.osim"]
        for name in ("femur", "tibia", "talus", "calcn", "toes"):
            text = text.replace(f"{name}_", f"Segment{name}")
        members = members | {"subject.osim": text}
    write_zip(tmp_path / "trial", members)
    task = ParseUploadTask(recording=RecordingSource(file="trial", filename="trial.zip"))
    facts = RecordingFacts.model_validate(parse_upload.run(task, tmp_path, quiet).summary)
    assert facts.marker_set == ("body-model" if renamed else "opensim-bodies")
    assert facts.subject.mass_kg == MASS_KG
    assert facts.missing_landmarks == []
    assert not {remark.code for remark in facts.warnings} & {"head-missing", "sex-unknown"}
    offers = estimate_offers(facts, SubjectFields(), no_other_mass_source=True)
    assert [offer.method for offer in offers if not offer.possible] == []
