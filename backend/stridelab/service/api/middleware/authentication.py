"""Authentication middleware: checks host, origin, token or cookie, request rate and scope, in this order.

Without a token (loopback only) every user of this machine may call, so pages of other sites must not be able to send
requests in their name: the Host header must name this machine (DNS rebinding) and a foreign Origin is refused
(cross-site requests and websockets). With a token in the settings, a request carries that token, or one of the token
table, as ``Authorization: Bearer``, or a cookie from ``POST /login``.

Rate limit: token buckets in the memory of one API process.
"""

import time
from collections import OrderedDict
from collections.abc import Callable
from typing import Final
from urllib.parse import quote, urlsplit

import structlog
from sqlalchemy.exc import DBAPIError
from starlette.datastructures import Headers
from starlette.requests import HTTPConnection
from starlette.responses import RedirectResponse, Response
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from stridelab.errors import Busy, Fault, Forbidden, StridelabError, Unauthenticated, Unavailable
from stridelab.service.api import problems
from stridelab.service.api.dependencies import CALLER_KEY, parts_of
from stridelab.service.api.session_cookies import COOKIE, SCENARIO_KEY, SigningKeys
from stridelab.service.auth import audit
from stridelab.service.auth.callers import ADMIN, ANONYMOUS_ADMIN, UNAUTHENTICATED, Caller, needed_scope, require_scope
from stridelab.service.auth.token_cache import TokenCache
from stridelab.service.settings import LOOPBACK, Settings

_LOGIN: Final = "/login"
OPEN_PATHS: Final = frozenset({_LOGIN, "/api/v1/health"})
"""Paths that require no login, in addition to those below ``OPEN_FOLDER``."""
OPEN_FOLDER: Final = "/static/"

log = structlog.get_logger(__name__)
_AUDITED_REFUSALS_HZ: Final = 1.0
"""Maximum rate of refusals written to the audit table; further ones are only logged."""
_ADMIN: Final = Caller(ADMIN, "admin", ADMIN)
_INTERNAL: Final = "stridelab.inside"
_SCENARIOS: Final = "/api/v1/scenarios/"
_DEFAULT_PORT: Final = {"http": ":80", "https": ":443", "ws": ":80", "wss": ":443"}


