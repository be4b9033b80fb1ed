"""The synchronous client, for scripts, notebooks and the command line.

Written by ``scripts/make_sync_client.py`` from the asynchronous one: edit that.
"""

import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, contextmanager
from http import HTTPStatus
from pathlib import Path
from types import TracebackType
from typing import Any, TypeVar

import httpx
from pydantic import BaseModel

from stridelab.client import endpoints, uploads
from stridelab.client.connection import (
    DEFAULT_URL,
    RETRY_S,
    connection_headers,
    is_temporary,
    poll_s,
    request_arguments,
    unreachable_error,
)
from stridelab.client.errors import ClientError, ProblemError
from stridelab.client.sse import EventReader
from stridelab.client.streams import ComStream, open_sync
from stridelab.schemas.base import Page
from stridelab.schemas.jobs import FINAL_STATES, Job, JobEvent, JobResult
from stridelab.schemas.population import RecordingBatch
from stridelab.schemas.previews import PlanPreview, PlanPreviewInput, Solvers
from stridelab.schemas.reachability import RobotReachability
from stridelab.schemas.recordings import Recording, RecordingPatch, Subject, SubjectFields, SubjectInput
from stridelab.schemas.robots import Measure, RobotFacts, RobotPreparation, RobotSummary
from stridelab.schemas.scenarios import Scenario, ScenarioCheck, StoredScenario
from stridelab.schemas.service import Health
from stridelab.schemas.streams import StreamConfiguration

T = TypeVar("T")


