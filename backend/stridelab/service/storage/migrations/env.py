"""Alembic's entry: runs on the connection that ``migrate`` holds, and looks at our own tables only."""

from typing import Any

from alembic import context

from stridelab.service.storage.tables import metadata


def is_own_table(_object: Any, name: str | None, type_: str, _reflected: bool, _compare_to: Any) -> bool:
    """Whether a table belongs to ``metadata``; the queue's tables come from its own SQL."""
    return not (type_ == "table" and name is not None and name.startswith("procrastinate_"))


context.configure(
    connection=context.config.attributes["connection"],
    target_metadata=metadata,
    include_object=is_own_table,
    compare_server_default=True,
)
with context.begin_transaction():
    context.run_migrations()
