"""Exceptions of the project: every failure that a user can cause or must know about is a ``StridelabError``.

An error carries a stable ``code`` (kebab case; part of the HTTP contract), a message for the user and, where it
applies, the places in the input that caused it. The web layer maps the *class* to an HTTP status and the command
line maps it to an exit code; the layers below depend on neither.
"""

import errno
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True)
class Fault:
    """One invalid place in the input: ``where`` names a file, marker, plate, phase or field."""

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
    """The input was read, but contains an invalid value."""


class NotEstimable(StridelabError):
    """The data are valid, but do not allow the requested result (no plates, no window, unknown marker set)."""


class NotFound(StridelabError):
    """No object with this id."""


class Conflict(StridelabError):
    """The request contradicts the state of the object."""


class TooLarge(StridelabError):
    """The request exceeds a configured limit."""


class Busy(StridelabError):
    """The queue is full; ``retry_after_s`` is the time to wait before the next attempt."""

    def __init__(self, code: str, message: str, retry_after_s: float) -> None:
        super().__init__(code, message)
        self.retry_after_s = retry_after_s


class Forbidden(StridelabError):
    """Not allowed with these credentials."""


class Unavailable(StridelabError):
    """A part of the service does not answer (database, storage, a missing program)."""


class StorageFull(Unavailable):
    """Not enough storage is left for an upload or the files of a computation."""


class Unauthenticated(Forbidden):
    """No valid credentials came with the request."""


def problem_of(error: StridelabError) -> dict[str, Any]:
    """The error as JSON, without its class: ``{"code", "detail", "errors": [{"where", "message"}]}``."""
    faults = [{"where": fault.where, "message": fault.message} for fault in error.faults]
    return {"code": error.code, "detail": error.message, "errors": faults}


def is_disk_full(error: BaseException) -> bool:
    """Whether ``error`` was raised because a disk or a quota is full."""
    return isinstance(error, OSError) and error.errno in (errno.ENOSPC, errno.EDQUOT)


def scratch_full_error() -> StorageFull:
    """Error of a computation that could not write its files."""
    return StorageFull(
        "scratch-full", "The disk is full: the computation could not write its files. Free some space, then try again."
    )


def error_of(problem: Mapping[str, Any], class_name: str | None) -> StridelabError:
    """The error of a ``problem_of``; a ``StridelabError`` if ``class_name`` is no class of this module, or ``Busy``."""
    named = globals().get(class_name or "")
    kind = StridelabError
    if isinstance(named, type) and issubclass(named, StridelabError) and named is not Busy:
        kind = named
    faults = [Fault(item["where"], item["message"]) for item in problem["errors"]]
    return kind(problem["code"], problem["detail"], faults)
