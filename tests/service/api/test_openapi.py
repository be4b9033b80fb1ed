"""The description is complete, its examples run, and the service keeps to it."""

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import httpx
import pytest
import schemathesis
from hypothesis import HealthCheck, Phase, settings
from schemathesis.specs.openapi.checks import positive_data_acceptance

from stridelab.errors import Fault, UnreadableFile
from stridelab.service import bundled_scenarios
from stridelab.service.api.app import create_app
from stridelab.service.api.recordings.parsing import Parsed
from stridelab.service.bundled import seed
from stridelab.service.settings import Settings
from support.interface import Served
from support.rows import add_job, add_recording, facts, start_job, succeed
from support.scenarios import add_scenario

DESCRIPTION = create_app(Settings()).openapi()
OPERATIONS = [
    (method.upper(), path, operation)
    for path, operations in DESCRIPTION["paths"].items()
    for method, operation in operations.items()
]
CHANGEABLE = "0" * 32
"""A recording and a scenario that examples may change; jobs work on the samples that every service has."""


def examples() -> Iterator[tuple[str, str, str, Any]]:
    for method, path, operation in OPERATIONS:
        content = operation.get("requestBody", {}).get("content", {}).get("application/json", {})
        for name, example in content.get("examples", {}).items():
            yield method, path, name, example["value"]


@pytest.mark.parametrize(("method", "path", "operation"), OPERATIONS, ids=lambda x: x if isinstance(x, str) else "")
def test_every_call_is_explained(method: str, path: str, operation: dict[str, Any]) -> None:
    assert operation["summary"]
    assert operation["description"].endswith((".", ")."))
    assert operation["tags"]
    content = operation.get("requestBody", {}).get("content", {})
    assert "application/json" not in content or content["application/json"]["examples"]
    good = [status for status in operation["responses"] if status.startswith(("2", "3"))]
    assert len(good) == 1
    for status, response in operation["responses"].items():
        assert response["description"]
        if status in {"204", "303"}:
            continue
        schemas = [media["schema"] for media in response["content"].values()]
        assert all(schemas)
        if status not in good:
            assert list(response["content"]) == ["application/problem+json"]
            assert schemas == [{"$ref": "#/components/schemas/Problem"}]


def test_nothing_refers_to_nowhere() -> None:
    text = json.dumps(DESCRIPTION)
    known = {f"#/components/schemas/{name}" for name in DESCRIPTION["components"]["schemas"]}
    used = {piece.split('"')[0] for piece in text.split('"$ref": "')[1:]}
    assert used <= known
    assert "HTTPValidationError" not in text


async def unreadable(*_: object) -> None:
    raise UnreadableFile("unreadable-file", "No generated file is a trial.", [Fault("file", "cannot be read")])


async def understood(_parts: object, folder: Path, *_: object) -> Parsed:
    (folder / "tracks.parquet").write_bytes(b"PAR1")
    return Parsed(facts(), folder / "tracks.parquet")


@pytest.fixture(scope="module")
def stocked(service: Served) -> Iterator[Served]:
    """Enough things with known ids that examples and generated calls find something; uploads are not parsed."""
    parts = service.parts
    service.run(seed(parts.engine, parts.blobs))
    service.run(bundled_scenarios.seed(parts.engine))
    service.run(add_scenario(parts, CHANGEABLE))
    service.run(add_recording(parts, CHANGEABLE))
    for _ in range(2):
        job_id = service.run(add_job(parts))
        service.run(succeed(parts, service.run(start_job(parts, job_id)), [("com.csv", "text/csv", b"x")]))
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("stridelab.service.api.recordings.endpoints.parse", unreadable)
        patch.setattr("stridelab.service.api.recordings.changing.parse", understood)
        yield service


@pytest.mark.parametrize(
    ("method", "path", "name", "value"), list(examples()), ids=lambda x: x if isinstance(x, str) else ""
)
def test_every_example_runs(stocked: Served, method: str, path: str, name: str, value: Any) -> None:
    with stocked.http() as http:
        subject = http.post("/api/v1/subjects", json={}).json()["subject_id"]
        place = path.replace("{subject_id}", subject)
        place = place.replace("{recording_id}", CHANGEABLE).replace("{scenario_id}", CHANGEABLE)
        answer = http.request(method, place, json=value)
    if path.endswith("/plans/preview") and answer.status_code == 422:  # on a machine without the C++ solver
        assert answer.json()["code"] == "solver-unavailable"
        return
    assert answer.status_code < 300, answer.text


schema = schemathesis.openapi.from_dict(DESCRIPTION)


# Left out: the pages' own addresses, and the stream, which ends with its job only. Not checked: that whatever fits the
# schema is accepted, because no schema can say which cursors, markers and plates exist.
@schema.include(path_regex="^/api/").exclude(path="/api/v1/jobs/{job_id}/events").parametrize()
@settings(
    max_examples=12,
    deadline=None,
    derandomize=True,
    phases=[Phase.explicit, Phase.generate],
    suppress_health_check=list(HealthCheck),
)
def test_the_service_keeps_to_its_description(case: schemathesis.Case, stocked: Served) -> None:
    if "wait" in (case.query or {}):
        case.query.pop("wait")
    answer = case.call(base_url=stocked.base_url, timeout=30)
    case.validate_response(answer, excluded_checks=[positive_data_acceptance])
    assert answer.status_code < 500
    assert answer.headers["x-content-type-options"] == ["nosniff"]


def test_the_description_is_served(http: httpx.Client) -> None:
    served = http.get("/api/v1/openapi.json").json()
    assert served["paths"] == DESCRIPTION["paths"]
