"""Databases of earlier versions."""

from typing import Any

import sqlalchemy
from alembic.autogenerate import compare_metadata
from alembic.runtime.migration import MigrationContext

from stridelab.service.storage.migrating import engine_of, upgrade_on
from stridelab.service.storage.tables import metadata


def migrate_to(url: str, revision: str) -> None:
    """Bring an empty database to ``revision``."""
    engine = engine_of(url)
    with engine.begin() as connection:
        upgrade_on(connection, revision)
    engine.dispose()


def differences(connection: sqlalchemy.Connection) -> list[Any]:
    """In what the tables differ from the declared ones."""

    def ours(_object: object, name: str, type_: str, _reflected: bool, _other: object) -> bool:
        return not (type_ == "table" and name.startswith("procrastinate_"))

    context = MigrationContext.configure(connection, opts={"include_object": ours, "compare_server_default": True})
    return list(compare_metadata(context, metadata))
