"""``bundle.zip``: input, result and files of a finished job in one archive, streamed while it is written."""

import io
import json
import zipfile
from collections.abc import AsyncIterator
from datetime import datetime
from typing import Final

from sqlalchemy import select
from starlette.responses import StreamingResponse

from stridelab.schemas.jobs import JobResult
from stridelab.service.api.dependencies import Parts
from stridelab.service.api.downloads import content_disposition
from stridelab.service.jobs.store import JobRecord
from stridelab.service.kinds.provenance import bibtex_of
from stridelab.service.storage.tables import recording

_FLUSH_BYTES: Final = 256 * 1024


async def stream_bundle(parts: Parts, record: JobRecord, result: JobResult) -> StreamingResponse:
    """Stream the archive of a succeeded job.

    It contains ``input.json``, ``result.json``, ``versions.json``, ``references.bib``, ``artifacts/...`` and, if it
    still exists, the input recording as ``input/...``.
    """
    texts = {
        "input.json": _json_text(result.input),
        "result.json": _json_text(result.model_dump(mode="json")),
        "versions.json": _json_text(result.versions),
        "references.bib": bibtex_of(result.references),
    }
    blobs = {f"artifacts/{artifact.name}": f"{record.blob_prefix}/{artifact.name}" for artifact in result.artifacts}
    if record.recording_id is not None:
        async with parts.engine.connect() as connection:
            rows = await connection.execute(
                select(recording.c.filename, recording.c.blob_key).where(recording.c.id == record.recording_id)
            )
            blobs |= {f"input/{row.filename}": row.blob_key for row in rows}
    headers = {"Content-Disposition": content_disposition(f"{record.kind}-{record.id[:8]}.zip")}
    return StreamingResponse(
        _zip_chunks(parts, texts, blobs, record.finished_at or record.created_at),
        media_type="application/zip",
        headers=headers,
    )


def _json_text(value: object) -> str:
    return json.dumps(value, indent=2, ensure_ascii=False) + "\n"


async def _zip_chunks(
    parts: Parts, texts: dict[str, str], blobs: dict[str, str], written_at: datetime
) -> AsyncIterator[bytes]:
    moment = written_at.timetuple()[:6]
    outbox = _WriteBuffer()
    # Artifacts are already compressed (Parquet) or small, so the archive stores them uncompressed to save CPU time.
    with zipfile.ZipFile(outbox, "w", zipfile.ZIP_STORED) as archive:
        for name, text in texts.items():
            archive.writestr(zipfile.ZipInfo(name, moment), text)
        for name, key in blobs.items():
            with archive.open(zipfile.ZipInfo(name, moment), "w", force_zip64=True) as entry:
                async for piece in parts.blobs.stream(key):
                    entry.write(piece)
                    if outbox.waiting_bytes > _FLUSH_BYTES:
                        yield outbox.take_bytes()
    yield outbox.take_bytes()


class _WriteBuffer(io.RawIOBase):
    """A non-seekable write buffer whose content is taken out piece by piece."""

    def __init__(self) -> None:
        super().__init__()
        self._pieces: list[bytes] = []
        self.waiting_bytes = 0

    def writable(self) -> bool:
        return True

    def write(self, data: "bytes | bytearray | memoryview") -> int:  # type: ignore[override]  # any buffer, as zipfile passes
        piece = bytes(data)
        self._pieces.append(piece)
        self.waiting_bytes += len(piece)
        return len(piece)

    def take_bytes(self) -> bytes:
        """Return and clear the bytes written since the last call."""
        taken, self._pieces, self.waiting_bytes = b"".join(self._pieces), [], 0
        return taken
