"""Ends long-running responses (long polls, streams) when the server shuts down."""

import asyncio
from collections.abc import Awaitable
from typing import TypeVar

T = TypeVar("T")


async def await_unless(closing: asyncio.Event, work: Awaitable[T]) -> T | None:
    """Await ``work`` and return its result; if ``closing`` is set first, cancel it and return None."""
    doing, stopping = asyncio.ensure_future(work), asyncio.ensure_future(closing.wait())
    try:
        await asyncio.wait({doing, stopping}, return_when=asyncio.FIRST_COMPLETED)
        return await doing if doing.done() else None
    finally:
        for task in (doing, stopping):
            task.cancel()
        await asyncio.gather(doing, stopping, return_exceptions=True)
