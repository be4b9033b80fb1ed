"""Coroutines in a thread of their own: the loop of a browser test's thread belongs to Playwright."""

import asyncio
from collections.abc import Coroutine
from concurrent.futures import ThreadPoolExecutor
from typing import TypeVar

Answer = TypeVar("Answer")


def run(work: Coroutine[None, None, Answer]) -> Answer:
    """What ``work`` returns."""
    with ThreadPoolExecutor(1) as thread:
        return thread.submit(lambda: asyncio.run(work)).result()
