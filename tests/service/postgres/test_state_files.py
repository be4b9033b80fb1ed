"""State that is truncated, garbage, read-only or without room: one sentence and an exit code, or no harm at all.

What the service writes into its data folder and reads again: ``postgres.json``, ``supervisor.lock``, ``worker.beat``,
locks below ``work`` and ``spool``, logs; in the cluster ``PG_VERSION`` and ``postmaster.pid``. Secrets are files of the
administrator.
"""

import json
import shutil
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from stridelab.errors import InvalidInput, Unavailable
from stridelab.service.jobs.work_folder import HEARTBEAT_FILE, WorkFolder
from stridelab.service.postgres.embedded import EmbeddedPostgres, running_url
from stridelab.service.settings import Settings
from support.faults.disks import mounted_folder
from support.service.database import public_folder
from support.service.processes import environment, free_port

DAMAGED = {
    "empty": b"",
    "garbage": bytes(range(256)),
    "cut off": b'{\n "cluster": "/var/li',
    "of another form": b'[1, "two"]',
    "without the folder": b'{"socket": "/somewhere"}',
}


@pytest.fixture(scope="module")
def data() -> Iterator[Path]:
    """A data folder whose database was made and does not run."""
    with public_folder() as folder:
        server = EmbeddedPostgres(folder / "data")
        server.start()
        server.stop()
        yield folder / "data"


def refused_start(folder: Path, *command: str, **settings: str) -> str:
    """What ``stridelab serve``, or another command, says where it does not start: one line."""
    result = subprocess.run(
        [sys.executable, "-m", "stridelab.cli", *(command or ("serve",))],
        env=environment(STRIDELAB_DATA_DIR=str(folder), STRIDELAB_PORT=str(free_port()), **settings),
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
    )
    assert result.returncode not in (0, 1), result.stderr  # 1 would be an unexpected error
    assert "Traceback" not in result.stdout + result.stderr
    error_lines = [line for line in result.stderr.splitlines() if line.startswith("error: ")]
    assert len(error_lines) == 1, result.stderr
    return error_lines[0]


@pytest.mark.parametrize("how", DAMAGED)
def test_a_damaged_pointer_to_the_database_is_named_with_the_remedy(data: Path, how: str) -> None:
    pointer = data / "postgres.json"
    good = pointer.read_bytes()
    pointer.write_bytes(DAMAGED[how])
    try:
        server = EmbeddedPostgres(data)
        with pytest.raises(Unavailable, match=r"postgres\.json is damaged.*Remove it: the database") as caught:
            server.start()
        assert caught.value.code == "state-file-damaged"
        assert pointer.read_bytes() == DAMAGED[how]
        assert running_url(data) is None
        pointer.unlink()  # the remedy that it names
        server.start()
        server.stop()
        assert json.loads(pointer.read_bytes())["cluster"] == json.loads(good)["cluster"]
    finally:
        pointer.write_bytes(good)


def test_a_pointer_to_a_cluster_elsewhere_is_not_to_be_removed(tmp_path: Path) -> None:
    (tmp_path / "postgres.json").write_bytes(b"")
    with pytest.raises(Unavailable, match=r"Replace it by.*PG_VERSION"):
        EmbeddedPostgres(tmp_path).start()


@pytest.mark.parametrize("command", [("serve",), ("backup", "lab.backup")])
def test_every_command_says_so_in_one_line(data: Path, tmp_path: Path, command: tuple[str, ...]) -> None:
    pointer = data / "postgres.json"
    good = pointer.read_bytes()
    pointer.write_bytes(b"")
    try:
        message = refused_start(data, *(str(tmp_path / part) if part.endswith(".backup") else part for part in command))
    finally:
        pointer.write_bytes(good)
    assert "state-file-damaged" in message


@pytest.mark.parametrize("content", [b"", bytes(range(128, 256)), b"18.x"])
def test_a_damaged_version_of_the_cluster_is_named(data: Path, content: bytes) -> None:
    version = data / "postgres" / "cluster" / "PG_VERSION"
    good = version.read_bytes()
    version.write_bytes(content)
    try:
        with pytest.raises(Unavailable, match="PG_VERSION is damaged") as caught:
            EmbeddedPostgres(data).start()
        assert caught.value.code == "state-file-damaged"
    finally:
        version.write_bytes(good)


@pytest.mark.parametrize("content", [b"", b"\0" * 40, bytes(range(128, 256)), b"99999999999999999999999\n"])
def test_a_damaged_pid_file_is_no_obstacle(data: Path, content: bytes) -> None:
    file = data / "postgres" / "cluster" / "postmaster.pid"
    file.write_bytes(content)
    server = EmbeddedPostgres(data)
    try:
        server.start(timeout_s=30.0)
    finally:
        server.stop()
        file.unlink(missing_ok=True)


