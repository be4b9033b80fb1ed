"""When the files of a transaction are removed again."""

import asyncio
from typing import Any

import pytest
from sqlalchemy import func, insert, select
from sqlalchemy.ext.asyncio import AsyncConnection

from stridelab.service.storage.database import make_engine
from stridelab.service.storage.publication import publish_files
from stridelab.service.storage.tables import worker
from support.service.database import run_with_engine


def count_workers(url: str) -> Any:
    async def read_count(engine: Any) -> int:
        async with engine.connect() as connection:
            return int((await connection.execute(select(func.count()).select_from(worker))).scalar_one())

    return run_with_engine(url, read_count)


def publish_row(url: str, removed: list[str], *, published: bool) -> None:
    """Publish a row and record the outcome; what is removed is noted in ``removed``."""

    async def note_removal() -> None:
        removed.append("files")

    async def publish_and_record() -> None:
        engine = make_engine(url)
        try:
            async with publish_files(note_removal) as publication:
                async with publication.transaction(engine) as connection:
                    await connection.execute(insert(worker))
                publication.record_outcome(published=published)
        finally:
            await engine.dispose()

    asyncio.run(publish_and_record())


def test_files_of_a_task_that_is_cancelled_right_after_the_commit_stay(
    database_url: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The connection goes back to its pool after the COMMIT, which takes time on a busy machine."""
    close, removed = AsyncConnection.close, list[str]()

    async def close_and_be_cancelled(self: AsyncConnection) -> None:
        await close(self)
        raise asyncio.CancelledError

    with monkeypatch.context() as patched:
        patched.setattr(AsyncConnection, "close", close_and_be_cancelled)
        with pytest.raises(asyncio.CancelledError):
            publish_row(database_url, removed, published=True)
    assert count_workers(database_url) == 1
    assert removed == []


@pytest.mark.parametrize(("published", "removed"), [(True, []), (False, ["files"])])
def test_a_recorded_outcome_decides(database_url: str, published: bool, removed: list[str]) -> None:
    noted: list[str] = []
    publish_row(database_url, noted, published=published)
    assert noted == removed
