"""Database tables. The rows of ``job`` are the queue, too: those in the state ``queued`` wait in it."""

from sqlalchemy import (
    BigInteger,
    Boolean,
    Column,
    DateTime,
    Float,
    ForeignKey,
    Identity,
    Index,
    Integer,
    MetaData,
    Table,
    Text,
    func,
    text,
)
from sqlalchemy.dialects.postgresql import JSONB

metadata = MetaData(
    naming_convention={"pk": "%(table_name)s_pkey", "fk": "%(table_name)s_%(column_0_name)s_fkey"},
)


def _created_at() -> Column[object]:
    return Column("created_at", DateTime(timezone=True), nullable=False, server_default=func.now())


subject = Table(
    "subject",
    metadata,
    Column("id", Text, primary_key=True),
    _created_at(),
    Column("owner", Text),
    Column("fields", JSONB, nullable=False, comment="SubjectFields"),
    Index("subject_newest", "created_at", "id"),
)

recording = Table(
    "recording",
    metadata,
    Column("id", Text, primary_key=True),
    _created_at(),
    Column("owner", Text),
    Column("bundled", Boolean, nullable=False, server_default="false"),
    Column("filename", Text, nullable=False),
    Column("sha256", Text, nullable=False),
    Column("bytes", BigInteger, nullable=False),
    Column("blob_key", Text, nullable=False),
    Column("tracks_key", Text, nullable=False, comment="tracks.parquet, written by the parsing child"),
    Column("facts", JSONB, nullable=False, comment="RecordingFacts as parsed with the present switches"),
    Column("subject_id", Text, ForeignKey("subject.id", ondelete="SET NULL")),
    Column("subject_fields", JSONB, nullable=False, comment="SubjectFields stated by the user"),
    Column("static_recording_id", Text, ForeignKey("recording.id", ondelete="SET NULL")),
    Column("marker_map", JSONB, nullable=False, server_default="{}"),
    Column("plate_switches", JSONB, nullable=False, server_default="{}"),
    Column("truth_job_id", Text, ForeignKey("job.id", ondelete="SET NULL", use_alter=True)),
    Column("session_id", Text, comment="trials with one clock and one body mass"),
    Column("session_stated", Boolean, nullable=False, server_default="false"),
    Index("recording_sha256", "sha256"),
    Index("recording_newest", "created_at", "id"),
    Index("recording_session", "session_id"),
    Index("recording_subject", "subject_id", "created_at", "id"),
)

scenario = Table(
    "scenario",
    metadata,
    Column("id", Text, primary_key=True),
    _created_at(),
    Column("owner", Text),
    Column("body", JSONB, nullable=False),
    Column("bundled", Boolean, nullable=False, server_default="false"),
    Column("updated_at", DateTime(timezone=True), nullable=False, server_default=func.now()),
    Index("scenario_newest", "created_at", "id"),
)

marker_set = Table(
    "marker_set",
    metadata,
    Column("id", Text, primary_key=True),
    _created_at(),
    Column("owner", Text),
    Column("name", Text, nullable=False),
    Column("body", JSONB, nullable=False, comment="MarkerSetInput"),
    Index("marker_set_name", "name", unique=True),
    Index("marker_set_newest", "created_at", "id"),
)

robot = Table(
    "robot",
    metadata,
    Column("id", Text, primary_key=True),
    _created_at(),
    Column("owner", Text),
    Column("name", Text, nullable=False),
    Column("filename", Text, nullable=False),
    Column("sha256", Text, nullable=False, comment="of the uploaded file"),
    Column("bytes", BigInteger, nullable=False, comment="of the stored files"),
    Column("bundle_key", Text, nullable=False, comment="zip of the rebuilt description and its meshes"),
    Column("links_key", Text, nullable=False, comment="display meshes, GLB"),
    Column("learned_key", Text, comment="zip of the learned densities"),
    Column("state", Text, nullable=False),
    Column("card", JSONB, nullable=False, comment="the card without the paths of files"),
    Column("assumed", JSONB, nullable=False, comment="by field of the card"),
    Column("version", Integer, nullable=False, server_default="1", comment="of the card"),
    Column("earlier", JSONB, nullable=False, server_default="[]", comment="EarlierCard, the newest last"),
    Column("facts", JSONB, nullable=False, comment="RobotFacts"),
    Column("shapes", JSONB, nullable=False, comment="effectors with their learned reach"),
    Column("commission", JSONB, comment="CommissionRobotSummary"),
    Index("robot_name", "name", unique=True),
)

