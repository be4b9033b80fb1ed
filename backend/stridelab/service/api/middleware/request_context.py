"""The outermost layer: request ids, one log line per request, security headers, and no exception without an answer."""

import time
import uuid
from typing import Final

import structlog
from opentelemetry.trace import Span, SpanKind
from starlette.datastructures import Headers, MutableHeaders
from starlette.requests import ClientDisconnect
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from stridelab.service import telemetry
from stridelab.service.api import problems
from stridelab.service.api.dependencies import KEY
from stridelab.service.auth.callers import STRANGER

log = structlog.get_logger(__name__)

CONTENT_POLICY: Final = (
    "default-src 'self'; script-src 'self'; style-src 'self'; img-src 'self' data: blob:; connect-src 'self'; "
    "object-src 'none'; base-uri 'none'; form-action 'self'; frame-ancestors 'self'"
)
"""Everything from this service, nothing inline; the page of the 3D scene brings a policy of its own."""

CLIENT_GONE: Final = 499
"""In the log: the client ended, or the server closed, the connection before the request was whole."""
HEADERS: Final = {
    "X-Content-Type-Options": "nosniff",
    "X-Frame-Options": "SAMEORIGIN",
    # "no-referrer" would make browsers send "Origin: null" with our own forms.
    "Referrer-Policy": "same-origin",
    "Cross-Origin-Opener-Policy": "same-origin",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Permissions-Policy": "camera=(), microphone=(), geolocation=()",
}


class Edge:
    """ASGI middleware around everything else; streams pass through it unbuffered."""

    def __init__(self, app: ASGIApp) -> None:
        self.app = app

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] not in ("http", "websocket"):
            await self.app(scope, receive, send)
            return
        request_id = uuid.uuid4().hex[:16]
        with structlog.contextvars.bound_contextvars(request_id=request_id):
            if scope["type"] == "websocket":
                await self.app(scope, receive, send)
            else:
                parent = Headers(scope=scope).get("traceparent")
                named = {"request_id": request_id}
                with telemetry.span(scope["method"], named, parent=parent, kind=SpanKind.SERVER) as span:
                    await self._answer(scope, receive, send, request_id, span)

    async def _answer(self, scope: Scope, receive: Receive, send: Send, request_id: str, span: Span) -> None:
        status = 0
        started_at = time.perf_counter()

        async def send_with_headers(message: Message) -> None:
            nonlocal status
            if message["type"] == "http.response.start":
                status = message["status"]
                _add_headers(message, request_id)
            await send(message)

        try:
            await self.app(scope, receive, send_with_headers)
        except ClientDisconnect:
            status = CLIENT_GONE
        except Exception:
            log.exception("request failed", method=scope["method"], route=_route_of(scope))
            if status:
                raise  # the answer has begun: all that is left is to break the connection
            sorry = problems.problem(
                500, "internal-error", "Something went wrong inside the service; its log has the details."
            )
            await problems.answer(sorry)(scope, receive, send_with_headers)
        finally:
            route = _route_of(scope)
            span.update_name(f"{scope['method']} {route}")
            span.set_attribute("http.response.status_code", status)
            if status >= 500:
                telemetry.failed(span)
            log.info(
                "request",
                method=scope["method"],
                route=route,
                status=status,
                took_ms=round(1000 * (time.perf_counter() - started_at), 1),
                **({} if KEY in scope and scope[KEY] is not STRANGER else {"stranger": True}),
            )


def _add_headers(message: Message, request_id: str) -> None:
    headers = MutableHeaders(scope=message)
    for name, value in HEADERS.items():
        headers.setdefault(name, value)
    headers.setdefault("Content-Security-Policy", CONTENT_POLICY)
    headers["X-Request-ID"] = request_id


def _route_of(scope: Scope) -> str:
    """The template of the matched route; what a visitor typed is never logged."""
    path = getattr(scope.get("route"), "path", None)
    return str(path) if path is not None else "unmatched"
