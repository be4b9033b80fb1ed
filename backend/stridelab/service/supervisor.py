"""``stridelab serve``: starts the database, the web server, a worker and the viewer, and keeps them running.

All programs end with the supervisor, also when it is killed with ``kill -9`` (``parent_death``). A program that exits
is restarted with increasing delay; one that runs and does not respond (``heartbeat``, ``watchdog``) is killed and
restarted. The supervisor owns the embedded database's folder, so every worker registered in the database at start is
dead, and its jobs are requeued at once.
"""

import contextlib
import importlib.util
import os
import signal
import socket
import subprocess
import sys
import threading
import time
import urllib.error
import urllib.request
from collections.abc import Callable, Iterator
from pathlib import Path
from types import FrameType
from typing import Final, NoReturn

import psycopg

from stridelab.errors import Fault, InvalidInput, Unavailable
from stridelab.service.data_folder import explain_os_errors, open_data_folder
from stridelab.service.postgres.embedded import EmbeddedPostgres
from stridelab.service.processes.supervised_program import FAILURES, BusySignal, SupervisedProgram
from stridelab.service.processes.watchdog import FailureState, ResponseWatchdog
from stridelab.service.settings import Settings
from stridelab.service.storage.migrate import libpq_address, migrate_in_child

VIEWER: Final = "stridelab_web.viewer"
API: Final = "stridelab.service.api"
PAGES: Final = "stridelab.service.page_server"
WORKER: Final = "stridelab.service.jobs.worker"
_POLL_INTERVAL_S: Final = 0.2
_PAGES_SHARES: Final = (0.4, 0.1)
"""Shares of its time in which the web server needs a processor: the second one starts above, is not needed below."""
_PAGES_REST_S: Final = 600.0
"""Time without need after which the second web server ends: it takes 0.1 GB."""
_DATABASE_CHECK_S: Final = 0.5
_DATABASE_POLL_S: Final = 1.0
_DATABASE_HUNG_S: Final = 30.0
"""Longer than for a program: every probe starts a new server process, which is slow on a busy machine."""
_STOP_TIMEOUT_S: Final = 3.0
_START_TIMEOUT_S: Final = 60.0
_MAX_FAILED_STARTS: Final = 5
_LOOPBACK_OF_WILDCARD: Final = {"0.0.0.0": "127.0.0.1", "::": "::1", "": "127.0.0.1"}  # noqa: S104 (keys of a look-up)


class _StopRequested(BaseException):
    """SIGINT or SIGTERM arrived."""


def serve(settings: Settings, *, with_worker: bool = True, print_line: Callable[[str], None] | None = None) -> None:
    """Run the whole service until SIGINT or SIGTERM.

    Raises ``InvalidInput`` (``token-needed``, ``secret-unreadable``), ``Unavailable`` (``port-taken``,
    ``data-folder-unusable``, ``disk-full``, ``service-does-not-start``, and those of ``EmbeddedPostgres.start``).
    """
    speak = print_line or _print_line
    _refuse_unusable_secrets(settings)
    _require_token_beyond_loopback(settings)
    _refuse_taken_port(settings)
    folder = settings.data_folder
    open_data_folder(folder)
    url = _configured_database(settings)
    database = EmbeddedPostgres(folder, settings.pg_bin) if url is None else None
    programs: list[SupervisedProgram] = []
    try:
        with _handle_signals(_raise_stop):
            if database is not None:
                if not (folder / "postgres.json").exists():
                    speak(f"First start: preparing the database in {folder}")
                url = database.start()
            migrate_in_child(str(url))
            forget = _worker_unregistration(str(url)) if database is not None else lambda: None
            forget()
            with explain_os_errors(folder):
                programs += _create_programs(settings, str(url), forget, with_worker=with_worker)
                _start_until_healthy(settings, programs[0])
            speak(f"stridelab is running on {_service_url(settings)}")
            speak(
                f"Next: open it in a browser, or run `{_cli_command()} demo` in another terminal. Ctrl-C stops "
                "everything."
            )
            _keep_running(programs, database, speak)
    except _StopRequested:
        return
    finally:
        with _handle_signals(signal.SIG_IGN):
            _stop_programs(programs)
            if database is not None:
                database.stop()


