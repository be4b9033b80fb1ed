"""Uploads by content: stored while a recording uses them, removed if their process died before the row was written."""

from datetime import timedelta
from pathlib import Path

from sqlalchemy import insert
from sqlalchemy.ext.asyncio import AsyncEngine

from stridelab.service.storage.blobs import BlobStore
from stridelab.service.storage.content_addressed import delete_if_unused, remove_unused, upload_key
from stridelab.service.storage.tables import recording
from support.service.database import run_with_engine
from support.service.stored_rows import facts


def test_an_upload_without_a_recording_is_swept_once_it_is_old(database_url: str, tmp_path: Path) -> None:
    async def scenario(engine: AsyncEngine) -> None:
        blobs = BlobStore.from_url((tmp_path / "blobs").as_uri())
        source = tmp_path / "file"
        source.write_bytes(b"x")
        used, unused = upload_key("a" * 64), upload_key("b" * 64)
        for key in (used, unused):
            await blobs.put_file(key, source)
        row = {"filename": "f", "sha256": "a" * 64, "bytes": 1, "facts": facts().model_dump(mode="json")}
        async with engine.begin() as connection:
            await connection.execute(
                insert(recording).values(id="r", blob_key=used, tracks_key="t", subject_fields={}, **row)
            )
        async with engine.connect() as connection:
            assert await remove_unused(connection, blobs, timedelta(hours=1)) == []
            assert await remove_unused(connection, blobs, timedelta(0)) == [unused]
            assert not await delete_if_unused(connection, blobs, used)
        assert await blobs.exists(used)
        assert not await blobs.exists(unused)

    run_with_engine(database_url, scenario)
