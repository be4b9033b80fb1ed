import asyncio
import os
import signal
from collections.abc import AsyncGenerator
from typing import Any

import psycopg
import pytest
from sqlalchemy import func, select, text
from sqlalchemy.ext.asyncio import AsyncEngine

from stridelab.errors import NotFound
from stridelab.schemas.jobs import JobEvent
from stridelab.service.jobs import notifications as board_module
from stridelab.service.jobs.events import CHANNEL
from stridelab.service.jobs.notifications import JobNotifications
from stridelab.service.jobs.store import JobStore
from stridelab.service.postgres.embedded import EmbeddedPostgres
from stridelab.service.storage.migrate import migrate
from support.service.database import public_folder, run_with_engine
from support.service.job_kinds import KINDS


def test_waiting_ends_when_the_job_does(database_url: str) -> None:
    async def act(engine: AsyncEngine) -> None:
        async with JobNotifications(database_url) as board:
            store = JobStore(engine, KINDS)
            job_id = (await store.submit("work", {})).job_id
            assert (await board.wait_for_end(store, job_id, 0.0)).state == "queued"
            waiting = asyncio.create_task(board.wait_for_end(store, job_id, 60.0))
            await asyncio.sleep(0.1)
            await store.request_cancel(job_id)
            assert (await asyncio.wait_for(waiting, 5.0)).state == "cancelled"
            with pytest.raises(NotFound):
                await board.wait_for_end(store, "nothing", 1.0)
            assert board._watchers == {}

    run_with_engine(database_url, act)


def test_many_watchers_of_one_job_and_none_of_another(database_url: str) -> None:
    async def act(engine: AsyncEngine) -> None:
        async with JobNotifications(database_url) as board:
            store = JobStore(engine, KINDS)
            await asyncio.wait_for(board._listener.listening.wait(), 10)
            first, second, third = [(await store.submit("work", {"n": n})).job_id for n in range(3)]
            with board.watch_job(
                third
            ) as passed:  # notifications keep their order: those of the submissions are through
                await store.request_cancel(third)
                await asyncio.wait_for(passed.wait(), 5.0)
            with board.watch_job(first) as a, board.watch_job(first) as b, board.watch_job(second) as c:
                await store.request_cancel(first)
                await asyncio.wait_for(asyncio.gather(a.wait(), b.wait()), 5.0)
                assert not c.is_set()

    run_with_engine(database_url, act)


def test_all_listeners_to_a_job_share_one_reader(database_url: str, monkeypatch: pytest.MonkeyPatch) -> None:
    async def act(engine: AsyncEngine) -> None:
        store = JobStore(engine, KINDS)
        reads = 0
        read_events = store.events_after

        async def count_read(*arguments: Any) -> tuple[JobEvent, ...]:
            nonlocal reads
            reads += 1
            return await read_events(*arguments)

        monkeypatch.setattr(store, "events_after", count_read)
        job_id = (await store.submit("work", {})).job_id
        async with JobNotifications(database_url) as board:
            await asyncio.wait_for(board._listener.listening.wait(), 10)
            first = board.follow_events(store, job_id)
            early = [await anext(first)]
            others = [asyncio.create_task(_all_events(board, store, job_id)) for _ in range(200)]
            while board._feeds[job_id].listeners < 201:
                await asyncio.sleep(0.01)
            await store.request_cancel(job_id)
            early += [events async for events in first]
            received = await asyncio.wait_for(asyncio.gather(*others), 20)
            expected = [event for events in early for event in events]
            assert [event.state for event in expected] == ["queued", "cancelled"]
            assert all(events == expected for events in received)
            assert reads < 10
            assert board._feeds == {}
            assert board._watchers == {}

    run_with_engine(database_url, act)


