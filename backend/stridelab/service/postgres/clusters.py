"""Creates a database cluster, checks by which version of PostgreSQL it was made, and upgrades an older one.

``pg_upgrade`` copies the old cluster into a new one beside it. Until the pointer file names the new one, the old one is
the database: an upgrade that is interrupted begins anew at the next start. The old cluster stays as it was, except that
it is recovered if its server was killed, because ``pg_upgrade`` refuses a cluster that needs recovery.
"""

import shutil
from dataclasses import replace
from pathlib import Path

from stridelab.errors import Unavailable
from stridelab.service.postgres.paths import PostgresHome, reachable_binaries, run_postgres_program, wheel_installations

_INITDB_OPTIONS = ("-U", "postgres", "-A", "trust", "-E", "UTF8", "--locale=C")
_UPGRADE_TIMEOUT_S = 3600.0


def create_cluster(home: PostgresHome, folder: Path, *options: str) -> None:
    """Create an empty cluster at ``folder``, completely or not at all; ``options`` are further ones of ``initdb``.

    Raises ``Unavailable`` (``postgres-cannot-run``).
    """
    draft = folder.with_name(f"{folder.name}.new")
    shutil.rmtree(draft, ignore_errors=True)
    run_postgres_program([home.binaries / "initdb", "-D", draft, *_INITDB_OPTIONS, *options], home.account, 300.0)
    draft.rename(folder)


def is_outdated(home: PostgresHome) -> bool:
    """Whether an older version of PostgreSQL than the installed one created the cluster.

    Raises ``Unavailable``: ``state-file-damaged``, and ``cluster-version`` if a later version created it.
    """
    made_by, present = cluster_version(home.cluster), installed_version(home.binaries, home.account)
    if made_by > present:
        raise Unavailable(
            "cluster-version",
            f"The database in {home.cluster} was created by PostgreSQL {made_by}, the installed version is {present}. "
            f"Set STRIDELAB_PG_BIN to version {made_by}.",
        )
    return made_by < present


def upgraded_home(home: PostgresHome, shelter: Path | None = None) -> PostgresHome:
    """Copy the cluster of ``home`` into one of the installed version beside it; returns its home.

    Raises ``Unavailable`` (``cluster-version``) without binaries of the old version, or with the end of what
    ``pg_upgrade`` printed; the old cluster is then unchanged.
    """
    made_by, present = cluster_version(home.cluster), installed_version(home.binaries, home.account)
    old = _binaries_of(made_by, home, shelter)
    upgraded = home.cluster.with_name(f"cluster-{present}")
    draft = upgraded.with_name(f"{upgraded.name}.draft")
    for leftover in (draft, upgraded):  # of an interrupted upgrade
        shutil.rmtree(leftover, ignore_errors=True)
    try:
        control = _recovered_control_data(home, old)
        has_checksums = "Data page checksum version: 0" not in " ".join(control.split())
        create_cluster(home, draft, *(() if has_checksums else ("--no-data-checksums",)))
        folders: list[str | Path] = ["-b", old, "-B", home.binaries, "-d", home.cluster, "-D", draft, "-s", home.socket]
        argv = [home.binaries / "pg_upgrade", "-U", "postgres", *folders]
        run_postgres_program(argv, home.account, _UPGRADE_TIMEOUT_S, home.socket)
    except Unavailable as error:
        shutil.rmtree(draft, ignore_errors=True)
        raise Unavailable(
            "cluster-version",
            f"The database in {home.cluster} could not be upgraded from PostgreSQL {made_by} to {present} and is "
            f"unchanged. {error.message}",
        ) from error
    draft.rename(upgraded)
    return replace(home, cluster=upgraded)


def cluster_version(cluster: Path) -> int:
    """Major version of PostgreSQL that created ``cluster``; raises ``Unavailable`` (``state-file-damaged``)."""
    text = (cluster / "PG_VERSION").read_text(encoding="utf-8", errors="replace").strip()
    if not (text.isascii() and text.isdecimal()):
        raise Unavailable(
            "state-file-damaged",
            f"{cluster / 'PG_VERSION'} is damaged: it does not contain the version of the database. Restore a backup "
            "into an empty data folder, or, if nothing else is damaged, write the version number into it.",
        )
    return int(text)


def installed_version(binaries: Path, account: str | None) -> int:
    """Major version of the programs in ``binaries``; raises ``Unavailable`` (``postgres-cannot-run``)."""
    return int(run_postgres_program([binaries / "postgres", "--version"], account).split()[2].split(".")[0])


def _binaries_of(version: int, home: PostgresHome, shelter: Path | None) -> Path:
    for installed in wheel_installations():
        binaries = reachable_binaries(installed, home.account, shelter)
        if installed_version(binaries, home.account) == version:
            return binaries
    raise Unavailable(
        "cluster-version",
        f"The database in {home.cluster} was created by PostgreSQL {version}, of which no programs are installed to "
        f"upgrade it. Set STRIDELAB_PG_BIN to version {version}; to upgrade, make a backup with it and restore that "
        "into an empty data folder without it.",
    )


def _recovered_control_data(home: PostgresHome, old: Path) -> str:
    """Output of ``pg_controldata`` for the old cluster, after a recovery if its server was killed."""
    control = run_postgres_program([old / "pg_controldata", home.cluster], home.account)
    if "shut down\n" not in control:  # a server in single-user mode recovers it, and ends where its input ends
        run_postgres_program([old / "postgres", "--single", "-D", home.cluster, "postgres"], home.account)
    return control
