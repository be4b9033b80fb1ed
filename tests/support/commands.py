"""What a command that was run to its end left behind."""

from collections.abc import Callable
from dataclasses import dataclass


@dataclass(frozen=True)
class Ran:
    code: int
    out: str
    err: str


Run = Callable[..., Ran]
"""``run(*arguments)``: the command line with these arguments."""
