"""Scenarios: which of them come with the program, when they were changed, and which jobs work on them."""

import sqlalchemy as sa
from alembic import op

revision = "0002"
down_revision = "0001"
branch_labels = None
depends_on = None


def upgrade() -> None:
    op.add_column("scenario", sa.Column("bundled", sa.Boolean(), server_default="false", nullable=False))
    op.add_column(
        "scenario",
        sa.Column("updated_at", sa.DateTime(timezone=True), server_default=sa.text("now()"), nullable=False),
    )
    op.execute("UPDATE scenario SET updated_at = created_at")
    op.create_index("scenario_newest", "scenario", ["created_at", "id"])
    op.add_column("job", sa.Column("scenario_id", sa.Text(), comment="what the job plans for"))
    op.create_foreign_key("job_scenario_id_fkey", "job", "scenario", ["scenario_id"], ["id"], ondelete="SET NULL")
    op.create_index("job_scenario", "job", ["scenario_id"])
