"""What all models of the HTTP contract share."""

from typing import Annotated, Generic, TypeVar

from pydantic import BaseModel, ConfigDict, Field

T = TypeVar("T")


class Contract(BaseModel):
    """Base of every request and answer: unknown fields are refused in requests, numbers are finite."""

    model_config = ConfigDict(extra="forbid", allow_inf_nan=False, frozen=True)


Interval = Annotated[tuple[float, float], Field(description="start and end in seconds of the recording's time axis")]


class Page(Contract, Generic[T]):
    """One page of a list; ``next`` is the cursor of the following page, or null."""

    items: list[T]
    next: str | None = None


class Remark(Contract):
    """A warning: a stable code and a sentence."""

    code: str
    message: str


class FaultItem(Contract):
    """One place in the input and what is wrong there."""

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