def _configured_database(settings: Settings) -> str | None:
    if settings.database_url is None:
        return None  # and SQLAlchemy, which takes a while to import, is not needed here
    from stridelab.service.storage.database import database_url

    return database_url(settings)


def _worker_unregistration(url: str) -> Callable[[], None]:
    """A function that unregisters all workers; valid because the supervisor's worker is the only one and has ended."""

    def unregister_workers() -> None:
        with (
            contextlib.suppress(psycopg.OperationalError),  # restarting: the missing heartbeat will unregister it
            psycopg.connect(libpq_address(url), autocommit=True, connect_timeout=5) as connection,
        ):
            connection.execute("DELETE FROM worker")

    return unregister_workers


def _create_programs(
    settings: Settings, url: str, before_worker_restart: Callable[[], None], *, with_worker: bool
) -> list[SupervisedProgram]:
    """The programs to keep running, the web server first."""
    logs, blobs = settings.data_folder / "logs", settings.data_folder / "blobs"
    for private in (logs, blobs):
        private.mkdir(mode=0o700, exist_ok=True)
    environment = {
        "MALLOC_ARENA_MAX": "1",  # more serve threads that allocate at the same time; an idle service takes 33 MB less
        **os.environ,
        "STRIDELAB_DATABASE_URL": url,
        "STRIDELAB_BLOB_URL": settings.blob_address,
        "STRIDELAB_DATA_DIR": str(settings.data_folder),
        "STRIDELAB_HOST": settings.host,
        "STRIDELAB_PORT": str(settings.port),
        **{f"STRIDELAB_{name}_URL": f"http://127.0.0.1:{_free_port()}" for name in ("VIEWER", "PAGES")},
    }

    def log_path(name: str) -> Path | None:
        return logs / f"{name}.log" if settings.log_files else None

    programs = [SupervisedProgram(API, log_path("api"), environment)]
    if with_worker:
        programs.append(SupervisedProgram(WORKER, log_path("worker"), environment, before_worker_restart))
    if importlib.util.find_spec("stridelab_web") is not None and importlib.util.find_spec(VIEWER) is not None:
        programs.append(SupervisedProgram(VIEWER, log_path("viewer"), environment))
        busy = BusySignal(programs[0], *_PAGES_SHARES, _PAGES_REST_S)
        programs.append(SupervisedProgram(PAGES, log_path("pages"), environment, is_wanted=busy.is_busy))
    return programs


def _start_until_healthy(settings: Settings, api: SupervisedProgram) -> None:
    """Start the web server alone first: it responds sooner when nothing else competes for the processors."""
    deadline = time.monotonic() + _START_TIMEOUT_S
    while True:
        api.keep_running()
        if _is_healthy(settings):
            return
        if api.failures >= _MAX_FAILED_STARTS or time.monotonic() > deadline:
            raise Unavailable("service-does-not-start", f"The web server does not start: {api.last_log_line()}")
        time.sleep(_POLL_INTERVAL_S / 2)


def _keep_running(
    programs: list[SupervisedProgram], database: EmbeddedPostgres | None, print_line: Callable[[str], None]
) -> NoReturn:
    next_check, complained = 0.0, False
    probe = _DatabaseProbe(database) if database is not None else None
    while True:
        now = time.monotonic()
        if database is not None and now >= next_check:
            if probe is not None and (verdict := probe.failure_state()) is not None:
                print_line(f"The database {FAILURES[verdict]}: restarting it.")
                database.kill()
            if database.postmaster_pid is None:
                try:
                    database.start(timeout_s=10.0)
                    complained = False
                except Unavailable as error:  # retried until it starts
                    if not complained:
                        print_line(f"The database stopped and does not start again: {error.message}")
                    complained = True
            next_check = time.monotonic() + _DATABASE_CHECK_S
        for program in programs:
            program.keep_running(print_line)
        time.sleep(_POLL_INTERVAL_S)


