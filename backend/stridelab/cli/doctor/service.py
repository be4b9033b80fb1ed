"""``stridelab doctor`` about what a service is made of: its tables, clock, workers, files, memory and solver."""

import asyncio
import tempfile
import time
import uuid
from pathlib import Path
from typing import Any, Final

import psutil
import psycopg

from stridelab.cli.doctor.checks import Check
from stridelab.cores import default_slots
from stridelab.errors import InvalidInput, StridelabError
from stridelab.service.jobs.work_folder import HEARTBEAT_FILE
from stridelab.service.postgres.embedded import running_url
from stridelab.service.processes import confinement
from stridelab.service.processes.sandbox import LAYERS
from stridelab.service.settings import Settings
from stridelab.service.storage.migrate import all_revisions, libpq_address, present_revision

CLOCKS_APART_S: Final = 5.0
_STORE_ANSWERS_S: Final = 15.0
_SERVICE_MB: Final = 1000
"""What database, web server, viewer and waiting children take together, beside the jobs."""


def tables(settings: Settings) -> Check:
    """The tables have the revision of this program; skipped where no database runs."""
    url = _url(settings)
    if url is None:
        return Check("tables", True, "the embedded database does not run; serve brings its tables up to date")
    try:
        present = present_revision(url)
    except psycopg.Error as error:
        return _away("tables", error)
    wanted = all_revisions()[-1]
    found = f"revision {present or 'none'}, this program has {wanted}"
    if present is not None and present not in all_revisions():
        return Check("tables", False, found, "A newer stridelab made them: install that one, or restore a backup.")
    return Check("tables", present == wanted, found, "Stop the service, make a backup, then run: stridelab migrate")


def clock(settings: Settings) -> Check:
    """The database's clock and this machine's agree: logins and silent workers are judged by them."""
    url = _url(settings)
    if url is None:
        return Check("clock", True, "the database is on this machine")
    try:
        before = time.time()
        ((theirs,),) = _ask(url, "SELECT extract(epoch FROM clock_timestamp())::float8")
        apart = theirs - (before + time.time()) / 2
    except psycopg.Error as error:
        return _away("clock", error)
    fix = "Let both machines set their clocks by NTP (chrony or systemd-timesyncd)."
    return Check("clock", abs(apart) < CLOCKS_APART_S, f"{apart:+.2f} s apart from the database", fix)


def workers(settings: Settings) -> Check:
    """Where jobs wait, somebody works."""
    url = _url(settings)
    if url is None:
        return Check("workers", True, "serve starts one")
    counts = (
        "SELECT (SELECT count(*) FROM procrastinate_workers WHERE last_heartbeat > now() - make_interval(secs => %s)),"
        " (SELECT count(*) FROM job WHERE state = 'queued')"
    )
    try:
        ((alive, waiting),) = _ask(url, counts, settings.stall_s)
    except psycopg.errors.UndefinedTable:
        return Check("workers", True, "no tables yet")
    except psycopg.Error as error:
        return _away("workers", error)
    fix = "Start one where the database and the files can be reached: stridelab worker"
    return Check("workers", alive > 0 or waiting == 0, f"{alive} alive, {waiting} jobs waiting", fix)


def beat(settings: Settings) -> Check:
    """The worker of this data folder was in touch with the database a moment ago."""
    file = settings.data_folder / HEARTBEAT_FILE
    silent_s = time.time() - file.stat().st_mtime if file.exists() else None
    found = "never heard of" if silent_s is None else f"heard of {silent_s:.1f} s ago"
    fix = "Look into its log; it needs STRIDELAB_DATABASE_URL and the same STRIDELAB_DATA_DIR."
    return Check("worker", silent_s is not None and silent_s < settings.stall_s, found, fix)


