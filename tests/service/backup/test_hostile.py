"""Archives that were damaged, or made to do harm: refused before anything is touched."""

import hashlib
import json
import os
import random
import subprocess
import sys
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import psycopg
import pytest

from stridelab.errors import UnreadableFile
from stridelab.service.backup.archive import MANIFEST, check_archive, open_archive
from stridelab.service.backup.create import BackupContents
from stridelab.service.storage.migrate import is_migrated
from support.service.processes import environment
from support.service.stored_rows import read_rows, read_stored_files

PutBack = Callable[..., BackupContents]
Contents = dict[str, bytes]


def contents(path: Path) -> Contents:
    with zipfile.ZipFile(path) as archive:
        return {name: archive.read(name) for name in archive.namelist()}


def write(path: Path, members: Contents, *, honest: bool = True) -> Path:
    """An archive of ``members``; an ``honest`` one lists their sizes and hashes as they are."""
    manifest = json.loads(members[MANIFEST])
    if honest:
        manifest["members"] = {
            name: {"bytes": len(body), "sha256": hashlib.sha256(body).hexdigest()}
            for name, body in members.items()
            if name != MANIFEST
        }
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, body in {**members, MANIFEST: json.dumps(manifest).encode()}.items():
            archive.writestr(name, body)
    return path


def with_manifest(whole: Contents, **changes: Any) -> Contents:
    return {**whole, MANIFEST: json.dumps({**json.loads(whole[MANIFEST]), **changes}).encode()}


def refused(path: Path, code: str = "backup-damaged") -> UnreadableFile:
    with pytest.raises(UnreadableFile) as caught, open_archive(path):
        pytest.fail("it was accepted")
    assert caught.value.code == code
    return caught.value


@pytest.mark.parametrize("body", [b"", b"hello", b"PK\x03\x04" + bytes(100), b"PGDMP" + bytes(50)])
def test_what_is_no_archive(body: bytes, tmp_path: Path) -> None:
    (tmp_path / "x").write_bytes(body)
    refused(tmp_path / "x", "backup-unreadable")
    refused(tmp_path, "backup-unreadable")
    refused(tmp_path / "nowhere", "backup-unreadable")
    os.mkfifo(tmp_path / "pipe")
    refused(tmp_path / "pipe", "backup-unreadable")


@pytest.mark.parametrize("share", [0.1, 0.5, 0.9, 0.999])
def test_a_backup_that_was_cut_off(backup: Path, tmp_path: Path, share: float) -> None:
    whole = backup.read_bytes()
    (tmp_path / "x").write_bytes(whole[: int(share * len(whole))])
    refused(tmp_path / "x", "backup-unreadable")


def test_any_flipped_bit_is_detected_or_harmless(backup: Path, tmp_path: Path) -> None:
    whole, draw = backup.read_bytes(), random.Random(12)
    before = contents(backup)
    for _ in range(60):
        changed = bytearray(whole)
        changed[draw.randrange(len(whole))] ^= 1 << draw.randrange(8)
        (tmp_path / "x").write_bytes(changed)
        try:
            with open_archive(tmp_path / "x") as archive:
                members = {name: b"".join(archive.read_pieces(name)) for name in archive.manifest.members}
        except UnreadableFile:
            continue
        # dates and the like: what is read is what was written
        assert members == {name: body for name, body in before.items() if name != MANIFEST}


NAMES = [
    "../evil",
    "files/../../evil",
    "files//etc/passwd",
    "files/.hidden",
    "/etc/passwd",
    "tables/../job.copy",
    "tables/job.sql",
    "files/" + "x" * 500,
    "files/a\\b",
    "readme.txt",
]


@pytest.mark.parametrize("name", NAMES)
def test_names_that_do_not_belong_there(backup: Path, tmp_path: Path, name: str) -> None:
    refused(write(tmp_path / "x", {**contents(backup), name: b"x"}))


