"""A database of an earlier version keeps what is in it."""

import psycopg

from stridelab.service.storage.migrating import is_migrated, migrate
from support.database import TestDatabases
from support.revisions import migrate_to


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
