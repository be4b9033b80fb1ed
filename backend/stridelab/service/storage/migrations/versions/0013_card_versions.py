"""Earlier versions of the cards of users' robots."""

import sqlalchemy as sa
from alembic import op
from sqlalchemy.dialects.postgresql import JSONB

revision = "0013"
down_revision = "0012"
branch_labels = None
depends_on = None


def upgrade() -> None:
    version = sa.Column("version", sa.Integer, nullable=False, server_default="1", comment="of the card")
    earlier = sa.Column("earlier", JSONB, nullable=False, server_default="[]", comment="EarlierCard, the newest last")
    op.add_column("robot", version)
    op.add_column("robot", earlier)
