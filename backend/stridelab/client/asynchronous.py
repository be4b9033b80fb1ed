"""The asynchronous client, for web pages and other services; it has the same methods as the synchronous one."""

import asyncio
import time
from collections.abc import AsyncIterator, Iterator, Sequence
from contextlib import AbstractAsyncContextManager, contextmanager
from http import HTTPStatus
from pathlib import Path
from types import TracebackType
from typing import TypeVar

import httpx

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
from stridelab.client.methods import Endpoints
from stridelab.client.sse import EventReader
from stridelab.client.streams import (
    MARKERS_PATH,
    STREAM_PATH,
    Address,
    AsyncComStream,
    AsyncMarkerStream,
    open_async,
    watch_async,
)
from stridelab.schemas.jobs import FINAL_STATES, Job, JobEvent
from stridelab.schemas.population import RecordingBatch
from stridelab.schemas.recordings import Recording, SubjectFields
from stridelab.schemas.scenarios import ReadTerrain, TerrainUnit, UpAxis
from stridelab.schemas.streams import MarkerStreamConfiguration, StreamConfiguration

T = TypeVar("T")


class AsyncClient(Endpoints):
    """Client of one service. Methods raise ``ProblemError`` for an error response, ``Unreachable`` if there is none."""

    def __init__(
        self,
        base_url: str = DEFAULT_URL,
        token: str | None = None,
        *,
        timeout_s: float = 30.0,
        transport: httpx.AsyncBaseTransport | None = None,
    ) -> None:
        self._timeout_s, headers = timeout_s, connection_headers(token)
        self._http = httpx.AsyncClient(base_url=base_url, headers=headers, timeout=timeout_s, transport=transport)
        self._address = Address(str(self._http.base_url), headers, timeout_s)

    async def __aenter__(self) -> "AsyncClient":  # noqa: PYI034 (beartype cannot check Self here)
        return self

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        await self.close()

    async def close(self) -> None:
        """Close the connections."""
        await self._http.aclose()

    async def upload(
        self,
        path: Path,
        subject: SubjectFields | None = None,
        *,
        filename: str | None = None,
        session_id: str | None = None,
        progress: uploads.ProgressCallback | None = None,
    ) -> Recording:
        """Upload a recording, which is parsed on return; ``progress(sent_bytes, total_bytes)`` is called meanwhile."""
        form = uploads.form([(filename or path.name, path)], uploads.text_fields(subject, session_id), progress)
        with self._translate_errors():
            response = await self._http.post(uploads.PATH, **form)
        endpoints.raise_for_problem(response)
        return endpoints.response_reader(Recording)(response)

    async def read_terrain(
        self,
        path: Path,
        unit: TerrainUnit = "m",
        up: UpAxis | None = None,
        *,
        cell_m: float | None = None,
        height_range_m: float | None = None,
        filename: str | None = None,
        progress: uploads.ProgressCallback | None = None,
    ) -> ReadTerrain:
        """Find the surfaces, stairs and rails in the file of a terrain with lengths in ``unit``; nothing is stored.

        ``up`` is the axis that points up; if omitted, it is found where the points are clear, else +z, of GLB +y. A PNG
        needs ``cell_m``, the edge of its cells, and ``height_range_m`` from black to white.
        """
        stated = {"unit": unit, "up": up, "cell_m": cell_m, "height_range_m": height_range_m}
        fields = {name: str(value) for name, value in stated.items() if value is not None}
        form = uploads.form([(filename or path.name, path)], fields, progress)
        with self._translate_errors():
            response = await self._http.post(uploads.TERRAIN_PATH, **form, timeout=uploads.TERRAIN_TIMEOUT_S)
        endpoints.raise_for_problem(response)
        return endpoints.response_reader(ReadTerrain)(response)

    async def upload_batch(
        self,
        files: Sequence[tuple[str, Path]],
        table: str | None = None,
        *,
        progress: uploads.ProgressCallback | None = None,
    ) -> RecordingBatch:
        """Upload many files (name, path), or zips of them, with the subject table (CSV); parsed on return.

        If the service reads them in a job, waits for it; a failed job raises ``ProblemError``.
        """
        form = uploads.form(files, {} if table is None else {"subjects": table}, progress)
        with self._translate_errors():
            response = await self._http.post(uploads.BATCH_PATH, **form, timeout=uploads.BATCH_TIMEOUT_S)
        endpoints.raise_for_problem(response)
        if response.status_code != HTTPStatus.ACCEPTED:
            return endpoints.response_reader(RecordingBatch)(response)
        job = await self.wait(endpoints.response_reader(Job)(response).id)
        if job.state != "succeeded":
            raise uploads.refusal_of(job)
        summary = (await self.result(job.id)).summary
        return uploads.batch_of(summary, [await self.recording(one) for one in summary["recording_ids"]])

    async def wait(self, job_id: str, timeout_s: float | None = None) -> Job:
        """Wait until a job has finished. Raises ``TimeoutError`` after ``timeout_s``; None waits indefinitely."""
        deadline = None if timeout_s is None else time.monotonic() + timeout_s
        failures = 0
        while True:
            left_s = None if deadline is None else deadline - time.monotonic()
            try:
                job = await self.job(job_id, wait_s=poll_s(left_s))
                failures = 0
            except ClientError as error:
                if failures == len(RETRY_S) or not is_temporary(error):
                    raise
                await asyncio.sleep(RETRY_S[failures])
                failures += 1
                continue
            if job.state in FINAL_STATES:
                return job
            if left_s is not None and left_s <= 0:
                raise TimeoutError(f"job {job_id} is still {job.state} after {timeout_s} s")

    async def events(self, job_id: str, last_event_id: int | None = None) -> AsyncIterator[JobEvent]:
        """Yield the events of a job until it has finished; an interrupted stream is resumed."""
        reader = EventReader()
        reader.last_id = None if last_event_id is None else str(last_event_id)
        failures = 0
        while True:
            headers = {"Accept": "text/event-stream"}
            if reader.last_id is not None:
                headers["Last-Event-ID"] = reader.last_id
            try:
                async with self._http.stream("GET", endpoints.events_path(job_id), headers=headers) as response:
                    if response.status_code >= 400:
                        await response.aread()
                        endpoints.raise_for_problem(response)
                    async for line in response.aiter_lines():
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
            await asyncio.sleep(RETRY_S[min(failures, len(RETRY_S) - 1)])
            failures += 1

    def stream_com(self, configuration: StreamConfiguration) -> AbstractAsyncContextManager[AsyncComStream]:
        """Online estimation: ``async with lab.stream_com(...) as stream``, then ``await stream.send(samples)``."""
        return open_async(self._address, STREAM_PATH, configuration, AsyncComStream)

    def stream_markers(
        self, configuration: MarkerStreamConfiguration
    ) -> AbstractAsyncContextManager[AsyncMarkerStream]:
        """Live balance: ``async with lab.stream_markers(...) as stream``, then ``await stream.send(frame)``."""
        return open_async(self._address, MARKERS_PATH, configuration, AsyncMarkerStream)

    def watch_live(self, session_id: str) -> AsyncIterator[str]:
        """The messages of a live robot as JSON texts, until its session ends."""
        return watch_async(self._address, f"{endpoints.API}/live/{session_id}")

    async def _send(self, call: endpoints.Call[T]) -> T:
        with self._translate_errors():
            response = await self._http.request(call.method, call.path, **request_arguments(call, self._timeout_s))
        endpoints.raise_for_problem(response)
        return call.read(response)

    async def _save(self, file: endpoints.Download) -> Path:
        part = file.target.with_name(f".part-{file.target.name}")
        try:
            with self._translate_errors():
                async with self._http.stream("GET", file.path, timeout=self._timeout_s + file.wait_s) as response:
                    if response.status_code >= 400:
                        await response.aread()
                        endpoints.raise_for_problem(response)
                    with part.open("wb") as content:
                        async for piece in response.aiter_bytes():
                            content.write(piece)
            return part.replace(file.target)
        finally:
            part.unlink(missing_ok=True)

    @contextmanager
    def _translate_errors(self) -> Iterator[None]:
        try:
            yield
        except httpx.TransportError as error:
            raise unreachable_error(str(self._http.base_url), error) from error
