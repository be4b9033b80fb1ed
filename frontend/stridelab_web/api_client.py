"""HTTP client of the pages."""

import tempfile
from pathlib import Path

from starlette.requests import HTTPConnection

from stridelab.client import AsyncClient
from stridelab_web.config import WebConfig

TIMEOUT_S = 60.0


def make_client(config: WebConfig) -> AsyncClient:
    """The client of the web app."""
    return AsyncClient(config.base_url, config.token, timeout_s=TIMEOUT_S, transport=config.transport)


def client_of(connection: HTTPConnection) -> AsyncClient:
    """The client of the running web app."""
    client: AsyncClient = connection.app.state.client
    return client


async def read_tracks(client: AsyncClient, recording_id: str) -> bytes:
    """``tracks.parquet`` of a recording."""
    with tempfile.TemporaryDirectory(prefix="stridelab-") as folder:
        path = await client.download_tracks(recording_id, Path(folder) / "tracks.parquet")
        return path.read_bytes()
