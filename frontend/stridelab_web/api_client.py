"""HTTP client of the pages."""

import tempfile
from collections.abc import Awaitable
from pathlib import Path
from typing import TypeVar

from starlette.requests import HTTPConnection

from stridelab.client import AsyncClient, ProblemError
from stridelab.schemas.jobs import Job
from stridelab_web.config import WebConfig

TIMEOUT_S = 60.0
FILE_GONE = "file-gone"
T = TypeVar("T")


def make_client(config: WebConfig) -> AsyncClient:
    """The client of the web app."""
    return AsyncClient(config.base_url, config.token, timeout_s=TIMEOUT_S, transport=config.transport)


def client_of(connection: HTTPConnection) -> AsyncClient:
    """The client of the running web app."""
    client: AsyncClient = connection.app.state.client
    return client


def took_s(job: Job) -> float | None:
    """Seconds from start to end of a finished job, else None."""
    if job.started_at is None or job.finished_at is None:
        return None
    return (job.finished_at - job.started_at).total_seconds()


async def none_if_missing(request: Awaitable[T]) -> T | None:
    """The awaited result, or None if the service answers 404: what a page names may be deleted while it is viewed."""
    try:
        return await request
    except ProblemError as refusal:
        if refusal.status == 404:
            return None
        raise


class JobFiles:
    """Reads the files of a finished job for its page, and collects the names of those that are no longer stored.

    A page without one of its files shows what the summary of the result still contains.
    """

    def __init__(self, client: AsyncClient, job_id: str) -> None:
        self._client, self.job_id = client, job_id
        self.gone: list[str] = []

    async def read_file(self, name: str) -> bytes | None:
        """Content of an artifact, or None if its file is gone from the store.

        Raises ``ProblemError`` for every other refusal.
        """
        try:
            return await self._client.read_artifact(self.job_id, name)
        except ProblemError as refusal:
            if refusal.problem.code != FILE_GONE:
                raise
            self.gone.append(name)
            return None


async def read_tracks(client: AsyncClient, recording_id: str) -> bytes:
    """``tracks.parquet`` of a recording."""
    with tempfile.TemporaryDirectory(prefix="stridelab-") as folder:
        path = await client.download_tracks(recording_id, Path(folder) / "tracks.parquet")
        return path.read_bytes()
