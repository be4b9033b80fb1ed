"""One exception tree. Every failure that a user can cause or must know of is a ``StridelabError``.

An error carries a stable ``code`` (kebab case; part of the HTTP contract), a sentence a lab member understands and,
where it applies, the places in the input that caused it. The web layer maps the *class* to a status, the command
line maps it to an exit code; nothing below them knows of either.
"""

from collections.abc import Sequence
from dataclasses import dataclass


@dataclass(frozen=True)
class Fault:
    """One place in the input and what is wrong there; ``where`` names a file, marker, plate, phase or field."""

    where: str
    message: str


class StridelabError(Exception):
    """Base of all errors of this project."""

    def __init__(self, code: str, message: str, faults: Sequence[Fault] = ()) -> None:
        super().__init__(message)
        self.code = code
        self.message = message
        self.faults = tuple(faults)


class UnreadableFile(StridelabError):
    """The file is not what it claims to be, is truncated, or cannot be parsed."""


class InvalidInput(StridelabError):
    """The input was read, but a value in it makes no sense."""


class NotEstimable(StridelabError):
    """The data are valid, but do not allow the requested result (no plates, no window, unknown marker set)."""


class NotFound(StridelabError):
    """No object with this id."""


class Conflict(StridelabError):
    """The request contradicts the state of the object."""


class TooLarge(StridelabError):
    """Over a limit of the settings."""


class Busy(StridelabError):
    """The queue is full; ``retry_after_s`` says when to come back."""

    def __init__(self, code: str, message: str, retry_after_s: float) -> None:
        super().__init__(code, message)
        self.retry_after_s = retry_after_s


class Forbidden(StridelabError):
    """Not allowed with these credentials."""


class Unavailable(StridelabError):
    """A part of the service does not answer (database, storage, a missing program)."""


class StorageFull(Unavailable):
    """No room is left for what was sent."""


class Unauthenticated(Forbidden):
    """No valid credentials came with the request."""
