"""Publishes files with a transaction; removes them again only if the transaction certainly did not commit.

Files are stored before the rows that refer to them are committed. If the connection breaks, the process is stopped or
the server goes down during COMMIT, the client does not know whether the rows exist. The files then stay: if the rows
were committed the files are needed; otherwise the janitor (``jobs.retention``) removes them. All code that stores files
before rows uses ``publish_files``.
"""

from collections.abc import AsyncIterator, Awaitable, Callable, Iterator
from contextlib import asynccontextmanager, contextmanager, suppress
from typing import Final

import psycopg
import sqlalchemy
import structlog
from sqlalchemy.exc import DBAPIError, InterfaceError, OperationalError
from sqlalchemy.ext.asyncio import AsyncConnection, AsyncEngine

from stridelab.errors import StridelabError

_UNKNOWN_COMPLETION: Final = "40003"
"""SQLSTATE statement_completion_unknown."""
DATABASE_ERRORS: Final = (OperationalError, InterfaceError, psycopg.OperationalError, TimeoutError)
"""Exceptions raised while the database does not respond."""
_log = structlog.get_logger(__name__)


class Publication:
    """Commit state of the transactions that publish some files.

    ``in_doubt`` is True from the moment a COMMIT is sent, unless the server answers that it was rolled back, until
    ``record_outcome``: a task can also be cancelled after the answer, while it returns its connection. ``published`` is
    set by ``record_outcome`` once the caller knows whether the rows exist.
    """

    def __init__(self) -> None:
        self.in_doubt = False
        self.published = False

    @asynccontextmanager
    async def transaction(self, engine: AsyncEngine) -> AsyncIterator[AsyncConnection]:
        """``engine.begin()`` that records whether the outcome of its COMMIT is known."""
        async with engine.connect() as connection, connection.begin() as transaction:
            yield connection
            with self._track_commit():
                await transaction.commit()

    @contextmanager
    def synchronous_transaction(self, engine: sqlalchemy.Engine) -> Iterator[sqlalchemy.Connection]:
        """``transaction`` for programs without an event loop."""
        with engine.connect() as connection, connection.begin() as transaction:
            yield connection
            with self._track_commit():
                transaction.commit()

    def record_outcome(self, *, published: bool) -> None:
        """Record whether the rows exist, as read after the transaction."""
        self.published, self.in_doubt = published, False

    @contextmanager
    def _track_commit(self) -> Iterator[None]:
        before, self.in_doubt = self.in_doubt, True
        try:
            yield
        except DBAPIError as error:
            if proves_rollback(error.orig):
                self.in_doubt = before
            raise


def proves_rollback(error: BaseException | None) -> bool:
    """Whether ``error``, raised by COMMIT, is the server's answer that the transaction was rolled back.

    That is an answer of severity ERROR. A FATAL one ends the session and may come after the commit (for example while
    the server waits for a standby), and an error without a SQLSTATE is the client's own: the connection broke.
    """
    if not isinstance(error, psycopg.Error) or error.sqlstate in (None, _UNKNOWN_COMPLETION):
        return False
    return error.diag.severity_nonlocalized == "ERROR"


@asynccontextmanager
async def publish_files(remove: Callable[[], Awaitable[object]]) -> AsyncIterator[Publication]:
    """Store and publish files inside the block; calls ``remove`` if they were certainly not published.

    Files that stay because the outcome is unknown, or because ``remove`` fails, are removed by the janitor.
    """
    publication = Publication()
    try:
        yield publication
    finally:
        if publication.in_doubt and not publication.published:
            _log.warning("files-kept", reason="the outcome of a commit is unknown")
        elif not publication.published:
            # if storage or database are unavailable, the janitor removes the files later
            with suppress(StridelabError, *DATABASE_ERRORS):
                await remove()
