"""Backup archive: a zip of the tables' rows, the stored files and a manifest with the hash of each member.

Nothing in it is executed: rows are stored as data (PostgreSQL's COPY text), never as SQL. Archives are not trusted:
names, sizes and hashes of all members are verified before the first of them is used; ``check_archive`` does so in a
child process, which an archive made for it can at most crash, fill or stop.
"""

import asyncio
import hashlib
import os
import re
import tempfile
import zipfile
import zlib
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from types import TracebackType
from typing import Final, Literal

from pydantic import Field, ValidationError

from stridelab.errors import Conflict, InvalidInput, StorageFull, TooLarge, UnreadableFile
from stridelab.schemas.base import Contract
from stridelab.service.processes.pool import IsolatedPool
from stridelab.service.processes.running_child import IsolatedOutcome
from stridelab.service.processes.sandbox import Sandbox
from stridelab.service.storage.blobs import CHUNK_BYTES, is_key

FORMAT_VERSION: Final = 1
"""Format version; incremented by changes that make an archive unreadable for earlier versions of the program."""
MANIFEST: Final = "manifest.json"
CHECK_MEMORY_MB: Final = 4096
_CHECK_TIMEOUT_S: Final = 600.0
_CHECK_BYTES_PER_S: Final = 1e6
"""Minimum speed of the check, in bytes of the archive; most disks and processors reach a hundred times as much."""
MAX_MANIFEST_BYTES: Final = 256 << 20
"""Maximum size of the manifest, for writing and reading."""
_TABLE: Final = re.compile(r"tables/[a-z][a-z_]{0,60}\.copy")
_HASH: Final = r"^[0-9a-f]{64}$"
Progress = Callable[[float, str], None]


def ignore_progress(_fraction: float, _message: str) -> None:
    """Ignore the progress."""


class ArchiveMember(Contract):
    """Size and SHA-256 of a member of the archive."""

    bytes: int = Field(ge=0)
    sha256: str = Field(pattern=_HASH)


class ArchivedTable(Contract):
    """Columns of a table in the order of the COPY text, and its number of rows."""

    columns: list[str] = Field(min_length=1, max_length=200)
    rows: int = Field(ge=0)


class Manifest(Contract):
    """Contents of the archive; ``missing`` are stored files that rows refer to and that did not exist."""

    format: int = Field(ge=1)
    kind: Literal["stridelab-backup"]
    made_at: str = Field(max_length=40)
    program: str = Field(max_length=40)
    revision: str = Field(pattern=r"^[0-9A-Za-z_]{1,40}$")
    with_files: bool
    tables: dict[str, ArchivedTable]
    members: dict[str, ArchiveMember]
    missing: list[str] = Field(default=[])

    @property
    def file_keys(self) -> list[str]:
        """Keys of the stored files."""
        return [name.removeprefix("files/") for name in self.members if name.startswith("files/")]

    @property
    def file_bytes(self) -> int:
        """Total size of the stored files."""
        return sum(member.bytes for name, member in self.members.items() if name.startswith("files/"))


def table_member(table: str) -> str:
    """Name of the member with the rows of ``table``."""
    return f"tables/{table}.copy"


def file_member(key: str) -> str:
    """Name of the member with the stored file ``key``."""
    return f"files/{key}"