class _DatabaseProbe:
    """Polls the database in a separate thread, since a hung database blocks the calling thread."""

    def __init__(self, database: EmbeddedPostgres) -> None:
        self._database = database
        self._pid: int | None = None
        self._watchdog: ResponseWatchdog | None = None
        self._answers = 0
        self._counted_answers = 0
        threading.Thread(target=self._poll_database, daemon=True).start()

    def failure_state(self) -> FailureState | None:
        """``stopped`` or ``hangs``; None if the postmaster responds or does not run."""
        pid = self._database.postmaster_pid
        if pid is None:
            self._pid = self._watchdog = None
            return None
        if pid != self._pid or self._watchdog is None:
            self._pid, self._watchdog = pid, ResponseWatchdog(pid, hung_s=_DATABASE_HUNG_S)
        if self._answers != self._counted_answers:
            self._counted_answers = self._answers
            self._watchdog.record_answer()
            return None
        return self._watchdog.failure_state()

    def _poll_database(self) -> None:
        while True:
            with contextlib.suppress(Unavailable):  # not started yet, or stopped for good
                self._answers += self._database.responds_in_time()
            time.sleep(_DATABASE_POLL_S)


def _stop_programs(programs: list[SupervisedProgram]) -> None:
    """Send SIGTERM to all programs, then SIGKILL after a grace period."""
    for program in programs:
        program.send_signal(signal.SIGTERM)
    deadline = time.monotonic() + _STOP_TIMEOUT_S
    for program in programs:
        if program.process is not None:
            with contextlib.suppress(subprocess.TimeoutExpired):
                program.process.wait(max(0.0, deadline - time.monotonic()))
            program.send_signal(signal.SIGKILL)
            program.process.wait()


def _refuse_unusable_secrets(settings: Settings) -> None:
    """Raise ``InvalidInput`` (``secret-unreadable``) on the console instead of in every program's log."""
    _ = settings.token, settings.blob_options, settings.database_dsn


def _require_token_beyond_loopback(settings: Settings) -> None:
    if not settings.is_loopback and settings.token is None:
        raise InvalidInput(
            "token-needed",
            f"{settings.host} can be reached from other machines, so a token is needed: set STRIDELAB_API_TOKEN, or "
            "leave STRIDELAB_HOST at 127.0.0.1.",
            [Fault("STRIDELAB_API_TOKEN", "not set")],
        )


def _refuse_taken_port(settings: Settings) -> None:
    family = socket.AF_INET6 if ":" in settings.host else socket.AF_INET
    with socket.socket(family, socket.SOCK_STREAM) as probe:
        probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            probe.bind((settings.host, settings.port))
        except OSError as error:
            raise Unavailable(
                "port-taken",
                f"Port {settings.port} on {settings.host} cannot be used ({error.strerror}). Is stridelab running "
                "already? Stop it, or set STRIDELAB_PORT to another port.",
            ) from error


def _free_port() -> int:
    with socket.socket(socket.AF_INET, socket.SOCK_STREAM) as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


def _service_url(settings: Settings) -> str:
    host = _LOOPBACK_OF_WILDCARD.get(settings.host, settings.host)
    return f"http://[{host}]:{settings.port}" if ":" in host else f"http://{host}:{settings.port}"


def _cli_command() -> str:
    """Command that runs this installation's command line from the current folder."""
    script = Path(sys.executable).with_name("stridelab")
    return os.path.relpath(script) if script.exists() else "stridelab"


def _is_healthy(settings: Settings) -> bool:
    direct = urllib.request.build_opener(urllib.request.ProxyHandler({}))
    try:
        with direct.open(f"{_service_url(settings)}/api/v1/health", timeout=2.0) as answer:
            return bool(answer.status == 200)
    except (OSError, urllib.error.URLError):
        return False


@contextlib.contextmanager
def _handle_signals(handler: "Callable[[int, FrameType | None], None] | signal.Handlers") -> Iterator[None]:
    """Handle SIGINT and SIGTERM with ``handler`` inside the block."""
    before = {signum: signal.signal(signum, handler) for signum in (signal.SIGINT, signal.SIGTERM)}
    try:
        yield
    finally:
        for signum, previous in before.items():
            signal.signal(signum, previous)


def _raise_stop(_signum: int, _frame: FrameType | None) -> None:
    raise _StopRequested


def _print_line(line: str) -> None:
    sys.stdout.write(f"{line}\n")
    sys.stdout.flush()
