"""The file that a backup is: a zip of the tables' rows, the stored files and a manifest with the hash of each.

Nothing in it is ever executed: rows travel as data (PostgreSQL's COPY text), never as SQL. A reader believes nothing:
names, sizes and hashes of all members are checked before the first of them is used.
"""

import hashlib
import os
import re
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
from stridelab.service.storage.blobs import CHUNK_BYTES, is_key

FORMAT: Final = 1
"""Raised when a program that knows only earlier ones could not read the file."""
MANIFEST: Final = "manifest.json"
MAX_MANIFEST_BYTES: Final = 256 << 20
"""A list of contents that is longer is neither written nor read."""
_TABLE: Final = re.compile(r"tables/[a-z][a-z_]{0,60}\.copy")
_HASH: Final = r"^[0-9a-f]{64}$"
Progress = Callable[[float, str], None]


def silent(_fraction: float, _message: str) -> None:
    """Nobody watches."""


class Member(Contract):
    """What a member of the archive must hold."""

    bytes: int = Field(ge=0)
    sha256: str = Field(pattern=_HASH)


class Table(Contract):
    """One table's rows: the columns in their order in the COPY text, and how many rows."""

    columns: list[str] = Field(min_length=1, max_length=200)
    rows: int = Field(ge=0)


class Manifest(Contract):
    """What the archive holds; ``missing`` are stored files that rows name and that were gone already."""

    format: int = Field(ge=1)
    kind: Literal["stridelab-backup"]
    made_at: str = Field(max_length=40)
    program: str = Field(max_length=40)
    revision: str = Field(pattern=r"^[0-9A-Za-z_]{1,40}$")
    with_files: bool
    tables: dict[str, Table]
    members: dict[str, Member]
    missing: list[str] = Field(default=[])

    @property
    def files(self) -> list[str]:
        """Keys of the stored files."""
        return [name.removeprefix("files/") for name in self.members if name.startswith("files/")]

    @property
    def file_bytes(self) -> int:
        """Size of the stored files together."""
        return sum(member.bytes for name, member in self.members.items() if name.startswith("files/"))


def table_member(table: str) -> str:
    """The member that holds the rows of ``table``."""
    return f"tables/{table}.copy"


def file_member(key: str) -> str:
    """The member that holds the stored file ``key``."""
    return f"files/{key}"


class Packer:
    """Writes an archive beside ``target`` and puts it there whole, or not at all. A context manager.

    Raises ``Conflict`` (``backup-exists``) unless ``force``, ``InvalidInput`` (``backup-folder-missing``),
    ``StorageFull`` (``no-room``).
    """

    def __init__(self, target: Path, *, force: bool = False) -> None:
        self.target = target
        self.members: dict[str, Member] = {}
        self._draft = target.with_name(f".{target.name}.{os.getpid()}.part")
        if not target.absolute().parent.is_dir():
            raise InvalidInput("backup-folder-missing", f"The folder {target.absolute().parent} does not exist.")
        if target.exists() and not force:
            raise Conflict("backup-exists", f"{target} exists already; --force replaces it.")

    def __enter__(self) -> "Packer":  # noqa: PYI034 (the tests' type checks know no Self here)
        with _room():
            # the people in it are nobody else's business
            self._file = os.fdopen(os.open(self._draft, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600), "wb")
            self._zip = zipfile.ZipFile(self._file, "w")
        return self

    @contextmanager
    def member(self, name: str, *, compress: bool = False) -> Iterator[Callable[[bytes], None]]:
        """A function that appends to a new member ``name``."""
        info = zipfile.ZipInfo(name)
        info.compress_type = zipfile.ZIP_DEFLATED if compress else zipfile.ZIP_STORED
        digest, size = hashlib.sha256(), 0
        with _room(), self._zip.open(info, "w", force_zip64=True) as entry:

            def append(piece: bytes) -> None:
                nonlocal size
                entry.write(piece)
                digest.update(piece)
                size += len(piece)

            yield append
        self.members[name] = Member(bytes=size, sha256=digest.hexdigest())

    def finish(self, manifest: Manifest) -> None:
        """Write the manifest, make sure that all is on the disk, and move the archive to its place.

        Raises ``TooLarge`` (``backup-too-large``) for some two million files.
        """
        listed = manifest.model_dump_json().encode()
        if len(listed) > MAX_MANIFEST_BYTES:
            raise TooLarge(
                "backup-too-large",
                f"{len(manifest.files)} files are too many for one backup; let the object store copy them itself.",
            )
        with _room():
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
        self._zip.fp = None  # an archive that was given up gets no directory
        self._file.close()
        self._draft.unlink(missing_ok=True)


