"""Recording date of a C3D file, from TRIAL:DATE or a DATE of the manufacturer.

BTS writes TRIAL:DATE as year, month and day. Texts are read in ISO 8601 order only: 05/06/2019 is ambiguous.
"""

import re
from collections.abc import Callable, Sequence
from datetime import date
from typing import Final

DATE_PARAMETERS: Final = (
    ("TRIAL", "DATE"),
    ("TRIAL", "RECORDING_DATE"),
    ("TRIAL", "CREATION_DATE"),
    ("MANUFACTURER", "DATE"),
    ("MANUFACTURER", "RECORDING_DATE"),
)
"""Groups and parameters in order of preference."""
FIRST_YEAR: Final = 1970
_ISO = re.compile(r"^(\d{4})[-/.]?(\d{2})[-/.]?(\d{2})(?!\d)")


def recorded_on(texts: Callable[[str, str], Sequence[str]], numbers: Callable[[str, str], Sequence[float]]) -> str:
    """Recording date as ``YYYY-MM-DD``; empty if absent or a placeholder (year 0, month 13).

    ``texts`` and ``numbers`` return the values of a parameter by its group and name, empty if it has none of the kind.
    """
    for group, name in DATE_PARAMETERS:
        for year, month, day in (*_date_in_text(texts(group, name)), *_date_in_numbers(numbers(group, name))):
            try:
                day_recorded = date(year, month, day)
            except (ValueError, OverflowError):
                continue
            if day_recorded.year >= FIRST_YEAR:
                return day_recorded.isoformat()
    return ""


def _date_in_text(texts: Sequence[str]) -> list[tuple[int, int, int]]:
    match = _ISO.match("".join(texts[:1]).strip())
    return [] if match is None else [(int(match[1]), int(match[2]), int(match[3]))]


def _date_in_numbers(numbers: Sequence[float]) -> list[tuple[int, int, int]]:
    if len(numbers) < 3 or not all(float(value).is_integer() for value in numbers[:3]):
        return []
    return [(int(numbers[0]), int(numbers[1]), int(numbers[2]))]
