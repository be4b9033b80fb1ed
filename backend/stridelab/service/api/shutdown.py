"""Ends long-running responses (event streams, long polls) when the server shuts down."""

import asyncio
from collections.abc import AsyncIterator, Awaitable
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


async def iterate_until(closing: asyncio.Event, source: AsyncIterator[T]) -> AsyncIterator[T]:
    """Yield the items of ``source`` until it ends or ``closing`` is set."""
    while True:
        try:
            item = await await_unless(closing, anext(source))
        except StopAsyncIteration:
            return
        if item is None:
            return
        yield item
