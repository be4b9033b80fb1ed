"""A database of an earlier version keeps what is in it."""

from pathlib import Path

import psycopg
import pytest

from stridelab.service.storage.migrate import all_revisions, engine_of, is_migrated, migrate
from support.service.database import TestDatabases, differences, migrate_to
from support.service.stored_rows import fill, rows


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
            kept = new.execute("SELECT body, bundled, updated_at = created_at FROM scenario").fetchall()
            assert kept == [({"a": 1}, False, True)]
            assert new.execute("SELECT id, kind, scenario_id FROM job").fetchall() == [("j", "estimate-com", None)]
            new.execute("UPDATE job SET scenario_id = 's'")
            new.execute("DELETE FROM scenario")
            assert new.execute("SELECT scenario_id FROM job").fetchall() == [(None,)]


@pytest.mark.parametrize("revision", all_revisions()[:-1])
def test_every_row_survives_the_way_from(postgres: TestDatabases, tmp_path: Path, revision: str) -> None:
    """All that an earlier version kept is there afterwards, value for value, and the tables are the declared ones."""
    with postgres.fresh(migrated=False) as url:
        migrate_to(url, revision)
        fill(url, tmp_path / "blobs")
        before = rows(url)
        migrate(url)
        after = rows(url)
        for table, kept in before.items():
            for old in kept:
                old.pop("queue_id", None)  # the row of the queue that revision 0009 drops
            assert [{name: new[name] for name in old} for old, new in zip(kept, after[table], strict=True)] == kept
        migrate(url)  # nothing is left to do
        assert rows(url) == after
        engine = engine_of(url)
        with engine.connect() as connection:
            assert differences(connection) == []
        engine.dispose()
