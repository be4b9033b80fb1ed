import asyncio
import os
import signal

import psycopg
import pytest
from sqlalchemy.ext.asyncio import AsyncEngine

from stridelab.errors import NotFound
from stridelab.service.jobs import notifications as board_module
from stridelab.service.jobs.notifications import JobNotifications
from stridelab.service.jobs.store import JobStore
from stridelab.service.postgres.embedded import EmbeddedPostgres
from stridelab.service.storage.migrate import migrate
from support.service.database import public_folder, within
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

    within(database_url, act)


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

    within(database_url, act)


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

    within(database_url, act)


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
                    await asyncio.wait_for(change.wait(), 20)  # told to look again
                waiting = asyncio.create_task(board.wait_for_end(store, job_id, 60.0))
                await asyncio.wait_for(board._listener.listening.wait(), 10)
                await store.request_cancel(job_id)
                assert (await asyncio.wait_for(waiting, 20.0)).state == "cancelled"

        try:
            within(url, act)
        finally:
            server.stop()
