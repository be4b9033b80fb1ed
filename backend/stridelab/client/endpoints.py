"""HTTP calls of the service as data: the request, and the parser of its response.

Both clients have the functions that return a ``Call`` or a ``Download`` as methods, with their documentation.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Generic, TypeVar
from urllib.parse import quote

import httpx
from pydantic import BaseModel, TypeAdapter, ValidationError

from stridelab.client.errors import ClientError, ProblemError
from stridelab.schemas.base import Page, Problem
from stridelab.schemas.jobs import Job, JobResult
from stridelab.schemas.live.messages import LiveSession, LiveSessions
from stridelab.schemas.plans import PlanContactsInput
from stridelab.schemas.previews import PartialResults, PlanPreview, PlanPreviewInput, Solvers
from stridelab.schemas.reachability import RobotReachability
from stridelab.schemas.recordings import Recording, RecordingPatch, Subject, SubjectInput
from stridelab.schemas.robots import Measure, OwnRobot, RobotFacts, RobotPreparation, RobotSummary
from stridelab.schemas.scenarios import Course, ScaledScene, Scenario, ScenarioCheck, StoredScenario, TerrainCrossing
from stridelab.schemas.service import Health
from stridelab.schemas.streams import LiveStreams

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
    params: Mapping[str, str | Sequence[str]] = field(default_factory=dict)
    headers: Mapping[str, str] = field(default_factory=dict)
    json: Any = None
    wait_s: float = 0.0


@dataclass(frozen=True)
class Download:
    """A GET request whose response is saved as the file ``target``."""

    path: str
    target: Path
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


def health() -> Call[Health]:
    """Health and version of the service."""
    return Call("GET", f"{API}/health", response_reader(Health))


def _list_page(path: str, page: type[T], limit: int, cursor: str | None, **filters: Any) -> Call[T]:
    given = {"limit": str(limit), "cursor": cursor, **filters}
    return Call("GET", path, response_reader(page), {name: v for name, v in given.items() if v is not None})


def recordings(
    limit: int = 50,
    cursor: str | None = None,
    session_id: str | None = None,
    *,
    subject_id: str | None = None,
    linked: bool | None = None,
    search: str | None = None,
    sort: str | None = None,
) -> Call[Page[Recording]]:
    """One page of recordings; optionally of one session or subject, or with or without a subject.

    ``search`` keeps those that contain all of its words; ``sort`` is ``newest`` (default), ``oldest`` or ``name``.
    """
    filters = {"session_id": session_id, "subject_id": subject_id, "search": search, "sort": sort}
    filters["linked"] = None if linked is None else str(linked).lower()
    return _list_page(f"{API}/recordings", Page[Recording], limit, cursor, **filters)


def recording(recording_id: str) -> Call[Recording]:
    """One recording."""
    return Call("GET", _path_of("recordings", recording_id), response_reader(Recording))


def patch_recording(recording_id: str, patch: RecordingPatch) -> Call[Recording]:
    """Change the fields that are set in ``patch``."""
    return Call("PATCH", _path_of("recordings", recording_id), response_reader(Recording), json=_set_fields(patch))


def delete_recording(recording_id: str) -> Call[None]:
    """Delete a recording with its jobs, results and files."""
    return Call("DELETE", _path_of("recordings", recording_id), read_nothing)


def subjects(
    limit: int = 50, cursor: str | None = None, *, search: str | None = None, sort: str | None = None
) -> Call[Page[Subject]]:
    """One page of subjects; ``search`` and ``sort`` as for ``recordings``."""
    return _list_page(f"{API}/subjects", Page[Subject], limit, cursor, search=search, sort=sort)


def subject(subject_id: str) -> Call[Subject]:
    """One subject."""
    return Call("GET", _path_of("subjects", subject_id), response_reader(Subject))


def add_subject(fields: SubjectInput) -> Call[Subject]:
    """Add a subject."""
    return Call("POST", f"{API}/subjects", response_reader(Subject), json=_set_fields(fields))


def patch_subject(subject_id: str, fields: SubjectInput) -> Call[Subject]:
    """Change the fields that are set in ``fields``."""
    return Call("PATCH", _path_of("subjects", subject_id), response_reader(Subject), json=_set_fields(fields))


def delete_subject(subject_id: str) -> Call[None]:
    """Delete a subject; its recordings remain."""
    return Call("DELETE", _path_of("subjects", subject_id), read_nothing)


def scenarios(
    limit: int = 50, cursor: str | None = None, *, search: str | None = None, sort: str | None = None
) -> Call[Page[StoredScenario]]:
    """One page of scenarios; ``search`` and ``sort`` as for ``recordings``."""
    return _list_page(f"{API}/scenarios", Page[StoredScenario], limit, cursor, search=search, sort=sort)


def scenario(scenario_id: str) -> Call[StoredScenario]:
    """One scenario."""
    return Call("GET", _path_of("scenarios", scenario_id), response_reader(StoredScenario))


def add_scenario(body: Scenario | Mapping[str, Any]) -> Call[StoredScenario]:
    """Store a scenario; one that the robot cannot perform is refused (``scenario-invalid``)."""
    return Call("POST", f"{API}/scenarios", response_reader(StoredScenario), json=_scenario_fields(body))


def put_scenario(
    scenario_id: str, body: Scenario | Mapping[str, Any], unless_changed: StoredScenario | None = None
) -> Call[StoredScenario]:
    """Replace a scenario; refused (``scenario-changed``) if it differs from ``unless_changed`` in the meantime."""
    headers = {} if unless_changed is None else {"If-Match": unless_changed.etag}
    return Call(
        "PUT",
        _path_of("scenarios", scenario_id),
        response_reader(StoredScenario),
        headers=headers,
        json=_scenario_fields(body),
    )


def delete_scenario(scenario_id: str) -> Call[None]:
    """Delete a scenario; its jobs remain."""
    return Call("DELETE", _path_of("scenarios", scenario_id), read_nothing)


def check_scenario(body: Scenario | Mapping[str, Any]) -> Call[ScenarioCheck]:
    """Validate a scenario: faults, and the margin of each contact."""
    return Call("POST", f"{API}/scenarios/check", response_reader(ScenarioCheck), json=_scenario_fields(body))


def compose_scenario(body: Course | Mapping[str, Any]) -> Call[PlanContactsInput]:
    """Compose obstacles in a row to the input of ``plan-contacts``."""
    content = _set_fields(body) if isinstance(body, BaseModel) else dict(body)
    return Call("POST", f"{API}/scenarios/compose", response_reader(PlanContactsInput), json=content)


def cross_terrain(body: TerrainCrossing | Mapping[str, Any]) -> Call[PlanContactsInput]:
    """Compose the task of crossing a terrain, the input of ``plan-contacts``; nothing is stored."""
    content = _set_fields(body) if isinstance(body, BaseModel) else dict(body)
    return Call("POST", f"{API}/terrains/crossing", response_reader(PlanContactsInput), json=content)


def scaled_scene(body: ScaledScene | Mapping[str, Any]) -> Call[Scenario]:
    """Scale a bundled scene to a robot; nothing is stored."""
    content = body.model_dump(mode="json") if isinstance(body, BaseModel) else dict(body)
    path = f"{API}/scenarios/scaled"
    return Call("POST", path, response_reader(Scenario), json=content, wait_s=LOADING_TIMEOUT_S)


def solvers() -> Call[Solvers]:
    """Solvers of the centroidal problem, and the reason for unavailable ones."""
    return Call("GET", f"{API}/solvers", response_reader(Solvers), wait_s=LOADING_TIMEOUT_S)


def preview_plan(body: PlanPreviewInput | Mapping[str, Any]) -> Call[PlanPreview]:
    """Compute the centroidal motion of a scenario, optionally with a push; requires the C++ solver."""
    content = _set_fields(body) if isinstance(body, BaseModel) else dict(body)
    return Call("POST", f"{API}/plans/preview", response_reader(PlanPreview), json=content, wait_s=LOADING_TIMEOUT_S)


def robots() -> Call[Page[RobotSummary]]:
    """All robots."""
    return Call("GET", f"{API}/robots", response_reader(Page[RobotSummary]))


def marker_streams() -> Call[LiveStreams]:
    """Open streams of markers."""
    return Call("GET", f"{API}/stream/markers", response_reader(LiveStreams))


def live_robots() -> Call[LiveSessions]:
    """Robots that are live, the newest first."""
    return Call("GET", f"{API}/live", response_reader(LiveSessions))


def live_robot(session_id: str) -> Call[LiveSession]:
    """One robot that is live."""
    return Call("GET", _path_of("live", session_id), response_reader(LiveSession))


def start_live(
    scenario_id: str | None = None, robot: str | None = None, velocity: tuple[float, float, float] | None = None
) -> Call[LiveSession]:
    """Start a live robot: the motion of a stored scenario, or a level walk of a robot.

    With ``velocity`` (ahead, left in m/s, turning in rad/s) it walks with it instead.
    """
    body: dict[str, Any] = {"scenario_id": scenario_id} if robot is None else {"robot": robot}
    if velocity is not None:
        body["velocity"] = velocity
    return Call("POST", f"{API}/live", response_reader(LiveSession), json=body)


def end_live(session_id: str) -> Call[None]:
    """End a live robot."""
    return Call("DELETE", _path_of("live", session_id), read_nothing)


def robot(name: str) -> Call[RobotFacts]:
    """Facts of one robot; takes a few seconds if it is not prepared yet."""
    return Call("GET", _path_of("robots", name), response_reader(RobotFacts), wait_s=LOADING_TIMEOUT_S)


def robot_card(name: str) -> Call[OwnRobot]:
    """Card of a robot that a user uploaded; a bundled robot has none to be read (``bundled-read-only``)."""
    return Call("GET", _path_of("robots", name, "card"), response_reader(OwnRobot))


def delete_robot(name: str) -> Call[None]:
    """Delete one's own robot; refused while scenarios or jobs need it (``robot-in-use``)."""
    return Call("DELETE", _path_of("robots", name), read_nothing)


