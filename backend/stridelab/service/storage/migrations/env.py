"""Alembic's entry: runs on the connection that ``migrate`` holds."""

from alembic import context

from stridelab.service.storage.tables import metadata

context.configure(
    connection=context.config.attributes["connection"], target_metadata=metadata, compare_server_default=True
)
with context.begin_transaction():
    context.run_migrations()
