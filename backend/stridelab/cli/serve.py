"""``stridelab serve``, ``worker`` and ``migrate``: read the settings and call the service's entry points."""

import os
from pathlib import Path
from typing import TYPE_CHECKING

from pydantic import ValidationError

from stridelab.errors import Fault, InvalidInput

if TYPE_CHECKING:
    from stridelab.service.settings import Settings


def start_service(*, host: str | None, port: int | None, data_dir: Path | None, without_worker: bool) -> None:
    """Start everything with the settings of the environment; options given here take precedence."""
    from stridelab.service.supervisor import serve as supervise

    # The children of the supervisor read the same variables.
    for name, value in (("HOST", host), ("PORT", port), ("DATA_DIR", data_dir)):
        if value is not None:
            os.environ[f"STRIDELAB_{name}"] = str(value)
    supervise(read_settings(), with_worker=not without_worker)


def start_worker() -> None:
    """Start one worker on an existing database."""
    from stridelab.service.data_folder import open_data_folder
    from stridelab.service.jobs.worker import main

    _database_url("worker")
    open_data_folder(read_settings().data_folder)
    main()


def migrate_database() -> None:
    """Upgrade the schema of an existing database."""
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
