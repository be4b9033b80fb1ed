"""One explained term of a page."""

from typing import NamedTuple


class Term(NamedTuple):
    """What a term means, in one sentence, and the page of the book that defines it (with its anchor)."""

    meaning: str
    chapter: str
