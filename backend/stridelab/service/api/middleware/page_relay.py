"""Lets a second web server render the pages that read from the database only, so that they delay no other request.

A page takes 5 to 30 ms of processor time, in which the event loop of a web server answers nothing else.
"""

import re
from typing import Final

import httpx
import structlog
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from stridelab.service.api.middleware.authentication import as_internal_app

log = structlog.get_logger(__name__)

RELAYED: Final = re.compile(r"/|/scenarios|/(jobs|recordings|subjects|population)(/.*)?")
"""Paths of pages whose content does not depend on the memory of a web server (robots, live robots, 3D scenes do)."""
_LISTS: Final = ("/", "/scenarios", "/jobs", "/recordings", "/subjects", "/population")
_TIMEOUT: Final = httpx.Timeout(60.0)
_MAX_CONNECTIONS: Final = 32
_HOP_BY_HOP: Final = frozenset({b"connection", b"keep-alive", b"transfer-encoding", b"te", b"trailer", b"upgrade"})
_OWN: Final = frozenset({b"date", b"server"})
"""Headers that the first web server adds itself."""
_FORWARDED: Final = frozenset({b"x-forwarded-for", b"x-forwarded-proto"})


class PageRelayMiddleware:
    """ASGI middleware that relays requests for pages to ``pages_url``; while that does not answer, it renders them.

    The other web server checks login, host and rate itself; it trusts the forwarded address of this machine.
    """

    def __init__(self, app: ASGIApp, pages_url: str) -> None:
        self.app = app
        self._client = httpx.AsyncClient(
            base_url=pages_url,
            limits=httpx.Limits(max_connections=_MAX_CONNECTIONS),
            trust_env=False,  # a proxy of the environment is not for this machine
        )

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] == "http" and scope["method"] == "GET" and RELAYED.fullmatch(scope["path"]):
            try:
                start, body = await self._fetch_page(scope)
            except httpx.TransportError as error:
                log.debug("page not relayed", error=repr(error))
            else:
                await send(start)
                await send(body)
                return
        try:
            await self.app(scope, receive, send)
        finally:
            if scope["type"] == "lifespan":
                await self._client.aclose()

    async def _fetch_page(self, scope: Scope) -> tuple[Message, Message]:
        """The page as sent, still compressed; whole, so that nothing of it was sent if the other server ends."""
        query = b"?" + scope["query_string"] if scope["query_string"] else b""
        url = self._client.base_url.copy_with(raw_path=scope["raw_path"] + query)
        headers = [pair for pair in scope["headers"] if pair[0] not in _HOP_BY_HOP | _FORWARDED]
        if scope.get("client") is not None:
            headers.append((b"x-forwarded-for", scope["client"][0].encode()))
        headers.append((b"x-forwarded-proto", scope["scheme"].encode()))
        request = httpx.Request("GET", url, headers=headers, extensions={"timeout": _TIMEOUT.as_dict()})
        answer = await self._client.send(request, stream=True)
        try:
            body = b"".join([part async for part in answer.aiter_raw()])
        finally:
            await answer.aclose()
        kept = [pair for pair in answer.headers.raw if pair[0].lower() not in _HOP_BY_HOP | _OWN]
        start = {"type": "http.response.start", "status": answer.status_code, "headers": kept}
        return start, {"type": "http.response.body", "body": body}


async def render_lists(app: ASGIApp) -> None:
    """Render home and the lists once: their templates and statements are compiled at first use, for half a second."""
    transport = httpx.ASGITransport(as_internal_app(app), raise_app_exceptions=False)
    async with httpx.AsyncClient(transport=transport, base_url="http://127.0.0.1") as client:
        for path in _LISTS:
            await client.get(path)
