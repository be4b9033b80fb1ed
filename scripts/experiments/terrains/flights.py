"""Random flights with the proportions of building codes for TALOS: both feet or one per tread, with or without rail."""

from dataclasses import replace
from typing import Final

import numpy as np

from experiments.terrains.bounds import BOUNDS
from experiments.terrains.draw import Draw
from experiments.terrains.survey import Drawn
from stridelab.contacts.scenarios.parts import TALOS, Scenario, Timing, move_effector, phase, scenario
from stridelab.contacts.scenarios.parts import both_feet as feet_at
from stridelab.contacts.scenarios.stairs import HandRail, Stairs, climb

HEIGHT_M: Final = (0.15, 0.19)
DEPTH_M: Final = (0.25, 0.32)
TOE_GAP_M: Final = 0.06
"""Largest gap between toe and riser; on a short tread the sole's rectangle ends 2 mm before the edge."""
KINDS: Final = ("both", "alternate", "both, rail", "alternate, rail")
BOTH: Final = Timing(1.5, 1.05, 0.2)
ALTERNATE: Final = Timing(1.5, 0.98, 0.2)
"""2.5 s per tread with both feet, 1.18 s with one foot on each; a hand takes a further ``HAND_S``."""
HAND_S: Final = 0.8
_EDGE_M: Final = 0.002


def random_flights(number: int, seed: int) -> list[Drawn]:
    """``number`` flights of two to five treads; every flight depends on the seed and its index only."""
    flights = []
    for index in range(number):
        draw, kind = Draw(np.random.default_rng([seed, 31, index])), KINDS[index % len(KINDS)]
        height_m, depth_m = draw.number(HEIGHT_M), draw.number(DEPTH_M)
        gap_m = min(TOE_GAP_M, depth_m - TALOS.toe_m - BOUNDS["talos"].half_size_m[0] - _EDGE_M)
        stairs = Stairs(draw.integer(3, 5), height_m, depth_m, toe_gap_m=round(gap_m, 4))
        footing, _, with_rail = kind.partition(", ")
        if with_rail:
            bounds = BOUNDS["talos"]
            ahead_m, up_m, aside_m = (
                draw.number(one) for one in (bounds.rail_ahead_m, bounds.rail_height_m, bounds.rail_aside_m)
            )
            candidate = _beside_rail(stairs, HandRail(ahead_m, up_m, -aside_m), footing)
        else:
            candidate = climb(stairs, BOTH if footing == "both" else ALTERNATE, footing)  # type: ignore[arg-type]
        flights.append(Drawn(index, "talos", kind, candidate))
    return flights


def _beside_rail(stairs: Stairs, rail: HandRail, footing: str) -> Scenario:
    """Up the stairs with the right hand on a rail: the hand moves before the feet, once for every tread."""
    timing = BOTH if footing == "both" else ALTERNATE
    hand_timing = replace(timing, move_s=HAND_S, rest_s=0.1)
    slope = stairs.height_m / stairs.depth_m
    standing = feet_at(TALOS, 0.0, 0.0) | {"right_hand": rail.hand_contact(0.0, slope)}
    phases = [phase(timing.ends_s, standing)]
    for i in range(1, stairs.number + 2):
        tread = min(i, stairs.number)
        hold, x_m = stairs.foothold(tread), tread * stairs.depth_m
        if i <= stairs.number:
            phases += move_effector(standing, rail.hand_contact(x_m, slope), hand_timing)
        if footing == "both":
            for name in ("right_foot", "left_foot") if i <= stairs.number else ():
                phases += move_effector(standing, feet_at(TALOS, *hold)[name], timing)
        else:
            phases += move_effector(standing, feet_at(TALOS, *hold)[("left_foot", "right_foot")[i % 2]], timing)
    phases[-1]["duration_s"] = timing.ends_s
    height, depth = 100 * stairs.height_m, 100 * stairs.depth_m
    text = f"{stairs.number} stairs {height:.1f} cm high and {depth:.1f} cm deep, {footing}, the right hand on a rail."
    terrain = [
        {"name": "ground", "kind": "box", "center_m": [2.0, 0.0, -0.1], "size_m": [8.0, 4.0, 0.2]},
        *stairs.ascending_boxes(TALOS),
        rail.rail_surface(0.0, stairs.number * stairs.depth_m, slope),
    ]
    return scenario("Flight with a rail", text, "talos", terrain, phases)
