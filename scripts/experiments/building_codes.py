"""Flights of stairs with the sizes that building codes ask for, on TALOS."""

from dataclasses import replace
from typing import Final

from stridelab.contacts.scenarios.parts import (
    TALOS,
    Scenario,
    Timing,
    both_feet,
    ground,
    move_effector,
    phase,
    scenario,
)
from stridelab.contacts.scenarios.stairs import HandRail, Stairs, climb

HOUSE: Final = Stairs(5, 0.17, 0.28)
"""Within the limits for stairs of dwellings of most codes, e.g. DIN 18065: risers of 14 to 20 cm, runs of 23 to 37."""
OUTDOOR: Final = Stairs(6, 0.14, 0.37)
"""Twice the riser plus the run is 65 cm, the upper end of the usual rule (59 to 65 cm)."""
HOUSE_RAIL: Final = HandRail(ahead_m=0.10, height_m=0.94, y_m=-0.58)
"""A handrail whose top is 0.80 m above the line through the nosings."""


def house_stairs() -> Scenario:
    """Up five stairs of 17 x 28 cm, both feet on each, both hands on handrails."""
    slope = HOUSE.height_m / HOUSE.depth_m
    rails = {"right_hand": HOUSE_RAIL, "left_hand": replace(HOUSE_RAIL, y_m=-HOUSE_RAIL.y_m)}
    timing = Timing(1.9, 1.4, 0.3)

    def hand_contacts(x_m: float) -> dict[str, dict[str, object]]:
        return {hand: rail.hand_contact(x_m, slope) | {"effector": hand} for hand, rail in rails.items()}

    footholds = [HOUSE.foothold(stair) for stair in range(HOUSE.number + 1)]
    standing = both_feet(TALOS, *footholds[0]) | hand_contacts(footholds[0][0])
    phases = [phase(timing.ends_s, standing)]
    for x_m, z_m in footholds[1:]:
        feet = both_feet(TALOS, x_m, z_m)
        for target in (*hand_contacts(x_m).values(), feet["right_foot"], feet["left_foot"]):
            phases += move_effector(standing, target, timing)
    phases[-1]["duration_s"] = timing.ends_s
    surfaces = [
        rail.rail_surface(footholds[0][0], footholds[-1][0], slope) | {"name": hand.replace("hand", "handrail")}
        for hand, rail in rails.items()
    ]
    return scenario(
        "Stairs of a house",
        "Up five stairs 17 cm high and 28 cm deep, both feet on each, both hands on handrails 80 cm above the nosings.",
        TALOS.robot,
        [ground(), *HOUSE.ascending_boxes(TALOS), *surfaces],
        phases,
    )


def outdoor_stairs() -> Scenario:
    """Up six stairs of 14 x 37 cm, one foot on each, without a handrail."""
    return climb(OUTDOOR, Timing(1.9, 1.4, 0.4), "alternate", TALOS) | {
        "name": "Outdoor stairs",
        "description": "Up six stairs 14 cm high and 37 cm deep, one foot on each, without a handrail.",
    }
