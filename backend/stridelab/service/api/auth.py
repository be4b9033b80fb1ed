"""Who may call: the host and origin of a request, then its token or cookie.

Without a token (loopback only) everybody on this machine may call, so a page from elsewhere must not be able to speak
for them: the Host header must name this machine (DNS rebinding) and a foreign Origin is refused (cross-site requests,
cross-site websockets). With a token, a request carries it as ``Authorization: Bearer``, or the cookie that a browser
got for it at ``POST /login``. The cookie is an expiry date signed with a key derived from the token, so any number of
API processes accept it and nothing is stored.
"""

import hashlib
import hmac
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final
from urllib.parse import quote, urlsplit

from starlette.datastructures import Headers
from starlette.requests import HTTPConnection
from starlette.responses import RedirectResponse, Response
from starlette.types import ASGIApp, Receive, Scope, Send

from stridelab.errors import Fault, Forbidden, StridelabError, Unauthenticated
from stridelab.service.api import problems
from stridelab.service.settings import LOOPBACK, Settings

COOKIE: Final = "stridelab_session"
SESSION_S: Final = 12 * 3600
OPEN_PATHS: Final = frozenset({"/login", "/api/v1/health"})
"""Answered without a login; so is everything below ``OPEN_FOLDER``."""
OPEN_FOLDER: Final = "/static/"

_INSIDE: Final = "stridelab.inside"
_DEFAULT_PORT: Final = {"http": ":80", "https": ":443", "ws": ":80", "wss": ":443"}


@dataclass(frozen=True)
class Keys:
    """What is kept of the token: a hash to compare with, and a key that signs cookies."""

    token_hash: bytes
    cookie_key: bytes

    @staticmethod
    def of(token: str) -> "Keys":
        """The keys of ``token``."""
        raw = token.encode()
        return Keys(hashlib.sha256(b"token:" + raw).digest(), hashlib.sha256(b"cookie:" + raw).digest())

    def accepts_token(self, token: str) -> bool:
        """Whether ``token`` is the right one, in a time that does not depend on it."""
        return hmac.compare_digest(Keys.of(token).token_hash, self.token_hash)

    def cookie(self, now_s: float) -> str:
        """A cookie that is good for ``SESSION_S`` from ``now_s`` on."""
        expires_s = str(int(now_s) + SESSION_S)
        return f"{expires_s}.{self._sign(expires_s)}"

    def accepts_cookie(self, cookie: str, now_s: float) -> bool:
        """Whether ``cookie`` was signed with this token and has not expired."""
        expires_s, _, signature = cookie.partition(".")
        genuine = hmac.compare_digest(self._sign(expires_s).encode(), signature.encode("utf-8", "surrogateescape"))
        return genuine and int(expires_s) > now_s

    def _sign(self, expires_s: str) -> str:
        return hmac.new(self.cookie_key, expires_s.encode("utf-8", "surrogateescape"), hashlib.sha256).hexdigest()


