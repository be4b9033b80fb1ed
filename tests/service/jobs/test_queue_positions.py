import pytest
from sqlalchemy import event
from sqlalchemy.ext.asyncio import AsyncEngine

from stridelab.service.jobs.store import JobStore
from support.service.database import run_with_engine
from support.service.job_kinds import KINDS


@pytest.mark.parametrize(("max_age_s", "n_reads"), [(0.0, 5), (60.0, 2)])
def test_positions_are_read_once_and_again_for_new_jobs(database_url: str, max_age_s: float, n_reads: int) -> None:
    statements: list[str] = []

    async def act(engine: AsyncEngine) -> list[int | None]:
        event.listen(engine.sync_engine, "before_cursor_execute", lambda *call: statements.append(call[2]))
        store = JobStore(engine, KINDS, max_position_age_s=max_age_s)
        first, second = [(await store.submit("work", {"n": n}, owner="a")).job_id for n in range(2)]
        positions = [(await store.get(job_id)).queue_position for job_id in (first, second)]
        third = (await store.submit("work", {}, owner="b")).job_id
        return [*positions, *[(await store.get(job_id)).queue_position for job_id in (third, first, first)]]

    assert run_with_engine(database_url, act) == [1, 2, 2, 1, 1]
    assert sum("row_number()" in statement for statement in statements) == n_reads