def test_lists_that_do_not_fit(backup: Path, tmp_path: Path) -> None:
    members = contents(backup)
    listed = json.loads(members[MANIFEST])
    first = next(iter(listed["members"]))
    lies: dict[str, Any] = {
        "a hash": {**listed["members"], first: {"bytes": len(members[first]), "sha256": "0" * 64}},
        "a size": {**listed["members"], first: {**listed["members"][first], "bytes": 1 << 50}},
        "one too few": {name: member for name, member in listed["members"].items() if name != first},
        "one too many": {**listed["members"], "files/more": listed["members"][first]},
    }
    for lie in lies.values():
        refused(write(tmp_path / "x", with_manifest(members, members=lie), honest=False))
    oddities: tuple[dict[str, Any], ...] = (
        {"kind": "else"},
        {"revision": "1; DROP TABLE job"},
        {"extra": 1},
        {"tables": {}},
        {"members": "x"},
    )
    for odd in oddities:
        refused(write(tmp_path / "x", with_manifest(members, **odd), honest="members" not in odd))
    for raw in (b"", b"[]", b"\xff", b"[" * 100_000):
        with zipfile.ZipFile(tmp_path / "x", "w") as archive:
            archive.writestr(MANIFEST, raw)
        refused(tmp_path / "x")


def test_a_backup_with_one_name_twice_is_refused(backup: Path, tmp_path: Path) -> None:
    path = write(tmp_path / "x", contents(backup))
    with zipfile.ZipFile(path, "a") as archive, pytest.warns(UserWarning, match="Duplicate name"):
        archive.writestr("tables/job.copy", b"other")
    refused(path)


def test_a_bomb_is_stopped_by_what_it_says_and_by_what_it_is(backup: Path, tmp_path: Path) -> None:
    members = contents(backup)
    zeros = bytes(30_000_000)
    lie = {**members, "files/bomb": zeros}
    listed = json.loads(members[MANIFEST])["members"] | {"files/bomb": {"bytes": 10, "sha256": "0" * 64}}
    path = write(tmp_path / "x", with_manifest(lie, members=listed), honest=False)
    assert path.stat().st_size < 3_000_000
    assert "files/bomb" in refused(path).message


@pytest.mark.parametrize("newer", [{"format": 2}, {"format": 7, "something": "else"}])
def test_a_later_format_is_named_as_such(backup: Path, tmp_path: Path, newer: dict[str, Any]) -> None:
    members = contents(backup)
    listed = json.loads(members[MANIFEST])
    listed.pop("format")
    raw = json.dumps({**newer, **listed}).encode()
    refused(write(tmp_path / "x", {**members, MANIFEST: raw}), "backup-newer")


def column(path: Contents, table: str, name: str) -> int:
    return int(json.loads(path[MANIFEST])["tables"][table]["columns"].index(name))


def changed(members: Contents, table: str, name: str, value: str, row: int = 0) -> Contents:
    """The rows with one field changed."""
    lines = members[f"tables/{table}.copy"].decode().split("\n")
    fields = lines[row].split("\t")
    fields[column(members, table, name)] = value
    lines[row] = "\t".join(fields)
    return {**members, f"tables/{table}.copy": "\n".join(lines).encode()}


ROWS: dict[str, Callable[[Contents], Contents]] = {
    "a file outside": lambda m: changed(m, "recording", "blob_key", "../../etc/passwd"),
    "a file that is not there": lambda m: changed(m, "recording", "tracks_key", "recordings/rec1/other"),
    "a reference to nobody": lambda m: changed(m, "recording", "subject_id", "nobody"),
    "no number": lambda m: changed(m, "job", "attempt", "many"),
    "no json": lambda m: changed(m, "job", "input", "{"),
    "artifacts that are no list": lambda m: changed(m, "job", "result", '{"artifacts": 3}'),
    "too many fields": lambda m: changed(m, "job", "kind", "a\tb"),
    "an end in the middle": lambda m: {**m, "tables/job.copy": b"\\.\n" + m["tables/job.copy"]},
    "no utf-8": lambda m: changed(m, "subject", "owner", "\\xff"),
    "one id twice": lambda m: {**m, "tables/subject.copy": m["tables/subject.copy"] * 2},
    "no rows": lambda m: {**m, "tables/job_event.copy": b""},
    "an unknown table": lambda m: {
        **with_manifest(m, tables={**json.loads(m[MANIFEST])["tables"], "pg_authid": {"columns": ["x"], "rows": 0}}),
        "tables/pg_authid.copy": b"",
    },
    "an unknown column": lambda m: with_manifest(
        m, tables={**json.loads(m[MANIFEST])["tables"], "subject": {"columns": ["id", 'x") FROM PROGRAM'], "rows": 1}}
    ),
}


