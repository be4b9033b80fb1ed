"""The web app on the fake interface, called without a network."""

import asyncio
import re
from dataclasses import dataclass
from typing import Any

import httpx
from starlette.types import ASGIApp, Scope

from stridelab_web.app import create_web
from stridelab_web.config import ANONYMOUS_KEY, ScenarioRight, WebConfig
from support.fakes.service import FakeService


def anybody(scope: Scope, scenario_id: str, owner: str | None) -> ScenarioRight:
    """A service without a token: everybody changes everything."""
    return ScenarioRight(ANONYMOUS_KEY)


@dataclass(frozen=True)
class Caller:
    """Calls an ASGI app, one event loop per call; redirects are answers."""

    app: ASGIApp

    def request(self, method: str, address: str, **options: Any) -> httpx.Response:
        async def call() -> httpx.Response:
            transport = httpx.ASGITransport(app=self.app)
            async with httpx.AsyncClient(transport=transport, base_url="http://127.0.0.1") as client:
                return without_line_breaks(await client.request(method, address, **options))

        return asyncio.run(call())

    def get(self, address: str, **options: Any) -> httpx.Response:
        return self.request("GET", address, **options)


def without_line_breaks(answer: httpx.Response) -> httpx.Response:
    """A page as browsers show it: line breaks in the templates are one space, or nothing between two tags."""
    if not answer.headers.get("content-type", "").startswith("text/html") or re.search(
        "<pre|/static/viser/", answer.text
    ):
        return answer
    text = re.sub(r"\s*\n\s*|  +", " ", re.sub(r">\s*\n\s*<", "><", answer.text))
    headers = [(name, value) for name, value in answer.headers.multi_items() if name != "content-encoding"]
    return httpx.Response(answer.status_code, headers=headers, text=text, request=answer.request)


def make_client(fake: FakeService, **config: Any) -> Caller:
    """A caller of the web app over ``fake``."""
    given: dict[str, Any] = {"scenario_right": anybody, "transport": httpx.ASGITransport(app=fake.app()), **config}
    return Caller(create_web(WebConfig("http://127.0.0.1", "0.1.0", **given)))
