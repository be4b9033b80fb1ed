"""A database of an earlier version keeps what is in it."""

from pathlib import Path

import psycopg
import pytest

from stridelab.service.storage.migrate import all_revisions, engine_of, is_migrated, migrate
from support.service.database import TestDatabases, migrate_to, schema_differences
from support.service.processes import Jobs, assert_sound, worker
from support.service.stored_rows import fill_tables, read_rows

OLD_QUEUE = Path(__file__).parents[2] / "support" / "service" / "procrastinate-3.10.sql"
DELIVER = (
    "SELECT unnest(procrastinate_defer_jobs_v1(ARRAY[ROW(%s, 'run-job', 0, NULL, NULL,"
    " jsonb_build_object('job_id', %s::text), NULL)::procrastinate_job_to_defer_v1]))"
)


def test_scenarios_and_jobs_of_revision_0001(postgres: TestDatabases) -> None:
    with postgres.fresh(migrated=False) as url:
        migrate_to(url, "0001")
        with psycopg.connect(url) as old:
            old.execute("INSERT INTO scenario (id, created_at, body) VALUES ('s', '2026-01-02 03:04Z', '{\"a\": 1}')")
            old.execute("INSERT INTO job (id, kind, input, input_hash) VALUES ('j', 'estimate-com', '{}', 'h')")
        assert not is_migrated(url)
        migrate(url)
        assert is_migrated(url)
        with psycopg.connect(url) as new:
            scenario_rows = new.execute("SELECT body, bundled, updated_at = created_at FROM scenario").fetchall()
            assert scenario_rows == [({"a": 1}, False, True)]
            assert new.execute("SELECT id, kind, scenario_id FROM job").fetchall() == [("j", "estimate-com", None)]
            new.execute("UPDATE job SET scenario_id = 's'")
            new.execute("DELETE FROM scenario")
            assert new.execute("SELECT scenario_id FROM job").fetchall() == [(None,)]


@pytest.mark.parametrize("revision", all_revisions()[:-1])
def test_every_row_survives_the_way_from(postgres: TestDatabases, tmp_path: Path, revision: str) -> None:
    """All rows of an earlier version are there afterwards, value for value, and the tables are the declared ones."""
    with postgres.fresh(migrated=False) as url:
        migrate_to(url, revision)
        fill_tables(url, tmp_path / "blobs")
        before = read_rows(url)
        migrate(url)
        after = read_rows(url)
        for table, rows_before in before.items():
            for old in rows_before:
                old.pop("queue_id", None)  # the row of the queue that revision 0009 drops
            assert [
                {name: new[name] for name in old} for old, new in zip(rows_before, after[table], strict=True)
            ] == rows_before
        migrate(url)  # nothing is left to do
        assert read_rows(url) == after
        engine = engine_of(url)
        with engine.connect() as connection:
            assert schema_differences(connection) == []
        engine.dispose()


def test_jobs_in_flight_in_the_old_queue_are_run_by_the_new_one(postgres: TestDatabases, tmp_path: Path) -> None:
    """Waiting, fetched, started, redelivered and forgotten ones, each with its row in the queue of revision 0008."""
    states = {
        "waiting": ("queued", 0, "todo"),
        "fetched": ("queued", 0, "doing"),
        "redelivered": ("queued", 1, "todo"),
        "undelivered": ("queued", 0, "failed"),
        "started": ("running", 1, "doing"),
        "ended": ("failed", 1, "succeeded"),
        "cancelled": ("cancelled", 0, "cancelled"),
    }
    with postgres.fresh(migrated=False) as url:
        migrate_to(url, "0008")
        with psycopg.connect(url, autocommit=True) as old:
            old.execute(OLD_QUEUE.read_bytes())
            old.execute("INSERT INTO procrastinate_workers DEFAULT VALUES")
            for number, (name, (state, attempt, status)) in enumerate(states.items()):
                delivery = old.execute(DELIVER, ("short", name)).fetchone()
                assert delivery is not None
                old.execute(
                    "UPDATE procrastinate_jobs SET status = %s, worker_id = 1 WHERE id = %s", (status, *delivery)
                )
                old.execute(
                    "INSERT INTO job (id, kind, state, attempt, input, input_hash, queue_id, created_at, finished_at)"
                    " VALUES (%s, 'work', %s, %s, '{}', 'h', %s, now() + %s * interval '1 ms', now())",
                    (name, state, attempt, *delivery, number),
                )
                steps = ["queued", *["running"] * attempt]
                for step, event in enumerate(steps if steps[-1] == state else [*steps, state]):
                    old.execute(
                        "INSERT INTO job_event (job_id, state, attempt, fraction, message) VALUES (%s, %s, %s, 0, '')",
                        (name, event, attempt if step else 0),
                    )
            old.execute("INSERT INTO job (id, kind, input, input_hash) VALUES ('long', 'plan-motion', '{}', 'h')")
        migrate(url)
        with psycopg.connect(url, autocommit=True) as new:
            for catalogue, name in (("pg_class", "relname"), ("pg_proc", "proname"), ("pg_type", "typname")):
                leftovers = f"SELECT {name} FROM {catalogue} WHERE {name} LIKE '%procrastinate%'"
                assert new.execute(leftovers.encode()).fetchall() == []
            lanes = "SELECT DISTINCT lane FROM job WHERE kind = %s"
            assert new.execute(lanes, ("plan-motion",)).fetchall() == [("long",)]
            assert new.execute(lanes, ("work",)).fetchall() == [("short",)]
            new.execute("DELETE FROM job WHERE id = 'long'")  # no kind of the test's worker
        jobs = Jobs(url)
        with worker(url, tmp_path / "w", STRIDELAB_BLOB_URL=(tmp_path / "blobs").as_uri()):
            ended = {name: jobs.until_final(name) for name in states}
        outcomes = {name: (record.state, record.attempt) for name, record in ended.items()}
        assert outcomes == {
            "waiting": ("succeeded", 1),
            "fetched": ("succeeded", 1),
            "redelivered": ("succeeded", 2),
            "undelivered": ("succeeded", 1),
            "started": ("succeeded", 2),
            "ended": ("failed", 1),
            "cancelled": ("cancelled", 0),
        }
        assert_sound(url, tmp_path / "blobs", states)
