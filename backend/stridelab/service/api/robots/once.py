"""Work that several ask for at the same time, and that is done once."""

import asyncio
from collections.abc import Awaitable, Callable
from typing import Generic, TypeVar

T = TypeVar("T")


class Once(Generic[T]):
    """One running piece of work per key, shared by all who wait for it; nobody who leaves takes it from the others.

    What has failed is tried again by the next who asks. With ``keep``, what has succeeded is never done again.
    """

    def __init__(self, *, keep: bool) -> None:
        self._keep = keep
        self._tasks: dict[str, asyncio.Task[T]] = {}

    async def get(self, key: str, work: Callable[[], Awaitable[T]]) -> T:
        """The result of ``work()``, of this call or of the one that is under way for ``key``."""
        task = self._tasks.get(key)
        if task is None:
            task = asyncio.ensure_future(_started(work))
            self._tasks[key] = task
            task.add_done_callback(lambda done: self._ended(key, done))
        return await asyncio.shield(task)

    async def aclose(self) -> None:
        """Cancel what is still under way."""
        waiting = list(self._tasks.values())
        for task in waiting:
            task.cancel()
        await asyncio.gather(*waiting, return_exceptions=True)

    def _ended(self, key: str, task: "asyncio.Task[T]") -> None:
        failed = task.cancelled() or task.exception() is not None
        if failed or not self._keep:
            del self._tasks[key]


async def _started(work: Callable[[], Awaitable[T]]) -> T:
    return await work()
