"""``python -m stridelab_web.viewer``: the viewer process.

``STRIDELAB_VIEWER_URL`` is its loopback address, ``STRIDELAB_HOST`` and ``STRIDELAB_PORT`` are those of the HTTP
interface, ``STRIDELAB_API_TOKEN`` or ``STRIDELAB_API_TOKEN_FILE`` has the token for it, ``STRIDELAB_VIEWER_SCENES`` and
``STRIDELAB_USER_SCENES`` limit the number of open scenes.
"""

import asyncio
import contextlib
import os
from collections.abc import AsyncIterator
from pathlib import Path
from urllib.parse import urlsplit

import httpx
import uvicorn
from starlette.applications import Starlette

from stridelab.client import Client
from stridelab.machine import heartbeat
from stridelab_web.viewer.control import create_control
from stridelab_web.viewer.scene_builders import document_kinds
from stridelab_web.viewer.scene_limits import limits_of
from stridelab_web.viewer.scene_pool import ScenePool

TIDY_EVERY_S = 30.0
REQUEST_TIMEOUT_S = 110.0
"""Timeout of requests; the meshes of a robot are prepared at the first request."""
_EVERYWHERE = {"0.0.0.0": "127.0.0.1", "::": "[::1]", "": "127.0.0.1"}  # noqa: S104


def service_url() -> str:
    """Address of the HTTP interface, seen from this machine."""
    host = os.environ.get("STRIDELAB_HOST", "")
    return f"http://{_EVERYWHERE.get(host, host)}:{os.environ.get('STRIDELAB_PORT', '8000')}"


def api_token() -> str | None:
    """The API token, if one is set."""
    file = os.environ.get("STRIDELAB_API_TOKEN_FILE")
    text = Path(file).read_text(encoding="utf-8") if file else os.environ.get("STRIDELAB_API_TOKEN", "")
    return text.strip() or None


def main() -> None:
    """Run the viewer until the process is stopped."""
    here = urlsplit(os.environ.get("STRIDELAB_VIEWER_URL", "http://127.0.0.1:8765"))

    # An explicit transport keeps proxies of the environment out of a loopback connection.
    def client_with_key(key: str | None) -> Client:
        return Client(service_url(), key, timeout_s=REQUEST_TIMEOUT_S, transport=httpx.HTTPTransport())

    library = ScenePool(document_kinds(client_with_key(api_token()), client_with_key), limits_of(os.environ))

    @contextlib.asynccontextmanager
    async def lifespan(_: Starlette) -> AsyncIterator[None]:
        tasks = [asyncio.create_task(work) for work in (close_idle_periodically(library), heartbeat.write_heartbeats())]
        yield
        for task in tasks:
            task.cancel()
        await asyncio.to_thread(library.close_all)

    control = create_control(library, api_token())
    control.router.lifespan_context = lifespan
    uvicorn.run(control, host=here.hostname or "127.0.0.1", port=here.port or 8765, log_level="warning", ws="none")


async def close_idle_periodically(library: ScenePool) -> None:
    """Close idle scenes periodically, until cancelled."""
    while True:
        await asyncio.sleep(TIDY_EVERY_S)
        await asyncio.to_thread(library.close_idle)


if __name__ == "__main__":
    main()
