"""Languages of the pages: the language of a request, and the messages of the scripts.

The language of a request is that of its cookie, else the operator's (``STRIDELAB_LANGUAGE``), else the best that the
browser accepts, else English. The translations are those of ``stridelab.translations``.
"""

import hashlib
import json
import re
from collections.abc import Awaitable, Callable
from functools import cache
from typing import Final, cast, get_args
from urllib.parse import parse_qsl, urlencode

from starlette.datastructures import MutableHeaders
from starlette.exceptions import HTTPException
from starlette.requests import HTTPConnection, Request
from starlette.responses import RedirectResponse, Response
from starlette.types import ASGIApp, Receive, Scope, Send
from starlette.types import Message as AsgiMessage

from stridelab.schemas.service import Language
from stridelab.translations.catalogue import ENGLISH, LANGUAGES, in_language, read_catalogue
from stridelab.translations.served_sentences import SERVED
from stridelab_web.assets import IMMUTABLE

COOKIE: Final = "stridelab_language"
QUERY: Final = "language"
"""``?language=de`` on the address of any page sets the cookie and opens the page without it."""
COOKIE_S: Final = 365 * 24 * 3600
_UNTRANSLATED: Final = ("/static/", "/view/scene/")
"""Paths whose responses have no language."""

Endpoint = Callable[[Request], Awaitable[Response]]


def in_english(endpoint: Endpoint) -> Endpoint:
    """A page that is not translated: it is English as a whole, whatever the reader has chosen."""

    async def english_page(request: Request) -> Response:
        with in_language(ENGLISH):
            return await endpoint(request)

    return english_page


def chosen_language(cookie: str | None, accepted: str, default: Language | None) -> Language:
    """The language of a reader: that of the cookie, else the operator's, else the best accepted one, else English."""
    if cookie in LANGUAGES:
        return cast(Language, cookie)
    return default or _best_accepted(accepted) or ENGLISH


def _best_accepted(header: str) -> Language | None:
    """The language with the highest weight in an ``Accept-Language`` header; ``de-AT`` counts as ``de``."""
    weighted: list[tuple[float, Language]] = []
    for item in header[:1000].split(","):
        tag, _, parameter = item.strip().partition(";")
        code = tag.strip().lower().partition("-")[0]
        if code not in get_args(Language):
            continue
        match = re.fullmatch(r"\s*q=([01](?:\.\d{0,3})?)\s*", parameter)
        weight = 1.0 if not parameter else float(match.group(1)) if match else 0.0
        if weight > 0.0:
            weighted.append((-weight, cast(Language, code)))
    return min(weighted, key=lambda item: item[0])[1] if weighted else None


class LanguageMiddleware:
    """ASGI middleware: every page is made in the language of its reader, and says so to caches."""

    def __init__(self, app: ASGIApp, default: Language | None = None):
        self.app = app
        self._default = default

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] != "http" or scope["path"].startswith(_UNTRANSLATED):
            await self.app(scope, receive, send)
            return
        connection = HTTPConnection(scope)
        wanted = connection.query_params.get(QUERY)
        if wanted in LANGUAGES and scope["method"] == "GET" and not scope["path"].startswith("//"):
            await _remember_language(connection, cast(Language, wanted))(scope, receive, send)
            return
        accepted = connection.headers.get("accept-language", "")

        async def send_with_vary(message: AsgiMessage) -> None:
            if message["type"] == "http.response.start":
                headers = MutableHeaders(scope=message)
                headers.add_vary_header("Accept-Language")
                headers.add_vary_header("Cookie")
            await send(message)

        language = chosen_language(connection.cookies.get(COOKIE), accepted, self._default)
        scope["stridelab.language"] = language
        with in_language(language):
            await self.app(scope, receive, send_with_vary)


def reader_language(request: Request) -> Language:
    """The language that the reader has chosen, also on pages that are not translated."""
    return cast(Language, request.scope.get("stridelab.language", ENGLISH))


def language_links(request: Request) -> list[tuple[Language, str, str]]:
    """Code, name and address of this page in every language."""
    query = [(key, value) for key, value in request.query_params.multi_items() if key != QUERY]
    return [(code, name, f"?{urlencode([*query, (QUERY, code)])}") for code, name in LANGUAGES.items()]


def _remember_language(connection: HTTPConnection, language: Language) -> Response:
    """Opens the same page without the query and stores the language in a cookie, which scripts cannot read."""
    query = [item for item in parse_qsl(connection.url.query, keep_blank_values=True) if item[0] != QUERY]
    path = connection.url.path
    answer = RedirectResponse(f"{path}?{urlencode(query)}" if query else path, status_code=303)
    answer.headers["Cache-Control"] = "no-store"
    answer.set_cookie(
        COOKIE, language, max_age=COOKIE_S, httponly=True, samesite="lax", secure=connection.url.scheme == "https"
    )
    return answer


@cache
def script_catalogue(language: Language) -> tuple[str, str]:
    """The messages of the scripts in ``language`` as a script, and the name under which it is served."""
    messages = {
        message.id if isinstance(message.id, str) else message.id[0]: message.string
        for message in read_catalogue(language)
        if message.id and any(str(path).endswith(".js") for path, _ in message.locations)
    }
    text = json.dumps(messages, ensure_ascii=False, separators=(",", ":"), sort_keys=True)
    sentences = json.dumps([pattern for pattern in SERVED if pattern in messages], ensure_ascii=False)
    script = f"globalThis.stridelabMessages={text};globalThis.stridelabSentences={sentences};"
    return script, f"{language}-{hashlib.sha256(script.encode()).hexdigest()[:12]}.js"


async def script_file(request: Request) -> Response:
    """``GET /static/languages/{name}``: the messages of the scripts; the name changes with the content."""
    name = request.path_params["name"]
    language = cast(Language, name.partition("-")[0])
    if language not in LANGUAGES or script_catalogue(language)[1] != name:
        raise HTTPException(404, "This file belongs to another version: load the page again.")
    return Response(script_catalogue(language)[0], media_type="text/javascript", headers={"Cache-Control": IMMUTABLE})
