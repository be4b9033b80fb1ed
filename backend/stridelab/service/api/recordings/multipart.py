"""Streaming parser of multipart forms: files are hashed and written to disk while they arrive."""

import hashlib
import shutil
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import IO, Final

import anyio
from python_multipart.exceptions import FormParserError
from python_multipart.multipart import MultipartParser, parse_options_header
from starlette.requests import Request

from stridelab.errors import Fault, InvalidInput, StorageFull, TooLarge, is_disk_full
from stridelab.service.filenames import safe_filename

FORM_OVERHEAD_BYTES: Final = 64_000
"""Allowance for boundaries and text fields, in addition to the file."""
FILE_OVERHEAD_BYTES: Final = 1_000
"""Allowance for the headers of each file after the first."""
FIELD_LIMIT_BYTES: Final = 4_000
PART_LIMIT: Final = 20
"""Maximum number of parts, in addition to the files."""


@dataclass(frozen=True)
class Limits:
    """Size limits of an upload, in bytes; ``long_fields`` maps text fields to larger limits of their own.

    Without ``required``, a form may have no file.
    """

    file_bytes: int
    free_disk_bytes: int
    files: int = 1
    required: bool = True
    total_bytes: int | None = None
    long_fields: Mapping[str, int] = field(default_factory=dict)

    @property
    def body_bytes(self) -> int:
        """Maximum size of the body."""
        overhead = FORM_OVERHEAD_BYTES + sum(self.long_fields.values()) + FILE_OVERHEAD_BYTES * (self.files - 1)
        return (self.total_bytes or self.file_bytes * self.files) + overhead


@dataclass(frozen=True)
class ReceivedFile:
    """A received file, stored at ``path``; ``filename`` is sanitised for display and download."""

    path: Path
    filename: str
    size_bytes: int
    sha256: str


@dataclass(frozen=True)
class ReceivedForm(ReceivedFile):
    """A form with a single file: the file, and the text fields."""

    fields: dict[str, str]


@dataclass(frozen=True)
class ReceivedForms:
    """A form with several files: the files, and the text fields."""

    files: tuple[ReceivedFile, ...]
    fields: dict[str, str]


async def receive_form(request: Request, path: Path, limits: Limits) -> ReceivedForm:
    """Read the form of ``request`` and write its part ``file`` to ``path``.

    Raises ``TooLarge`` (``upload-too-large``), before reading if ``Content-Length`` exceeds the limit;
    ``StorageFull`` (``disk-full``); ``InvalidInput`` (``unsupported-media-type``, ``malformed-request``,
    ``file-missing``, ``empty-file``, ``invalid-request``).
    """
    form = await _read_form(request, lambda _: path, path.parent, limits)
    (one,) = form.files
    return ReceivedForm(one.path, one.filename, one.size_bytes, one.sha256, form.fields)


async def receive_forms(request: Request, folder: Path, limits: Limits) -> ReceivedForms:
    """Read a form with several parts ``file`` into ``folder``. Raises the errors of ``receive_form``."""
    return await _read_form(request, lambda index: folder / f"upload-{index:04d}", folder, limits)


async def _read_form(request: Request, path_of: Callable[[int], Path], folder: Path, limits: Limits) -> ReceivedForms:
    media_type, options = parse_options_header(request.headers.get("content-type", ""))
    if media_type != b"multipart/form-data" or not options.get(b"boundary"):
        raise InvalidInput(
            "unsupported-media-type",
            "Send the file as multipart/form-data with the field 'file', for example: curl -F file=@trial.c3d ...",
            [Fault("Content-Type", "not multipart/form-data with a boundary")],
        )
    announced = request.headers.get("content-length", "")
    expected_bytes = int(announced) if announced.isdecimal() else 0
    if expected_bytes > limits.body_bytes:
        raise _too_large(limits)
    if shutil.disk_usage(folder).free < limits.free_disk_bytes + expected_bytes:
        raise _disk_full()
    form = _IncomingForm(path_of, limits)
    try:
        parser = form.make_parser(options[b"boundary"])
        async for chunk in request.stream():
            # writing and hashing block, so they run in a thread
            await anyio.to_thread.run_sync(parser.write, chunk)
        parser.finalize()
    except FormParserError as error:
        raise InvalidInput("malformed-request", "The multipart form is damaged or cut off.") from error
    except OSError as error:
        if is_disk_full(error):
            raise _disk_full() from error
        raise
    finally:
        form.close()
    return form.received_forms()


