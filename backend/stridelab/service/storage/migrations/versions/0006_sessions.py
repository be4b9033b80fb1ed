"""Which session of trials a recording belongs to, and whether the user said so."""

import sqlalchemy as sa
from alembic import op

revision = "0006"
down_revision = "0005"
branch_labels = None
depends_on = None


def upgrade() -> None:
    op.add_column("recording", sa.Column("session_id", sa.Text, comment="trials with one clock and one body mass"))
    op.add_column(
        "recording",
        sa.Column("session_stated", sa.Boolean, server_default="false", nullable=False),
    )
    op.create_index("recording_session", "recording", ["session_id"])