class ArchiveWriter:
    """Context manager that writes an archive atomically to ``target``.

    Raises ``Conflict`` (``backup-exists``) unless ``force``, ``InvalidInput`` (``backup-folder-missing``),
    ``StorageFull`` (``no-room``).
    """

    def __init__(self, target: Path, *, force: bool = False) -> None:
        self.target = target
        self.members: dict[str, ArchiveMember] = {}
        self._draft = target.with_name(f".{target.name}.{os.getpid()}.part")
        if not target.absolute().parent.is_dir():
            raise InvalidInput("backup-folder-missing", f"The folder {target.absolute().parent} does not exist.")
        if target.exists() and not force:
            raise Conflict("backup-exists", f"{target} exists already; --force replaces it.")

    def __enter__(self) -> "ArchiveWriter":  # noqa: PYI034 (the tests' type checks know no Self here)
        with _explain_write_errors():
            # mode 0600: the archive contains personal data
            self._file = os.fdopen(os.open(self._draft, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600), "wb")
            self._zip = zipfile.ZipFile(self._file, "w")
        return self

    @contextmanager
    def add_member(self, name: str, *, compress: bool = False) -> Iterator[Callable[[bytes], None]]:
        """Add a member ``name``; yields a function that appends to it."""
        info = zipfile.ZipInfo(name)
        info.compress_type = zipfile.ZIP_DEFLATED if compress else zipfile.ZIP_STORED
        digest, size = hashlib.sha256(), 0
        with _explain_write_errors(), self._zip.open(info, "w", force_zip64=True) as entry:

            def append_piece(piece: bytes) -> None:
                nonlocal size
                entry.write(piece)
                digest.update(piece)
                size += len(piece)

            yield append_piece
        self.members[name] = ArchiveMember(bytes=size, sha256=digest.hexdigest())

    def finish_archive(self, manifest: Manifest) -> None:
        """Write the manifest, synchronise the archive to the disk and rename it to ``target``.

        Raises ``TooLarge`` (``backup-too-large``) for more than about two million files.
        """
        listed = manifest.model_dump_json().encode()
        if len(listed) > MAX_MANIFEST_BYTES:
            raise TooLarge(
                "backup-too-large",
                f"{len(manifest.file_keys)} files are too many for one backup; copy them with tools of the "
                "object store.",
            )
        with _explain_write_errors():
            with self._zip.open(MANIFEST, "w") as entry:
                entry.write(listed)
            self._zip.close()
            self._file.flush()
            os.fsync(self._file.fileno())
            self._file.close()
            self._draft.replace(self.target)
            folder = os.open(self.target.absolute().parent, os.O_RDONLY)
            os.fsync(folder)
            os.close(folder)

    def __exit__(
        self, _kind: type[BaseException] | None, _error: BaseException | None, _trace: TracebackType | None
    ) -> None:
        self._zip.fp = None  # no central directory for an aborted archive
        self._file.close()
        self._draft.unlink(missing_ok=True)


@contextmanager
def _explain_write_errors() -> Iterator[None]:
    try:
        yield
    except OSError as error:
        raise StorageFull("no-room", f"The backup cannot be written: {error.strerror or error}.") from error


class Archive:
    """A backup for reading, opened and verified by ``open_archive``."""

    def __init__(self, archive: zipfile.ZipFile, manifest: Manifest) -> None:
        self._zip, self.manifest = archive, manifest

    def read_pieces(self, name: str) -> Iterator[bytes]:
        """The member in pieces; raises ``UnreadableFile`` (``backup-damaged``) if it differs from the manifest."""
        promised, digest, size = self.manifest.members[name], hashlib.sha256(), 0
        try:
            with self._zip.open(name) as entry:
                while piece := entry.read(CHUNK_BYTES):
                    digest.update(piece)
                    size += len(piece)
                    if size > promised.bytes:
                        break
                    yield piece
        except (zipfile.BadZipFile, OSError, EOFError, ValueError, NotImplementedError, zlib.error) as error:
            raise _damaged_error(f"{name} cannot be read ({type(error).__name__})") from error
        if size != promised.bytes or digest.hexdigest() != promised.sha256:
            raise _damaged_error(f"{name} does not match its hash")


def check_archive(path: Path, on_progress: Progress = ignore_progress, *, memory_mb: int = CHECK_MEMORY_MB) -> None:
    """Verify all of an archive in a child process that can read this file only, with limits on memory and time.

    Raises the errors of ``open_archive``; ``UnreadableFile`` (``backup-damaged``) if the child exceeds a limit or
    crashes.
    """
    file = path.absolute()
    size_bytes = file.stat().st_size if file.is_file() else 0

    async def run_check(folder: Path) -> IsolatedOutcome:
        async with IsolatedPool() as pool:
            return await pool.run(
                f"{__name__}:check_in_child",
                {"file": str(file)},
                folder,
                timeout_s=_CHECK_TIMEOUT_S + size_bytes / _CHECK_BYTES_PER_S,
                memory_mb=memory_mb,
                on_progress=on_progress,
                low_priority=False,
                sandbox=Sandbox(reads=(str(file),)),
            )

    with tempfile.TemporaryDirectory() as folder:
        outcome = asyncio.run(run_check(Path(folder)))
    if outcome.error_class is not None:
        raise outcome.as_error()
    if outcome.state != "ok":
        reason = outcome.as_error().message.rstrip(".")
        raise _damaged_error(f"the process that checked it failed ({reason})")


