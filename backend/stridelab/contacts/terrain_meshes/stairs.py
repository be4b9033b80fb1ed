"""Flights of stairs among the surfaces of a terrain: level treads of one rise and one run, and the rails beside them.

The run is measured between the front edges of treads, so that a landing can be the last one.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from jaxtyping import Float

from stridelab.contacts.terrain_meshes.surfaces import UpperFace, upper_faces
from stridelab.conventions import Rotation

RISE_M: Final = (0.05, 0.30)
RUN_M: Final = (0.15, 0.60)
LEAST_TREADS: Final = 3
TOLERANCE_M: Final = (0.01, 0.02)
"""Of rises and runs, without noise: about twice what building codes allow."""
SIDE_SHARE: Final = 0.5
"""Least overlap of neighbouring treads, as a share of the narrower one."""
BESIDE_M: Final = 0.4
LEVEL_COSINE: Final = float(np.cos(np.deg2rad(2.0)))
SAME_HEIGHT_M: Final = 0.01
SAME_EDGE_M: Final = 0.05
ALIGNED_RAD: Final = float(np.deg2rad(5.0))
"""Treads turned by more against the heading are those of a spiral."""
Place2 = Float[np.ndarray, "2"]


@dataclass(frozen=True)
class Tolerances:
    """How far rises and runs of a flight may differ (m)."""

    rise_m: float
    run_m: float


def tolerances_of(noise_m: float, spacing_m: float) -> Tolerances:
    """Tolerances that grow with the noise and the spacing of a scan."""
    return Tolerances(TOLERANCE_M[0] + 2.0 * noise_m, TOLERANCE_M[1] + 2.0 * spacing_m)


@dataclass(frozen=True, eq=False)
class _Tread:
    """A level surface, seen along a heading: front and back edge, sides, height."""

    name: str
    front_m: float
    back_m: float
    sides_m: tuple[float, float]
    height_m: float


def find_stairs(
    boxes: Sequence[dict[str, Any]], rails: Sequence[dict[str, Any]], tolerances: Tolerances
) -> list[dict[str, Any]]:
    """Flights (``FoundStairs``) from the longest on; each surface is a tread of one flight at most."""
    faces = upper_faces(boxes)
    level = [k for k, (R, _, _) in enumerate(faces) if R[2, 2] > LEVEL_COSINE]
    flights: list[tuple[float, list[_Tread]]] = []
    for heading_rad in _edge_headings([faces[k] for k in level]):
        ahead = np.array([np.cos(heading_rad), np.sin(heading_rad)])
        aligned = [k for k in level if _turned_from(faces[k][0], heading_rad) < ALIGNED_RAD]
        treads = [_seen_along(str(boxes[k]["name"]), faces[k], ahead) for k in aligned]
        flights += [(heading_rad, flight) for flight in _flights_along(treads, tolerances)]
    flights.sort(key=lambda one: -len(one[1]))
    used: set[str] = set()
    chosen = []
    for heading_rad, flight in flights:
        names = {tread.name for tread in flight}
        if len(names & used) <= 1:  # a landing between two flights belongs to both
            used |= names
            chosen.append(_describe_flight(heading_rad, flight, rails))
    return chosen


def _turned_from(R: Rotation, heading_rad: float) -> float:
    """Angle between a heading and the nearest edge of a face, in plan."""
    yaw_rad = float(np.arctan2(R[1, 0], R[0, 0]))
    return abs((yaw_rad - heading_rad + 0.25 * np.pi) % (0.5 * np.pi) - 0.25 * np.pi)


def _edge_headings(faces: Sequence[UpperFace]) -> list[float]:
    """Directions of the edges of level surfaces, both ways, a degree apart."""
    turns = {round(float(np.rad2deg(np.arctan2(R[1, 0], R[0, 0]))) % 90.0) % 90 for R, _, _ in faces}
    headings = []
    for turn in sorted(turns):
        exact = [
            np.rad2deg(np.arctan2(R[1, 0], R[0, 0]))
            for R, _, _ in faces
            if abs((np.rad2deg(np.arctan2(R[1, 0], R[0, 0])) - turn + 45.0) % 90.0 - 45.0) < 1.0
        ]
        mean = turn + float(np.mean([(one - turn + 45.0) % 90.0 - 45.0 for one in exact]))
        headings += [float(np.deg2rad((mean + 90.0 * k + 180.0) % 360.0 - 180.0)) for k in range(4)]
    return headings


def _seen_along(name: str, face: UpperFace, ahead: Place2) -> _Tread:
    R, top_m, half_m = face
    left = np.array([-ahead[1], ahead[0]])
    corners = top_m[:2] + np.array([(i, j) for i in (-1, 1) for j in (-1, 1)]) * half_m @ R[:2, :2].T
    along, aside = corners @ ahead, corners @ left
    return _Tread(
        name, float(along.min()), float(along.max()), (float(aside.min()), float(aside.max())), float(top_m[2])
    )


def _flights_along(treads: Sequence[_Tread], tolerances: Tolerances) -> list[list[_Tread]]:
    """The longest flights, of disjoint treads; each tread is followed by the one that fits the flight best."""
    order = sorted(treads, key=lambda one: one.height_m)
    flights: list[list[_Tread]] = []
    for first in order:
        if _continues_floor(first, order):
            continue
        for second in order:
            if not _is_next_tread(first, second):
                continue
            flight = [first, second]
            while (after := _next_tread(flight, order, tolerances)) is not None:
                flight.append(after)
            if len(flight) >= LEAST_TREADS:
                flights.append(flight)
    flights.sort(key=lambda one: -len(one))
    used: set[str] = set()
    longest = []
    for flight in flights:
        if not used & {tread.name for tread in flight}:
            used |= {tread.name for tread in flight}
            longest.append(flight)
    return longest


def _continues_floor(tread: _Tread, treads: Sequence[_Tread]) -> bool:
    """Whether a surface is the last part of a floor, which holes of a scan divide, and no tread."""
    return any(
        abs(one.height_m - tread.height_m) < SAME_HEIGHT_M
        and abs(one.back_m - tread.front_m) < SAME_EDGE_M
        and min(one.sides_m[1], tread.sides_m[1]) > max(one.sides_m[0], tread.sides_m[0])
        for one in treads
        if one is not tread
    )


def _is_next_tread(lower: _Tread, upper: _Tread) -> bool:
    """Whether a tread is the next one up: by rise, run, and place beside it."""
    rise_m, run_m = upper.height_m - lower.height_m, upper.front_m - lower.front_m
    low = max(lower.sides_m[0], upper.sides_m[0])
    high = min(lower.sides_m[1], upper.sides_m[1])
    narrow = min(lower.sides_m[1] - lower.sides_m[0], upper.sides_m[1] - upper.sides_m[0])
    return (
        RISE_M[0] <= rise_m <= RISE_M[1]
        and RUN_M[0] <= run_m <= RUN_M[1]
        and high - low > SIDE_SHARE * narrow
        and abs(upper.front_m - lower.back_m) < RUN_M[0]
    )


def _next_tread(flight: Sequence[_Tread], treads: Sequence[_Tread], tolerances: Tolerances) -> _Tread | None:
    rise_m = (flight[-1].height_m - flight[0].height_m) / (len(flight) - 1)
    run_m = (flight[-1].front_m - flight[0].front_m) / (len(flight) - 1)
    fitting = [
        (abs(one.front_m - flight[-1].front_m - run_m) + abs(one.height_m - flight[-1].height_m - rise_m), one)
        for one in treads
        if _is_next_tread(flight[-1], one)
        and abs(one.front_m - flight[-1].front_m - run_m) < tolerances.run_m
        and abs(one.height_m - flight[-1].height_m - rise_m) < tolerances.rise_m
    ]
    return min(fitting, key=lambda one: one[0])[1] if fitting else None


def _describe_flight(heading_rad: float, flight: Sequence[_Tread], rails: Sequence[dict[str, Any]]) -> dict[str, Any]:
    n = len(flight) - 1
    rise_m, run_m = (flight[-1].height_m - flight[0].height_m) / n, (flight[-1].front_m - flight[0].front_m) / n
    right = float(np.median([tread.sides_m[0] for tread in flight]))
    left = float(np.median([tread.sides_m[1] for tread in flight]))
    ahead = np.array([np.cos(heading_rad), np.sin(heading_rad)])
    aside = np.array([-ahead[1], ahead[0]])
    start = flight[0].front_m * ahead + 0.5 * (left + right) * aside
    beside = [
        str(rail["name"])
        for rail in rails
        if _is_beside(rail, ahead, aside, (right, left), (flight[0].front_m, flight[-1].front_m))
    ]
    return {
        "rise_m": round(rise_m, 4),
        "run_m": round(run_m, 4),
        "width_m": round(left - right, 4),
        "start_m": [round(float(start[0]), 4), round(float(start[1]), 4), round(flight[0].height_m - rise_m, 4)],
        "heading_rad": round(heading_rad, 5),
        "treads": [tread.name for tread in flight],
        "rails": beside,
    }


def _is_beside(
    rail: dict[str, Any], ahead: Place2, aside: Place2, sides_m: tuple[float, float], ends_m: tuple[float, float]
) -> bool:
    """Whether most of a rail, or of the flight, runs along the other, inside its sides or a little beside them."""
    ends = np.array([rail["from_m"], rail["to_m"]])[:, :2]
    along, across = np.sort(ends @ ahead), ends @ aside
    shared_m = min(along[1], ends_m[1]) - max(along[0], ends_m[0])
    is_along = shared_m > 0.5 * min(along[1] - along[0], ends_m[1] - ends_m[0])
    return bool(is_along and (across > sides_m[0] - BESIDE_M).all() and (across < sides_m[1] + BESIDE_M).all())