class Gate:
    """ASGI middleware that lets a request or websocket pass, or answers in its place."""

    def __init__(self, app: ASGIApp, settings: Settings, keys: Keys | None, clock: Callable[[], float] = time.time):
        self.app = app
        self._keys = keys
        self._clock = clock
        extra = {name.strip().lower() for name in settings.allowed_hosts.split(",") if name.strip()}
        # Behind a token a rebound name gains nothing: it has neither the token nor the cookie, which belongs to our
        # own name. So hosts are free there, unless a list was given.
        self._hosts = frozenset({*LOOPBACK, settings.host.lower(), *extra}) if extra or keys is None else None

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] not in ("http", "websocket") or scope.get(_INSIDE):
            await self.app(scope, receive, send)
            return
        connection = HTTPConnection(scope)
        try:
            self._check_host(connection.headers)
            self._check_origin(connection.headers)
            self._check_login(connection)
        except StridelabError as refusal:
            if scope["type"] == "websocket":
                code = 4401 if isinstance(refusal, Unauthenticated) else 4403
                await send({"type": "websocket.close", "code": code, "reason": refusal.code})
            else:
                await self._refuse(connection, refusal)(scope, receive, send)
            return
        await self.app(scope, receive, send)

    def _check_host(self, headers: Headers) -> None:
        if self._hosts is not None and _host_name(headers.get("host", "")) not in self._hosts:
            raise Forbidden(
                "foreign-host",
                "This service does not answer to that host name; STRIDELAB_ALLOWED_HOSTS lists further names.",
                [Fault("Host", "not allowed")],
            )

    def _check_origin(self, headers: Headers) -> None:
        origin = headers.get("origin")
        foreign = origin is not None and _place(origin) != _bare(headers.get("host", ""), _scheme(origin))
        if foreign or (origin is None and headers.get("sec-fetch-site") == "cross-site" and not _navigates(headers)):
            raise Forbidden(
                "foreign-origin",
                "The request comes from a page of another site, which may not speak for you.",
                [Fault("Origin", "not this service")],
            )

    def _check_login(self, connection: HTTPConnection) -> None:
        path = connection.scope["path"]
        if self._keys is None or path in OPEN_PATHS or path.startswith(OPEN_FOLDER):
            return
        scheme, _, token = connection.headers.get("authorization", "").partition(" ")
        if scheme.lower() == "bearer" and self._keys.accepts_token(token.strip()):
            return
        if self._keys.accepts_cookie(connection.cookies.get(COOKIE, ""), self._clock()):
            return
        raise Unauthenticated(
            "login-needed",
            "This service needs its API token: send it as 'Authorization: Bearer ...', or log in at /login.",
        )

    def _refuse(self, connection: HTTPConnection, refusal: StridelabError) -> Response:
        wants_page = "text/html" in connection.headers.get("accept", "")
        is_page = connection.scope["method"] == "GET" and not connection.scope["path"].startswith("/api/")
        if isinstance(refusal, Unauthenticated) and wants_page and is_page:
            return RedirectResponse(f"/login?next={quote(_relative(connection.scope))}", status_code=303)
        return problems.answer_error(refusal)


def inside(app: ASGIApp) -> ASGIApp:
    """``app`` for callers in this very process (the pages): past the gate, which no header can do."""

    async def call(scope: Scope, receive: Receive, send: Send) -> None:
        await app({**scope, _INSIDE: True}, receive, send)

    return call


def _relative(scope: Scope) -> str:
    query = scope["query_string"].decode("latin-1")
    return str(scope["path"]) + (f"?{query}" if query else "")


def local_target(target: str) -> str:
    """``target`` if it is an address of this service, else its front page: a login must not lead elsewhere."""
    parts = urlsplit(target)
    plain = target.isprintable() and "\\" not in target
    if parts.scheme or parts.netloc or not plain or not target.startswith("/") or target.startswith("//"):
        return "/"
    return target


def _navigates(headers: Headers) -> bool:
    """Whether somebody follows a link to us: allowed from anywhere, as it only shows a page to its own user."""
    return headers.get("sec-fetch-mode") == "navigate" and headers.get("sec-fetch-dest") == "document"


def _host_name(host: str) -> str:
    """``[::1]:8000`` -> ``::1``, ``Example.org.:80`` -> ``example.org``."""
    if host.startswith("["):
        return host[1:].partition("]")[0].lower()
    return host.partition(":")[0].rstrip(".").lower()


def _scheme(origin: str) -> str:
    """Scheme of an origin, in lower case."""
    return origin.partition(":")[0].lower()


def _place(origin: str) -> str:
    scheme, separator, place = origin.partition("://")
    return _bare(place, scheme.lower()) if separator else origin


def _bare(place: str, scheme: str) -> str:
    """Host and port in lower case, without the scheme's own port."""
    return place.lower().removesuffix(_DEFAULT_PORT.get(scheme, ""))
