"""Parts of the results of running jobs."""

import sqlalchemy as sa
from alembic import op

revision = "0011"
down_revision = "0010"
branch_labels = None
depends_on = None


def upgrade() -> None:
    op.create_table(
        "job_partial",
        sa.Column("job_id", sa.Text(), nullable=False),
        sa.Column("attempt", sa.Integer(), nullable=False, comment="fencing token"),
        sa.Column("number", sa.Integer(), nullable=False, comment="from 1 within the attempt"),
        sa.Column("body", sa.Text(), nullable=False, comment="PartialChunk"),
        sa.ForeignKeyConstraint(["job_id"], ["job.id"], name="job_partial_job_id_fkey", ondelete="CASCADE"),
        sa.PrimaryKeyConstraint("job_id", "attempt", "number", name="job_partial_pkey"),
        prefixes=["UNLOGGED"],
    )
