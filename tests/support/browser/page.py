"""Coroutines in a thread of their own: the loop of a browser test's thread belongs to Playwright.

A page of a running service that remembers what went wrong in it.
"""

import asyncio
from collections.abc import Coroutine
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from pathlib import Path
from typing import TypeVar
from urllib.parse import urlsplit

from playwright.sync_api import ConsoleMessage, Page, Request, WebSocket

from stridelab.client import Client

Answer = TypeVar("Answer")


def run(work: Coroutine[None, None, Answer]) -> Answer:
    """What ``work`` returns."""
    with ThreadPoolExecutor(1) as thread:
        return thread.submit(lambda: asyncio.run(work)).result()


VISER_ALONE = "Evaluating a string as JavaScript violates"
"""viser's sorter of Gaussian splats, which no scene here uses, asks to evaluate text; the frame's policy refuses."""


VISER_DRAGS = "Unable to preventDefault inside passive event listener invocation."
"""viser's drag of a node says so in Chromium; the drag works."""


@dataclass(frozen=True)
class Service:
    """A running ``stridelab serve``; one of its own has the process ``pid`` and keeps its data in ``data``."""

    url: str
    client: Client
    pid: int | None = None
    data: Path | None = None


@dataclass
class Tab:
    """A page that remembers what went wrong in it."""

    page: Page
    url: str
    missteps: list[str] = field(default_factory=list)

    def go(self, address: str) -> Page:
        self.page.goto(f"{self.url}{address}")
        return self.page

    def on_console(self, message: ConsoleMessage) -> None:
        if message.type == "error" and message.text != VISER_DRAGS:
            self.missteps.append(f"console: {message.text} ({message.location.get('url')})")

    def on_error(self, error: Exception) -> None:
        if VISER_ALONE not in str(error):
            self.missteps.append(f"error: {error}")

    def on_websocket(self, socket: WebSocket) -> None:
        if urlsplit(socket.url).netloc != urlsplit(self.url).netloc:
            self.missteps.append(f"outside: {socket.url}")

    def on_request(self, request: Request) -> None:
        if urlsplit(request.url).scheme in ("http", "https", "ws") and not request.url.startswith(self.url):
            self.missteps.append(f"outside: {request.url}")
