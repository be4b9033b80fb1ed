import asyncio
import gc
import threading

import psycopg
import pytest
from alembic.script import ScriptDirectory
from psycopg import waiting
from sqlalchemy import text
from sqlalchemy.ext.asyncio import AsyncEngine

from stridelab.errors import InvalidInput, Unavailable
from stridelab.service.jobs.queue import DATABASE_UNAVAILABLE
from stridelab.service.settings import Settings
from stridelab.service.storage import database
from stridelab.service.storage.database import connect_autocommit, database_url, make_engine, parse_url
from stridelab.service.storage.migrate import MIGRATIONS, all_revisions, engine_of, is_migrated, migrate
from support.service.database import TestDatabases, run_with_engine, schema_differences


def test_migrations_make_exactly_the_declared_tables(database_url: str) -> None:
    engine = engine_of(database_url)
    with engine.connect() as connection:
        assert schema_differences(connection) == []
    engine.dispose()


def test_file_names_tell_the_order_of_revisions() -> None:
    scripts = ScriptDirectory(str(MIGRATIONS))
    assert [script.revision for script in scripts.walk_revisions()][::-1] == all_revisions()


def test_migrating_twice_and_at_once_is_harmless(postgres: TestDatabases) -> None:
    with postgres.fresh(migrated=False) as url:
        assert not is_migrated(url)
        failures: list[BaseException] = []

        def work() -> None:
            try:
                migrate(url)
            except BaseException as error:
                failures.append(error)

        threads = [threading.Thread(target=work) for _ in range(4)]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
        assert failures == []
        assert is_migrated(url)


def test_database_of_a_newer_version_is_refused(database_url: str) -> None:
    with psycopg.connect(database_url) as connection:
        connection.execute("UPDATE alembic_version SET version_num = '9999'")
    with pytest.raises(Unavailable, match="9999") as caught:
        migrate(database_url)
    assert caught.value.code == "database-newer"


def test_unreachable_database_is_named_without_its_password() -> None:
    with pytest.raises(Unavailable) as caught:
        migrate("postgresql://someone:secret@127.0.0.1:1/none", wait_s=0.1)
    assert caught.value.code == "database-unreachable"
    assert "127.0.0.1" in caught.value.message
    assert "secret" not in caught.value.message


@pytest.mark.parametrize("url", ["sqlite:///x.db", "mysql://h/d", "::", ""])
def test_only_postgresql_urls(url: str) -> None:
    with pytest.raises(InvalidInput, match="STRIDELAB_DATABASE_URL"):
        parse_url(url)


def test_password_comes_from_its_file(tmp_path) -> None:
    secret = tmp_path / "password"
    secret.write_text("p@ss:word/1\n", encoding="utf-8")
    settings = Settings(database_url="postgresql://lab@db:5432/lab", database_password_file=secret)
    assert parse_url(str(database_url(settings))).password == "p@ss:word/1"
    assert database_url(Settings(database_url=None)) is None


def test_a_process_that_is_frozen_in_a_transaction_holds_its_lock_for_a_limited_time(
    database_url: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(database, "IDLE_MS", 500)

    async def act() -> None:
        frozen, other = make_engine(database_url), make_engine(database_url)
        take = text("SELECT version_num FROM alembic_version FOR UPDATE")
        async with frozen.connect() as holds:
            await holds.execute(take)
            async with asyncio.timeout(20.0), other.begin() as waits:
                await waits.execute(take)
            with pytest.raises(DATABASE_UNAVAILABLE):  # so that a worker that wakes up repeats its transaction
                await holds.execute(take)
            await holds.invalidate()
        await frozen.dispose()
        await other.dispose()

    asyncio.run(act())


def test_options_of_the_database_address_are_preserved(database_url: str) -> None:
    async def shown(engine: AsyncEngine) -> list[str]:
        async with engine.connect() as connection:
            names = ("statement_timeout", "idle_in_transaction_session_timeout")
            return [(await connection.execute(text(f"SHOW {name}"))).scalar_one() for name in names]

    mark = "&" if "?" in database_url else "?"
    assert run_with_engine(f"{database_url}{mark}options=-c%20statement_timeout%3D7000", shown) == ["7s", "2min"]


def test_a_burst_of_requests_does_not_start_a_server_process_each_time(database_url: str) -> None:
    async def burst(engine: AsyncEngine) -> list[set[int]]:
        async def server_process() -> int:
            async with engine.connect() as connection:
                return int((await connection.execute(text("SELECT pg_backend_pid() FROM pg_sleep(0.02)"))).scalar_one())

        return [set(await asyncio.gather(*(server_process() for _ in range(40)))) for _ in range(3)]

    first, *others = run_with_engine(database_url, burst)
    assert all(used <= first for used in others)


@pytest.mark.parametrize("times", [1, 50])
def test_cancelled_reader_returns_its_connection_in_its_mode(
    database_url: str, monkeypatch: pytest.MonkeyPatch, times: int
) -> None:
    """Cancelled at each of its suspensions, once or again and again as a disconnected client's request is.

    psycopg suspends in every call here, as it does in a busy event loop.
    """
    monkeypatch.setattr(waiting, "MAX_BUSY_TIME", 0.0)

    async def read(engine: AsyncEngine) -> None:
        async with connect_autocommit(engine) as connection:
            await connection.execute(text("SELECT 1"))

    async def cancel_everywhere(engine: AsyncEngine) -> int:
        await read(engine)
        for steps in range(1000):
            task = asyncio.create_task(read(engine))
            for _ in range(steps):
                await asyncio.sleep(0)
            if task.done():
                return steps
            for _ in range(times):
                task.cancel()
                await asyncio.sleep(0)
            await asyncio.gather(task, return_exceptions=True)
            assert engine.sync_engine.pool.status().endswith("Checked out connections: 0")
            async with engine.connect() as connection:
                assert (await connection.get_raw_connection()).driver_connection.autocommit is False
        raise AssertionError("the reader never ended")

    assert run_with_engine(database_url, cancel_everywhere) > 5
    gc.collect()  # a connection that was not returned warns here
