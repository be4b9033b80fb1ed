"""Search of lists by words."""

from typing import Any

from sqlalchemy import ColumnElement, and_, or_


def contains_words(words: str, *columns: ColumnElement[Any]) -> ColumnElement[bool]:
    """Whether every word occurs in one of the columns, in upper or lower case."""
    found = (or_(*(column.icontains(word, autoescape=True) for column in columns)) for word in words.split())
    return and_(True, *found)
