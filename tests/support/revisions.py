"""Databases of earlier versions."""

from stridelab.service.storage.migrating import engine_of, upgrade_on


def migrate_to(url: str, revision: str) -> None:
    """Bring an empty database to ``revision``."""
    engine = engine_of(url)
    with engine.begin() as connection:
        upgrade_on(connection, revision)
    engine.dispose()
