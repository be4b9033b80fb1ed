"""The job's row is the queue; the tables of procrastinate, which had a second row for every job, are dropped.

Jobs that wait keep their place, which their own row gave them before. Jobs that run have no worker any more: those of
the earlier version have stopped, and the first worker of this one queues their jobs again.
"""

import sqlalchemy as sa
from alembic import op

revision = "0009"
down_revision = "0008"
branch_labels = None
depends_on = None

LONG_KINDS = (
    "learn-reachability",
    "plan-motion",
    "plan-receding",
    "read-batch",
    "reproduce",
    "simulate-recording",
    "study-population",
    "sweep",
)
"""Kinds of the long lane at this revision."""
DROP_PROCRASTINATE = """
    DO $$ DECLARE statement text; BEGIN
        FOR statement IN
            SELECT format('DROP TABLE %s CASCADE', oid::regclass) FROM pg_class
             WHERE relnamespace = current_schema()::regnamespace AND relkind = 'r' AND relname LIKE 'procrastinate\\_%'
        LOOP EXECUTE statement; END LOOP;
        FOR statement IN
            SELECT format('DROP FUNCTION %s CASCADE', oid::regprocedure) FROM pg_proc
             WHERE pronamespace = current_schema()::regnamespace AND proname LIKE 'procrastinate\\_%'
        LOOP EXECUTE statement; END LOOP;
        FOR statement IN
            SELECT format('DROP TYPE %s CASCADE', oid::regtype) FROM pg_type
             WHERE typnamespace = current_schema()::regnamespace AND typname LIKE 'procrastinate\\_%' AND typelem = 0
        LOOP EXECUTE statement; END LOOP;
    END $$
"""


def upgrade() -> None:
    op.create_table(
        "worker",
        sa.Column("id", sa.BigInteger(), sa.Identity(always=False), nullable=False),
        sa.Column("last_heartbeat", sa.DateTime(timezone=True), server_default=sa.text("now()"), nullable=False),
        sa.PrimaryKeyConstraint("id", name="worker_pkey"),
    )
    op.add_column("job", sa.Column("lane", sa.Text(), server_default="short", nullable=False))
    op.add_column(
        "job",
        sa.Column("worker_id", sa.BigInteger(), comment="runs the job, or ran it last; its row goes when it dies"),
    )
    job = sa.table("job", sa.column("kind"), sa.column("lane"))
    op.execute(job.update().where(job.c.kind.in_(LONG_KINDS)).values(lane="long"))
    op.drop_column("job", "queue_id")
    op.create_index(
        "job_waiting",
        "job",
        [sa.text("coalesce(owner, '')"), sa.text("priority DESC"), "created_at", "id"],
        postgresql_where=sa.text("state = 'queued'"),
    )
    op.create_index("job_running", "job", ["worker_id"], postgresql_where=sa.text("state = 'running'"))
    op.execute(DROP_PROCRASTINATE)