@pytest.mark.parametrize("what", ROWS)
def test_rows_that_cannot_be(backup: Path, database_url: str, put_back: PutBack, tmp_path: Path, what: str) -> None:
    with psycopg.connect(database_url) as connection:
        connection.execute("INSERT INTO subject (id, fields) VALUES ('kept', '{}')")
    before = read_rows(database_url)
    path = write(tmp_path / "x", ROWS[what](contents(backup)))
    with pytest.raises(UnreadableFile) as caught:
        put_back(path, database_url, replace=True)
    assert caught.value.code == "backup-damaged"
    assert read_rows(database_url) == before
    assert read_stored_files(tmp_path / "blobs") == {}


def test_a_revision_that_is_not_known(backup: Path, empty: str, put_back: PutBack, tmp_path: Path) -> None:
    path = write(tmp_path / "x", with_manifest(contents(backup), revision="9999"))
    with pytest.raises(UnreadableFile) as caught:
        put_back(path, empty)
    assert caught.value.code == "backup-newer"
    assert not is_migrated(empty)


def test_the_check_in_a_child_accepts_a_backup_and_names_what_is_wrong(backup: Path, tmp_path: Path) -> None:
    heard: list[float] = []
    check_archive(backup, lambda fraction, _message: heard.append(fraction))
    assert heard[-1] == 1.0
    (tmp_path / "x").write_bytes(b"hello")
    for path in (tmp_path / "x", tmp_path / "nowhere"):
        with pytest.raises(UnreadableFile) as refusal:
            check_archive(path)
        assert refusal.value.code == "backup-unreadable"
    whole = contents(backup)
    name = next(name for name in whole if name.startswith("tables/"))
    with pytest.raises(UnreadableFile) as refusal:
        check_archive(write(tmp_path / "y", {**whole, name: whole[name] + b"1"}, honest=False))
    assert refusal.value.code == "backup-damaged"


def test_a_manifest_that_fills_the_memory_costs_the_child_alone(backup: Path, tmp_path: Path) -> None:
    """200 MB of manifest in 200 kB of archive: the limit of its own size alone would let it through."""
    whole = with_manifest(contents(backup), made_at="x" * 200_000_000)
    with pytest.raises(UnreadableFile) as refusal:
        check_archive(write(tmp_path / "x", whole, honest=False), memory_mb=300)
    assert refusal.value.code == "backup-damaged"
    assert "memory" in refusal.value.message


def test_restore_checks_in_a_child_before_anything_is_made(tmp_path: Path) -> None:
    """A reader that breaks takes down its child, not the command, which says so and makes no data folder."""
    site = tmp_path / "site"
    site.mkdir()
    (site / "sitecustomize.py").write_text(
        "import os, sys, zipfile\n"
        "if 'stridelab.service.processes.fork_server' in ' '.join(sys.orig_argv):\n"
        "    zipfile.ZipFile = lambda *_: os.abort()\n"
    )
    (tmp_path / "x").write_bytes(b"PK")
    own = {"PYTHONPATH": str(site), "STRIDELAB_DATA_DIR": str(tmp_path / "data")}
    command = [sys.executable, "-m", "stridelab.cli", "restore", str(tmp_path / "x")]
    run = subprocess.run(command, env=environment(**own), capture_output=True, text=True, check=False, timeout=120)
    assert run.returncode > 0
    assert "backup-damaged" in run.stdout + run.stderr
    assert not (tmp_path / "data").exists()