job = Table(
    "job",
    metadata,
    Column("id", Text, primary_key=True),
    _created_at(),
    Column("owner", Text),
    Column("kind", Text, nullable=False),
    Column("state", Text, nullable=False, server_default="queued"),
    Column("priority", Integer, nullable=False, server_default="0"),
    Column("attempt", Integer, nullable=False, server_default="0", comment="fencing token"),
    Column("returned", Integer, nullable=False, server_default="0", comment="attempts handed back in good order"),
    Column("input", JSONB, nullable=False),
    Column("input_hash", Text, nullable=False),
    Column("idempotency_key", Text),
    Column("recording_id", Text, ForeignKey("recording.id", ondelete="CASCADE"), comment="what the job works on"),
    Column("scenario_id", Text, ForeignKey("scenario.id", ondelete="SET NULL"), comment="what the job plans for"),
    Column("fraction", Float, nullable=False, server_default="0"),
    Column("message", Text, nullable=False, server_default=""),
    Column("cancel_requested", Boolean, nullable=False, server_default="false"),
    Column("started_at", DateTime(timezone=True)),
    Column("finished_at", DateTime(timezone=True)),
    Column("lane", Text, nullable=False, server_default="short"),
    Column("worker_id", BigInteger, comment="runs the job, or ran it last; its row goes when it dies"),
    Column("result", JSONB, comment="summary, versions, references, artifacts"),
    Column("blob_prefix", Text, comment="results/<job>/<attempt> once published"),
    Column("error", JSONB, comment="Problem"),
    Column("log_tail", Text),
    Column("traceparent", Text, comment="trace of the submission"),
    Index("job_state", "state", "priority", "created_at"),
    Index("job_newest", "created_at", "id"),
    Index("job_recording", "recording_id"),
    Index("job_scenario", "scenario_id"),
    Index(
        "job_waiting",
        text("coalesce(owner, '')"),
        text("priority DESC"),
        "created_at",
        "id",
        postgresql_where=text("state = 'queued'"),
    ),
    Index("job_running", "worker_id", postgresql_where=text("state = 'running'")),
    Index("job_served", text("coalesce(owner, '')"), "started_at"),
    Index(
        "job_idempotency",
        "owner",
        "idempotency_key",
        unique=True,
        postgresql_nulls_not_distinct=True,
        postgresql_where=text("idempotency_key IS NOT NULL"),
    ),
)

worker = Table(
    "worker",
    metadata,
    Column("id", BigInteger, Identity(), primary_key=True),
    Column("last_heartbeat", DateTime(timezone=True), nullable=False, server_default=func.now()),
)

job_event = Table(
    "job_event",
    metadata,
    Column("seq", BigInteger, Identity(), primary_key=True),
    Column("job_id", Text, ForeignKey("job.id", ondelete="CASCADE"), nullable=False),
    Column("at", DateTime(timezone=True), nullable=False, server_default=func.now()),
    Column("state", Text, nullable=False),
    Column("attempt", Integer, nullable=False),
    Column("fraction", Float, nullable=False),
    Column("message", Text, nullable=False),
    Index("job_event_of", "job_id", "seq"),
    Index("job_event_age", "at"),
)

job_partial = Table(
    "job_partial",
    metadata,
    Column("job_id", Text, ForeignKey("job.id", ondelete="CASCADE"), primary_key=True),
    Column("attempt", Integer, primary_key=True, comment="fencing token"),
    Column("number", Integer, primary_key=True, comment="from 1 within the attempt"),
    Column("body", Text, nullable=False, comment="PartialChunk"),
    prefixes=["UNLOGGED"],  # parts of running jobs: a crash of the database ends their attempts, too
)

token = Table(
    "token",
    metadata,
    Column("id", Text, primary_key=True),
    _created_at(),
    Column("name", Text, nullable=False),
    Column("scope", Text, nullable=False),
    Column("token_hash", Text, nullable=False, comment="SHA-256"),
    Column("expires_at", DateTime(timezone=True)),
    Column("revoked_at", DateTime(timezone=True)),
    Index("token_hash", "token_hash", unique=True),
    Index("token_name", "name", unique=True, postgresql_where=text("revoked_at IS NULL")),
)

audit = Table(
    "audit",
    metadata,
    Column("id", Text, primary_key=True),
    _created_at(),
    Column("action", Text, nullable=False),
    Column("caller", Text),
    Column("what", Text),
    Index("audit_newest", "created_at", "id"),
)
