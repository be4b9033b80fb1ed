"""``stridelab doctor``: checks of a service's tables, clock, workers, files, memory, solver and sandbox."""

import asyncio
import tempfile
import time
import uuid
from pathlib import Path
from typing import Any, Final

import psutil
import psycopg

from stridelab.cli.doctor.checks import Check
from stridelab.errors import InvalidInput, StridelabError
from stridelab.machine.cores import default_slots
from stridelab.service.jobs.work_folder import HEARTBEAT_FILE
from stridelab.service.postgres.embedded import running_url
from stridelab.service.processes import confinement
from stridelab.service.processes.sandbox import LAYERS
from stridelab.service.settings import Settings
from stridelab.service.storage.migrate import all_revisions, libpq_address, present_revision

MAX_CLOCK_OFFSET_S: Final = 5.0
_STORE_TIMEOUT_S: Final = 15.0
_SERVICE_MB: Final = 1000
"""Memory of database, web server, viewer and idle child processes together, without jobs."""


def check_tables(settings: Settings) -> Check:
    """Check that the tables have the revision of this program; passes if no database runs."""
    url = _database_url(settings)
    if url is None:
        return Check("tables", True, "the embedded database does not run; serve brings its tables up to date")
    try:
        present = present_revision(url)
    except psycopg.Error as error:
        return _database_failure("tables", error)
    wanted = all_revisions()[-1]
    detail = f"revision {present or 'none'}, this program has {wanted}"
    if present is not None and present not in all_revisions():
        return Check(
            "tables", False, detail, "A newer stridelab created them: install that version, or restore a backup."
        )
    return Check("tables", present == wanted, detail, "Stop the service, make a backup, then run: stridelab migrate")


def check_clock(settings: Settings) -> Check:
    """Check that the clocks of the database and of this machine agree; logins and heartbeats compare them."""
    url = _database_url(settings)
    if url is None:
        return Check("clock", True, "the database is on this machine")
    try:
        before = time.time()
        ((database_time_s,),) = _run_query(url, "SELECT extract(epoch FROM clock_timestamp())::float8")
        offset_s = database_time_s - (before + time.time()) / 2
    except psycopg.Error as error:
        return _database_failure("clock", error)
    fix = "Synchronise both clocks by NTP (chrony or systemd-timesyncd)."
    return Check("clock", abs(offset_s) < MAX_CLOCK_OFFSET_S, f"{offset_s:+.2f} s apart from the database", fix)


def check_workers(settings: Settings) -> Check:
    """Check that a worker is alive if jobs are queued."""
    url = _database_url(settings)
    if url is None:
        return Check("workers", True, "serve starts one")
    counts = (
        "SELECT (SELECT count(*) FROM worker WHERE last_heartbeat > now() - make_interval(secs => %s)),"
        " (SELECT count(*) FROM job WHERE state = 'queued')"
    )
    try:
        ((alive, waiting),) = _run_query(url, counts, settings.stall_s)
    except psycopg.errors.UndefinedTable:
        return Check("workers", True, "no tables yet")
    except psycopg.Error as error:
        return _database_failure("workers", error)
    fix = "Start a worker that can reach the database and the files: stridelab worker"
    return Check("workers", alive > 0 or waiting == 0, f"{alive} alive, {waiting} jobs waiting", fix)


def check_heartbeat(settings: Settings) -> Check:
    """Check that the worker of this data folder has a recent heartbeat."""
    file = settings.data_folder / HEARTBEAT_FILE
    silent_s = time.time() - file.stat().st_mtime if file.exists() else None
    detail = "no heartbeat" if silent_s is None else f"last heartbeat {silent_s:.1f} s ago"
    fix = "Look into its log; it needs STRIDELAB_DATABASE_URL and the same STRIDELAB_DATA_DIR."
    return Check("worker", silent_s is not None and silent_s < settings.stall_s, detail, fix)


