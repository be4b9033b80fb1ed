"""Downloads: streams stored files with a file name that is safe in a header."""

from collections.abc import Mapping
from typing import Final
from urllib.parse import quote

from starlette.responses import StreamingResponse

from stridelab.errors import NotFound, Unavailable
from stridelab.service.api.dependencies import Parts

PARQUET: Final = "application/vnd.apache.parquet"
OCTETS: Final = "application/octet-stream"
FILE_GONE: Final = "The stored file is gone. Restore a backup, or upload the recording or compute the result again."


def content_disposition(filename: str) -> str:
    """``Content-Disposition`` of an attachment (RFC 6266), with the name in ASCII and in UTF-8."""
    plain = "".join(c if c.isascii() and c.isprintable() and c not in '"\\%' else "_" for c in filename)
    return f"attachment; filename=\"{plain}\"; filename*=UTF-8''{quote(filename, safe='')}"


async def send_blob(
    parts: Parts,
    key: str,
    filename: str,
    media_type: str,
    more_headers: Mapping[str, str] | None = None,
    *,
    n_bytes: int | None = None,
) -> StreamingResponse:
    """Stream the stored file ``key``, which should have ``n_bytes``.

    Raises, before anything is sent, ``NotFound`` (``file-gone``) and ``Unavailable`` (``stored-file-damaged``).
    """
    info = await parts.blobs.info(key)
    if info is None:
        raise NotFound("file-gone", FILE_GONE)
    if n_bytes not in (None, info.bytes):
        message = f"The store has {info.bytes} instead of {n_bytes} bytes of {filename}."
        raise Unavailable("stored-file-damaged", message)
    headers = {
        "Content-Disposition": content_disposition(filename),
        "Content-Length": str(info.bytes),
        "Cache-Control": "private, no-cache",
        **(more_headers or {}),
    }
    return StreamingResponse(parts.blobs.stream(key), media_type=media_type, headers=headers)
