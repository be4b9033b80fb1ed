"""Keys of the PostgreSQL advisory locks of this program, collected here because they share one key space.

All processes of a database must use the same keys, whatever their version: never change a key, only add new ones.
``content_addressed.lock_blob`` derives further keys from a 64-bit hash of the blob key.
"""

from typing import Final

MIGRATION: Final = 0x5712DE1AB
"""One process upgrades the tables."""
ADMISSION: Final = 0x5712DE1AC
"""One submission at a time counts the queue and adds to it."""
REAPER: Final = 0x5712DE1AD
"""One worker puts lost jobs back into the queue."""
JANITOR: Final = 0x5712DE1AE
"""One worker removes what is past its retention."""
REMOVAL: Final = 0x5712DE1AF
"""Shared by processes that remove files, exclusive for a backup."""
SCENARIO_SEEDING: Final = 0x5712DE1B0
"""One process writes the bundled scenarios to the database."""
SAMPLE_SEEDING: Final = 0x5712DE1B1
"""One process writes the sample recording to the database."""
