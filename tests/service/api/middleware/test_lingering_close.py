"""A refused client is listened to for a while, and no longer."""

import asyncio
import time

import pytest
from starlette.responses import PlainTextResponse, Response
from starlette.types import Message, Receive, Scope, Send

from stridelab.service.api.middleware.lingering_close import LingeringCloseMiddleware
from support.service.processes import crowding


class Talker:
    """A client that sends ``pieces`` of a body (None: it never stops, and pauses between them)."""

    def __init__(self, pieces: int | None) -> None:
        self._left = pieces
        self.n_reads = 0
        self.sent: list[Message] = []

    async def receive(self) -> Message:
        self.n_reads += 1
        if self._left is None:
            await asyncio.sleep(0.01)
            return {"type": "http.request", "body": b"x", "more_body": True}
        self._left -= 1
        return {"type": "http.request", "body": b"x", "more_body": self._left > 0}

    async def send(self, message: Message) -> None:
        self.sent.append(message)


def answering(status: int) -> LingeringCloseMiddleware:
    async def app(scope: Scope, receive: Receive, send: Send) -> None:
        answer: Response = PlainTextResponse("done", status_code=status)
        await answer(scope, receive, send)

    return LingeringCloseMiddleware(app, drain_timeout_s=0.2)


def scope(**headers: str) -> Scope:
    return {"type": "http", "headers": [(name.encode(), value.encode()) for name, value in headers.items()]}


@pytest.mark.anyio
async def test_the_rest_of_a_refused_body_is_read_after_the_answer() -> None:
    talker = Talker(5)
    await answering(413)(scope(), talker.receive, talker.send)
    assert talker.n_reads == 5
    assert [message.get("body") for message in talker.sent[1:]] == [b"done", b""]
    assert [message.get("more_body", False) for message in talker.sent[1:]] == [True, False]


@pytest.mark.anyio
async def test_reading_the_rest_of_a_refused_body_has_a_time_limit() -> None:
    talker = Talker(None)
    began_s = time.monotonic()
    await answering(413)(scope(), talker.receive, talker.send)
    assert 0.15 < time.monotonic() - began_s < 5 * crowding()
    assert talker.sent[-1].get("more_body", False) is False


@pytest.mark.parametrize(("status", "headers"), [(200, {}), (413, {"expect": "100-continue"})])
@pytest.mark.anyio
async def test_no_rest_is_read_after_an_accepted_request_or_while_the_client_waits(
    status: int, headers: dict[str, str]
) -> None:
    talker = Talker(5)
    await answering(status)(scope(**headers), talker.receive, talker.send)
    assert talker.n_reads == 0
    assert len(talker.sent) == 2