class AuthenticationMiddleware:
    """ASGI middleware that authenticates a request or websocket, or refuses it."""

    def __init__(
        self, app: ASGIApp, settings: Settings, keys: SigningKeys | None, clock: Callable[[], float] = time.time
    ):
        self.app = app
        self._keys = keys
        self._clock = clock
        self._rate_limiter = RateLimiter(settings.rate_limit_hz)
        self._audit_limiter = RateLimiter(_AUDITED_REFUSALS_HZ)
        extra = {name.strip().lower() for name in settings.allowed_hosts.split(",") if name.strip()}
        # With a token, DNS rebinding gains nothing: the page of the rebound name has neither the token nor the cookie,
        # which belongs to the real host name. Any host is then accepted, unless the settings list the allowed ones.
        self._hosts = frozenset({*LOOPBACK, settings.host.lower(), *extra}) if extra or keys is None else None

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] not in ("http", "websocket") or scope.get(_INTERNAL):
            await self.app(scope, receive, send)
            return
        connection = HTTPConnection(scope)
        caller = UNAUTHENTICATED
        try:
            self._check_host(connection.headers)
            self._check_origin(connection.headers)
            caller = await self._identify_caller(connection)
            if not _is_open(scope["path"]):
                require_scope(caller, needed_scope(scope["type"], scope.get("method", ""), scope["path"]))
        except StridelabError as refusal:
            await self._record_refusal(connection, caller, refusal)
            if scope["type"] == "websocket":
                code = 4401 if isinstance(refusal, Unauthenticated) else 4403
                await send({"type": "websocket.close", "code": code, "reason": refusal.code})
            else:
                await self._refusal_response(connection, refusal)(scope, receive, send)
            return
        scope[CALLER_KEY] = caller  # in place: the request context middleware reads it from the same dict
        await self.app(scope, self._check_at_end_of_body(receive, connection, caller), send)

    def _check_at_end_of_body(self, receive: Receive, connection: HTTPConnection, caller: Caller) -> Receive:
        """``receive`` that checks again, at the end of a body in several pieces, that the token is not revoked.

        It raises ``Unauthenticated`` (``login-needed``).
        """
        if connection.scope["type"] != "http" or caller.token_id in (None, ADMIN):
            return receive
        n_pieces = 0

        async def receive_and_check() -> Message:
            nonlocal n_pieces
            message = await receive()
            n_pieces += message["type"] == "http.request"
            is_end = message["type"] == "http.request" and not message.get("more_body", False)
            if is_end and n_pieces > 1 and await parts_of(connection).tokens.caller_of_id(str(caller.token_id)) is None:
                raise Unauthenticated("login-needed", "The token of this request was revoked before its end.")
            return message

        return receive_and_check

    def _check_host(self, headers: Headers) -> None:
        if self._hosts is not None and _host_name(headers.get("host", "")) not in self._hosts:
            raise Forbidden(
                "foreign-host",
                "This service does not answer to that host name; STRIDELAB_ALLOWED_HOSTS lists further names.",
                [Fault("Host", "not allowed")],
            )

    def _check_origin(self, headers: Headers) -> None:
        origin = headers.get("origin")
        foreign = origin is not None and _origin_host(origin) != _without_default_port(
            headers.get("host", ""), _origin_scheme(origin)
        )
        if foreign or (
            origin is None and headers.get("sec-fetch-site") == "cross-site" and not _is_navigation(headers)
        ):
            raise Forbidden(
                "foreign-origin",
                "The request comes from a page of another site; cross-site requests are not allowed.",
                [Fault("Origin", "not this service")],
            )

    async def _identify_caller(self, connection: HTTPConnection) -> Caller:
        """Authenticate the caller and count the request against its rate limit.

        Raises ``Unauthenticated`` (``login-needed``), ``Busy`` (``too-many-requests``).
        """
        if self._keys is None:
            return ANONYMOUS_ADMIN
        path = connection.scope["path"]
        if _is_open(path) and path != _LOGIN:
            return UNAUTHENTICATED
        caller = None if path == _LOGIN else await self._authenticated_caller(connection, self._keys)
        if caller is not None:
            self._rate_limiter.count_request(f"token {caller.token_id}")
            return caller
        self._rate_limiter.count_request(
            f"address {connection.client.host if connection.client else ''}", STRANGER_SHARE
        )
        if path == _LOGIN:
            return UNAUTHENTICATED
        raise Unauthenticated(
            "login-needed",
            "This service requires an API token: send it as 'Authorization: Bearer ...', or log in at /login.",
        )

    async def _authenticated_caller(self, connection: HTTPConnection, keys: SigningKeys) -> Caller | None:
        scheme, _, secret = connection.headers.get("authorization", "").partition(" ")
        try:
            if scheme.lower() == "bearer" and secret.startswith(SCENARIO_KEY):
                token_id = keys.token_of_scenario_key(secret, self._clock(), _replaced_scenario(connection.scope))
            elif scheme.lower() == "bearer" and secret.strip():
                return await token_holder(secret.strip(), keys, parts_of(connection).tokens)
            else:
                token_id = keys.token_of(connection.cookies.get(COOKIE, ""), self._clock())
            if token_id is None or token_id == ADMIN:
                return _ADMIN if token_id else None
            return await parts_of(connection).tokens.caller_of_id(token_id)
        except DBAPIError as error:
            raise Unavailable("database-unreachable", "The database does not answer. Try again shortly.") from error

    async def _record_refusal(self, connection: HTTPConnection, caller: Caller, refusal: StridelabError) -> None:
        """Log a refusal, and write it to the audit table at a limited rate, so that refusals cannot fill the disk."""
        if isinstance(refusal, Unavailable) or connection.scope["type"] != "http":
            return
        audit.log_action(caller, "refused", refusal.code)
        try:
            self._audit_limiter.count_request("all")
            async with parts_of(connection).engine.begin() as database:
                await audit.write_row(database, caller, "refused", refusal.code)
        except Busy:
            return  # logged only
        except DBAPIError:
            log.warning("refusal not in the audit table: the database does not answer")

    def _refusal_response(self, connection: HTTPConnection, refusal: StridelabError) -> Response:
        wants_page = "text/html" in connection.headers.get("accept", "")
        is_page = connection.scope["method"] == "GET" and not connection.scope["path"].startswith("/api/")
        if isinstance(refusal, Unauthenticated) and wants_page and is_page:
            return RedirectResponse(f"/login?next={quote(_relative_url(connection.scope))}", status_code=303)
        return problems.error_response(refusal)