def check_in_child(task: dict[str, str], _folder: Path, progress: Progress) -> None:
    """Verify the archive ``task["file"]``. Raises as ``open_archive``."""
    with open_archive(Path(task["file"]), progress):
        pass


@contextmanager
def open_archive(path: Path, on_progress: Progress = ignore_progress, *, is_checked: bool = False) -> Iterator[Archive]:
    """Open an archive after verifying all of it; if ``is_checked``, its members are verified when they are read.

    Raises ``UnreadableFile``: ``backup-unreadable`` (no such archive), ``backup-damaged`` (truncated, changed,
    unexpected members), ``backup-newer`` (made by a program of a later format).
    """
    if not path.is_file():  # reading a pipe would block
        raise UnreadableFile("backup-unreadable", f"{path} cannot be read: it is not a file.")
    try:
        archive = zipfile.ZipFile(path)
    except (OSError, zipfile.BadZipFile, ValueError, NotImplementedError) as error:
        reason = getattr(error, "strerror", None) or "it is not a backup, or it is truncated"
        raise UnreadableFile("backup-unreadable", f"{path} cannot be read: {reason}.") from error
    with archive:
        opened = Archive(archive, _read_manifest(archive))
        sizes = opened.manifest.members
        total, done = sum(member.bytes for member in sizes.values()) or 1, 0
        for name, member in () if is_checked else sizes.items():
            for piece in opened.read_pieces(name):
                done += len(piece)
                on_progress(done / total, f"checking {'rows' if name.startswith('tables/') else 'files'}")
            if member.bytes == 0:
                on_progress(done / total, "checking")
        yield opened


def _read_manifest(archive: zipfile.ZipFile) -> Manifest:
    infos = {info.filename: info for info in archive.infolist()}
    if MANIFEST not in infos or len(infos) != len(archive.infolist()):
        raise _damaged_error("it has no manifest, or duplicate names")
    if infos[MANIFEST].file_size > MAX_MANIFEST_BYTES:
        raise _damaged_error("its manifest is too large")
    try:
        raw = archive.read(MANIFEST)
    except (zipfile.BadZipFile, OSError, RuntimeError, NotImplementedError, zlib.error) as error:
        raise _damaged_error("its manifest cannot be read") from error
    manifest = _parse_manifest(raw)
    if set(manifest.members) | {MANIFEST} != set(infos):
        raise _damaged_error("its contents differ from its manifest")
    if {table_member(table) for table in manifest.tables} != {n for n in manifest.members if n.startswith("tables/")}:
        raise _damaged_error("its tables differ from its manifest")
    for name, member in manifest.members.items():
        info = infos[name]
        is_plain = info.compress_type in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED) and not info.flag_bits & 1
        if not (_TABLE.fullmatch(name) or (name.startswith("files/") and is_key(name.removeprefix("files/")))):
            raise _damaged_error(f"{name[:80]!r} is not a valid member of a backup")
        if not is_plain or info.file_size != member.bytes:
            raise _damaged_error(f"{name} differs from its manifest")
    return manifest


def _parse_manifest(raw: bytes) -> Manifest:
    try:
        manifest = Manifest.model_validate_json(raw)
    except ValidationError as error:
        newer = _format_of(raw)
        if newer is not None and newer > FORMAT_VERSION:
            raise _newer_format_error() from error
        raise _damaged_error("its manifest is invalid") from error
    if manifest.format > FORMAT_VERSION:
        raise _newer_format_error()
    return manifest


def _format_of(raw: bytes) -> int | None:
    match = re.search(rb'"format"\s*:\s*(\d{1,6})', raw[:2000])
    return int(match[1]) if match else None


def _newer_format_error() -> UnreadableFile:
    return UnreadableFile(
        "backup-newer", "This backup was made by a newer version of stridelab; restore it with that version."
    )


def _damaged_error(reason: str) -> UnreadableFile:
    return UnreadableFile("backup-damaged", f"This backup cannot be used: {reason}. Nothing was restored.")
