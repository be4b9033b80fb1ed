"""A refusal that comes before the end of an upload must still be heard.

A server that closes while bytes are on their way makes the connection be reset, and the client never reads why. So
after a refusal the rest of the body is taken and thrown away for a few seconds; then the connection is closed.
"""

import asyncio
from contextlib import suppress
from typing import Final

from starlette.datastructures import Headers
from starlette.types import ASGIApp, Message, Receive, Scope, Send

PATIENCE_S: Final = 5.0


class Linger:
    """ASGI middleware that listens on while a refused client is still talking."""

    def __init__(self, app: ASGIApp, patience_s: float = PATIENCE_S) -> None:
        self.app = app
        self._patience_s = patience_s

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] != "http":
            await self.app(scope, receive, send)
            return
        # Asking for the body would tell a client that waits for "100 Continue" to send it.
        heard_all = "expect" in Headers(scope=scope)
        is_refusal = False

        async def receive_and_note() -> Message:
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
                    async with asyncio.timeout(self._patience_s):
                        while not heard_all:
                            await receive_and_note()
                message = {"type": "http.response.body", "body": b"", "more_body": False}
            await send(message)

        await self.app(scope, receive_and_note, send_and_linger)