def test_slow_and_late_listeners_miss_no_event(database_url: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """With fewer events in memory than were written while a listener was busy."""
    monkeypatch.setattr(board_module, "RECENT_EVENTS", 3)

    async def act(engine: AsyncEngine) -> None:
        store = JobStore(engine, KINDS)
        job_id = (await store.submit("work", {})).job_id
        async with JobNotifications(database_url) as board:
            await asyncio.wait_for(board._listener.listening.wait(), 10)
            fast, slow = board.follow_events(store, job_id), board.follow_events(store, job_id)
            received: dict[str, list[int]] = {"fast": [], "slow": [event.seq for event in await anext(slow)]}

            async def follow(name: str, source: AsyncGenerator[tuple[JobEvent, ...], None]) -> None:
                received[name] += [event.seq for events in [e async for e in source] for event in events]

            following = asyncio.create_task(follow("fast", fast))
            insert = text("INSERT INTO job_event (job_id, state, attempt, fraction, message) "
                          "VALUES (:id, 'running', 1, 0.5, 'a')")  # fmt: skip
            for _ in range(10):
                async with engine.begin() as connection:
                    await connection.execute(insert, {"id": job_id})
                    await connection.execute(select(func.pg_notify(CHANNEL, job_id)))
                await asyncio.sleep(0.02)
            await store.request_cancel(job_id)
            await asyncio.wait_for(following, 20)
            await asyncio.wait_for(follow("slow", slow), 20)
            late = [event.seq for event in await _all_events(board, store, job_id)]
            resumed = [event.seq for event in await _all_events(board, store, job_id, late[4])]
        assert len(late) == 12
        assert received["fast"] == received["slow"] == late
        assert resumed == late[5:]

    run_with_engine(database_url, act)


def test_listeners_end_with_the_server_and_with_the_job_row(database_url: str) -> None:
    async def act(engine: AsyncEngine) -> None:
        store = JobStore(engine, KINDS)
        job_id = (await store.submit("work", {})).job_id
        async with JobNotifications(database_url) as board:
            closing = asyncio.Event()
            following = asyncio.create_task(_all_events(board, store, job_id, 0, closing))
            await asyncio.sleep(0.3)
            closing.set()
            assert len(await asyncio.wait_for(following, 5)) == 1
            with pytest.raises(NotFound):
                await _all_events(board, store, "nothing")
            assert board._feeds == {}

    run_with_engine(database_url, act)


async def _all_events(
    board: JobNotifications, store: JobStore, job_id: str, after: int = 0, closing: asyncio.Event | None = None
) -> list[JobEvent]:
    return [event async for events in board.follow_events(store, job_id, after, closing) for event in events]


def test_lost_notifications_cost_only_time(database_url: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(board_module, "FALLBACK_S", 0.3)

    async def act(engine: AsyncEngine) -> None:
        async with JobNotifications(database_url) as board:
            store = JobStore(engine, KINDS)
            job_id = (await store.submit("work", {})).job_id
            waiting = asyncio.create_task(board.wait_for_end(store, job_id, 60.0))
            await asyncio.sleep(0.1)

            def change_silently() -> None:
                with psycopg.connect(database_url) as connection:
                    connection.execute("UPDATE job SET state = 'failed', error = '{}' WHERE id = %s", (job_id,))

            await asyncio.to_thread(change_silently)
            assert (await asyncio.wait_for(waiting, 10.0)).state == "failed"

    run_with_engine(database_url, act)


def test_board_survives_a_restart_of_the_database() -> None:
    with public_folder() as folder:
        server = EmbeddedPostgres(folder)
        url = server.start()
        migrate(url)

        async def act(engine: AsyncEngine) -> None:
            async with JobNotifications(url) as board:
                store = JobStore(engine, KINDS)
                job_id = (await store.submit("work", {})).job_id
                await asyncio.wait_for(board._listener.listening.wait(), 10)
                with board.watch_job(job_id) as change:
                    os.kill(int(server.postmaster_pid or 0), signal.SIGKILL)
                    await asyncio.to_thread(server.start)
                    change.clear()
                    await asyncio.wait_for(change.wait(), 20)  # notified to look again
                waiting = asyncio.create_task(board.wait_for_end(store, job_id, 60.0))
                await asyncio.wait_for(board._listener.listening.wait(), 10)
                await store.request_cancel(job_id)
                assert (await asyncio.wait_for(waiting, 20.0)).state == "cancelled"

        try:
            run_with_engine(url, act)
        finally:
            server.stop()