def _too_large(limits: Limits) -> TooLarge:
    limit = f"{limits.file_bytes / 1e6:g} MB"
    if limits.total_bytes is not None:
        limit += f" per file and {limits.total_bytes / 1e6:g} MB in total"
    return TooLarge(
        "upload-too-large", f"The file is larger than {limit}, the limit of this service.",
        [Fault("file", "too large")],
    )  # fmt: skip


def _disk_full() -> StorageFull:
    return StorageFull("disk-full", "The disk of the service is nearly full; nothing was stored. Free some space.")


class _IncomingFile:
    """A file that is being received."""

    def __init__(self, path: Path, filename: str) -> None:
        self.path, self.filename, self.size = path, filename, 0
        self._hash = hashlib.sha256()
        self._target: IO[bytes] = path.open("wb")

    def write(self, piece: bytes) -> None:
        self._hash.update(piece)
        self._target.write(piece)

    def close(self) -> None:
        self._target.close()

    def to_received_file(self) -> ReceivedFile:
        return ReceivedFile(self.path, self.filename, self.size, self._hash.hexdigest())


class _IncomingForm:
    """State of a form that is being received."""

    def __init__(self, path_of: Callable[[int], Path], limits: Limits) -> None:
        self._path_of, self._limits = path_of, limits
        self._files: list[_IncomingFile] = []
        self._header, self._value = b"", b""
        self._disposition = b""
        self._name, self._text = "", b""
        self._parts = 0
        self._complete = False
        self._fields: dict[str, str] = {}

    def make_parser(self, boundary: bytes) -> MultipartParser:
        """Create a parser whose callbacks fill this form."""
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
            max_size=float(self._limits.body_bytes + 1_000_000),
        )

    def close(self) -> None:
        """Close the files; their partial content remains on disk."""
        for one in self._files:
            one.close()

    def received_forms(self) -> ReceivedForms:
        """Return the complete form.

        Raises ``InvalidInput`` (``malformed-request``, ``file-missing``, ``empty-file``).
        """
        if not self._complete:
            raise InvalidInput("malformed-request", "The multipart form is damaged or cut off.")
        if not self._files and self._limits.required:
            raise InvalidInput("file-missing", "The form has no field 'file'.", [Fault("file", "missing")])
        if self._limits.files == 1 and self._files and self._files[0].size == 0:
            raise InvalidInput("empty-file", "The file is empty: it has 0 bytes.", [Fault("file", "0 bytes")])
        return ReceivedForms(tuple(one.to_received_file() for one in self._files), self._fields)

    def _part_begins(self) -> None:
        self._parts += 1
        self._disposition, self._text = b"", b""
        if self._parts > PART_LIMIT + self._limits.files - 1:
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
        if len(self._files) == self._limits.files:
            if self._limits.files == 1:
                raise InvalidInput("invalid-request", "Send one file per request.", [Fault("file", "given twice")])
            raise InvalidInput(
                "invalid-request", f"Send at most {self._limits.files} files per request.", [Fault("file", "too many")]
            )
        filename = safe_filename(options.get(b"filename", b"").decode("utf-8", "replace"))
        self._files.append(_IncomingFile(self._path_of(len(self._files)), filename))

    def _data_arrives(self, data: bytes, start: int, end: int) -> None:
        piece = data[start:end]
        if self._name != "file":
            self._text += piece
            if len(self._text) > self._limits.long_fields.get(self._name, FIELD_LIMIT_BYTES):
                raise InvalidInput(
                    "invalid-request", "A field of the form is too long.", [Fault(self._name[:60], "too long")]
                )
            return
        one = self._files[-1]
        one.size += len(piece)
        total = sum(each.size for each in self._files)
        if one.size > self._limits.file_bytes or total > (self._limits.total_bytes or total):
            raise _too_large(self._limits)
        one.write(piece)

    def _part_ends(self) -> None:
        if self._name == "file":
            self._files[-1].close()
            return
        if self._name in self._fields:
            raise InvalidInput(
                "invalid-request", "A field of the form is given twice.", [Fault(self._name[:60], "given twice")]
            )
        self._fields[self._name] = self._text.decode("utf-8", "replace")

    def _form_ends(self) -> None:
        self._complete = True
