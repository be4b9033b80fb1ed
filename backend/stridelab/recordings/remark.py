"""Remarks on recordings and results; imports no numerical library."""

from dataclasses import dataclass


@dataclass(frozen=True)
class Remark:
    """Note on a recording or a result for the user; ``code`` is stable, ``message`` is a sentence."""

    code: str
    message: str