class Client:
    """Client of one service. Methods raise ``ProblemError`` for an error response, ``Unreachable`` if there is none."""

    def __init__(
        self,
        base_url: str = DEFAULT_URL,
        token: str | None = None,
        *,
        timeout_s: float = 30.0,
        transport: httpx.BaseTransport | None = None,
    ) -> None:
        self._timeout_s, self._headers = timeout_s, connection_headers(token)
        self._http = httpx.Client(base_url=base_url, headers=self._headers, timeout=timeout_s, transport=transport)

    def __enter__(self) -> "Client":  # noqa: PYI034 (beartype cannot check Self here)
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def close(self) -> None:
        """Close the connections."""
        self._http.close()

    def health(self) -> Health:
        """Health and version of the service."""
        return self._send(endpoints.get_health())

    def upload(
        self,
        path: Path,
        subject: SubjectFields | None = None,
        *,
        filename: str | None = None,
        session_id: str | None = None,
        progress: uploads.ProgressCallback | None = None,
    ) -> Recording:
        """Upload a recording, which is parsed on return; ``progress(sent_bytes, total_bytes)`` is called meanwhile."""
        upload = uploads.Upload(path, subject or SubjectFields(), filename, session_id)
        with self._translate_errors():
            response = self._http.post(uploads.PATH, content=upload.pieces(progress), headers=upload.headers())
        endpoints.raise_for_problem(response)
        return endpoints.response_reader(Recording)(response)

    def upload_batch(
        self,
        files: Sequence[tuple[str, Path]],
        table: str | None = None,
        *,
        progress: uploads.ProgressCallback | None = None,
    ) -> RecordingBatch:
        """Upload many files (name, path), or zips of them, with the subject table (CSV); parsed on return.

        If the service reads them in a job, waits for it; a failed job raises ``ProblemError``.
        """
        upload = uploads.BatchUpload(files, table)
        with self._translate_errors():
            response = self._http.post(
                uploads.BATCH_PATH,
                content=upload.pieces(progress),
                headers=upload.headers(),
                timeout=uploads.BATCH_TIMEOUT_S,
            )
        endpoints.raise_for_problem(response)
        if response.status_code != HTTPStatus.ACCEPTED:
            return endpoints.response_reader(RecordingBatch)(response)
        job = self.wait(endpoints.response_reader(Job)(response).id)
        if job.state != "succeeded":
            raise uploads.refusal_of(job)
        summary = self.result(job.id).summary
        return uploads.batch_of(summary, [self.recording(one) for one in summary["recording_ids"]])

    def recordings(
        self,
        limit: int = 50,
        cursor: str | None = None,
        session_id: str | None = None,
        *,
        subject_id: str | None = None,
        linked: bool | None = None,
    ) -> Page[Recording]:
        """One page of recordings, newest first; optionally of one session or subject, or with or without a subject."""
        return self._send(endpoints.list_recordings(limit, cursor, session_id, subject_id, linked))

    def recording(self, recording_id: str) -> Recording:
        """One recording."""
        return self._send(endpoints.get_recording(recording_id))

    def patch_recording(self, recording_id: str, patch: RecordingPatch) -> Recording:
        """Change the fields that are set in ``patch``."""
        return self._send(endpoints.patch_recording(recording_id, patch))

    def delete_recording(self, recording_id: str) -> None:
        """Delete a recording with its jobs, results and files."""
        self._send(endpoints.delete_recording(recording_id))

    def download_file(self, recording_id: str, target: Path) -> Path:
        """Save the uploaded file as ``target``."""
        return self._download(endpoints.file_path(recording_id), target)

    def download_tracks(self, recording_id: str, target: Path) -> Path:
        """Save markers and wrenches as ``target`` (Parquet)."""
        return self._download(endpoints.tracks_path(recording_id), target)

    def subjects(self, limit: int = 50, cursor: str | None = None) -> Page[Subject]:
        """One page of subjects, newest first."""
        return self._send(endpoints.list_subjects(limit, cursor))

    def subject(self, subject_id: str) -> Subject:
        """One subject."""
        return self._send(endpoints.get_subject(subject_id))

    def add_subject(self, fields: SubjectInput) -> Subject:
        """Add a subject."""
        return self._send(endpoints.add_subject(fields))

    def patch_subject(self, subject_id: str, fields: SubjectInput) -> Subject:
        """Change the fields that are set in ``fields``."""
        return self._send(endpoints.patch_subject(subject_id, fields))

    def delete_subject(self, subject_id: str) -> None:
        """Delete a subject; its recordings remain."""
        self._send(endpoints.delete_subject(subject_id))

    def scenarios(self, limit: int = 50, cursor: str | None = None) -> Page[StoredScenario]:
        """One page of scenarios, newest first."""
        return self._send(endpoints.list_scenarios(limit, cursor))

    def scenario(self, scenario_id: str) -> StoredScenario:
        """One scenario."""
        return self._send(endpoints.get_scenario(scenario_id))

    def add_scenario(self, body: Scenario | Mapping[str, Any]) -> StoredScenario:
        """Store a scenario; one that the robot cannot perform is refused (``scenario-invalid``)."""
        return self._send(endpoints.add_scenario(body))

    def put_scenario(
        self, scenario_id: str, body: Scenario | Mapping[str, Any], unless_changed: StoredScenario | None = None
    ) -> StoredScenario:
        """Replace a scenario; refused (``scenario-changed``) if it differs from ``unless_changed`` in the meantime."""
        return self._send(endpoints.put_scenario(scenario_id, body, unless_changed))

    def delete_scenario(self, scenario_id: str) -> None:
        """Delete a scenario; its jobs remain."""
        self._send(endpoints.delete_scenario(scenario_id))

    def check_scenario(self, body: Scenario | Mapping[str, Any]) -> ScenarioCheck:
        """Validate a scenario: faults, and the margin of each contact."""
        return self._send(endpoints.check_scenario(body))

    def solvers(self) -> Solvers:
        """Solvers of the centroidal problem, and the reason for unavailable ones."""
        return self._send(endpoints.list_solvers())

    def preview_plan(self, body: PlanPreviewInput | Mapping[str, Any]) -> PlanPreview:
        """Compute the centroidal motion of a scenario, optionally with a push; requires the C++ solver."""
        return self._send(endpoints.preview_plan(body))

    def robots(self) -> Page[RobotSummary]:
        """All robots."""
        return self._send(endpoints.list_robots())

    def robot(self, name: str) -> RobotFacts:
        """Facts of one robot; takes a few seconds if it is not prepared yet."""
        return self._send(endpoints.get_robot(name))

    def robot_preparation(self, name: str) -> RobotPreparation:
        """State of the preparation of a robot's display files; starts the preparation if necessary."""
        return self._send(endpoints.robot_preparation(name))

    def robot_reachability(self, name: str, measure: Measure | None = None) -> RobotReachability:
        """Reachability of the centre of mass: samples, surfaces and maps; by default with the measure of plans."""
        return self._send(endpoints.robot_reachability(name, measure))

    def robot_links(self, name: str, target: Path) -> Path:
        """Save the display meshes of a robot as ``target`` (binary glTF); slow if they do not exist yet."""
        return self._download(endpoints.links_path(name), target, wait_s=endpoints.LOADING_TIMEOUT_S)

    def submit(
        self,
        kind: str,
        request: BaseModel | Mapping[str, Any],
        *,
        priority: int = 0,
        idempotency_key: str | None = None,
    ) -> Job:
        """Submit a job; repeating the request with the same ``idempotency_key`` returns the same job."""
        return self._send(endpoints.submit_job(kind, request, priority, idempotency_key))

    def jobs(
        self,
        limit: int = 50,
        cursor: str | None = None,
        *,
        state: str | None = None,
        kind: str | None = None,
        recording_id: str | None = None,
        scenario_id: str | None = None,
    ) -> Page[Job]:
        """One page of jobs, newest first."""
        filters = {"state": state, "kind": kind, "recording_id": recording_id, "scenario_id": scenario_id}
        return self._send(endpoints.list_jobs(limit, cursor, **filters))

    def job(self, job_id: str, wait_s: float = 0.0) -> Job:
        """One job; waits up to ``wait_s`` (at most 60 s) for it to finish."""
        return self._send(endpoints.get_job(job_id, wait_s))

    def wait(self, job_id: str, timeout_s: float | None = None) -> Job:
        """Wait until a job has finished. Raises ``TimeoutError`` after ``timeout_s``; None waits indefinitely."""
        deadline = None if timeout_s is None else time.monotonic() + timeout_s
        failures = 0
        while True:
            left_s = None if deadline is None else deadline - time.monotonic()
            try:
                job = self.job(job_id, wait_s=poll_s(left_s))
                failures = 0
            except ClientError as error:
                if failures == len(RETRY_S) or not is_temporary(error):
                    raise
                time.sleep(RETRY_S[failures])
                failures += 1
                continue
            if job.state in FINAL_STATES:
                return job
            if left_s is not None and left_s <= 0:
                raise TimeoutError(f"job {job_id} is still {job.state} after {timeout_s} s")

    def events(self, job_id: str, last_event_id: int | None = None) -> Iterator[JobEvent]:
        """Yield the events of a job until it has finished; an interrupted stream is resumed."""
        reader = EventReader()
        reader.last_id = None if last_event_id is None else str(last_event_id)
        failures = 0
        while True:
            headers = {"Accept": "text/event-stream"}
            if reader.last_id is not None:
                headers["Last-Event-ID"] = reader.last_id
            try:
                with self._http.stream("GET", endpoints.events_path(job_id), headers=headers) as response:
                    if response.status_code >= 400:
                        response.read()
                        endpoints.raise_for_problem(response)
                    for line in response.iter_lines():
                        event = reader.feed(line)
                        if event is not None:
                            failures = 0
                            yield event
                            if event.state in FINAL_STATES:
                                return
            except (ProblemError, httpx.TransportError) as error:
                if isinstance(error, ProblemError) and (failures == len(RETRY_S) or not is_temporary(error)):
                    raise
                if failures == len(RETRY_S):
                    raise unreachable_error(str(self._http.base_url), error) from error
            reader.reset()
            time.sleep(RETRY_S[min(failures, len(RETRY_S) - 1)])
            failures += 1

    def cancel(self, job_id: str) -> Job:
        """Cancel a job that has not finished."""
        return self._send(endpoints.cancel_job(job_id))

    def delete_job(self, job_id: str) -> Job:
        """Delete a finished job with its result and files; an unfinished one is cancelled instead."""
        return self._send(endpoints.delete_job(job_id))

    def result(self, job_id: str) -> JobResult:
        """Summary and list of files of a succeeded job."""
        return self._send(endpoints.get_result(job_id))

    def download_artifact(self, job_id: str, name: str, target: Path) -> Path:
        """Save one file of a result as ``target``."""
        return self._download(endpoints.artifact_path(job_id, name), target)

    def download_bundle(self, job_id: str, target: Path) -> Path:
        """Save input, result, versions, references and all files of a job as a zip file ``target``."""
        return self._download(endpoints.bundle_path(job_id), target)

    def read_artifact(self, job_id: str, name: str) -> bytes:
        """Content of one file of a result."""
        return self._send(
            endpoints.Call("GET", endpoints.artifact_path(job_id, name), lambda response: response.content)
        )

    def stream_com(self, configuration: StreamConfiguration) -> AbstractContextManager[ComStream]:
        """Online estimation: ``with lab.stream_com(...) as stream``, then ``stream.send(samples)``."""
        return open_sync(str(self._http.base_url), self._headers, configuration, self._timeout_s)

    def _send(self, call: endpoints.Call[T]) -> T:
        with self._translate_errors():
            response = self._http.request(call.method, call.path, **request_arguments(call, self._timeout_s))
        endpoints.raise_for_problem(response)
        return call.read(response)

    def _download(self, path: str, target: Path, wait_s: float = 0.0) -> Path:
        part = target.with_name(f".part-{target.name}")
        try:
            with self._translate_errors():
                with self._http.stream("GET", path, timeout=self._timeout_s + wait_s) as response:
                    if response.status_code >= 400:
                        response.read()
                        endpoints.raise_for_problem(response)
                    with part.open("wb") as file:
                        for piece in response.iter_bytes():
                            file.write(piece)
            return part.replace(target)
        finally:
            part.unlink(missing_ok=True)

    @contextmanager
    def _translate_errors(self) -> Iterator[None]:
        try:
            yield
        except httpx.TransportError as error:
            raise unreachable_error(str(self._http.base_url), error) from error
