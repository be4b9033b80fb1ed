"""Database row of an uploaded recording, and the storage key of its tracks."""

import asyncio
import hashlib
import uuid
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from stridelab.schemas.recordings import RecordingFacts, SubjectFields
from stridelab.service.recording_sessions import session_id_of
from stridelab.service.storage.content_addressed import upload_key


def recording_prefix(recording_id: str) -> str:
    """Key prefix of the files that belong to this recording alone."""
    return f"recordings/{recording_id}"


def file_sha256(path: Path) -> str:
    """SHA-256 of a file, in hexadecimal."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


async def new_tracks_key(recording_id: str, tracks: Path) -> str:
    """A unique key for these tracks that ends in their SHA-256 (``hash_in_key``)."""
    digest = await asyncio.to_thread(file_sha256, tracks)
    return f"{recording_prefix(recording_id)}/tracks-{uuid.uuid4().hex[:8]}-{digest}.parquet"


def uploaded_row(
    *,
    recording_id: str,
    owner: str | None,
    filename: str,
    sha256: str,
    size_bytes: int,
    tracks_key: str,
    facts: RecordingFacts,
    subject: SubjectFields,
    session_id: str | None = None,
) -> dict[str, Any]:
    """Column values of a new recording; without ``session_id``, the session is derived (``session_id_of``)."""
    values: dict[str, Any] = {
        "id": recording_id,
        "owner": owner,
        "filename": filename,
        "sha256": sha256,
        "bytes": size_bytes,
        "blob_key": upload_key(sha256),
        "tracks_key": tracks_key,
        "facts": facts.model_dump(mode="json"),
        "subject_fields": subject.model_dump(mode="json", exclude_none=True),
        "marker_map": {},
        "plate_switches": {},
        "session_stated": session_id is not None,
    }
    values["session_id"] = session_id or session_id_of(values, datetime.now(UTC))
    return values
