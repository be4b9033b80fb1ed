"""``python -m stridelab_web.viewer``: the viewer process.

``STRIDELAB_VIEWER_URL`` says at which loopback address it listens, ``STRIDELAB_HOST`` and ``STRIDELAB_PORT`` where the
HTTP interface is, ``STRIDELAB_API_TOKEN`` or ``STRIDELAB_API_TOKEN_FILE`` how to log in there.
"""

import asyncio
import contextlib
import os
import tempfile
from collections.abc import AsyncIterator
from pathlib import Path
from urllib.parse import urlsplit

import httpx
import uvicorn
from starlette.applications import Starlette

from stridelab.client import Client
from stridelab.schemas.recordings import Recording
from stridelab_web.frames import Frames, build_frames
from stridelab_web.tables import read_columns
from stridelab_web.viewer.control import create_control
from stridelab_web.viewer.library import Document, Library

COM_TABLE = "com.parquet"
TIDY_EVERY_S = 30.0
_EVERYWHERE = {"0.0.0.0": "127.0.0.1", "::": "[::1]", "": "127.0.0.1"}  # noqa: S104


def service_url() -> str:
    """Address of the HTTP interface, seen from this machine."""
    host = os.environ.get("STRIDELAB_HOST", "")
    return f"http://{_EVERYWHERE.get(host, host)}:{os.environ.get('STRIDELAB_PORT', '8000')}"


def token() -> str | None:
    """The API token, if one is set."""
    file = os.environ.get("STRIDELAB_API_TOKEN_FILE")
    text = Path(file).read_text(encoding="utf-8") if file else os.environ.get("STRIDELAB_API_TOKEN", "")
    return text.strip() or None


def load(client: Client, document: Document, recording: Recording) -> Frames:
    """The frames of a document, read through the HTTP interface."""
    with tempfile.TemporaryDirectory(prefix="stridelab-") as folder:
        tracks = client.download_tracks(recording.id, Path(folder) / "tracks.parquet").read_bytes()
        com = None
        if document.job_id is not None:
            com = client.download_artifact(document.job_id, COM_TABLE, Path(folder) / COM_TABLE).read_bytes()
    return build_frames(recording, read_columns(tracks), None if com is None else read_columns(com))


def main() -> None:
    """Listen until the process is ended."""
    here = urlsplit(os.environ.get("STRIDELAB_VIEWER_URL", "http://127.0.0.1:8765"))
    # An explicit transport keeps proxies of the environment out of a loopback connection.
    client = Client(service_url(), token(), transport=httpx.HTTPTransport())
    library = Library(
        look_up=lambda document: client.recording(document.recording_id),
        load=lambda document, recording: load(client, document, recording),
    )

    @contextlib.asynccontextmanager
    async def lifespan(_: Starlette) -> AsyncIterator[None]:
        tidying = asyncio.create_task(tidy(library))
        yield
        tidying.cancel()
        await asyncio.to_thread(library.close)

    control = create_control(library, token())
    control.router.lifespan_context = lifespan
    uvicorn.run(control, host=here.hostname or "127.0.0.1", port=here.port or 8765, log_level="warning", ws="none")


async def tidy(library: Library) -> None:
    """Close scenes that nobody looks at, for ever."""
    while True:
        await asyncio.sleep(TIDY_EVERY_S)
        await asyncio.to_thread(library.close_idle)


if __name__ == "__main__":
    main()
