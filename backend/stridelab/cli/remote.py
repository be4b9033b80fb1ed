"""Commands with ``--server``: upload a job's files, run the job there and download its result."""

import tempfile
import uuid
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

from stridelab.cli.options import Delivery, EstimateRequest
from stridelab.cli.results import Bar, progress_bar
from stridelab.client import Client, ClientError, ProblemError, Unreachable
from stridelab.errors import (
    Busy,
    Conflict,
    Fault,
    Forbidden,
    InvalidInput,
    NotEstimable,
    NotFound,
    StridelabError,
    TooLarge,
    Unavailable,
    UnreadableFile,
)
from stridelab.schemas.base import Contract, Problem
from stridelab.schemas.jobs import EstimateComInput, Job, JobResult
from stridelab.schemas.recordings import RecordingPatch
from stridelab.service.kinds.base import ArtifactFile, Outcome
from stridelab.service.local_runs import write_result

AFTER_UPLOAD, AFTER_JOB = 0.3, 0.9
"""Fractions of the bar at the end of the upload and of the job; the rest is the download."""

ErrorClass = type[StridelabError]
_CLASS_OF_STATUS: dict[int, ErrorClass] = {
    400: InvalidInput,
    401: Forbidden,
    403: Forbidden,
    404: NotFound,
    409: Conflict,
    413: TooLarge,
    503: Unavailable,
    507: Unavailable,
}


Prepare = Callable[[Client, Bar], Contract]
"""Uploads the files that the job needs and returns the job's input."""


def run_remotely(
    kind: str, title: str, prepare: Prepare, folder: Path, delivery: Delivery, *, unprepared: ErrorClass
) -> JobResult:
    """Run a job of ``kind`` on the server of ``delivery`` and download its files into ``folder``.

    Raises the error that the same request raises here, and ``Unavailable`` if the service does not answer.
    ``unprepared`` is the class of errors for requests that the service refuses during ``prepare``.
    """
    result, failure = run_remotely_or_fail(kind, title, prepare, folder, delivery, unprepared=unprepared)
    if failure is not None:
        raise failure
    return result


def run_remotely_as_is(kind: str, title: str, job_input: Contract, folder: Path, delivery: Delivery) -> JobResult:
    """``run_remotely`` for a job that needs no files."""
    return run_remotely(kind, title, lambda _client, _bar: job_input, folder, delivery, unprepared=InvalidInput)


def run_remotely_or_fail(
    kind: str, title: str, prepare: Prepare, folder: Path, delivery: Delivery, *, unprepared: ErrorClass
) -> tuple[JobResult, StridelabError | None]:
    """``run_remotely`` for a job that may leave files although it fails; returns the result and the error."""
    failure: StridelabError | None = None
    refused, server, token = unprepared, delivery.server or "", delivery.token
    with (
        translated_errors(server, lambda: refused),
        Client(server, token) as client,
        progress_bar(title) as bar,
    ):
        job_input = prepare(client, bar)
        refused = InvalidInput
        job = client.submit(kind, job_input, idempotency_key=uuid.uuid4().hex)
        finished = _follow_job(client, job.id, bar)
        if finished.state != "succeeded":
            failure = _job_failure(finished)
        try:
            result = client.result(job.id)
        except ProblemError:
            if failure is None:
                raise
            raise failure from None
        for done, artifact in enumerate(result.artifacts):
            bar(AFTER_JOB + (1.0 - AFTER_JOB) * done / len(result.artifacts), f"downloading {artifact.name}")
            client.download_artifact(job.id, artifact.name, folder / _plain_name(artifact.name))
        bar(1.0, "done")
    artifacts = tuple(ArtifactFile(a.name, a.media_type) for a in result.artifacts)
    outcome = Outcome(result.summary, tuple(result.references), artifacts)
    return write_result(folder, result.kind, job_input, outcome, versions=result.versions), failure


@contextmanager
def translated_errors(server: str, refused: Callable[[], ErrorClass] = lambda: InvalidInput) -> Iterator[None]:
    """Turn client errors of the block into ``StridelabError``; ``refused`` returns the class for status 422."""
    try:
        yield
    except ProblemError as error:
        raise _as_error(error.problem, refused(), error.retry_after_s) from error
    except Unreachable as error:
        raise Unavailable("service-unreachable", f"No service answers at {server}: {error}.") from error
    except ClientError as error:
        raise Unavailable("service-not-understood", f"{error}.") from error


def estimate_remotely(
    request: EstimateRequest,
    folder: Path,
    delivery: Delivery,
    kind: str = "estimate-com",
    model: type[EstimateComInput] = EstimateComInput,
) -> JobResult:
    """Upload the recording, run ``kind`` on it on the server, and download its files into ``folder``."""
    request.to_input("checked before anything is sent", model)
    return run_remotely(
        kind,
        request.file.name,
        lambda client, bar: request.to_input(_upload_recording(client, request, bar), model),
        folder,
        delivery,
        unprepared=UnreadableFile,
    )


def _upload_recording(client: Client, request: EstimateRequest, bar: Bar) -> str:
    """Upload the files and their given data; returns the id of the recording."""
    with tempfile.TemporaryDirectory() as folder:
        path = request.file
        if request.upload_name != path.name:
            path = Path(folder, request.upload_name)
            request.write_upload(path)
        recording = client.upload(
            path,
            request.subject_fields(),
            progress=lambda sent, total: bar(AFTER_UPLOAD * sent / max(total, 1), "uploading"),
        )
    patch: dict[str, object] = {}
    if request.static is not None:
        bar(AFTER_UPLOAD, "uploading the static trial")
        patch["static_recording_id"] = client.upload(request.static).id
    if markers := request.marker_map_for(recording.labels):
        patch["marker_map"] = markers
    if plates := request.plate_switches():
        patch["plates"] = plates
    if patch:
        client.patch_recording(recording.id, RecordingPatch.model_validate(patch))
    return recording.id


def _follow_job(client: Client, job_id: str, bar: Bar) -> Job:
    """Show the job's progress until it has finished; Ctrl-C also cancels the job."""
    try:
        for event in client.events(job_id):
            fraction = AFTER_UPLOAD + (AFTER_JOB - AFTER_UPLOAD) * event.progress.fraction
            bar(fraction, event.progress.text or event.progress.message or event.state)
        return client.wait(job_id)
    except KeyboardInterrupt:
        client.cancel(job_id)
        raise


def _plain_name(name: str) -> str:
    if not name or name in {".", ".."} or "/" in name or "\\" in name:
        raise Unavailable("service-not-understood", f"The service returned an invalid file name: {name!r}.")
    return name


def _job_failure(job: Job) -> StridelabError:
    if job.error is not None:
        return _as_error(job.error, NotEstimable)
    return Unavailable(f"job-{job.state.replace('_', '-')}", f"The job on the service has ended as {job.state}.")


def _as_error(problem: Problem, refused: type[StridelabError], retry_after_s: float | None = None) -> StridelabError:
    """Error for a problem response; ``refused`` is the class for status 422, which several classes share."""
    if problem.status == 429:
        return Busy(problem.code, problem.detail, retry_after_s or 5.0)
    faults = [Fault(item.where, item.message) for item in problem.errors]
    kind = _CLASS_OF_STATUS.get(problem.status, refused if problem.status == 422 else StridelabError)
    return kind(problem.code, problem.detail, faults)
