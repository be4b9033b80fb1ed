"""Base classes shared by all schemas of the HTTP interface."""

from typing import Annotated, Any, ClassVar, Generic, TypeVar

from pydantic import BaseModel, ConfigDict, Field

T = TypeVar("T")
Model = TypeVar("Model", bound="Contract")


class Contract(BaseModel):
    """Base of every request and response: unknown fields are rejected, numbers are finite."""

    model_config = ConfigDict(extra="forbid", allow_inf_nan=False, frozen=True)

    ignored_fields: ClassVar[frozenset[str]] = frozenset()
    """Fields of a document that ``readable_fields`` removes: those that the service adds to what it has stored."""

    @classmethod
    def readable_fields(cls, document: Any) -> Any:
        """``document`` without the fields that this model ignores; anything but a mapping as it is."""
        if not isinstance(document, dict):
            return document
        return {name: value for name, value in document.items() if name not in cls.ignored_fields}

    @classmethod
    def from_object(cls: type[Model], source: object, /, **others: Any) -> Model:  # noqa: PYI019 (beartype cannot check Self)
        """Instance with the values ``others``, and for all other fields the attributes of ``source`` of their names."""
        fields = {name: getattr(source, name) for name in cls.model_fields if name not in others}
        return cls.model_validate({**fields, **others})


Interval = Annotated[tuple[float, float], Field(description="start and end in seconds of the recording's time axis")]


class Page(Contract, Generic[T]):
    """One page of a list; ``next`` is the cursor of the next page, or null on the last one."""

    items: list[T]
    next: str | None = None


class Remark(Contract):
    """A warning: a stable code and an explanation."""

    code: str
    message: str


class FaultItem(Contract):
    """A fault in the input: its place and an explanation."""

    where: str
    message: str


class Problem(Contract):
    """``application/problem+json`` (RFC 9457)."""

    type: str = "about:blank"
    title: str
    status: int
    code: str
    detail: str
    instance: str | None = None
    errors: list[FaultItem] = []
    request_id: str | None = None
