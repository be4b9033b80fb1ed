"""Messages between the web server and the process of a stream: a kind, a number of samples, and the content.

Uses the standard library only, because both ends import it.
"""

import struct
from dataclasses import dataclass
from typing import Final, Literal

TEXT: Final = b"t"
PACKED: Final = b"b"
PROBLEM: Final = b"p"
"""JSON ``{"raised", "problem": {"code", "detail", "errors"}}``; the process ends after it."""

HEADER: Final = struct.Struct("<cII")


@dataclass(frozen=True)
class Parcel:
    """One message; ``samples`` is the number of samples that an answer covers."""

    kind: Literal[b"t", b"b", b"p"]
    content: bytes
    samples: int = 0

    def to_bytes(self) -> bytes:
        """Serialise the message."""
        return HEADER.pack(self.kind, self.samples, len(self.content)) + self.content
