"""Messages between a client and the process of its stream: a kind, a number of samples, and the content.

Uses the standard library only, because the web server imports it.
"""

import base64
from dataclasses import dataclass
from typing import Any, Final, Literal

TEXT: Final = "text"
PACKED: Final = "packed"


@dataclass(frozen=True)
class Parcel:
    """One message; ``samples`` is the number of samples that an answer covers."""

    kind: Literal["text", "packed"]
    content: bytes
    samples: int = 0

    def to_json(self) -> dict[str, Any]:
        """The message as JSON."""
        return {"kind": self.kind, "content": base64.b64encode(self.content).decode(), "samples": self.samples}

    @staticmethod
    def from_json(message: dict[str, Any]) -> "Parcel":
        """The message of ``to_json``."""
        return Parcel(message["kind"], base64.b64decode(message["content"]), message["samples"])