@contextmanager
def _room() -> Iterator[None]:
    try:
        yield
    except OSError as error:
        raise StorageFull("no-room", f"The backup cannot be written: {error.strerror or error}.") from error


class Archive:
    """A backup that is read; opened by ``open_archive``, which has checked it."""

    def __init__(self, archive: zipfile.ZipFile, manifest: Manifest) -> None:
        self._zip, self.manifest = archive, manifest

    def pieces(self, name: str) -> Iterator[bytes]:
        """The member in pieces; raises ``UnreadableFile`` (``backup-damaged``) where it is not what was promised."""
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
            raise _damaged(f"{name} cannot be read ({type(error).__name__})") from error
        if size != promised.bytes or digest.hexdigest() != promised.sha256:
            raise _damaged(f"{name} is not what its hash says")


@contextmanager
def open_archive(path: Path, on_progress: Progress = silent) -> Iterator[Archive]:
    """Check the whole archive, then hand it over.

    Raises ``UnreadableFile``: ``backup-unreadable`` (no such archive), ``backup-damaged`` (truncated, changed,
    something in it that does not belong there), ``backup-newer`` (made by a program of a later format).
    """
    if not path.is_file():  # a pipe would be waited for
        raise UnreadableFile("backup-unreadable", f"{path} cannot be read: it is no file.")
    try:
        archive = zipfile.ZipFile(path)
    except (OSError, zipfile.BadZipFile, ValueError, NotImplementedError) as error:
        said = getattr(error, "strerror", None) or "it is no backup, or its end is missing"
        raise UnreadableFile("backup-unreadable", f"{path} cannot be read: {said}.") from error
    with archive:
        opened = Archive(archive, _checked_manifest(archive))
        sizes = opened.manifest.members
        total, done = sum(member.bytes for member in sizes.values()) or 1, 0
        for name, member in sizes.items():
            for piece in opened.pieces(name):
                done += len(piece)
                on_progress(done / total, f"checking {'rows' if name.startswith('tables/') else 'files'}")
            if member.bytes == 0:
                on_progress(done / total, "checking")
        yield opened


def _checked_manifest(archive: zipfile.ZipFile) -> Manifest:
    infos = {info.filename: info for info in archive.infolist()}
    if MANIFEST not in infos or len(infos) != len(archive.infolist()):
        raise _damaged("it has no list of contents, or one name twice")
    if infos[MANIFEST].file_size > MAX_MANIFEST_BYTES:
        raise _damaged("its list of contents is too long to be one")
    try:
        raw = archive.read(MANIFEST)
    except (zipfile.BadZipFile, OSError, RuntimeError, NotImplementedError, zlib.error) as error:
        raise _damaged("its list of contents cannot be read") from error
    manifest = _parsed(raw)
    if set(manifest.members) | {MANIFEST} != set(infos):
        raise _damaged("what is in it is not what it lists")
    if {table_member(table) for table in manifest.tables} != {n for n in manifest.members if n.startswith("tables/")}:
        raise _damaged("its tables are not those that it lists")
    for name, member in manifest.members.items():
        info = infos[name]
        stored = info.compress_type in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED) and not info.flag_bits & 1
        if not (_TABLE.fullmatch(name) or (name.startswith("files/") and is_key(name.removeprefix("files/")))):
            raise _damaged(f"{name[:80]!r} does not belong into a backup")
        if not stored or info.file_size != member.bytes:
            raise _damaged(f"{name} is not what it lists")
    return manifest


def _parsed(raw: bytes) -> Manifest:
    try:
        manifest = Manifest.model_validate_json(raw)
    except ValidationError as error:
        newer = _format_of(raw)
        if newer is not None and newer > FORMAT:
            raise _newer() from error
        raise _damaged("its list of contents makes no sense") from error
    if manifest.format > FORMAT:
        raise _newer()
    return manifest


def _format_of(raw: bytes) -> int | None:
    found = re.search(rb'"format"\s*:\s*(\d{1,6})', raw[:2000])
    return int(found[1]) if found else None


def _newer() -> UnreadableFile:
    return UnreadableFile("backup-newer", "A newer version of stridelab made this backup; restore it with that one.")


def _damaged(how: str) -> UnreadableFile:
    return UnreadableFile("backup-damaged", f"This backup cannot be used: {how}. Nothing was restored.")
