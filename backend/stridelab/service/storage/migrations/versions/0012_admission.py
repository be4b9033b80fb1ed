"""A function that counts the queue for one submission at a time."""

from alembic import op

revision = "0012"
down_revision = "0011"
branch_labels = None
depends_on = None


def upgrade() -> None:
    # volatile, so that the count sees what was committed while the function waited for the lock
    op.execute(
        """
        CREATE FUNCTION count_waiting_jobs(admission_lock bigint, submitter text)
        RETURNS TABLE (n_waiting bigint, n_of_submitter bigint) LANGUAGE plpgsql VOLATILE AS $$
        BEGIN
            PERFORM pg_advisory_xact_lock(admission_lock);
            RETURN QUERY
                SELECT count(*), count(*) FILTER (WHERE owner = submitter) FROM job WHERE state = 'queued';
        END
        $$
        """
    )