async def token_holder(secret: str, keys: SigningKeys, cache: TokenCache) -> Caller | None:
    """Holder of the token ``secret``: the admin of the settings, the caller of the token table, or None."""
    return _ADMIN if keys.accepts_token(secret) else await cache.caller_of_secret(secret)


def _replaced_scenario(scope: Scope) -> str:
    """Id of the scenario that a ``PUT`` request replaces; empty for other requests."""
    path = str(scope["path"])
    replaces = scope.get("method") == "PUT" and path.startswith(_SCENARIOS)
    return path.removeprefix(_SCENARIOS) if replaces else ""


def _is_open(path: str) -> bool:
    return path in OPEN_PATHS or path.startswith(OPEN_FOLDER)


def as_internal_app(app: ASGIApp) -> ASGIApp:
    """Wrap ``app`` for requests from within this process (the web pages), which skip authentication and compression.

    The mark is set in the ASGI scope, which a client cannot do with a header.
    """

    async def call_internally(scope: Scope, receive: Receive, send: Send) -> None:
        headers = [header for header in scope["headers"] if header[0] != b"accept-encoding"]
        await app({**scope, "headers": headers, _INTERNAL: True}, receive, send)

    return call_internally


def _relative_url(scope: Scope) -> str:
    query = scope["query_string"].decode("latin-1")
    return str(scope["path"]) + (f"?{query}" if query else "")


def local_target(target: str) -> str:
    """Return ``target`` if it is a path of this service, else ``/``: a login must not redirect to other sites."""
    try:
        parts = urlsplit(target)
    except ValueError:  # as for "//["
        return "/"
    plain = target.isprintable() and "\\" not in target
    if parts.scheme or parts.netloc or not plain or not target.startswith("/") or target.startswith("//"):
        return "/"
    return target


def _is_navigation(headers: Headers) -> bool:
    """Whether the request is a top-level navigation: allowed from any site, because only the user sees the page."""
    return headers.get("sec-fetch-mode") == "navigate" and headers.get("sec-fetch-dest") == "document"


def _host_name(host: str) -> str:
    """``[::1]:8000`` -> ``::1``, ``Example.org.:80`` -> ``example.org``."""
    if host.startswith("["):
        return host[1:].partition("]")[0].lower()
    return host.partition(":")[0].rstrip(".").lower()


def _origin_scheme(origin: str) -> str:
    """Scheme of an origin, in lower case."""
    return origin.partition(":")[0].lower()


def _origin_host(origin: str) -> str:
    scheme, separator, place = origin.partition("://")
    return _without_default_port(place, scheme.lower()) if separator else origin


def _without_default_port(place: str, scheme: str) -> str:
    """Host and port in lower case, without the default port of the scheme."""
    return place.lower().removesuffix(_DEFAULT_PORT.get(scheme, ""))


BURST_S: Final = 10.0
"""Capacity of a bucket, as the number of seconds in which it is filled."""
STRANGER_SHARE: Final = 0.1
"""Fraction of the rate for clients without a valid token, per address."""
_MAX_BUCKETS: Final = 10_000


class RateLimiter:
    """Token buckets by name, each refilled with ``rate_hz`` requests per second; 0 disables the limit."""

    def __init__(self, rate_hz: float, clock: Callable[[], float] = time.monotonic) -> None:
        self._rate_hz, self._clock = rate_hz, clock
        self._buckets: OrderedDict[str, tuple[float, float]] = OrderedDict()

    def count_request(self, name: str, share: float = 1.0) -> None:
        """Count a request of ``name``. Raises ``Busy`` (``too-many-requests``) if its bucket is empty."""
        rate_hz = self._rate_hz * share
        if rate_hz == 0:
            return
        now_s = self._clock()
        most = max(1.0, rate_hz * BURST_S)
        left, at_s = self._buckets.pop(name, (most, now_s))
        left = min(most, left + (now_s - at_s) * rate_hz)
        allowed = left >= 1.0
        self._buckets[name] = (left - 1.0 if allowed else left, now_s)
        if len(self._buckets) > _MAX_BUCKETS:
            self._buckets.popitem(last=False)  # the least recently used bucket is the fullest
        if not allowed:
            raise Busy(
                "too-many-requests",
                f"More than {rate_hz:g} requests per second; STRIDELAB_RATE_LIMIT_HZ is the limit. Try again later.",
                (1.0 - left) / rate_hz,
            )
