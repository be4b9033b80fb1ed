"""A long-lived child that answers the requests of all clients, one at a time.

It is started by the first request, replaced when it fails, and ends by itself after an idle time.
"""

import asyncio
from contextlib import AsyncExitStack
from pathlib import Path
from types import TracebackType
from typing import Any, Final

import structlog

from stridelab.errors import Busy, Unavailable
from stridelab.service.processes.pool import ANSWER_TIMEOUT_S, ChildSession, IsolatedPool

Json = dict[str, Any]

PREVIEW: Final = "stridelab.service.api.previews.preview:run_in_child"
PREVIEW_OF_OWN: Final = "stridelab.service.api.previews.preview:OwnRobotPlanner"
PREVIEW_MEMORY_MB: Final = 1024
"""Memory limit of the preview child beyond its libraries."""
IDLE_S: Final = 600
MAX_WAITING: Final = 16
"""Maximum number of waiting requests; further ones raise ``Busy``."""
log = structlog.get_logger(__name__)


class PreviewProcess:
    """Asynchronous context manager: the preview planner in a child process of ``pool``, which is killed at exit.

    With ``folder``, the planner of the user's robot whose files were staged there.
    """

    def __init__(self, pool: IsolatedPool, *, answer_s: float = ANSWER_TIMEOUT_S, folder: Path | None = None) -> None:
        self._pool, self._answer_s, self._folder = pool, answer_s, folder
        self._request_lock = asyncio.Lock()
        self._waiting = 0
        self._session: ChildSession | None = None
        self._open = AsyncExitStack()

    async def __aenter__(self) -> "PreviewProcess":  # noqa: PYI034
        return self

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        await self._open.aclose()

    @property
    def pid(self) -> int | None:
        """Process id of the child; None while there is none."""
        return None if self._session is None else self._session.pid

    async def ask(self, request: Json) -> Json:
        """The child's answer to ``request``.

        Raises the child's error; ``Busy`` (``preview-busy``) if too many requests wait; ``Unavailable`` if the child
        died (``preview-failed``) or did not answer in time (``preview-stuck``). The next request starts a new child.
        """
        if self._waiting >= MAX_WAITING:
            raise Busy("preview-busy", "Too many plans are being previewed at this moment.", 1.0)
        self._waiting += 1
        try:
            async with self._request_lock:
                return await self._answer(request)
        finally:
            self._waiting -= 1

    async def _answer(self, request: Json) -> Json:
        if self._session is None or self._session.has_ended:
            await self._open.aclose()  # the session of a child that has ended
            self._session = await self._open.enter_async_context(
                self._pool.open_session(
                    PREVIEW if self._folder is None else PREVIEW_OF_OWN,
                    memory_mb=PREVIEW_MEMORY_MB,
                    answer_s=self._answer_s,
                    idle_s=IDLE_S,
                    folder=self._folder,
                )
            )
        outcome = await self._session.run(request)
        if outcome.state == "ok":
            value: Json = outcome.value
            return value
        if outcome.error_class is not None:
            raise outcome.as_error()
        self._session = None
        await self._open.aclose()
        log.error("preview failed", state=outcome.state, log_tail=outcome.log_tail[-2000:])
        if outcome.state == "timeout":
            raise Unavailable("preview-stuck", f"{outcome.as_error().message} The planner was restarted.")
        raise Unavailable("preview-failed", "The planner ended unexpectedly and was restarted.")
