"""A database with very many recordings and subjects, for tests and benchmarks of lists."""

import json
from typing import Final

import psycopg

from support.service.stored_rows import facts

N_RECORDINGS: Final = 20_000
N_SUBJECTS: Final = 400
N_OF_OLDEST: Final = 130
"""Recordings of the first subject; they are the oldest."""
_SUBJECTS: Final = """
    INSERT INTO subject (id, created_at, fields)
    SELECT 's' || n, timestamptz '2026-01-01 00:00Z' + n * interval '1 minute', jsonb_build_object('name', 'P' || n)
      FROM generate_series(1, %(subjects)s) AS n
"""
_RECORDINGS: Final = """
    INSERT INTO recording
           (id, created_at, filename, sha256, bytes, blob_key, tracks_key, facts, subject_fields, subject_id)
    SELECT 'r' || n, timestamptz '2026-01-01 00:00Z' + n * interval '1 minute', n || '.c3d',
           's', 1, 'u/' || n, 't/' || n, %(facts)s, '{}',
           CASE WHEN n <= %(of_oldest)s THEN 's1' WHEN n %% 3 > 0 THEN 's' || 2 + n %% (%(subjects)s - 1) END
      FROM generate_series(1, %(recordings)s) AS n
"""


def store_many_recordings(url: str) -> None:
    """Fill an empty database: the first subject has the oldest recordings, a third of the others has no subject."""
    labels = [f"Marker {n}" for n in range(60)]
    of_a_walk = facts(labels=labels, landmarks={f"landmark_{n}": label for n, label in enumerate(labels)})
    values = {
        "facts": json.dumps(of_a_walk.model_dump(mode="json")),
        "subjects": N_SUBJECTS,
        "recordings": N_RECORDINGS,
        "of_oldest": N_OF_OLDEST,
    }
    with psycopg.connect(url) as connection:
        connection.execute(_SUBJECTS, values)
        connection.execute(_RECORDINGS, values)
