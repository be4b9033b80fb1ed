"""Robots of users."""

import sqlalchemy as sa
from alembic import op
from sqlalchemy.dialects import postgresql

revision = "0010"
down_revision = "0009"
branch_labels = None
depends_on = None


def upgrade() -> None:
    op.create_table(
        "robot",
        sa.Column("id", sa.Text(), primary_key=True),
        sa.Column("created_at", sa.DateTime(timezone=True), server_default=sa.text("now()"), nullable=False),
        sa.Column("owner", sa.Text()),
        sa.Column("name", sa.Text(), nullable=False),
        sa.Column("filename", sa.Text(), nullable=False),
        sa.Column("sha256", sa.Text(), nullable=False, comment="of the uploaded file"),
        sa.Column("bytes", sa.BigInteger(), nullable=False, comment="of the stored files"),
        sa.Column("bundle_key", sa.Text(), nullable=False, comment="zip of the rebuilt description and its meshes"),
        sa.Column("links_key", sa.Text(), nullable=False, comment="display meshes, GLB"),
        sa.Column("learned_key", sa.Text(), comment="zip of the learned densities"),
        sa.Column("state", sa.Text(), nullable=False),
        sa.Column("card", postgresql.JSONB(), nullable=False, comment="the card without the paths of files"),
        sa.Column("assumed", postgresql.JSONB(), nullable=False, comment="by field of the card"),
        sa.Column("facts", postgresql.JSONB(), nullable=False, comment="RobotFacts"),
        sa.Column("shapes", postgresql.JSONB(), nullable=False, comment="effectors with their learned reach"),
        sa.Column("commission", postgresql.JSONB(), comment="CommissionRobotSummary"),
    )
    op.create_index("robot_name", "robot", ["name"], unique=True)
