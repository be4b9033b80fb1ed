"""Deleting a recording deletes, or names, the studies and reports that hold its person."""

import httpx
import pytest

from stridelab.service.api.jobs import delete
from stridelab.service.kinds.registry import KINDS
from support.service.stored_rows import add_recording, publish_result, start_job
from support.service.web_server import Served, refusal_code

JOBS = "/api/v1/jobs"


@pytest.mark.parametrize("with_studies", [False, True])
def test_a_deleted_recording_is_deleted_from_studies_or_they_are_named(
    http: httpx.Client, service: Served, with_studies: bool
) -> None:
    one, other = (service.run(add_recording(service.parts)) for _ in range(2))
    person = {"recording_id": one, "subject": "Jane Doe", "height_m": 1.66}
    studies = [
        service.run(service.parts.store.submit("study-population", {"recording_ids": ids, "subjects": [person]})).job_id
        for ids in ([one, other], [other])
    ]
    for study in studies:
        service.run(publish_result(service.parts, service.run(start_job(service.parts, study))))
    answer = http.delete(f"/api/v1/recordings/{one}", params={"with_studies": str(with_studies).lower()})
    assert answer.status_code == 204
    assert answer.headers.get("Stridelab-Kept-In") == (None if with_studies else studies[0])
    assert http.get(f"{JOBS}/{studies[0]}").status_code == (404 if with_studies else 200)
    assert http.get(f"{JOBS}/{studies[1]}").status_code == 200


@pytest.mark.parametrize("field", ["reference_recording_ids", "before_recording_ids"])
def test_reports_beside_a_deleted_recording_are_named_and_deleted(
    http: httpx.Client, service: Served, field: str
) -> None:
    reported, beside = (service.run(add_recording(service.parts)) for _ in range(2))
    body = {"recording_ids": [reported], field: [beside], "title": "Jane Doe"}
    report = service.run(service.parts.store.submit("gait-report", body)).job_id
    service.run(publish_result(service.parts, service.run(start_job(service.parts, report))))
    studies = service.run(delete.studies_of(service.parts, [beside]))
    assert studies == [report]
    answer = http.delete(f"/api/v1/recordings/{beside}", params={"with_studies": "true"})
    assert (answer.status_code, answer.headers.get("Stridelab-Kept-In")) == (204, None)
    assert http.get(f"{JOBS}/{report}").status_code == 404


@pytest.mark.parametrize("kind", ["com-bench", "gait-measures", "gait-report", "study-population"])
def test_unknown_recordings_are_refused_before_a_job_waits(http: httpx.Client, kind: str) -> None:
    answer = http.post(f"{JOBS}/{kind}", json={"recording_ids": ["0" * 31]})
    assert refusal_code(answer) == (404, "recording-not-found")


def test_every_list_of_recordings_is_searched_when_one_is_deleted() -> None:
    lists = {
        name
        for kind in KINDS.values()
        for name in kind.input_model.model_fields
        if "recording" in name and name.endswith("ids")
    }
    assert lists == set(delete.RECORDING_LISTS)
