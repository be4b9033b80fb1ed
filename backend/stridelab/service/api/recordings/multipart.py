"""A multipart form with one file, read as it arrives: the file goes to disk with a running hash, never into memory."""

import errno
import hashlib
import re
import shutil
import unicodedata
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Final

import anyio
from python_multipart.exceptions import FormParserError
from python_multipart.multipart import MultipartParser, parse_options_header
from starlette.requests import Request

from stridelab.errors import Fault, InvalidInput, StorageFull, TooLarge

FORM_OVERHEAD_BYTES: Final = 64_000
"""Room for boundaries and text fields beside the file."""
FIELD_LIMIT_BYTES: Final = 4_000
PART_LIMIT: Final = 20
NAME_LIMIT: Final = 120


@dataclass(frozen=True)
class Limits:
    """Bounds of an upload, in bytes."""

    file_bytes: int
    free_disk_bytes: int


@dataclass(frozen=True)
class ReceivedForm:
    """A form whose file lies at ``path``; ``filename`` is safe to show and to offer for download."""

    path: Path
    filename: str
    size_bytes: int
    sha256: str
    fields: dict[str, str]


def safe_filename(claimed: str) -> str:
    """The last part of a claimed file name without control, direction or path characters, at most 120 long.

    It is shown and offered for download, and never used as a path of ours.
    """
    plain = unicodedata.normalize("NFC", re.split(r"[/\\]", claimed)[-1])
    plain = "".join(character for character in plain if character.isprintable() and character not in '"<>:|?*')
    plain = plain.strip(" .")
    stem, dot, suffix = plain.rpartition(".")
    if dot and len(suffix) <= 10:
        plain = f"{stem[: NAME_LIMIT - 1 - len(suffix)]}.{suffix}"
    return plain[:NAME_LIMIT] or "recording"


async def receive_form(request: Request, path: Path, limits: Limits) -> ReceivedForm:
    """Read the form of ``request``; its part ``file`` is written to ``path``.

    Raises ``TooLarge`` (``upload-too-large``) from the announced length alone where that is over the limit, else at
    the byte that exceeds it; ``StorageFull`` (``disk-full``); ``InvalidInput`` (``unsupported-media-type``,
    ``malformed-request``, ``file-missing``, ``empty-file``, ``invalid-request``).
    """
    media_type, options = parse_options_header(request.headers.get("content-type", ""))
    if media_type != b"multipart/form-data" or not options.get(b"boundary"):
        raise InvalidInput(
            "unsupported-media-type",
            "Send the file as multipart/form-data with the field 'file', for example: curl -F file=@trial.c3d ...",
            [Fault("Content-Type", "not multipart/form-data with a boundary")],
        )
    announced = request.headers.get("content-length", "")
    expected_bytes = int(announced) if announced.isdecimal() else 0
    if expected_bytes > limits.file_bytes + FORM_OVERHEAD_BYTES:
        raise _too_large(limits)
    if shutil.disk_usage(path.parent).free < limits.free_disk_bytes + expected_bytes:
        raise _disk_full()
    with path.open("wb") as target:
        form = _Form(target, limits)
        try:
            parser = form.parser(options[b"boundary"])
            async for chunk in request.stream():
                # Writing and hashing block; other requests go on meanwhile.
                await anyio.to_thread.run_sync(parser.write, chunk)
            parser.finalize()
        except FormParserError as error:
            raise InvalidInput("malformed-request", "The multipart form is damaged or cut off.") from error
        except OSError as error:
            if error.errno in (errno.ENOSPC, errno.EDQUOT):
                raise _disk_full() from error
            raise
    return form.received(path)


def _too_large(limits: Limits) -> TooLarge:
    return TooLarge(
        "upload-too-large",
        f"The file is larger than {limits.file_bytes / 1e6:g} MB, the most that this service takes.",
        [Fault("file", "too large")],
    )


def _disk_full() -> StorageFull:
    return StorageFull("disk-full", "The disk of the service is nearly full; nothing was stored. Free some space.")


class _Form:
    """State of one form while its bytes arrive."""

    def __init__(self, target: IO[bytes], limits: Limits) -> None:
        self._target, self._limits = target, limits
        self._hash = hashlib.sha256()
        self._size = 0
        self._header, self._value = b"", b""
        self._disposition = b""
        self._name, self._text = "", b""
        self._parts = 0
        self._filename: str | None = None
        self._complete = False
        self._fields: dict[str, str] = {}

    def parser(self, boundary: bytes) -> MultipartParser:
        """A parser that fills this form."""
        return MultipartParser(
            boundary,
            {
                "on_part_begin": self._part_begins,
                "on_header_field": self._header_grows,
                "on_header_value": self._value_grows,
                "on_header_end": self._header_ends,
                "on_headers_finished": self._headers_end,
                "on_part_data": self._data_arrives,
                "on_part_end": self._part_ends,
                "on_end": self._form_ends,
            },
            max_size=float(self._limits.file_bytes + FORM_OVERHEAD_BYTES + 1_000_000),
        )

    def received(self, path: Path) -> ReceivedForm:
        """The whole form; raises ``InvalidInput`` where it is cut off or has no file."""
        if not self._complete:
            raise InvalidInput("malformed-request", "The multipart form is damaged or cut off.")
        if self._filename is None:
            raise InvalidInput("file-missing", "The form has no field 'file'.", [Fault("file", "missing")])
        if self._size == 0:
            raise InvalidInput("empty-file", "The file is empty: it has 0 bytes.", [Fault("file", "0 bytes")])
        return ReceivedForm(path, self._filename, self._size, self._hash.hexdigest(), self._fields)

    def _part_begins(self) -> None:
        self._parts += 1
        self._disposition, self._text = b"", b""
        if self._parts > PART_LIMIT:
            raise InvalidInput("invalid-request", "The form has too many fields.")

    def _header_grows(self, data: bytes, start: int, end: int) -> None:
        self._header += data[start:end]

    def _value_grows(self, data: bytes, start: int, end: int) -> None:
        self._value += data[start:end]

    def _header_ends(self) -> None:
        if self._header.lower() == b"content-disposition":
            self._disposition = self._value
        self._header, self._value = b"", b""

    def _headers_end(self) -> None:
        _, options = parse_options_header(self._disposition)
        self._name = options.get(b"name", b"").decode("utf-8", "replace")
        if self._name != "file":
            return
        if self._filename is not None:
            raise InvalidInput("invalid-request", "One file at a time, please.", [Fault("file", "given twice")])
        self._filename = safe_filename(options.get(b"filename", b"").decode("utf-8", "replace"))

    def _data_arrives(self, data: bytes, start: int, end: int) -> None:
        piece = data[start:end]
        if self._name != "file":
            self._text += piece
            if len(self._text) > FIELD_LIMIT_BYTES:
                raise InvalidInput(
                    "invalid-request", "A field of the form is too long.", [Fault(self._name[:60], "too long")]
                )
            return
        self._size += len(piece)
        if self._size > self._limits.file_bytes:
            raise _too_large(self._limits)
        self._hash.update(piece)
        self._target.write(piece)

    def _part_ends(self) -> None:
        if self._name == "file":
            return
        if self._name in self._fields:
            raise InvalidInput(
                "invalid-request", "A field of the form is given twice.", [Fault(self._name[:60], "given twice")]
            )
        self._fields[self._name] = self._text.decode("utf-8", "replace")

    def _form_ends(self) -> None:
        self._complete = True
