"""What a scene can show, and the address under which its parts lie."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Final, Literal, get_args

DocumentKind = Literal["recording", "plan", "scenario", "robot"]
PlayerForm = Literal["viser", "html"]
"""A file for viser's own player, or one page with that player and the file in it."""
KEY_HEADER: Final = "X-Stridelab-Scenario-Key"
"""With which key to store what is changed through a websocket to the viewer."""
REFUSAL_HEADER: Final = "X-Stridelab-Scenario-Refusal"
"""In its place: why nothing may be changed through it."""
USER_HEADER: Final = "X-Stridelab-User"
"""Who watches through a websocket to the viewer, percent-encoded; empty where nobody logs in."""
NO_JOB: Final = "-"
"""Stands for "no result" in an address."""


@dataclass(frozen=True)
class Document:
    """A recording (with the result ``job_id``, if one is chosen), the plan of the job ``id``, a scenario, a robot."""

    kind: DocumentKind
    id: str
    job_id: str | None = None

    @property
    def address(self) -> str:
        """Where the scene lies in the web app."""
        return f"/view/scene/{self.kind}/{self.id}/{self.job_id or NO_JOB}"

    @property
    def wanted(self) -> dict[str, str | None]:
        """The document as the viewer process is asked for it."""
        return {"kind": self.kind, "id": self.id, "job_id": self.job_id}


def document_of(fields: Mapping[str, Any]) -> Document:
    """The document with these ``kind``, ``id`` and ``job_id`` (or ``job``, as in an address).

    Raises ``KeyError`` where a field is missing or there is no such kind.
    """
    if fields["kind"] not in get_args(DocumentKind):
        raise KeyError(fields["kind"])
    job_id = fields["job"] if "job" in fields else fields["job_id"]
    return Document(fields["kind"], str(fields["id"]), None if job_id in (None, NO_JOB) else str(job_id))
