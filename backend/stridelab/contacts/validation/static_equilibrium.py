"""Static equilibrium of the contacts of a phase, and its margin.

The robot is in static equilibrium if its CoM is above the support region and within reach:

    r* = max_{c, r} r   such that   n_k (c_x, c_y) + r <= b_k   for all edges of the region,   c within reach

is the largest possible distance of the CoM from the border. If it is negative, the phase is passed only in motion.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Final

import numpy as np
from jaxtyping import Float

from stridelab.contacts.validation.phase_consistency import sole_contacts
from stridelab.contacts.validation.reach_slack import ReachLimits, Slack, SlackPrograms, contacts_with_limits, reach_set
from stridelab.contacts.validation.surface_contact import Stance, SurfaceContact
from stridelab.contacts.wrench_cones.contact_points import PointContacts
from stridelab.contacts.wrench_cones.support_region import rest_region_m
from stridelab.conventions import Vector3
from stridelab.errors import Fault, NotEstimable

Polygon = tuple[tuple[float, float], ...]
MIN_SLACK_M: Final = 1e-3
"""Minimum reach slack of a stance for which the margin is computed; also the tolerance of a negative margin."""
START_DISTANCE: Final = 0.1
"""Initial distance from the border, in units of the distance between the contacts."""
LEVEL_SINE: Final = 1e-9
"""Vertical component below which an axis of a contact frame is level."""
CACHE_DECIMALS: Final = 9
"""Decimals to which stances are rounded for the cache."""
CACHE_SIZE: Final = 4096
"""Size of the cache of support regions: dragging one contact changes only a few phases."""


@dataclass(frozen=True, eq=False)
class StaticEquilibrium:
    """Support region ``region_m`` (counter-clockwise, empty if none), and the margin ``margin_m`` = r* at ``com_m``.

    Both margin and CoM are None without a region, without reach limits and if those leave no slack.
    """

    region_m: Polygon
    margin_m: float | None = None
    com_m: Vector3 | None = None


def static_equilibria(stances: Sequence[Stance], slacks: Sequence[Slack | None]) -> tuple[StaticEquilibrium, ...]:
    """Static equilibrium of every phase; ``slacks`` are the slacks of its reach limits."""
    unique = {_identity_key(stance): (stance, slack) for stance, slack in zip(stances, slacks, strict=True)}
    regions = {key: _support_region(stance) for key, (stance, _) in unique.items()}
    solvable = {
        key: (stance, slack)
        for key, (stance, slack) in unique.items()
        if regions[key] and slack is not None and slack.slack_m > MIN_SLACK_M
    }
    solved = dict(
        zip(solvable, _solve_margins([regions[key] for key in solvable], list(solvable.values())), strict=True)
    )
    return tuple(
        solved.get(_identity_key(stance), StaticEquilibrium(regions[_identity_key(stance)])) for stance in stances
    )


def rest_faults(equilibria: Sequence[StaticEquilibrium]) -> Iterator[Fault]:
    """Faults of the first and the last phase if the CoM cannot be at rest there."""
    last = len(equilibria) - 1
    ends = {0: "begins", last: "ends"} if last > 0 else {0: "begins and ends"} if equilibria else {}
    for k, when in ends.items():
        margin = equilibria[k].margin_m
        if margin is not None and margin < -MIN_SLACK_M:
            yield Fault(
                f"phases[{k}]",
                f"the motion {when} here at rest, but the CoM stays {-margin:.2g} m short of static equilibrium on "
                "these contacts: add a contact or move these closer",
            )


def phases_without_rest(equilibria: Sequence[StaticEquilibrium]) -> list[int]:
    """Indices of the intermediate phases in which the CoM cannot be at rest."""
    inner = range(1, len(equilibria) - 1)
    return [k for k in inner if (margin := equilibria[k].margin_m) is not None and margin < -MIN_SLACK_M]


def _identity_key(stance: Stance) -> frozenset[int]:
    return frozenset(map(id, stance.values()))


def _solve_margins(
    regions: Sequence[Polygon], stances: Sequence[tuple[Stance, Slack | None]]
) -> list[StaticEquilibrium]:
    """Solve all programs in one batch, starting from the CoM with the largest reach slack."""
    if not stances:
        return []
    reach = ReachLimits.from_sets([reach_set(contacts_with_limits(stance)) for stance, _ in stances], width=0.0)
    n = max(map(len, regions))
    corners = np.array([[*region, *[region[0]] * (n - len(region))] for region in regions])
    rows, offsets = _edge_half_planes(corners)
    scale = reach.scale[:, np.newaxis]
    offsets = (offsets - np.einsum("smk,sk->sm", rows, reach.origin_m)) / scale
    begin = (np.array([slack.com_m for _, slack in stances if slack is not None]) - reach.origin_m) / scale
    room = (offsets - np.einsum("smk,sk->sm", rows, begin)).min(axis=1)
    inside = reach.limits
    limits = SlackPrograms(
        np.concatenate([rows, inside.rows], axis=1),
        np.concatenate([np.ones(offsets.shape), inside.widths], axis=1),
        np.concatenate([offsets, inside.limits], axis=1),
        inside.centers,
        inside.radii,
        0.0,
    )
    x, _ = limits.maximise_slack(np.column_stack([begin, room - START_DISTANCE]))
    margins, com_m = reach.scale * x[:, 3], reach.world_m(x)
    return [
        StaticEquilibrium(region, float(margin), _at_usual_height(c, stance))
        for region, margin, c, (stance, _) in zip(regions, margins, com_m, stances, strict=True)
    ]


def _at_usual_height(com_m: Vector3, stance: Stance) -> Vector3:
    """``com_m`` at the usual height above the soles, within reach; r* does not depend on the height."""
    usual = [
        t.placement.position_m[2] + t.shape.com_height_m
        for t in sole_contacts(stance)
        if t.shape.com_height_m is not None
    ]
    if not usual:
        return com_m
    z = com_m[2]
    low, high = -np.inf, np.inf
    for at, reach in reach_set(contacts_with_limits(stance)):
        away, up = com_m - at.position_m, at.rotation[2]
        here = away @ at.rotation
        with np.errstate(divide="ignore", invalid="ignore"):
            ends = (np.array([reach.com_low_m, reach.com_high_m]) - here) / up
        steep = np.abs(up) > LEVEL_SINE  # one axis at least
        low = max(low, float(ends[:, steep].min(axis=0).max()))
        high = min(high, float(ends[:, steep].max(axis=0).min()))
        half = np.sqrt(max(reach.com_distance_max_m**2 - float(away[:2] @ away[:2]), 0.0))
        low, high = max(low, -half - away[2]), min(high, half - away[2])
    rise = np.clip(np.mean(usual) - z, min(low, 0.0), max(high, 0.0))
    return np.asarray(com_m + np.array([0.0, 0.0, rise]))


def _edge_half_planes(
    corners_m: Float[np.ndarray, "s m 2"],
) -> tuple[Float[np.ndarray, "s m 3"], Float[np.ndarray, "s m"]]:
    """Outward horizontal normals and offsets of the edges of polygons; an edge of length 0 repeats the first one."""
    edge = np.roll(corners_m, -1, axis=1) - corners_m
    length = np.linalg.norm(edge, axis=2)
    rows = np.stack([edge[..., 1], -edge[..., 0], np.zeros(length.shape)], axis=2)
    rows /= np.where(length > 0.0, length, 1.0)[..., np.newaxis]
    offsets = np.einsum("smk,smk->sm", rows[..., :2], corners_m)
    has_length = length > 0.0
    return np.where(has_length[..., np.newaxis], rows, rows[:, :1]), np.where(has_length, offsets, offsets[:, :1])


def _support_region(stance: Stance) -> Polygon:
    """The support region; of the soles alone if hands and soles can squeeze, so that no bounded section exists."""
    for touches in (list(stance.values()), sole_contacts(stance)):
        try:
            return _region_of_contacts(touches)
        except NotEstimable:
            continue
    return ()


def _region_of_contacts(touches: Sequence[SurfaceContact]) -> Polygon:
    if not touches:
        return ()
    at = PointContacts.from_placements(
        [(touch.placement, touch.shape.half_size_m, touch.friction) for touch in touches]
    )
    x, y, _ = at.position_m[0]
    relative = (at.position_m - at.position_m[0]).round(CACHE_DECIMALS)
    region = cached_region(relative.tobytes(), at.rotation.round(CACHE_DECIMALS).tobytes(), at.friction.tobytes())
    return tuple((float(x + dx), float(y + dy)) for dx, dy in region)


@lru_cache(maxsize=CACHE_SIZE)
def cached_region(position: bytes, rotation: bytes, friction: bytes) -> Polygon:
    """Cached region of points given by the bytes of their arrays; on stairs the same stance recurs every step."""
    contacts = PointContacts(
        np.frombuffer(position).reshape(-1, 3), np.frombuffer(rotation).reshape(-1, 3, 3), np.frombuffer(friction)
    )
    return tuple((float(x), float(y)) for x, y in rest_region_m(contacts))
