"""Outermost middleware: request ids, one log line and span per request, security headers, unexpected exceptions."""

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
from stridelab.service.api.dependencies import CALLER_KEY
from stridelab.service.auth.callers import UNAUTHENTICATED

log = structlog.get_logger(__name__)

CONTENT_POLICY: Final = (
    "default-src 'self'; script-src 'self'; style-src 'self'; img-src 'self' data: blob:; connect-src 'self'; "
    "object-src 'none'; base-uri 'none'; form-action 'self'; frame-ancestors 'self'"
)
"""Allows resources of this service only, nothing inline; the page of the 3D scene sets its own policy."""

CLIENT_GONE: Final = 499
"""Logged status if the connection was closed before the request was complete."""
HEADERS: Final = {
    "X-Content-Type-Options": "nosniff",
    "X-Frame-Options": "SAMEORIGIN",
    # "no-referrer" would make browsers send "Origin: null" with our own forms.
    "Referrer-Policy": "same-origin",
    "Cross-Origin-Opener-Policy": "same-origin",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Permissions-Policy": "camera=(), microphone=(), geolocation=()",
}


class RequestContextMiddleware:
    """ASGI middleware around the whole application; streaming responses are not buffered."""

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
                with telemetry.start_span(scope["method"], named, parent=parent, kind=SpanKind.SERVER) as span:
                    await self._handle_request(scope, receive, send, request_id, span)

    async def _handle_request(self, scope: Scope, receive: Receive, send: Send, request_id: str, span: Span) -> None:
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
                raise  # the response has started, so the connection can only be aborted
            failure = problems.make_problem(
                500, "internal-error", "Something went wrong inside the service; its log has the details."
            )
            await problems.problem_response(failure)(scope, receive, send_with_headers)
        finally:
            route = _route_of(scope)
            span.update_name(f"{scope['method']} {route}")
            span.set_attribute("http.response.status_code", status)
            if status >= 500:
                telemetry.mark_failed(span)
            log.info(
                "request",
                method=scope["method"],
                route=route,
                status=status,
                took_ms=round(1000 * (time.perf_counter() - started_at), 1),
                **({} if CALLER_KEY in scope and scope[CALLER_KEY] is not UNAUTHENTICATED else {"stranger": True}),
            )


def _add_headers(message: Message, request_id: str) -> None:
    headers = MutableHeaders(scope=message)
    for name, value in HEADERS.items():
        headers.setdefault(name, value)
    headers.setdefault("Content-Security-Policy", CONTENT_POLICY)
    headers["X-Request-ID"] = request_id


def _route_of(scope: Scope) -> str:
    """Path template of the matched route; the requested path itself is never logged."""
    path = getattr(scope.get("route"), "path", None)
    return str(path) if path is not None else "unmatched"
