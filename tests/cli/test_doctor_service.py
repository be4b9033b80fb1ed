"""What doctor says of a service's parts, each well and each not."""

import os
import socket
import time
from collections.abc import Iterator
from pathlib import Path

import psycopg
import pytest
from typer.testing import CliRunner

from stridelab.cli.app import app
from stridelab.cli.doctor import service as parts
from stridelab.service.jobs.work_folder import HEARTBEAT_FILE
from stridelab.service.postgres.embedded import EmbeddedPostgres
from stridelab.service.settings import Settings
from stridelab.service.storage.migrate import migrate
from support.service.database import TestDatabases, public_folder
from support.service.processes import wait_until, worker

NOWHERE = Settings(database_url="postgresql://nobody@127.0.0.1:9/x")


@pytest.fixture
def settings(database_url: str, tmp_path: Path) -> Settings:
    return Settings(database_url=database_url, data_dir=tmp_path)


def test_the_database_revision_is_compared_with_the_program(settings: Settings, postgres: TestDatabases) -> None:
    assert parts.check_tables(settings).ok
    with psycopg.connect(str(settings.database_url)) as connection:
        connection.execute("UPDATE alembic_version SET version_num = '9999'")
    newer = parts.check_tables(settings)
    assert not newer.ok
    assert "newer stridelab" in newer.fix
    with postgres.fresh(migrated=False) as url:
        empty = parts.check_tables(Settings(database_url=url))
        assert not empty.ok
        assert "stridelab migrate" in empty.fix
        assert parts.check_workers(Settings(database_url=url)).ok


def test_a_clock_a_minute_off_is_reported_with_the_remedy(settings: Settings, monkeypatch: pytest.MonkeyPatch) -> None:
    assert parts.check_clock(settings).ok
    now = time.time
    monkeypatch.setattr(parts.time, "time", lambda: now() + 60.0)  # type: ignore[attr-defined]
    late = parts.check_clock(settings)
    assert not late.ok
    assert -62.0 < float(late.detail.split()[0]) < -58.0
    assert "NTP" in late.fix


def test_waiting_jobs_need_a_worker(settings: Settings) -> None:
    assert parts.check_workers(settings).detail == "0 alive, 0 jobs waiting"
    with psycopg.connect(str(settings.database_url)) as connection:
        connection.execute("INSERT INTO job (id, kind, input, input_hash) VALUES ('j', 'work', '{}', 'h')")
    idle = parts.check_workers(settings)
    assert not idle.ok
    assert "stridelab worker" in idle.fix
    with psycopg.connect(str(settings.database_url)) as connection:
        connection.execute("INSERT INTO worker DEFAULT VALUES")
    assert parts.check_workers(settings).detail == "1 alive, 1 jobs waiting"


@pytest.mark.parametrize("check", [parts.check_tables, parts.check_clock, parts.check_workers])
def test_an_unreachable_database_is_reported(check: object) -> None:
    results = check(NOWHERE)  # type: ignore[operator]
    assert not results.ok
    assert "database" in results.fix


def test_the_store_is_tested_and_left_unchanged(tmp_path: Path) -> None:
    store = tmp_path / "store"
    assert parts.check_storage(Settings(blob_url=store.as_uri())).ok
    assert not list(store.iterdir())
    (store / "doctor").write_text("a file where a folder should be")
    for broken in (store.as_uri(), "ftp://x/y", (store / "doctor" / "deeper").as_uri()):
        results = parts.check_storage(Settings(blob_url=broken))
        assert not results.ok, broken
        assert "STRIDELAB_BLOB_URL" in results.fix
    assert parts.check_storage(Settings(data_dir=tmp_path / "new")).ok
    assert not (tmp_path / "new").exists()


def test_a_store_that_never_answers_is_reported(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr(parts, "_STORE_TIMEOUT_S", 0.2)
    with socket.create_server(("127.0.0.1", 0)) as mute:
        keys = tmp_path / "keys"
        keys.write_text(f"endpoint=http://127.0.0.1:{mute.getsockname()[1]}\naccess_key_id=x\nsecret_access_key=y\n")
        results = parts.check_storage(Settings(blob_url="s3://bucket/prefix", blob_credentials_file=keys))
    assert not results.ok
    assert "no answer within" in results.detail


def test_memory_is_that_of_the_container_or_unit(tmp_path: Path) -> None:
    unit, own = tmp_path / "lab.slice" / "api.service", tmp_path / "own"
    unit.mkdir(parents=True)
    own.write_text("0::/lab.slice/api.service\n", encoding="ascii")
    whole = parts.memory_bytes(tmp_path, tmp_path / "none")
    assert parts.memory_bytes(tmp_path, own) == whole > 0
    (unit / "memory.max").write_text("max\n", encoding="ascii")
    assert parts.memory_bytes(tmp_path, own) == whole
    (unit.parent / "memory.max").write_text("3000000\n", encoding="ascii")
    assert parts.memory_bytes(tmp_path, own) == 3_000_000
    (unit / "memory.max").write_text("2000000\n", encoding="ascii")
    assert parts.memory_bytes(tmp_path, own) == 2_000_000


def test_too_little_memory_for_a_job_is_reported_and_the_solver_detected() -> None:
    assert parts.check_memory(Settings()).ok
    short = parts.check_memory(Settings(job_memory_mb=10**9))
    assert not short.ok
    assert "STRIDELAB_JOB_MEMORY_MB" in short.fix
    assert parts.check_solver(Settings()).ok


def test_a_worker_is_known_by_its_beat(database_url: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def exit_code() -> int:
        return CliRunner().invoke(app, ["doctor", "--worker"]).exit_code

    monkeypatch.setenv("STRIDELAB_DATA_DIR", str(tmp_path))
    assert exit_code() == 1
    with worker(database_url, tmp_path):
        wait_until(lambda: exit_code() == 0, 30, "a beat")
    old = time.time() - 21.0
    os.utime(tmp_path / HEARTBEAT_FILE, (old, old))
    assert exit_code() == 1


@pytest.fixture(scope="module")
def embedded() -> Iterator[Settings]:
    with public_folder() as folder:
        server = EmbeddedPostgres(folder / "data")
        try:
            migrate(server.start())
            yield Settings(data_dir=folder / "data")
        finally:
            server.stop()


def test_an_embedded_database_is_checked_while_it_runs(embedded: Settings, tmp_path: Path) -> None:
    assert "revision" in parts.check_tables(embedded).detail
    assert parts.check_clock(embedded).ok
    assert parts.check_workers(embedded).detail == "0 alive, 0 jobs waiting"
    asleep = Settings(data_dir=tmp_path)
    assert all(check(asleep).ok for check in (parts.check_tables, parts.check_clock, parts.check_workers))
