"""Names of the estimators of the centre of mass; a new estimator must be added here."""

from typing import Final, Literal, get_args

Method = Literal["smoother", "complementary", "rts", "kalman", "geometry"]
METHODS: Final[tuple[Method, ...]] = get_args(Method)
"""All names, in the order in which they are listed."""
