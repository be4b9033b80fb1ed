"""Restricts viser servers to connections of the web app.

viser checks neither origin nor login of a websocket and serves its page to every client. Here every server gets a
secret path that only the web app knows; requests for other paths, and requests of browser pages (which have an Origin),
are refused before viser handles them. viser has no hook for this, so the function that opens its socket is wrapped
while a server starts.
"""

import functools
import http
import secrets
import threading
from collections.abc import Callable
from typing import Any
from urllib.parse import unquote

import viser
import websockets.asyncio.server
from viser import _messages
from viser.infra import ClientId
from websockets.asyncio.server import ServerConnection
from websockets.datastructures import Headers
from websockets.http11 import Request, Response

from stridelab_web.scene.documents import USER_HEADER

_starting = threading.Lock()


def start_guarded_server(on_accept: Callable[[str], None] = lambda _: None) -> tuple[viser.ViserServer, str]:
    """A viser server on a free loopback port, and the secret that its websocket path must be.

    The callback is called with the user of each accepted websocket.
    """
    secret = secrets.token_urlsafe(24)
    with _starting:
        original = websockets.asyncio.server.serve
        websockets.asyncio.server.serve = functools.partial(_serve_guarded, original, secret, on_accept)  # type: ignore[misc,assignment]
        try:
            server = viser.ViserServer(host="127.0.0.1", port=0, verbose=False)
        finally:
            websockets.asyncio.server.serve = original  # type: ignore[misc]
    # The share button would open a tunnel through a server outside: it is gone, and so is what answers it.
    server.gui.configure_theme(show_share_button=False, show_logo=False)
    server.gui.main_panel.minimize()
    for message in (_messages.ShareUrlRequest, _messages.ShareUrlDisconnect):
        server._websock_server.unregister_handler(message)  # noqa: SLF001  (viser is pinned; a test looks)
    return server, secret


def header_of(server: viser.ViserServer, client_id: int, name: str) -> str | None:
    """A header with which the websocket of a client was opened; None without it, and for disconnected clients."""
    connection = server._websock_server._live_connections.get(ClientId(client_id))  # noqa: SLF001  (viser is pinned)
    return None if connection is None or connection.request is None else connection.request.headers.get(name)


def users_of(server: viser.ViserServer) -> list[str]:
    """The user of each websocket that is open, as ``USER_HEADER`` names it."""
    connections = list(server._websock_server._live_connections.values())  # noqa: SLF001  (viser is pinned)
    return [_user_of(connection.request) for connection in connections if connection.request is not None]


def _user_of(request: Request) -> str:
    return unquote(request.headers.get(USER_HEADER, ""))


def _serve_guarded(original: Any, secret: str, on_accept: Callable[[str], None], *args: Any, **options: Any) -> Any:
    viser_answers = options.pop("process_request")

    def process_request(connection: ServerConnection, request: Request) -> Response | None:
        authorised = secrets.compare_digest(request.path.encode(), f"/{secret}".encode())
        if not authorised or "Origin" in request.headers or request.headers.get("Upgrade", "").lower() != "websocket":
            return Response(http.HTTPStatus.FORBIDDEN, "Forbidden", Headers(), b"")
        answer: Response | None = viser_answers(connection, request)
        if answer is None:
            on_accept(_user_of(request))
        return answer

    return original(*args, process_request=process_request, **options)
