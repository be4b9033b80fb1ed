"""Files that a transaction publishes: removed again only where that transaction certainly did not commit.

Files are stored before the rows that name them are committed. When the connection breaks, the process is told to stop
or the server goes down while COMMIT is under way, the client does not know whether the rows are there. Files are
then kept: if the rows were committed they are needed, and if not, the janitor (``jobs.retention``) removes them.
Every place that stores files ahead of rows goes through ``publishing``, so that the rule is written once.
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
NO_ANSWER: Final = (OperationalError, InterfaceError, psycopg.OperationalError, TimeoutError)
"""What a database that does not answer raises."""
_log = structlog.get_logger(__name__)


class Publication:
    """What is known about the transactions that were to publish some files.

    ``in_doubt`` is True from the moment a COMMIT is sent until the server has answered it. ``published`` is set by
    ``settle`` once the caller knows whether the rows are there.
    """

    def __init__(self) -> None:
        self.in_doubt = False
        self.published = False

    @asynccontextmanager
    async def transaction(self, engine: AsyncEngine) -> AsyncIterator[AsyncConnection]:
        """``engine.begin()``, noting whether the outcome of its COMMIT is known."""
        async with engine.connect() as connection, connection.begin() as transaction:
            yield connection
            with self._committing():
                await transaction.commit()

    @contextmanager
    def synchronous_transaction(self, engine: sqlalchemy.Engine) -> Iterator[sqlalchemy.Connection]:
        """``transaction`` for programs without an event loop."""
        with engine.connect() as connection, connection.begin() as transaction:
            yield connection
            with self._committing():
                transaction.commit()

    def settle(self, *, published: bool) -> None:
        """Say what a later look at the rows has shown; it ends all doubt."""
        self.published, self.in_doubt = published, False

    @contextmanager
    def _committing(self) -> Iterator[None]:
        before, self.in_doubt = self.in_doubt, True
        try:
            yield
        except DBAPIError as error:
            if proves_rollback(error.orig):
                self.in_doubt = before
            raise
        self.in_doubt = before


def proves_rollback(error: BaseException | None) -> bool:
    """Whether ``error``, raised by COMMIT, is the server's answer that the transaction was rolled back.

    That is an answer of severity ERROR. A FATAL one ends the session and may come after the commit (for example while
    the server waits for a standby), and an error without a SQLSTATE is the client's own: the connection broke.
    """
    if not isinstance(error, psycopg.Error) or error.sqlstate in (None, _UNKNOWN_COMPLETION):
        return False
    return error.diag.severity_nonlocalized == "ERROR"


@asynccontextmanager
async def publishing(remove: Callable[[], Awaitable[object]]) -> AsyncIterator[Publication]:
    """Files are stored and published inside the block; ``remove`` takes them away where they certainly are not.

    Files that stay because the outcome is unknown, or because ``remove`` fails, are left to the janitor.
    """
    publication = Publication()
    try:
        yield publication
    finally:
        if publication.in_doubt and not publication.published:
            _log.warning("files-kept", reason="the outcome of a commit is unknown")
        elif not publication.published:
            # storage or database that is away: whatever stays is removed by the janitor
            with suppress(StridelabError, *NO_ANSWER):
                await remove()
