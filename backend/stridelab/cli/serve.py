"""``stridelab serve``, ``worker`` and ``migrate``: read the settings and call the service's entry points."""

import os
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from pydantic import ValidationError

from stridelab.errors import Fault, InvalidInput

if TYPE_CHECKING:
    from stridelab.service.settings import Settings


def serve(
    host: Annotated[str | None, typer.Option("--host", help="Address to bind to (STRIDELAB_HOST).")] = None,
    port: Annotated[int | None, typer.Option("--port", help="Public port (STRIDELAB_PORT).")] = None,
    data_dir: Annotated[Path | None, typer.Option("--data-dir", help="Data folder (STRIDELAB_DATA_DIR).")] = None,
    without_worker: Annotated[
        bool, typer.Option("--without-worker", help="Start the server without a worker.")
    ] = False,
) -> None:
    """Start database, API and pages, worker and viewer; Ctrl-C stops them."""
    from stridelab.service.supervisor import serve as supervise

    # Options take precedence over the environment; the children of the supervisor read the same variables.
    for name, value in (("HOST", host), ("PORT", port), ("DATA_DIR", data_dir)):
        if value is not None:
            os.environ[f"STRIDELAB_{name}"] = str(value)
    supervise(read_settings(), with_worker=not without_worker)


def worker() -> None:
    """Start one worker that takes jobs from STRIDELAB_DATABASE_URL until Ctrl-C."""
    from stridelab.service.data_folder import open_data_folder
    from stridelab.service.jobs.worker import main

    _database_url("worker")
    open_data_folder(read_settings().data_folder)
    main()


def migrate() -> None:
    """Bring the schema of STRIDELAB_DATABASE_URL up to date."""
    from stridelab.service.storage.database import migrate as upgrade

    upgrade(_database_url("migrate"))


def read_settings() -> "Settings":
    """The settings of the environment. Raises ``InvalidInput`` naming the invalid variables."""
    from stridelab.service.settings import current_settings

    try:
        return current_settings()
    except ValidationError as error:
        faults = [Fault(f"STRIDELAB_{'_'.join(map(str, e['loc'])).upper()}", e["msg"]) for e in error.errors()]
        raise InvalidInput("settings-invalid", "The settings in the environment are invalid.", faults) from error


def _database_url(command: str) -> str:
    url = read_settings().database_dsn
    if not url:
        raise InvalidInput(
            "database-url-missing",
            f"stridelab {command} needs STRIDELAB_DATABASE_URL; the embedded database belongs to stridelab serve.",
            [Fault("STRIDELAB_DATABASE_URL", "not set")],
        )
    return url
