"""Schemas of users' marker sets, and of a proposed marker map."""

from datetime import datetime
from typing import Annotated

from pydantic import Field

from stridelab.schemas.base import Contract

MarkerLabel = Annotated[str, Field(min_length=1, max_length=80)]
Landmark = Annotated[str, Field(min_length=1, max_length=40)]


class MarkerSetBody(Contract):
    """A marker set: the possible labels of each landmark, and the landmarks that a recording must have."""

    name: Annotated[str, Field(min_length=1, max_length=80, pattern=r"^\S(.*\S)?$")]
    landmarks: dict[Landmark, MarkerLabel | Annotated[list[MarkerLabel], Field(max_length=20)]] = Field(
        max_length=200, description="landmark to label, or to several labels of which a recording has one"
    )
    required: Annotated[list[Annotated[str, Field(max_length=200)]], Field(max_length=200)] | None = Field(
        default=None,
        description="landmarks without which the set does not fit; `l_psis|sacrum` lists alternatives. "
        "By default pelvis, knees and ankles",
    )

    def labels_of(self) -> dict[str, list[str]]:
        """All labels of each landmark."""
        return {name: [labels] if isinstance(labels, str) else labels for name, labels in self.landmarks.items()}


class MarkerSetInput(MarkerSetBody):
    """Body of ``POST /marker-sets``; ``source`` is a note, such as the laboratory or a publication.

    The fields of a stored marker set are ignored.
    """

    ignored_fields = frozenset({"id", "created_at", "owner", "recordings"})

    source: Annotated[str, Field(max_length=500)] | None = None


class StoredMarkerSet(MarkerSetInput):
    """A marker set stored by a user."""

    id: str
    created_at: datetime
    owner: str | None = None


class AddedMarkerSet(StoredMarkerSet):
    """Response of ``POST /marker-sets``."""

    recordings: list[str] = Field(
        default_factory=list,
        description="ids of recordings whose labels fit; their files are parsed again, usually before the response",
    )


class SourceMarkerSet(MarkerSetBody):
    """A user's marker set in the task of a child process; ``id`` is that of the stored set."""

    id: str | None = None


class MarkerSetProposalInput(Contract):
    """Body of ``POST /marker-sets/propose``."""

    recording_id: str


class ProposedLabel(Contract):
    """A label proposed for a landmark."""

    label: str
    confidence: Annotated[float, Field(ge=0.0, le=1.0)] = Field(
        description="share of the evidence for this landmark among the alternatives; 1 is certain"
    )


class MarkerSetProposal(Contract):
    """Response of ``POST /marker-sets/propose``."""

    recording_id: str
    landmarks: dict[str, ProposedLabel]
    unassigned: list[str] = Field(description="labels for which no landmark is proposed")
