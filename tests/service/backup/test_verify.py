"""``doctor --files`` finds what is missing or damaged, jobs refuse a damaged upload, a second upload repairs it."""

from pathlib import Path

import pytest
from typer.testing import CliRunner

from stridelab.cli.app import app
from stridelab.errors import UnreadableFile
from stridelab.service.backup.verify import verify_stored_files
from support.recordings.c3d_files import small_trial
from support.service.stored_rows import add_job, publish_result, start_job
from support.service.web_server import served, upload


def test_damaged_and_missing_files_are_reported_refused_and_repaired(
    database_url: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    content, blobs = small_trial(tmp_path / "walk.c3d").read_bytes(), tmp_path / "data" / "blobs"
    monkeypatch.setenv("STRIDELAB_DATABASE_URL", database_url)
    monkeypatch.setenv("STRIDELAB_BLOB_URL", blobs.as_uri())

    def doctor() -> tuple[int, str]:
        result = CliRunner().invoke(app, ["doctor", "--files"])
        return result.exit_code, result.output

    with served(database_url, tmp_path / "data") as lab, lab.http() as http:
        recording = upload(http, content).json()
        job = lab.run(add_job(lab.parts, recording["id"]))
        attempt = lab.run(start_job(lab.parts, job))
        lab.run(publish_result(lab.parts, attempt, [("com.csv", "text/csv", b"time_s\n")]))
        assert verify_stored_files(database_url, lab.parts.blobs).ok
        assert doctor()[0] == 0
        blob = blobs / "uploads" / recording["sha256"]
        flipped = bytearray(content)
        flipped[len(content) // 2] ^= 1
        blob.write_bytes(flipped)
        with pytest.raises(UnreadableFile, match="damaged"):
            lab.run(lab.parts.blobs.get_file(f"uploads/{recording['sha256']}", tmp_path / "out"))
        (blobs / attempt.blob_prefix / "com.csv").unlink()
        status, words = doctor()
        assert status == 1
        assert f"damaged: recording {recording['id']}, the uploaded file" in words
        assert f"missing: job {job}, com.csv" in words
        assert upload(http, content).status_code == 201
        assert blob.read_bytes() == content
        assert verify_stored_files(database_url, lab.parts.blobs).damaged == ()
