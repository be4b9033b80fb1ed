"""Proxy to the viewer process: viser's page and its websocket."""

import asyncio
import ssl
from dataclasses import replace
from functools import cache
from http import HTTPStatus
from typing import Any
from urllib.parse import quote, urlsplit

import httpx
import websockets
from starlette.concurrency import run_in_threadpool
from starlette.exceptions import HTTPException
from starlette.requests import HTTPConnection, Request
from starlette.responses import JSONResponse, Response
from starlette.websockets import WebSocket, WebSocketDisconnect
from websockets.asyncio.client import ClientConnection
from websockets.exceptions import ConnectionClosed

from stridelab.client import ClientError
from stridelab.schemas.base import Problem
from stridelab_web import viser_client
from stridelab_web.api_client import client_of
from stridelab_web.config import WebConfig
from stridelab_web.languages import COOKIE, chosen_language
from stridelab_web.scene.documents import KEY_HEADER, LABELLED, USER_HEADER, Document, document_of

OPENING_S = 120.0
STARTING_RETRIES = 7
"""Retries while the viewer is starting and refuses connections, over about 30 seconds."""
SHARE_MESSAGE = b"ShareUrl"
"""Type name inside the messages that ask viser for a tunnel through an external server."""


class ViewerUnavailable(Exception):
    """The viewer process does not answer, or cannot show the document."""

    def __init__(self, detail: str, status: int = 503, code: str = "viewer-unavailable") -> None:
        super().__init__(detail)
        self.status, self.code = status, code


PASSED_STATUSES = frozenset({404, 429})
"""Status codes of the viewer that are passed on; others become 503."""


async def scene_page(request: Request) -> Response:
    """``GET /view/scene/{kind}/{id}/{job}/``: the page of viser's client, which requests its files by name."""
    client = await run_in_threadpool(viser_client.built_client)
    headers = {"Content-Security-Policy": viser_client.CONTENT_POLICY, "Cache-Control": "no-cache"}
    return Response(client.page, media_type="text/html; charset=utf-8", headers=headers)


async def open_scene(request: Request) -> Response:
    """``POST /view/scene/{kind}/{id}/{job}/open``: build or update the scene.

    The field ``said`` is the reason why the last change from within the scene was refused, or empty.
    """
    try:
        opened = await _open_in_viewer(request, _document_of(request))
    except ViewerUnavailable as error:
        problem = Problem(
            title=HTTPStatus(error.status).phrase, status=error.status, code=error.code, detail=str(error)
        )
        return JSONResponse(
            problem.model_dump(mode="json"), status_code=error.status, media_type="application/problem+json"
        )
    return JSONResponse({"ready": True, "said": opened["said"]})


async def player_file(request: Request) -> Response:
    """``GET /view/scene/{kind}/{id}/{job}/motion.{form}``: a recording of the scene for viser's own player."""
    form = request.path_params["form"]
    try:
        answer = await _post_to_viewer(request, f"players/{form}", _document_of(request))
    except ViewerUnavailable as error:
        raise HTTPException(error.status, str(error)) from error
    headers = {"Content-Disposition": f'attachment; filename="motion.{form}"', "Cache-Control": "no-store"}
    return Response(answer.content, media_type="application/octet-stream", headers=headers)


async def relay_websocket(socket: WebSocket) -> None:
    """The websocket of viser's client (its page's address without the last slash).

    The service has checked host, origin and login; the origin is checked again, because a foreign page with access to
    this socket could read the recording. The socket is accepted before the scene is
    built: viser's client gives up after some seconds, and tries again only in a window that has the focus.
    """
    origin = socket.headers.get("origin")
    if origin is not None and urlsplit(origin).netloc != socket.headers.get("host"):
        await socket.close(4403, "foreign-origin")
        return
    versions = socket.scope["subprotocols"]
    await socket.accept(subprotocol=versions[0] if versions else None)
    try:
        document = _document_of(socket)
        opened = await _open_in_viewer(socket, document)
        upstream = await websockets.connect(
            f"ws://127.0.0.1:{opened['port']}/{opened['secret']}",
            subprotocols=[websockets.Subprotocol(name) for name in versions[:1]],
            max_size=None,
            compression=None,
            proxy=None,
            user_agent_header=None,
            additional_headers={USER_HEADER: quote(_user_of(socket)), **await _right_headers(socket, document)},
        )
    except ViewerUnavailable as error:
        await socket.close(1013, error.code)
        return
    except (ClientError, OSError, websockets.InvalidHandshake):
        await socket.close(1013, "viewer-unavailable")
        return
    async with upstream:
        tasks = [
            asyncio.create_task(_relay_to_viewer(socket, upstream)),
            asyncio.create_task(_relay_to_browser(socket, upstream)),
        ]
        await asyncio.wait(tasks, return_when=asyncio.FIRST_COMPLETED)
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)


