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
    """One message; ``samples`` is the number of samples that an answer covers.

    ``picture`` is what an answer shows to those who watch the stream; empty without.
    """

    kind: Literal["text", "packed"]
    content: bytes
    samples: int = 0
    picture: str = ""

    def to_json(self) -> dict[str, Any]:
        """The message as JSON."""
        content = base64.b64encode(self.content).decode()
        return {"kind": self.kind, "content": content, "samples": self.samples, "picture": self.picture}

    @staticmethod
    def from_json(message: dict[str, Any]) -> "Parcel":
        """The message of ``to_json``."""
        return Parcel(message["kind"], base64.b64decode(message["content"]), message["samples"], message["picture"])