def storage(settings: Settings) -> Check:
    """A file can be stored, read and removed where uploads and results go."""
    if settings.blob_url is None and not (settings.data_folder / "blobs").exists():
        return Check("files", True, "will go into the data folder")
    fix = "Check STRIDELAB_BLOB_URL (folder, permissions, bucket) and STRIDELAB_BLOB_CREDENTIALS_FILE (address, keys)."
    try:
        asyncio.run(asyncio.wait_for(_probe(settings), _STORE_ANSWERS_S))
    except StridelabError as error:
        return Check("files", False, error.message, fix)
    except TimeoutError:
        return Check("files", False, f"no answer within {_STORE_ANSWERS_S:.0f} s", fix)
    except OSError as error:
        return Check("files", False, f"{error.strerror}", fix)
    return Check("files", True, f"stored, read and removed one ({settings.blob_address.partition(':')[0]})")


async def _probe(settings: Settings) -> None:
    from stridelab.service.storage.blobs import BlobStore  # slow to import, and health checks have no need

    store = BlobStore.from_url(settings.blob_address, settings.blob_options)
    key, content = f"doctor/{uuid.uuid4().hex}", b"stridelab"
    with tempfile.TemporaryDirectory() as name:
        draft = Path(name) / "probe"
        draft.write_bytes(content)
        await store.put_file(key, draft)
        await store.get_file(key, draft)
        await store.delete(key)


def memory(settings: Settings) -> Check:
    """The jobs that may run at once fit into the memory."""
    have_mb = memory_bytes() / 1e6
    slots = (settings.worker_slots or default_slots()) + 1
    needed_mb = _SERVICE_MB + settings.job_memory_mb
    found = f"{have_mb:,.0f} MB for {slots} slots of up to {settings.job_memory_mb} MB"
    fix = f"One job and the service take up to {needed_mb} MB: lower STRIDELAB_JOB_MEMORY_MB."
    return Check("memory", have_mb > needed_mb, found, fix)


def memory_bytes(groups: Path = Path("/sys/fs/cgroup"), own: Path = Path("/proc/self/cgroup")) -> int:
    """Memory of the machine, or of the container or service unit that this process is in, where that has less."""
    limits = [psutil.virtual_memory().total]
    if own.is_file():
        name = next((line[3:] for line in own.read_text(encoding="ascii").splitlines() if line.startswith("0::")), "/")
        inside = groups / name.lstrip("/")
        for folder in (inside, *inside.parents):
            limit = folder / "memory.max"
            if limit.is_file() and (text := limit.read_text(encoding="ascii").strip()).isdigit():
                limits.append(int(text))
    return min(limits)


def solver(_settings: Settings) -> Check:
    """Which solver plans; CasADi does where the C++ one is not there, so this is never a failure."""
    from stridelab.centroidal.native.availability import NativeUnavailable, native_availability

    found = native_availability()
    return Check("solver", True, f"CasADi: {found.reason}" if isinstance(found, NativeUnavailable) else "C++")


def sandbox(settings: Settings) -> Check:
    """What processes that read files give up here; a failure only where all of it is required."""
    there = confinement.active_layers(settings)
    missing = [name for name in LAYERS if name not in there]
    found = ", ".join(there) or "none"
    if missing:
        found += f"; without {', '.join(missing)}" + (" (STRIDELAB_SANDBOX=off)" if settings.sandbox == "off" else "")
    fix = "Use Linux 6.7 or newer with Landlock and seccomp, or set STRIDELAB_SANDBOX=auto."
    return Check("sandbox", settings.sandbox != "required" or not missing, found, fix)


def _url(settings: Settings) -> str | None:
    """The database that runs, if one does."""
    try:
        return settings.database_dsn or running_url(settings.data_folder)
    except InvalidInput:
        return None  # the password file: the check of the database tells


def _ask(url: str, query: str, *values: Any) -> list[tuple[Any, ...]]:
    with psycopg.connect(libpq_address(url), connect_timeout=5) as connection:
        return connection.execute(query, values).fetchall()


def _away(name: str, error: Exception) -> Check:
    return Check(name, False, str(error).strip().splitlines()[0], "Mend what the check of the database says.")
