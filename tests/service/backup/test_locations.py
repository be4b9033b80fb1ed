"""Embedded services: backed up running and stopped, restored into a new folder, moved to a server of their own."""

import json
from collections.abc import Iterator
from pathlib import Path

import psycopg
import pytest
from typer.testing import CliRunner, Result

from stridelab.cli.app import app
from stridelab.service.postgres.embedded import EmbeddedPostgres
from stridelab.service.settings import Settings
from stridelab.service.storage.migrate import migrate
from support.service.database import public_folder
from support.service.stored_rows import FILES, fill_tables, read_rows, read_stored_files


@pytest.fixture(scope="module")
def lab() -> Iterator[Path]:
    """Data folder of an embedded service that has been stopped, with something in every table."""
    with public_folder() as folder:
        data = folder / "lab"
        server = EmbeddedPostgres(data)
        url = server.start()
        migrate(url)
        fill_tables(url, data / "blobs")
        server.stop()
        yield data


@pytest.fixture
def command(monkeypatch: pytest.MonkeyPatch) -> Iterator["Command"]:
    with public_folder() as folder:
        yield Command(monkeypatch, folder)


class Command:
    """The command line with settings of its own, and a folder that the embedded database can reach."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch, folder: Path) -> None:
        self._patch, self.folder = monkeypatch, folder

    def __call__(self, *arguments: object, **settings: object) -> Result:
        self._patch.setattr("stridelab.service.settings.current_settings", lambda: Settings(**settings))  # type: ignore[arg-type]
        return CliRunner().invoke(app, [*map(str, arguments)], catch_exceptions=False)

    def well(self, *arguments: object, **settings: object) -> str:
        result = self(*arguments, **settings)
        assert result.exit_code == 0, result.output
        return result.output

    def refused(self, *arguments: object, **settings: object) -> str:
        """The code of the error that it ends with."""
        result = self(*arguments, **settings)
        assert result.exit_code not in (0, 1), result.output
        return result.output.rsplit("(", 1)[1].split(")")[0]


def restored(data: Path) -> dict[str, list[dict[str, object]]]:
    server = EmbeddedPostgres(data)
    try:
        return read_rows(server.start())
    finally:
        server.stop()


def test_a_stopped_service_is_backed_up_and_comes_back_elsewhere(lab: Path, command: Command) -> None:
    file, data = command.folder / "lab.backup", command.folder / "new"
    output = command.well("backup", file, data_dir=lab)
    assert "2 recordings, 1 subject, 1 scenario, 6 jobs, 6 files (1.2 MB)" in output
    assert not (lab / "supervisor.lock").read_text()  # stopped again, and free
    assert "restored 2 recordings" in command.well("restore", file, data_dir=data)
    assert {row["id"] for row in restored(data)["job"]} == {"done", "half", "gone", "at-work", "second", "first"}
    assert read_stored_files(data / "blobs") == FILES


def test_a_running_service_is_backed_up_and_not_restored_under(lab: Path, command: Command) -> None:
    server = EmbeddedPostgres(lab)
    url = server.start()
    try:
        command.well("backup", command.folder / "running.backup", data_dir=lab)
        with psycopg.connect(url) as connection:  # it goes on
            assert connection.execute("SELECT 1").fetchone() == (1,)
        file = command.folder / "running.backup"
        assert command.refused("restore", file, "--replace", data_dir=lab) == "data-folder-in-use"
    finally:
        server.stop()


def test_a_damaged_backup_makes_no_database(command: Command) -> None:
    (command.folder / "x").write_text("no backup")
    assert command.refused("restore", command.folder / "x", data_dir=command.folder / "new") == "backup-unreadable"
    assert not (command.folder / "new").exists()


def test_where_no_data_are_nothing_is_backed_up(command: Command) -> None:
    assert command.refused("backup", command.folder / "x", data_dir=command.folder / "nowhere") == "no-data"
    assert list(command.folder.iterdir()) == []


def test_an_embedded_service_moves_to_a_server(lab: Path, command: Command, database_url: str) -> None:
    store = command.folder / "store"
    output = command.well("adopt", lab, database_url=database_url, blob_url=store.as_uri())
    assert "adopted 2 recordings" in output
    assert [row["id"] for row in read_rows(database_url)["recording"]] == ["rec1", "rec2"]
    assert read_stored_files(store) == FILES
    assert read_stored_files(lab / "blobs") == FILES
    assert not list(lab.glob(".stridelab-adopt-*"))

    assert command.refused("adopt", lab, database_url=database_url, blob_url=store.as_uri()) == "restore-over-data"
    # with the same store, files stay where they are
    (store / "uploads" / ("a" * 64)).unlink()
    command.well("adopt", lab, "--replace", database_url=database_url, blob_url=(lab / "blobs").as_uri())
    assert len(read_stored_files(store)) == len(FILES) - 1


def test_adopting_needs_a_server_and_a_folder(lab: Path, command: Command, database_url: str) -> None:
    assert command.refused("adopt", lab) == "database-url-missing"
    assert command.refused("adopt", command.folder / "nowhere", database_url=database_url) == "no-data"
    assert json.loads((lab / "postgres.json").read_text())["initialised"]
