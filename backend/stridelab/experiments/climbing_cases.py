"""The rails and stairs on which densities of the CoM are compared: fixed before any density was tried on them.

All are variations of experiments 2 and 3 of the thesis (4.6.3, 4.6.4) for TALOS. The rails are those of a prototype on
which uniform densities succeeded, the highest of them barely; the stairs vary height, depth, timing and footing.
"""

from dataclasses import dataclass
from typing import Any, Final, Literal

from stridelab.contacts.scenario_parts import Timing
from stridelab.contacts.stairs import Footing, HandRail, Stairs, climb, stairs_with_rail

Kind = Literal["rail", "stairs"]


@dataclass(frozen=True, eq=False)
class Case:
    """One scenario (``schemas.scenarios.Scenario`` as a mapping) of the grid, under a name that says what it varies."""

    name: str
    kind: Kind
    scenario: dict[str, Any]


@dataclass(frozen=True)
class Flight:
    """What varies from stairs to stairs."""

    height_m: float
    depth_m: float
    timing: Timing
    footing: Footing = "both"


SLOW: Final = Timing(2.5, 1.4, 0.2)
FAST: Final = Timing(2.0, 0.8, 0.2)
HASTY: Final = Timing(2.0, 0.8, 0.1)
PACES: Final = {SLOW: "slow", FAST: "fast", HASTY: "hasty"}

RAILS: Final = (
    HandRail(0.22, 0.80, -0.50),
    HandRail(0.22, 0.85, -0.54),
    HandRail(0.22, 0.70, -0.50),
    HandRail(0.22, 0.80, -0.42),
    HandRail(0.22, 0.80, -0.58),
    HandRail(0.10, 0.80, -0.50),
    HandRail(0.35, 0.80, -0.50),
    HandRail(0.22, 0.90, -0.50),
    HandRail(0.30, 0.90, -0.55),
    HandRail(0.22, 1.00, -0.55),
    HandRail(0.22, 1.10, -0.55),
)
"""Beside four stairs 15 cm high, after a level step."""

FLIGHTS: Final = (
    Flight(0.05, 0.28, SLOW),
    Flight(0.05, 0.30, FAST),
    Flight(0.05, 0.35, SLOW),
    Flight(0.10, 0.28, SLOW),
    Flight(0.10, 0.30, SLOW),
    Flight(0.10, 0.30, HASTY),
    Flight(0.10, 0.35, FAST),
    Flight(0.15, 0.28, SLOW),
    Flight(0.15, 0.30, SLOW),
    Flight(0.15, 0.30, FAST),
    Flight(0.15, 0.35, SLOW),
    Flight(0.15, 0.35, HASTY),
    Flight(0.05, 0.30, FAST, "alternate"),
    Flight(0.10, 0.28, SLOW, "alternate"),
    Flight(0.10, 0.30, SLOW, "alternate"),
    Flight(0.20, 0.30, SLOW),
)
"""Of four stairs each, without a rail."""
_NUMBER: Final = 4
TOE_GAP_M: Final = 0.04
"""Narrower than that of the bundled scenarios: shins come close to the next stair."""


def climbing_cases() -> tuple[Case, ...]:
    """All rails, then all stairs."""
    return (*(beside(rail) for rail in RAILS), *(up(flight) for flight in FLIGHTS))


def beside(rail: HandRail) -> Case:
    """Experiment 3 with another rail."""
    name = f"rail {rail.ahead_m:.2f} {rail.height_m:.2f} {rail.y_m:.2f}"
    return Case(name, "rail", stairs_with_rail(Stairs(_NUMBER, 0.15, toe_gap_m=TOE_GAP_M), rail))


def up(flight: Flight, number: int = _NUMBER) -> Case:
    """Experiment 2 with other stairs."""
    name = f"stairs {flight.height_m:.2f} {flight.depth_m:.2f} {PACES[flight.timing]} {flight.footing}"
    stairs = Stairs(number, flight.height_m, flight.depth_m, toe_gap_m=TOE_GAP_M)
    return Case(name, "stairs", climb(stairs, flight.timing, flight.footing))
