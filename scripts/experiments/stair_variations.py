"""Random stairs with varying heights, depths, paces and rails, each planned, tracked, certified and replayed.

    height 5 to 15 cm, depth 30 to 36 cm, toe gap 50 to 60 mm, all durations times 0.8 to 1.2, and beside every other
    flight a rail within the box ``RAIL_M``

A rejected variation is retried at other paces and contact positions (``alternatives_to``) on the same stairs. A
rejection is confirmed if none of these succeeds.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from itertools import product
from typing import Any, Final

import numpy as np

from experiments.execution import run_scenario
from stridelab.contacts.scenarios.parts import TALOS, Timing
from stridelab.contacts.scenarios.stairs import CLIMBING, HOLDING_ON, HandRail, Stairs, climb, stairs_with_rail
from stridelab.robots.loader import load_robot
from stridelab.wholebody.certificate.certificate import Check

HEIGHT_M: Final = (0.05, 0.15)
DEPTH_M: Final = (0.30, 0.36)
TOE_GAP_M: Final = (0.05, 0.06)
PACE: Final = (0.8, 1.2)
RAIL_M: Final = ((0.10, 0.35), (0.70, 1.00), (-0.58, -0.42))
"""Ranges of the rail: ahead of the feet, above the line through the footholds, to the left; from a prototype."""
NUMBER: Final = 60
STAIRS: Final = 3
"""Number of stairs in every flight."""
PACES: Final = (1.0, 1.2, 1.4, 0.8)
SHIFTS_M: Final = (0.012, -0.012)
"""Displacements of the soles along the treads, towards the edge (positive) or the riser."""
HALF_WIDTHS_M: Final = (0.10, 0.08)
HAND_SHIFTS_M: Final = (-0.08, 0.08)
"""Displacements of the hand along its rail."""


@dataclass(frozen=True)
class Variation:
    """Stairs, a pace (a factor on all durations) and an optional rail.

    ``shift_m`` and ``half_width_m`` place the soles on the treads, ``reach_m`` the hand on the rail.
    """

    height_m: float
    depth_m: float
    toe_gap_m: float
    pace: float
    rail: HandRail | None = None
    shift_m: float = 0.0
    half_width_m: float = TALOS.foot_y_m
    reach_m: float = 0.0

    @property
    def as_scenario(self) -> dict[str, Any]:
        """``schemas.scenarios.Scenario`` as a mapping, for TALOS."""
        stairs = Stairs(STAIRS, self.height_m, self.depth_m, toe_gap_m=self.toe_gap_m + self.shift_m)
        walker = replace(TALOS, foot_y_m=self.half_width_m)
        if self.rail is None:
            return climb(stairs, _scale_timing(CLIMBING, self.pace), "both", walker)
        up_m = self.reach_m * self.height_m / self.depth_m
        rail = replace(self.rail, ahead_m=self.rail.ahead_m + self.reach_m, height_m=self.rail.height_m + up_m)
        return stairs_with_rail(stairs, rail, _scale_timing(HOLDING_ON, self.pace), walker)


@dataclass(frozen=True)
class Attempt:
    """Result of one variation.

    ``stage`` and ``reason`` describe a failure; ``stage`` is None for a success. ``com_error_m`` is the largest CoM
    error of the replay.
    """

    stage: str | None
    reason: str = ""
    checks: tuple[Check, ...] = ()
    replayed: bool | None = None
    com_error_m: float | None = None

    @property
    def fell_despite_certificate(self) -> bool:
        """Whether every check passes but the replay does not complete."""
        return self.replayed is False and bool(self.checks) and all(check.passed for check in self.checks)


@dataclass(frozen=True)
class SearchResult:
    """Result of one random variation and, after a failure, of the search for alternatives."""

    index: int
    attempt: Attempt
    tried: int = 0
    instead: Variation | None = None

    @property
    def failure_confirmed(self) -> bool:
        """Whether the variation and all its alternatives on the same stairs fail."""
        return self.attempt.stage is not None and self.tried > 0 and self.instead is None


def random_variations(number: int = NUMBER, seed: int = 0) -> tuple[Variation, ...]:
    """``number`` random variations, alternately without and with a rail."""
    rng = np.random.default_rng(seed)
    variations: list[Variation] = []
    for k in range(number):
        height_m, depth_m, gap_m, pace = (float(rng.uniform(*box)) for box in (HEIGHT_M, DEPTH_M, TOE_GAP_M, PACE))
        place = [round(float(rng.uniform(*box)), 3) for box in RAIL_M]
        rail = HandRail(*place) if k % 2 else None
        variations.append(Variation(round(height_m, 3), round(depth_m, 3), round(gap_m, 4), round(pace, 2), rail))
    return tuple(variations)


def alternatives_to(variation: Variation) -> Iterator[Variation]:
    """Alternatives on the same stairs and rail: other paces, and one change of the sole or hand position at a time."""
    places = [variation]
    places += [replace(variation, shift_m=shift_m) for shift_m in SHIFTS_M]
    places += [replace(variation, half_width_m=half_m) for half_m in HALF_WIDTHS_M]
    places += [replace(variation, reach_m=reach_m) for reach_m in HAND_SHIFTS_M] if variation.rail is not None else []
    for place, pace in product(places, PACES):
        other = replace(place, pace=pace)
        if other != variation:
            yield other


def run_variation(variation: Variation) -> Attempt:
    """Plan, track, certify and replay a variation as the service does; errors become part of the result."""
    run = run_scenario(load_robot(TALOS.robot), variation.as_scenario)
    if run.replay is None:
        return Attempt(run.stage, run.error, run.checks)
    stage: str | None = run.stage if run.failed_checks else None
    reason = run.failed_checks
    if stage is None and not run.replay.completed:
        stage, reason = "replay", " ".join(remark.message for remark in run.replay.remarks)
    return Attempt(stage, reason, run.checks, run.replay.completed, run.replay.com_error_max_m)


def search_alternatives(
    index: int, variation: Variation, failed_attempt: Attempt, run: Callable[[Variation], Attempt] = run_variation
) -> SearchResult:
    """Try the alternatives ``alternatives_to`` until one succeeds."""
    tried = 0
    for tried, other in enumerate(alternatives_to(variation), start=1):
        if run(other).stage is None:
            return SearchResult(index, failed_attempt, tried, other)
    return SearchResult(index, failed_attempt, tried)


def _scale_timing(timing: Timing, pace: float) -> Timing:
    return Timing(*(round(seconds * pace, 3) for seconds in (timing.ends_s, timing.move_s, timing.rest_s)))
