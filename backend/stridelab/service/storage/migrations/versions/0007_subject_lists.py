"""Lists of subjects, and of the recordings of one subject or of none, newest first, without reading all rows."""

from alembic import op

revision = "0007"
down_revision = "0006"
branch_labels = None
depends_on = None


def upgrade() -> None:
    op.create_index("subject_newest", "subject", ["created_at", "id"])
    op.create_index("recording_subject", "recording", ["subject_id", "created_at", "id"])