async def _right_headers(socket: WebSocket, document: Document) -> dict[str, str]:
    """Headers with the key that stores changes made through this websocket; without one, the page stores a copy."""
    if document.kind != "scenario":
        return {}
    stored = await client_of(socket).scenario(document.id)
    right = socket.app.state.config.scenario_right(socket.scope, stored.id, stored.owner)
    return {} if right.key is None else {KEY_HEADER: right.key}


async def _relay_to_viewer(socket: WebSocket, upstream: ClientConnection) -> None:
    while True:
        try:
            message = await socket.receive_bytes()
            if SHARE_MESSAGE not in message:
                await upstream.send(message)
        except (WebSocketDisconnect, ConnectionClosed, KeyError):
            return  # the other direction is ended by the caller


async def _relay_to_browser(socket: WebSocket, upstream: ClientConnection) -> None:
    try:
        async for message in upstream:
            await socket.send_bytes(message if isinstance(message, bytes) else message.encode())
    except WebSocketDisconnect:
        return
    await socket.close(1001, "scene-closed")


def _document_of(connection: HTTPConnection) -> Document:
    try:
        document = document_of(connection.path_params)
    except KeyError as error:
        raise ViewerUnavailable("There is no such scene.", 404, "scene-not-found") from error
    if document.kind not in LABELLED:
        return document
    config: WebConfig = connection.app.state.config
    accepted = connection.headers.get("accept-language", "")
    return replace(document, language=chosen_language(connection.cookies.get(COOKIE), accepted, config.language))


def _user_of(connection: HTTPConnection) -> str:
    config: WebConfig = connection.app.state.config
    return config.user_of(connection.scope)


async def _open_in_viewer(connection: HTTPConnection, document: Document) -> dict[str, Any]:
    """``port`` and ``secret`` of the scene of ``document``; the viewer builds the scene unless it is open."""
    opened: dict[str, Any] = (await _post_to_viewer(connection, "scenes", document)).json()
    return opened


@cache
def _trusted_certificates() -> ssl.SSLContext:
    """Read once: reading them takes 25 ms, during which this process answers no other request."""
    return httpx.create_ssl_context()


async def _post_to_viewer(connection: HTTPConnection, path: str, document: Document) -> httpx.Response:
    """The viewer's response about ``document``. Raises ``ViewerUnavailable`` if it refuses or does not answer."""
    config: WebConfig = connection.app.state.config
    if config.viewer_url is None:
        raise ViewerUnavailable("This service runs without a viewer.")
    headers = {"Authorization": f"Bearer {config.token}"} if config.token else {}
    wanted = {**document.request_body, "user": _user_of(connection)}
    patient = httpx.AsyncHTTPTransport(retries=STARTING_RETRIES, verify=_trusted_certificates())
    try:
        async with httpx.AsyncClient(transport=patient, timeout=OPENING_S) as viewer:
            answer = await viewer.post(f"{config.viewer_url}/{path}", json=wanted, headers=headers)
        refusal = answer.json() if answer.is_error else {}
    except (httpx.HTTPError, ValueError) as error:
        raise ViewerUnavailable("The viewer does not answer. It may be starting; try again.") from error
    if answer.is_error:
        detail, code = refusal.get("detail", "The viewer cannot show this."), refusal.get("code", "viewer-unavailable")
        status = answer.status_code if answer.status_code in PASSED_STATUSES else 503
        raise ViewerUnavailable(str(detail), status, str(code))
    return answer
