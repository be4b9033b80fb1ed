"""Names of the estimators of the centre of mass and of the formulations of a plan; a new one must be added here."""

from typing import Final, Literal, get_args

Method = Literal["smoother", "complementary", "rts", "kalman", "geometry"]
METHODS: Final[tuple[Method, ...]] = get_args(Method)
"""All names, in the order in which they are listed."""

Formulation = Literal["forces", "circular-cones", "wrench"]
NODE_RATE_HZ: Final = (2.0, 50.0)
"""Minimum and maximum number of nodes per second of a plan."""
