"""When whose job was started last, which decides whose turn it is."""

import sqlalchemy as sa
from alembic import op

revision = "0004"
down_revision = "0003"
branch_labels = None
depends_on = None


def upgrade() -> None:
    op.create_index("job_served", "job", [sa.text("coalesce(owner, '')"), "started_at"])
