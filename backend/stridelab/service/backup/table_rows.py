"""Reads and writes the rows of the tables as data, and lists the files that they refer to."""

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any, Final

import psycopg
from psycopg import sql

from stridelab.errors import Conflict
from stridelab.service.backup.archive import ArchivedTable
from stridelab.service.storage import locks
from stridelab.service.storage.database import CONNECTION_OPTIONS
from stridelab.service.storage.migrate import libpq_address

Connection = psycopg.Connection[tuple[Any, ...]]
_OF_THE_INSTALLATION: Final = ("alembic_version", "worker", "job_partial")
_NAMED_FILES: Final = {
    "recording": "SELECT unnest(ARRAY[blob_key, tracks_key]) FROM recording",
    "job": """
    SELECT blob_prefix || '/' || (artifact->>'name')
            FROM job, jsonb_array_elements(job.result->'artifacts') AS artifact
           WHERE blob_prefix IS NOT NULL
    UNION SELECT 'batches/' || (input->>'batch_id') || '/' || name
            FROM job, jsonb_array_elements_text(job.input->'files') AS name
           WHERE kind = 'read-batch' AND state IN ('queued', 'running')
    """,
    "robot": "SELECT unnest(array_remove(ARRAY[bundle_key, links_key, learned_key], NULL)) FROM robot",
}
"""Queries of the keys of stored files by table: a database of an earlier version lacks some tables."""
_CLOSE_DELAY_S: Final = 3.0
"""Waiting time, because a recently closed connection is still listed."""


@dataclass(frozen=True)
class TableRows:
    """The tables of one schema, over one connection; without those that describe the installation."""

    connection: Connection

    def table_columns(self) -> dict[str, list[str]]:
        """Columns of every table, in ordinal order."""
        result = self.connection.execute(
            "SELECT c.table_name, c.column_name FROM information_schema.columns c"
            " JOIN information_schema.tables t USING (table_schema, table_name)"
            " WHERE table_schema = current_schema() AND t.table_type = 'BASE TABLE'"
            " ORDER BY c.table_name, c.ordinal_position"
        )
        columns: dict[str, list[str]] = {}
        for table, column in result:
            if table not in _OF_THE_INSTALLATION:
                columns.setdefault(table, []).append(column)
        return columns

    def referenced_files(self) -> set[str]:
        """Keys of all stored files that rows refer to."""
        tables = self.table_columns()
        queries = [query for table, query in _NAMED_FILES.items() if table in tables]
        return {str(key) for query in queries for (key,) in self.connection.execute(query)}

    def copy_rows_out(self, table: str, columns: list[str], append: Callable[[bytes], None]) -> ArchivedTable:
        """Pass the rows to ``append`` as COPY text; returns columns and number of rows."""
        rows = 0
        query = sql.SQL("COPY {} ({}) TO STDOUT").format(sql.Identifier(table), _column_list(columns))
        with self.connection.cursor().copy(query) as copy:
            for piece in copy:
                rows += bytes(piece).count(b"\n")  # a line break inside a value is written as two characters
                append(bytes(piece))
        return ArchivedTable(columns=columns, rows=rows)

    def copy_rows_in(self, table: str, columns: list[str], pieces: Iterator[bytes]) -> int:
        """Insert rows from COPY text; returns their number."""
        query = sql.SQL("COPY {} ({}) FROM STDIN").format(sql.Identifier(table), _column_list(columns))
        cursor = self.connection.cursor()
        with cursor.copy(query) as copy:
            for piece in pieces:
                copy.write(piece)
        return cursor.rowcount

    @contextmanager
    def without_foreign_keys(self, tables: list[str]) -> Iterator[None]:
        """Drop the foreign keys among ``tables`` for the block; adding them again checks all rows."""
        references = self.connection.execute(
            "SELECT conrelid::regclass::text, conname, pg_get_constraintdef(oid) FROM pg_constraint"
            " WHERE contype = 'f' AND conrelid = ANY(%s::regclass[])",
            ([_quote_identifier(table) for table in tables],),
        ).fetchall()
        for table, name, _ in references:
            self._alter_table(table, sql.SQL("DROP CONSTRAINT {}").format(sql.Identifier(name)))
        yield
        for table, name, definition in references:
            # the definition comes from the catalogue and belongs to a constraint of this program's migrations
            self._alter_table(table, sql.SQL("ADD CONSTRAINT {} {}").format(sql.Identifier(name), sql.SQL(definition)))

    def _alter_table(self, table: str, change: sql.Composed) -> None:
        self.connection.execute(sql.SQL("ALTER TABLE {} {}").format(sql.SQL(table), change))


@contextmanager
def open_snapshot(url: str) -> Iterator[TableRows]:
    """The rows in a read-only snapshot; no stored file is removed during the block."""
    with psycopg.connect(
        libpq_address(url), autocommit=True, application_name="stridelab-backup", **CONNECTION_OPTIONS
    ) as connection:
        connection.isolation_level = psycopg.IsolationLevel.REPEATABLE_READ
        connection.read_only = True
        # before the snapshot, so that it contains no rows whose files are just being removed
        connection.execute("SELECT pg_advisory_lock(%s)", (locks.REMOVAL,))
        with connection.transaction():
            yield TableRows(connection)
        # released here, because the server notices only some time later that a connection has been closed
        connection.execute("SELECT pg_advisory_unlock(%s)", (locks.REMOVAL,))


def refuse_other_connections(connection: Connection) -> None:
    """Raise ``Conflict`` (``service-running``) while a web server or a worker uses the database."""
    deadline = time.monotonic() + _CLOSE_DELAY_S
    while others := _count_other_connections(connection):
        if time.monotonic() > deadline:
            raise Conflict(
                "service-running",
                f"{others} connections use this database. Stop the web servers and workers first, then try again.",
            )
        time.sleep(0.1)


def _count_other_connections(connection: Connection) -> int:
    connection.execute("SELECT pg_stat_clear_snapshot()")
    row = connection.execute(
        "SELECT count(*) FROM pg_stat_activity WHERE datname = current_database()"
        " AND pid <> pg_backend_pid() AND backend_type = 'client backend'"
    ).fetchone()
    return int(row[0]) if row else 0


def _column_list(names: list[str]) -> sql.Composed:
    return sql.SQL(", ").join(map(sql.Identifier, names))


def _quote_identifier(table: str) -> str:
    return '"' + table.replace('"', '""') + '"'
