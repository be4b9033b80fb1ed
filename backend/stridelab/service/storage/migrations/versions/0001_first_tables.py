"""All tables of the first version.

Up to revision 0008 it also created the schema of procrastinate 3.10, which revision 0009 drops.
"""

import sqlalchemy as sa
from alembic import op
from sqlalchemy.dialects import postgresql

revision = "0001"
down_revision = None
branch_labels = None
depends_on = None


def upgrade() -> None:
    op.create_table(
        "scenario",
        sa.Column("id", sa.Text(), nullable=False),
        sa.Column("created_at", sa.DateTime(timezone=True), server_default=sa.text("now()"), nullable=False),
        sa.Column("owner", sa.Text()),
        sa.Column("body", postgresql.JSONB(), nullable=False),
        sa.PrimaryKeyConstraint("id", name="scenario_pkey"),
    )
    op.create_table(
        "subject",
        sa.Column("id", sa.Text(), nullable=False),
        sa.Column("created_at", sa.DateTime(timezone=True), server_default=sa.text("now()"), nullable=False),
        sa.Column("owner", sa.Text()),
        sa.Column("fields", postgresql.JSONB(), nullable=False, comment="SubjectFields"),
        sa.PrimaryKeyConstraint("id", name="subject_pkey"),
    )
    op.create_table(
        "recording",
        sa.Column("id", sa.Text(), nullable=False),
        sa.Column("created_at", sa.DateTime(timezone=True), server_default=sa.text("now()"), nullable=False),
        sa.Column("owner", sa.Text()),
        sa.Column("bundled", sa.Boolean(), server_default="false", nullable=False),
        sa.Column("filename", sa.Text(), nullable=False),
        sa.Column("sha256", sa.Text(), nullable=False),
        sa.Column("bytes", sa.BigInteger(), nullable=False),
        sa.Column("blob_key", sa.Text(), nullable=False),
        sa.Column("tracks_key", sa.Text(), nullable=False, comment="tracks.parquet, written by the parsing child"),
        sa.Column(
            "facts", postgresql.JSONB(), nullable=False, comment="RecordingFacts as parsed with the present switches"
        ),
        sa.Column("subject_id", sa.Text()),
        sa.Column("subject_fields", postgresql.JSONB(), nullable=False, comment="SubjectFields stated by the user"),
        sa.Column("static_recording_id", sa.Text()),
        sa.Column("marker_map", postgresql.JSONB(), server_default="{}", nullable=False),
        sa.Column("plate_switches", postgresql.JSONB(), server_default="{}", nullable=False),
        sa.Column("truth_job_id", sa.Text()),
        sa.ForeignKeyConstraint(
            ["static_recording_id"], ["recording.id"], name="recording_static_recording_id_fkey", ondelete="SET NULL"
        ),
        sa.ForeignKeyConstraint(["subject_id"], ["subject.id"], name="recording_subject_id_fkey", ondelete="SET NULL"),
        sa.PrimaryKeyConstraint("id", name="recording_pkey"),
    )
    op.create_index("recording_newest", "recording", ["created_at", "id"])
    op.create_index("recording_sha256", "recording", ["sha256"])
    op.create_table(
        "job",
        sa.Column("id", sa.Text(), nullable=False),
        sa.Column("created_at", sa.DateTime(timezone=True), server_default=sa.text("now()"), nullable=False),
        sa.Column("owner", sa.Text()),
        sa.Column("kind", sa.Text(), nullable=False),
        sa.Column("state", sa.Text(), server_default="queued", nullable=False),
        sa.Column("priority", sa.Integer(), server_default="0", nullable=False),
        sa.Column("attempt", sa.Integer(), server_default="0", nullable=False, comment="fencing token"),
        sa.Column(
            "returned", sa.Integer(), server_default="0", nullable=False, comment="attempts handed back in good order"
        ),
        sa.Column("input", postgresql.JSONB(), nullable=False),
        sa.Column("input_hash", sa.Text(), nullable=False),
        sa.Column("idempotency_key", sa.Text()),
        sa.Column("recording_id", sa.Text(), comment="what the job works on"),
        sa.Column("fraction", sa.Float(), server_default="0", nullable=False),
        sa.Column("message", sa.Text(), server_default="", nullable=False),
        sa.Column("cancel_requested", sa.Boolean(), server_default="false", nullable=False),
        sa.Column("started_at", sa.DateTime(timezone=True)),
        sa.Column("finished_at", sa.DateTime(timezone=True)),
        sa.Column("queue_id", sa.BigInteger(), comment="row of the queue, for delivery only"),
        sa.Column("result", postgresql.JSONB(), comment="summary, versions, references, artifacts"),
        sa.Column("blob_prefix", sa.Text(), comment="results/<job>/<attempt> once published"),
        sa.Column("error", postgresql.JSONB(), comment="Problem"),
        sa.Column("log_tail", sa.Text()),
        sa.ForeignKeyConstraint(["recording_id"], ["recording.id"], name="job_recording_id_fkey", ondelete="CASCADE"),
        sa.PrimaryKeyConstraint("id", name="job_pkey"),
    )
    op.create_index(
        "job_idempotency",
        "job",
        ["owner", "idempotency_key"],
        unique=True,
        postgresql_nulls_not_distinct=True,
        postgresql_where=sa.text("idempotency_key IS NOT NULL"),
    )
    op.create_index("job_newest", "job", ["created_at", "id"])
    op.create_index("job_recording", "job", ["recording_id"])
    op.create_index("job_state", "job", ["state", "priority", "created_at"])
    op.create_table(
        "job_event",
        sa.Column("seq", sa.BigInteger(), sa.Identity(always=False), nullable=False),
        sa.Column("job_id", sa.Text(), nullable=False),
        sa.Column("at", sa.DateTime(timezone=True), server_default=sa.text("now()"), nullable=False),
        sa.Column("state", sa.Text(), nullable=False),
        sa.Column("attempt", sa.Integer(), nullable=False),
        sa.Column("fraction", sa.Float(), nullable=False),
        sa.Column("message", sa.Text(), nullable=False),
        sa.ForeignKeyConstraint(["job_id"], ["job.id"], name="job_event_job_id_fkey", ondelete="CASCADE"),
        sa.PrimaryKeyConstraint("seq", name="job_event_pkey"),
    )
    op.create_index("job_event_age", "job_event", ["at"])
    op.create_index("job_event_of", "job_event", ["job_id", "seq"])

    # the two tables refer to each other
    op.create_foreign_key(
        "recording_truth_job_id_fkey", "recording", "job", ["truth_job_id"], ["id"], ondelete="SET NULL"
    )
