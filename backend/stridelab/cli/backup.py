"""``stridelab backup``, ``restore``, ``adopt`` and ``doctor --files``."""

from pathlib import Path
from typing import Annotated

import typer

from stridelab.cli.results import err, out, progress_bar
from stridelab.cli.serve import read_settings

Replace = Annotated[bool, typer.Option("--replace", help="Replace existing data.")]


def backup(
    file: Annotated[Path, typer.Argument(help="The backup to write.")],
    force: Annotated[bool, typer.Option("--force", help="Replace an earlier backup of that name.")] = False,
) -> None:
    """Write all data of the service into one file; the service may be running."""
    from stridelab.service.backup.create import create_backup
    from stridelab.service.backup.locations import open_location

    with open_location(read_settings(), require_stopped=False) as source, progress_bar("backup") as bar:
        taken = create_backup(source.database_url, source.open_store(), file, force=force, on_progress=bar)
    out.print(f"{file}: {_format_totals(taken.rows, taken.files, taken.bytes)}")
    _warn_missing(taken.missing)


def restore(
    file: Annotated[Path, typer.Argument(help="A backup.")],
    replace: Replace = False,
    with_tokens: Annotated[
        bool, typer.Option("--with-tokens", help="Replace the existing API tokens with those of the backup.")
    ] = False,
) -> None:
    """Replace all data of the service with a backup, completely or not at all. The service must not run."""
    from stridelab.service.backup.archive import check_archive, open_archive
    from stridelab.service.backup.locations import open_location
    from stridelab.service.backup.restore import restore_backup as run

    with progress_bar("check") as bar:
        check_archive(file, bar)  # before a database is made for it
    with (
        progress_bar("restore") as bar,
        open_archive(file, bar, is_checked=True) as archive,
        open_location(read_settings(), require_stopped=True, create=True) as location,
    ):
        taken = run(archive, location, with_tokens=with_tokens, replace=replace, on_progress=bar)
    out.print(f"restored {_format_totals(taken.rows, taken.files, taken.bytes)}")
    if taken.rows.get("token") and not with_tokens:
        out.print("The API tokens of the backup were not restored; --with-tokens restores them.")
    _warn_missing(taken.missing)


def adopt(
    folder: Annotated[Path, typer.Argument(help="Data folder of an embedded service that does not run.")],
    replace: Replace = False,
) -> None:
    """Move an embedded service's data into STRIDELAB_DATABASE_URL and STRIDELAB_BLOB_URL."""
    from stridelab.service.backup.restore import adopt_data_folder as run

    with progress_bar("adopt") as bar:
        taken = run(folder, read_settings(), replace=replace, on_progress=bar)
    out.print(f"adopted {_format_totals(taken.rows, taken.files, taken.bytes)}")
    out.print(f"{folder} is unchanged; delete it after checking the new service.")
    _warn_missing(taken.missing)


def verify_files() -> bool:
    """Check all stored files against their hashes; prints missing and damaged ones, returns whether all are intact."""
    from stridelab.service.backup.locations import open_location
    from stridelab.service.backup.verify import verify_stored_files

    with open_location(read_settings(), require_stopped=False) as location, progress_bar("files") as bar:
        report = verify_stored_files(location.database_url, location.open_store(), bar)
    hashes = f"; {report.without_hash} of them have no stored hash" if report.without_hash else ""
    out.print(f"{report.files} files ({report.bytes / 1e6:,.1f} MB) read{hashes}")
    for problem, files in (("missing", report.missing), ("damaged", report.damaged)):
        for one in files:
            err.print(f"[red]{problem}[/]: {one.description} ({one.key})", soft_wrap=True)
    if not report.ok:
        err.print("Upload a damaged recording again: the same file repairs it. Run the job of a damaged result again.")
    return report.ok


def _format_totals(rows: dict[str, int], files: int, size_bytes: int) -> str:
    counts = [(rows.get(name, 0), name) for name in ("recording", "subject", "scenario", "job")] + [(files, "file")]
    listed = ", ".join(f"{number} {name}{'' if number == 1 else 's'}" for number, name in counts)
    return f"{listed} ({size_bytes / 1e6:,.1f} MB)"


def _warn_missing(missing: tuple[str, ...]) -> None:
    if missing:
        err.print(f"[yellow]warning[/]: {len(missing)} stored files are missing, the first is {missing[0]}")