def robot_preparation(name: str) -> Call[RobotPreparation]:
    """State of the preparation of a robot's display files; starts the preparation if necessary."""
    return Call("GET", _path_of("robots", name, "preparation"), response_reader(RobotPreparation))


def robot_reachability(name: str, measure: Measure | None = None) -> Call[RobotReachability]:
    """Reachability of the centre of mass: samples, surfaces and maps; by default with the measure of plans."""
    params = {} if measure is None else {"measure": measure}
    path = _path_of("robots", name, "reachability")
    return Call("GET", path, response_reader(RobotReachability), params, wait_s=LOADING_TIMEOUT_S)


def submit(
    kind: str, request: BaseModel | Mapping[str, Any], *, priority: int = 0, idempotency_key: str | None = None
) -> Call[Job]:
    """Submit a job; repeating the request with the same ``idempotency_key`` returns the same job."""
    body = _set_fields(request) if isinstance(request, BaseModel) else dict(request)
    headers = {"Idempotency-Key": idempotency_key} if idempotency_key is not None else {}
    return Call("POST", _path_of("jobs", kind), response_reader(Job), {"priority": str(priority)}, headers, body)


def jobs(
    limit: int = 50,
    cursor: str | None = None,
    *,
    state: str | None = None,
    kind: str | None = None,
    recording_id: str | None = None,
    scenario_id: str | Sequence[str] | None = None,
    one_per_scenario: bool = False,
    search: str | None = None,
) -> Call[Page[Job]]:
    """One page of jobs, newest first; ``search`` looks in names. ``one_per_scenario``: of each only the newest."""
    filters = {"state": state, "kind": kind, "recording_id": recording_id, "scenario_id": scenario_id}
    filters |= {"one_per_scenario": "true" if one_per_scenario else None, "search": search}
    return _list_page(f"{API}/jobs", Page[Job], limit, cursor, **filters)


