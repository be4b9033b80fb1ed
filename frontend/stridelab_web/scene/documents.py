"""Documents that scenes show, and their addresses."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Final, Literal, get_args

from stridelab.schemas.service import Language

DocumentKind = Literal["recording", "plan", "scenario", "robot"]
LABELLED: Final[frozenset[DocumentKind]] = frozenset({"recording"})
"""Kinds with words in their scenes."""
PlayerForm = Literal["viser", "html"]
"""A file for viser's own player, or one page with that player and the file in it."""
KEY_HEADER: Final = "X-Stridelab-Scenario-Key"
"""Header with the key that stores changes made through a websocket to the viewer."""
USER_HEADER: Final = "X-Stridelab-User"
"""Header with the percent-encoded user of a websocket to the viewer; empty without login."""
NO_JOB: Final = "-"
"""Stands for "no result" in an address."""


@dataclass(frozen=True)
class Document:
    """A recording (with the result ``job_id``, if one is chosen), the plan of the job ``id``, a scenario, a robot.

    ``language`` is that of the labels in the scene: each language has a scene of its own.
    """

    kind: DocumentKind
    id: str
    job_id: str | None = None
    language: Language = "en"

    @property
    def address(self) -> str:
        """Address of the scene in the web app."""
        return f"/view/scene/{self.kind}/{self.id}/{self.job_id or NO_JOB}"

    @property
    def request_body(self) -> dict[str, str | None]:
        """Body of requests for the document to the viewer process."""
        return {"kind": self.kind, "id": self.id, "job_id": self.job_id, "language": self.language}


def document_of(fields: Mapping[str, Any]) -> Document:
    """The document with these ``kind``, ``id`` and ``job_id`` (or ``job``, as in an address), in ``language``.

    Raises ``KeyError`` where a field is missing or there is no such kind.
    """
    if fields["kind"] not in get_args(DocumentKind):
        raise KeyError(fields["kind"])
    job_id = fields["job"] if "job" in fields else fields["job_id"]
    language = fields.get("language", "en")
    return Document(
        fields["kind"],
        str(fields["id"]),
        None if job_id in (None, NO_JOB) else str(job_id),
        language if language in get_args(Language) else "en",
    )
