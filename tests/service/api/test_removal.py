"""What is deleted while a backup is made loses its rows at once, and its files after the backup."""

from collections.abc import Iterator
from datetime import timedelta
from pathlib import Path

import pytest

from stridelab.service.backup.table_rows import open_snapshot
from stridelab.service.jobs import retention
from stridelab.service.settings import Settings
from support.recordings.c3d_files import small_trial
from support.service.database import TestDatabases
from support.service.web_server import Served, refusal_code, served, upload

RECORDINGS = "/api/v1/recordings"


@pytest.fixture
def url(postgres: TestDatabases) -> Iterator[str]:
    with postgres.fresh() as fresh_url:
        yield fresh_url


@pytest.fixture
def lab(url: str, tmp_path: Path) -> Iterator[Served]:
    with served(url, tmp_path / "data") as running:
        yield running


def sweep(lab: Served, url: str) -> None:
    """What a worker's janitor does, with files that have just been written called old."""

    lab.run(retention.remove_expired(lab.parts.engine, lab.parts.blobs, Settings(database_url=url)))


def two_trials(folder: Path) -> list[bytes]:
    """Two files of different content."""
    return [small_trial(folder / f"{s}.c3d", seconds=s).read_bytes() for s in (0.5, 0.6)]


def test_files_stay_until_a_backup_is_done(
    lab: Served, url: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(retention.remove_orphans, "__defaults__", (timedelta(seconds=-1),))
    monkeypatch.setattr(retention, "ORPHAN_AGE", timedelta(seconds=-1))
    with lab.http() as http:
        remaining_id, deleted_id = (str(upload(http, content).json()["id"]) for content in two_trials(tmp_path))
        before = lab.stored_files()
        with open_snapshot(url) as rows:
            named = rows.referenced_files()
            assert http.patch(f"{RECORDINGS}/{remaining_id}", json={"plates": {"1": {"use": False}}}).status_code == 200
            assert http.delete(f"{RECORDINGS}/{deleted_id}").status_code == 204
            assert refusal_code(http.get(f"{RECORDINGS}/{deleted_id}")) == (404, "recording-not-found")
            sweep(lab, url)
            assert named <= lab.stored_files()
            assert before < lab.stored_files()
        sweep(lab, url)
        assert named & lab.stored_files() == {f"uploads/{http.get(f'{RECORDINGS}/{remaining_id}').json()['sha256']}"}
        assert len(lab.stored_files()) == 2
        assert http.get(f"{RECORDINGS}/{remaining_id}/tracks.parquet").status_code == 200