def job(job_id: str, wait_s: float = 0.0) -> Call[Job]:
    """One job; waits up to ``wait_s`` (at most 60 s) for it to finish."""
    params = {"wait": f"{wait_s:g}"} if wait_s > 0 else {}
    return Call("GET", _path_of("jobs", job_id), response_reader(Job), params, wait_s=wait_s)


def cancel(job_id: str) -> Call[Job]:
    """Cancel a job that has not finished."""
    return Call("DELETE", _path_of("jobs", job_id), response_reader(Job), {"cancel_only": "true"})


def delete_job(job_id: str) -> Call[Job]:
    """Delete a finished job with its result and files; an unfinished one is cancelled instead."""
    return Call("DELETE", _path_of("jobs", job_id), response_reader(Job))


def partial_results(job_id: str, after: str = "") -> Call[PartialResults]:
    """Parts of the result of a running job that follow the cursor ``after``; a finished job has none."""
    params = {"after": after} if after else {}
    return Call("GET", _path_of("jobs", job_id, "partial"), response_reader(PartialResults), params)


def result(job_id: str) -> Call[JobResult]:
    """Summary and list of files of a succeeded job."""
    return Call("GET", _path_of("jobs", job_id, "result"), response_reader(JobResult))


def events_path(job_id: str) -> str:
    """Path of the event stream of a job."""
    return _path_of("jobs", job_id, "events")


def read_artifact(job_id: str, name: str) -> Call[bytes]:
    """Content of one file of a result."""
    return Call("GET", _path_of("jobs", job_id, "artifacts", name), lambda response: response.content)


def download_artifact(job_id: str, name: str, target: Path) -> Download:
    """Save one file of a result as ``target``."""
    return Download(_path_of("jobs", job_id, "artifacts", name), target)


def download_bundle(job_id: str, target: Path) -> Download:
    """Save input, result, versions, references and all files of a job as a zip file ``target``."""
    return Download(_path_of("jobs", job_id, "bundle.zip"), target)


def download_file(recording_id: str, target: Path) -> Download:
    """Save the uploaded file as ``target``."""
    return Download(_path_of("recordings", recording_id, "file"), target)


def download_tracks(recording_id: str, target: Path) -> Download:
    """Save markers and wrenches as ``target`` (Parquet)."""
    return Download(_path_of("recordings", recording_id, "tracks.parquet"), target)


def robot_links(name: str, target: Path) -> Download:
    """Save the display meshes of a robot as ``target`` (binary glTF); slow if they do not exist yet."""
    return Download(_path_of("robots", name, "links"), target, wait_s=LOADING_TIMEOUT_S)


def _path_of(*parts: str) -> str:
    return "/".join((API, *(quote(part, safe="") for part in parts)))


def _scenario_fields(body: Scenario | Mapping[str, Any]) -> Any:
    """The fields of ``Scenario`` only, so that a ``StoredScenario`` can be sent as well."""
    if not isinstance(body, Scenario):
        return dict(body)
    return body.model_dump(mode="json", include=set(Scenario.model_fields), exclude_unset=True)


def _set_fields(request: BaseModel) -> Any:
    return request.model_dump(mode="json", exclude_unset=True)
