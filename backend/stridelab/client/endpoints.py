"""HTTP calls of the service as data: the request, and the parser of its response. Both clients use these."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any, Generic, TypeVar
from urllib.parse import quote

import httpx
from pydantic import BaseModel, TypeAdapter, ValidationError

from stridelab.client.errors import ClientError, ProblemError
from stridelab.schemas.base import Page, Problem
from stridelab.schemas.jobs import Job, JobResult
from stridelab.schemas.previews import PlanPreview, PlanPreviewInput, Solvers
from stridelab.schemas.reachability import RobotReachability
from stridelab.schemas.recordings import Recording, RecordingPatch, Subject, SubjectInput
from stridelab.schemas.robots import Measure, RobotFacts, RobotPreparation, RobotSummary
from stridelab.schemas.scenarios import Scenario, ScenarioCheck, StoredScenario
from stridelab.schemas.service import Health

T = TypeVar("T")
API = "/api/v1"
MAX_WAIT_S = 60.0
LOADING_TIMEOUT_S = 180.0
"""Additional timeout for requests that may load a robot or create its meshes for the first time."""


@dataclass(frozen=True)
class Call(Generic[T]):
    """One HTTP request and the parser of its response."""

    method: str
    path: str
    read: Callable[[httpx.Response], T]
    params: Mapping[str, str] = field(default_factory=dict)
    headers: Mapping[str, str] = field(default_factory=dict)
    json: Any = None
    wait_s: float = 0.0


def response_reader(kind: type[T]) -> Callable[[httpx.Response], T]:
    """Create a parser of responses of type ``kind``; fields added by newer services are ignored."""
    adapter = TypeAdapter(kind)

    def parse_response(response: httpx.Response) -> T:
        try:
            return adapter.validate_json(response.content, extra="ignore")
        except ValidationError as error:
            raise ClientError(f"{response.url} sent a response that this client cannot parse") from error

    return parse_response


def read_nothing(_: httpx.Response) -> None:
    """Parser of an empty response."""


def raise_for_problem(response: httpx.Response) -> None:
    """Raise ``ProblemError`` if the status is 400 or above; the content must have been read."""
    if response.status_code < 400:
        return
    try:
        problem = Problem.model_validate_json(response.content, extra="ignore")
    except ValidationError:
        problem = Problem(
            title=response.reason_phrase or "error",
            status=response.status_code,
            code="http-error",
            detail=f"{response.url} answered {response.status_code} without a problem description.",
        )
    after = response.headers.get("retry-after", "")
    raise ProblemError(problem, float(after) if after.isdecimal() else None)


def get_health() -> Call[Health]:
    """Health of the service."""
    return Call("GET", f"{API}/health", response_reader(Health))


def _list_page(path: str, page: type[T], limit: int, cursor: str | None, **filters: str | None) -> Call[T]:
    params = {"limit": str(limit), "cursor": cursor, **filters}
    return Call(
        "GET", path, response_reader(page), {name: value for name, value in params.items() if value is not None}
    )


def list_recordings(
    limit: int,
    cursor: str | None,
    session_id: str | None = None,
    subject_id: str | None = None,
    linked: bool | None = None,
) -> Call[Page[Recording]]:
    """A page of recordings, optionally of one session or subject, or only those with or without a subject."""
    filters = {"session_id": session_id, "subject_id": subject_id}
    filters["linked"] = None if linked is None else str(linked).lower()
    return _list_page(f"{API}/recordings", Page[Recording], limit, cursor, **filters)


def get_recording(recording_id: str) -> Call[Recording]:
    """One recording."""
    return Call("GET", _path_of("recordings", recording_id), response_reader(Recording))


def patch_recording(recording_id: str, patch: RecordingPatch) -> Call[Recording]:
    """Change the set fields of a recording."""
    return Call("PATCH", _path_of("recordings", recording_id), response_reader(Recording), json=_set_fields(patch))


def delete_recording(recording_id: str) -> Call[None]:
    """Delete a recording."""
    return Call("DELETE", _path_of("recordings", recording_id), read_nothing)


def list_subjects(limit: int, cursor: str | None) -> Call[Page[Subject]]:
    """A page of subjects."""
    return _list_page(f"{API}/subjects", Page[Subject], limit, cursor)


def get_subject(subject_id: str) -> Call[Subject]:
    """One subject."""
    return Call("GET", _path_of("subjects", subject_id), response_reader(Subject))


def add_subject(fields: SubjectInput) -> Call[Subject]:
    """Add a subject."""
    return Call("POST", f"{API}/subjects", response_reader(Subject), json=_set_fields(fields))


def patch_subject(subject_id: str, fields: SubjectInput) -> Call[Subject]:
    """Change the set fields of a subject."""
    return Call("PATCH", _path_of("subjects", subject_id), response_reader(Subject), json=_set_fields(fields))


def delete_subject(subject_id: str) -> Call[None]:
    """Delete a subject."""
    return Call("DELETE", _path_of("subjects", subject_id), read_nothing)


def list_scenarios(limit: int, cursor: str | None) -> Call[Page[StoredScenario]]:
    """A page of scenarios."""
    return _list_page(f"{API}/scenarios", Page[StoredScenario], limit, cursor)


def get_scenario(scenario_id: str) -> Call[StoredScenario]:
    """One scenario."""
    return Call("GET", _path_of("scenarios", scenario_id), response_reader(StoredScenario))


def add_scenario(body: Scenario | Mapping[str, Any]) -> Call[StoredScenario]:
    """Store a scenario."""
    return Call("POST", f"{API}/scenarios", response_reader(StoredScenario), json=_scenario_fields(body))


def put_scenario(
    scenario_id: str, body: Scenario | Mapping[str, Any], unless_changed: StoredScenario | None
) -> Call[StoredScenario]:
    """Replace a scenario; with ``unless_changed``, only if its ETag is unchanged."""
    headers = {} if unless_changed is None else {"If-Match": unless_changed.etag}
    return Call(
        "PUT",
        _path_of("scenarios", scenario_id),
        response_reader(StoredScenario),
        headers=headers,
        json=_scenario_fields(body),
    )


def delete_scenario(scenario_id: str) -> Call[None]:
    """Delete a scenario."""
    return Call("DELETE", _path_of("scenarios", scenario_id), read_nothing)


def check_scenario(body: Scenario | Mapping[str, Any]) -> Call[ScenarioCheck]:
    """Check a scenario."""
    return Call("POST", f"{API}/scenarios/check", response_reader(ScenarioCheck), json=_scenario_fields(body))


def list_solvers() -> Call[Solvers]:
    """Solvers of the centroidal problem."""
    return Call("GET", f"{API}/solvers", response_reader(Solvers), wait_s=LOADING_TIMEOUT_S)


def preview_plan(body: PlanPreviewInput | Mapping[str, Any]) -> Call[PlanPreview]:
    """Preview the plan of a scenario."""
    content = _set_fields(body) if isinstance(body, BaseModel) else dict(body)
    return Call("POST", f"{API}/plans/preview", response_reader(PlanPreview), json=content, wait_s=LOADING_TIMEOUT_S)


def list_robots() -> Call[Page[RobotSummary]]:
    """All robots."""
    return Call("GET", f"{API}/robots", response_reader(Page[RobotSummary]))


def get_robot(name: str) -> Call[RobotFacts]:
    """Facts of one robot."""
    return Call("GET", _path_of("robots", name), response_reader(RobotFacts), wait_s=LOADING_TIMEOUT_S)


def robot_preparation(name: str) -> Call[RobotPreparation]:
    """State of the preparation of one robot."""
    return Call("GET", _path_of("robots", name, "preparation"), response_reader(RobotPreparation))


def robot_reachability(name: str, measure: Measure | None) -> Call[RobotReachability]:
    """Reachability densities of one robot, for display."""
    params = {} if measure is None else {"measure": measure}
    return Call(
        "GET",
        _path_of("robots", name, "reachability"),
        response_reader(RobotReachability),
        params,
        wait_s=LOADING_TIMEOUT_S,
    )


def submit_job(
    kind: str, request: BaseModel | Mapping[str, Any], priority: int, idempotency_key: str | None
) -> Call[Job]:
    """Submit a job."""
    body = _set_fields(request) if isinstance(request, BaseModel) else dict(request)
    headers = {"Idempotency-Key": idempotency_key} if idempotency_key is not None else {}
    return Call("POST", _path_of("jobs", kind), response_reader(Job), {"priority": str(priority)}, headers, body)


def list_jobs(limit: int, cursor: str | None, **filters: str | None) -> Call[Page[Job]]:
    """A page of jobs; ``filters`` are ``state``, ``kind``, ``recording_id`` and ``scenario_id``."""
    return _list_page(f"{API}/jobs", Page[Job], limit, cursor, **filters)


def get_job(job_id: str, wait_s: float) -> Call[Job]:
    """One job; the service waits up to ``wait_s`` for it to finish."""
    params = {"wait": f"{wait_s:g}"} if wait_s > 0 else {}
    return Call("GET", _path_of("jobs", job_id), response_reader(Job), params, wait_s=wait_s)


def cancel_job(job_id: str) -> Call[Job]:
    """Cancel a job; a finished one is not changed."""
    return Call("DELETE", _path_of("jobs", job_id), response_reader(Job), {"cancel_only": "true"})


def delete_job(job_id: str) -> Call[Job]:
    """Delete a finished job."""
    return Call("DELETE", _path_of("jobs", job_id), response_reader(Job))


def get_result(job_id: str) -> Call[JobResult]:
    """Result of a job."""
    return Call("GET", _path_of("jobs", job_id, "result"), response_reader(JobResult))


def events_path(job_id: str) -> str:
    """Path of the event stream of a job."""
    return _path_of("jobs", job_id, "events")


def artifact_path(job_id: str, name: str) -> str:
    """Path of an artifact."""
    return _path_of("jobs", job_id, "artifacts", name)


def bundle_path(job_id: str) -> str:
    """Path of the archive of a job."""
    return _path_of("jobs", job_id, "bundle.zip")


def file_path(recording_id: str) -> str:
    """Path of the uploaded file of a recording."""
    return _path_of("recordings", recording_id, "file")


def tracks_path(recording_id: str) -> str:
    """Path of the markers and wrenches of a recording."""
    return _path_of("recordings", recording_id, "tracks.parquet")


def links_path(name: str) -> str:
    """Path of the display meshes of a robot."""
    return _path_of("robots", name, "links")


def _path_of(*parts: str) -> str:
    return "/".join((API, *(quote(part, safe="") for part in parts)))


def _scenario_fields(body: Scenario | Mapping[str, Any]) -> Any:
    """The fields of ``Scenario`` only, so that a ``StoredScenario`` can be sent as well."""
    if not isinstance(body, Scenario):
        return dict(body)
    return body.model_dump(mode="json", include=set(Scenario.model_fields), exclude_unset=True)


def _set_fields(request: BaseModel) -> Any:
    return request.model_dump(mode="json", exclude_unset=True)
