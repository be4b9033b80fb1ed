"""Keys of the PostgreSQL advisory locks of this program, all in one place because they share one key space.

Every process of one database must use the same keys, whatever its version: change none, add new ones.
``uploads.lock_blob`` takes further keys from a 64-bit hash of a file's place.
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
"""Shared by whoever removes files, exclusive for a backup."""
SCENARIO_SEEDING: Final = 0x5712DE1B0
"""One process brings the bundled scenarios into the database."""
SAMPLE_SEEDING: Final = 0x5712DE1B1
"""One process brings the sample recording into the database."""