def check_storage(settings: Settings) -> Check:
    """Check that a file can be stored, read and removed in the store of uploads and results."""
    if settings.blob_url is None and not (settings.data_folder / "blobs").exists():
        return Check("files", True, "will go into the data folder")
    fix = "Check STRIDELAB_BLOB_URL (folder, permissions, bucket) and STRIDELAB_BLOB_CREDENTIALS_FILE (address, keys)."
    try:
        asyncio.run(asyncio.wait_for(_probe_store(settings), _STORE_TIMEOUT_S))
    except StridelabError as error:
        return Check("files", False, error.message, fix)
    except TimeoutError:
        return Check("files", False, f"no answer within {_STORE_TIMEOUT_S:.0f} s", fix)
    except OSError as error:
        return Check("files", False, f"{error.strerror}", fix)
    return Check("files", True, f"stored, read and removed one ({settings.blob_address.partition(':')[0]})")


async def _probe_store(settings: Settings) -> None:
    from stridelab.service.storage.blobs import BlobStore  # slow to import, and health checks have no need

    store = BlobStore.from_url(settings.blob_address, settings.blob_options)
    key, content = f"doctor/{uuid.uuid4().hex}", b"stridelab"
    with tempfile.TemporaryDirectory() as name:
        draft = Path(name) / "probe"
        draft.write_bytes(content)
        await store.put_file(key, draft)
        await store.get_file(key, draft)
        await store.delete(key)


def check_memory(settings: Settings) -> Check:
    """Check that the service and one job fit into memory."""
    have_mb = memory_bytes() / 1e6
    slots = (settings.worker_slots or default_slots()) + 1
    needed_mb = _SERVICE_MB + settings.job_memory_mb
    detail = f"{have_mb:,.0f} MB for {slots} slots of up to {settings.job_memory_mb} MB"
    fix = f"One job and the service take up to {needed_mb} MB: lower STRIDELAB_JOB_MEMORY_MB."
    return Check("memory", have_mb > needed_mb, detail, fix)


def memory_bytes(groups: Path = Path("/sys/fs/cgroup"), own: Path = Path("/proc/self/cgroup")) -> int:
    """Memory of the machine in bytes or, if smaller, the limit of this process's control group."""
    limits = [psutil.virtual_memory().total]
    if own.is_file():
        name = next((line[3:] for line in own.read_text(encoding="ascii").splitlines() if line.startswith("0::")), "/")
        inside = groups / name.lstrip("/")
        for folder in (inside, *inside.parents):
            limit = folder / "memory.max"
            if limit.is_file() and (text := limit.read_text(encoding="ascii").strip()).isdigit():
                limits.append(int(text))
    return min(limits)


def check_solver(_settings: Settings) -> Check:
    """Report which solver plans; never fails, because CasADi replaces a missing C++ solver."""
    from stridelab.centroidal.native.availability import NativeUnavailable, native_availability

    native = native_availability()
    return Check("solver", True, f"CasADi: {native.reason}" if isinstance(native, NativeUnavailable) else "C++")


def check_sandbox(settings: Settings) -> Check:
    """Report the sandbox layers of processes that read files; fails only if required layers are missing."""
    active = confinement.active_layers(settings)
    missing = [name for name in LAYERS if name not in active]
    detail = ", ".join(active) or "none"
    if missing:
        detail += f"; without {', '.join(missing)}" + (" (STRIDELAB_SANDBOX=off)" if settings.sandbox == "off" else "")
    fix = "Use Linux 6.7 or newer with Landlock and seccomp, or set STRIDELAB_SANDBOX=auto."
    return Check("sandbox", settings.sandbox != "required" or not missing, detail, fix)


def _database_url(settings: Settings) -> str | None:
    """URL of the running database, or None."""
    try:
        return settings.database_dsn or running_url(settings.data_folder)
    except InvalidInput:
        return None  # the password file: the check of the database tells


def _run_query(url: str, query: str, *values: Any) -> list[tuple[Any, ...]]:
    with psycopg.connect(libpq_address(url), connect_timeout=5) as connection:
        return connection.execute(query, values).fetchall()


def _database_failure(name: str, error: Exception) -> Check:
    return Check(name, False, str(error).strip().splitlines()[0], "See the check of the database.")