def test_a_damaged_pid_file_of_a_running_database_stays(data: Path) -> None:
    first, second = EmbeddedPostgres(data), EmbeddedPostgres(data)
    first.start()
    file = data / "postgres" / "cluster" / "postmaster.pid"
    good = file.read_bytes()
    home = first._require_home()
    file.write_bytes(b"")
    try:
        second._remove_foreign_pid_file(home)
        assert file.exists()
    finally:
        file.write_bytes(good)
        first.stop()


@pytest.mark.parametrize("content", [b"", bytes(range(256))])
def test_locks_and_the_sign_of_life_may_hold_anything(data: Path, tmp_path: Path, content: bytes) -> None:
    for file in (data / "supervisor.lock", data / HEARTBEAT_FILE):
        file.write_bytes(content)
    server = EmbeddedPostgres(data)
    server.start()
    server.stop()
    (tmp_path / "left").mkdir()
    (tmp_path / "left" / ".lock").write_bytes(content)
    with WorkFolder(tmp_path) as own:
        assert list(tmp_path.iterdir()) == [own]


@pytest.mark.parametrize("name", ["supervisor.lock", "logs", "blobs"])
def test_a_file_in_the_place_of_a_folder_is_named(data: Path, name: str) -> None:
    file_in_place = data / name
    file_in_place.unlink(missing_ok=True)
    if name == "supervisor.lock":
        file_in_place.mkdir()
    else:
        file_in_place.write_bytes(b"")
    try:
        message = refused_start(data)
    finally:
        file_in_place.rmdir() if file_in_place.is_dir() else file_in_place.unlink()
    assert "data-folder-unusable" in message
    assert str(file_in_place) in message


def test_a_data_folder_that_is_a_file_is_named(tmp_path: Path) -> None:
    (tmp_path / "file").write_bytes(b"")
    for command in (("serve",), ("backup", str(tmp_path / "x"))):
        message = refused_start(tmp_path / "file", *command)
        assert ("data-folder-unusable" if command[0] == "serve" else "no-data") in message
    message = refused_start(tmp_path / "file" / "below")
    assert "data-folder-unusable" in message


def test_a_read_only_data_folder_is_named() -> None:
    with public_folder() as folder, mounted_folder(folder / "disk", "size=1m") as disk:
        subprocess.run(["mount", "-o", "remount,ro", str(disk)], check=True)
        for place in (disk, disk / "data"):
            message = refused_start(place)
            assert "data-folder-unusable" in message
            assert "Read-only" in message
            assert "STRIDELAB_DATA_DIR" in message
        worker = refused_start(disk, "worker", STRIDELAB_DATABASE_URL="postgresql://x@127.0.0.1:9/y")
        assert "data-folder-unusable" in worker


@pytest.mark.parametrize("with_database", [False, True])
def test_a_full_disk_is_reported_at_the_start(with_database: bool) -> None:
    with public_folder() as folder, mounted_folder(folder / "disk", "size=128m,mode=755") as disk:
        if with_database:
            server = EmbeddedPostgres(disk / "data")
            server.start()
            server.stop()
        free = shutil.disk_usage(disk).free
        (disk / "ballast").write_bytes(b"\0" * (free - (8192 if with_database else 30_000_000)))
        message = refused_start(disk / "data")
        assert "disk-full" in message
        assert str(disk / "data") in message
        (disk / "ballast").unlink()
        server = EmbeddedPostgres(disk / "data")
        server.start()
        server.stop()


@pytest.mark.parametrize("content", [None, b"", b"\n", bytes(range(128, 256)), b"two\nlines"])
def test_an_unusable_token_file_is_named_and_never_means_no_token(tmp_path: Path, content: bytes | None) -> None:
    file = tmp_path / "token"
    if content is not None:
        file.write_bytes(content)
    with pytest.raises(InvalidInput) as caught:
        _ = Settings(api_token_file=file).token
    assert caught.value.code == "secret-unreadable"
    assert [fault.where for fault in caught.value.faults] == ["STRIDELAB_API_TOKEN_FILE"]


@pytest.mark.parametrize("content", [None, bytes(range(128, 256))])
def test_other_unusable_secrets_are_named(tmp_path: Path, content: bytes | None) -> None:
    file = tmp_path / "secret"
    if content is not None:
        file.write_bytes(content)
    with pytest.raises(InvalidInput, match="STRIDELAB_DATABASE_PASSWORD_FILE"):
        _ = Settings(database_url="postgresql://x@y/z", database_password_file=file).database_dsn
    with pytest.raises(InvalidInput, match="STRIDELAB_BLOB_CREDENTIALS_FILE"):
        _ = Settings(blob_credentials_file=file).blob_options


def test_a_cut_off_line_of_credentials_is_named(tmp_path: Path) -> None:
    (tmp_path / "credentials").write_text("endpoint=http://objects:8333\naccess_k")
    with pytest.raises(InvalidInput, match="name=value"):
        _ = Settings(blob_credentials_file=tmp_path / "credentials").blob_options
    message = refused_start(tmp_path / "data", STRIDELAB_API_TOKEN_FILE=str(tmp_path / "none"))
    assert "secret-unreadable" in message
