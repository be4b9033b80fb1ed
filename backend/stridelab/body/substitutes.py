"""What missing landmarks cost: remarks for the user and the standard deviation of the CoM they add."""

from collections.abc import Iterable
from typing import Final

from stridelab.recordings.marker_sets import Substitute, substitutes

SEX_UNKNOWN: Final = Substitute(
    code="sex-unknown",
    message="The sex of the subject is not stated: the mean of the female and the male body is used",
    landmarks=(),
    horizontal_mm=2.0,
    vertical_mm=5.0,
)


def used(codes: Iterable[str]) -> tuple[Substitute, ...]:
    """The substitutes with these codes; a larger gap hides the smaller ones inside it."""
    codes = frozenset(codes)
    known = substitutes()
    return tuple(known[code] for code in known if code in codes and not codes & set(known[code].hidden_by))


def widened(sd_m: tuple[float, float, float], gaps: Iterable[Substitute]) -> tuple[float, float, float]:
    """Table error and costs added in quadrature, per world axis."""
    gaps = tuple(gaps)
    horizontal = sum((gap.horizontal_mm / 1e3) ** 2 for gap in gaps)
    vertical = sum((gap.vertical_mm / 1e3) ** 2 for gap in gaps)
    x, y, z = sd_m
    return (x * x + horizontal) ** 0.5, (y * y + horizontal) ** 0.5, (z * z + vertical) ** 0.5
