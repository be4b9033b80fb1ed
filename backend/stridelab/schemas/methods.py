"""The names of the estimators of the centre of mass; whoever adds one adds it here."""

from typing import Final, Literal, get_args

Method = Literal["smoother", "complementary", "rts", "kalman", "geometry"]
METHODS: Final[tuple[Method, ...]] = get_args(Method)
"""All of them, in the order in which they are listed and shown."""
