"""Lingering close: delivers a refusal that is sent before the request body has arrived completely.

If a server closes the connection while the client still sends, the connection is reset and the client cannot read the
response. Therefore the rest of the body is read and discarded for a few seconds before the connection is closed.
"""

import asyncio
from contextlib import suppress
from typing import Final

from starlette.datastructures import Headers
from starlette.types import ASGIApp, Message, Receive, Scope, Send

DRAIN_TIMEOUT_S: Final = 5.0


class LingeringCloseMiddleware:
    """ASGI middleware that drains the request body after a refusal, for a limited time."""

    def __init__(self, app: ASGIApp, drain_timeout_s: float = DRAIN_TIMEOUT_S) -> None:
        self.app = app
        self._drain_timeout_s = drain_timeout_s

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] != "http":
            await self.app(scope, receive, send)
            return
        # reading the body would make a client that waits for "100 Continue" send it
        heard_all = "expect" in Headers(scope=scope)
        is_refusal = False

        async def receive_and_track() -> Message:
            nonlocal heard_all
            message = await receive()
            heard_all = not message.get("more_body", False)
            return message

        async def send_and_linger(message: Message) -> None:
            nonlocal is_refusal
            if message["type"] == "http.response.start":
                is_refusal = message["status"] >= 400
            ends = message["type"] == "http.response.body" and not message.get("more_body", False)
            if ends and is_refusal and not heard_all:
                await send({**message, "more_body": True})
                with suppress(TimeoutError):
                    async with asyncio.timeout(self._drain_timeout_s):
                        while not heard_all:
                            await receive_and_track()
                message = {"type": "http.response.body", "body": b"", "more_body": False}
            await send(message)

        await self.app(scope, receive_and_track, send_and_linger)
