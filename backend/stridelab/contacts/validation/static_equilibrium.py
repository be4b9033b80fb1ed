"""Whether the contacts of a phase hold the robot still, and with how much to spare.

The CoM can rest above the support region, as far as the robot's reach lets it get there:

    r* = max_{c, r} r   such that   n_k (c_x, c_y) + r <= b_k   for all edges of the region,   c within reach

is the distance that it can keep from the border. If it is negative, the phase can only be passed in motion.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Final

import numpy as np
from jaxtyping import Float

from stridelab.contacts.validation.phase_consistency import soles
from stridelab.contacts.validation.reach_check import limited, reach_set
from stridelab.contacts.validation.reach_slack import Limits, ReachLimits, Slack
from stridelab.contacts.validation.surface_contact import Stance, Touch
from stridelab.contacts.wrench_cones.contact_points import PointContacts
from stridelab.contacts.wrench_cones.support_region import rest_region_m
from stridelab.conventions import Vector3
from stridelab.errors import Fault, NotEstimable

Polygon = tuple[tuple[float, float], ...]
ROOM_M: Final = 1e-3
"""With less room in its reach limits than this, a stance is not asked where its CoM could rest."""
AWAY: Final = 0.1
"""How far from the border the search begins, in units of the contacts' distance."""
LEVEL: Final = 1e-9
"""Axes of a contact frame that rise less than this are level."""
SAME_DIGITS: Final = 9
"""Stances whose numbers agree to so many decimals are one."""
REMEMBERED: Final = 4096
"""Stances whose regions are kept: whoever drags one contact changes a few phases only."""


@dataclass(frozen=True, eq=False)
class Rest:
    """``region_m`` seen from above, counter-clockwise, empty where nothing holds; ``margin_m`` is r*, at ``com_m``.

    Both are None without a region, and where the reach is not known or leaves no room.
    """

    region_m: Polygon
    margin_m: float | None = None
    com_m: Vector3 | None = None


def rests(stances: Sequence[Stance], slacks: Sequence[Slack | None]) -> tuple[Rest, ...]:
    """The answer of every phase; ``slacks`` are those of its reach limits."""
    unique = {_key(stance): (stance, slack) for stance, slack in zip(stances, slacks, strict=True)}
    regions = {key: _region(stance) for key, (stance, _) in unique.items()}
    asked = {
        key: (stance, slack)
        for key, (stance, slack) in unique.items()
        if regions[key] and slack is not None and slack.slack_m > ROOM_M
    }
    found = dict(zip(asked, _margins([regions[key] for key in asked], list(asked.values())), strict=True))
    return tuple(found.get(_key(stance), Rest(regions[_key(stance)])) for stance in stances)


def restless(found: Sequence[Rest]) -> Iterator[Fault]:
    """The first and the last phase, in which the robot stands still, where its CoM cannot come to rest."""
    last = len(found) - 1
    ends = {0: "begins", last: "ends"} if last > 0 else {0: "begins and ends"} if found else {}
    for k, when in ends.items():
        margin = found[k].margin_m
        if margin is not None and margin < -ROOM_M:
            yield Fault(
                f"phases[{k}]",
                f"the motion {when} here at rest, but the CoM stays {-margin:.2g} m short of where these contacts hold "
                "it still: put another contact, or this one nearer",
            )


def passed_in_motion(found: Sequence[Rest]) -> list[int]:
    """Phases between in which the CoM cannot rest."""
    inner = range(1, len(found) - 1)
    return [k for k in inner if (margin := found[k].margin_m) is not None and margin < -ROOM_M]


def _key(stance: Stance) -> frozenset[int]:
    return frozenset(map(id, stance.values()))


def _margins(regions: Sequence[Polygon], asked: Sequence[tuple[Stance, Slack | None]]) -> list[Rest]:
    """All programmes at once, from the CoM that has most room in its reach limits."""
    if not asked:
        return []
    reach = ReachLimits.of([reach_set(limited(stance)) for stance, _ in asked], width=0.0)
    n = max(map(len, regions))
    corners = np.array([[*region, *[region[0]] * (n - len(region))] for region in regions])
    rows, offsets = _edges(corners)
    scale = reach.scale[:, np.newaxis]
    offsets = (offsets - np.einsum("smk,sk->sm", rows, reach.origin_m)) / scale
    begin = (np.array([slack.com_m for _, slack in asked if slack is not None]) - reach.origin_m) / scale
    room = (offsets - np.einsum("smk,sk->sm", rows, begin)).min(axis=1)
    inside = reach.limits
    limits = Limits(
        np.concatenate([rows, inside.rows], axis=1),
        np.concatenate([np.ones(offsets.shape), inside.widths], axis=1),
        np.concatenate([offsets, inside.limits], axis=1),
        inside.centers,
        inside.radii,
        0.0,
    )
    x, _ = limits.most(np.column_stack([begin, room - AWAY]))
    margins, com_m = reach.scale * x[:, 3], reach.world_m(x)
    return [
        Rest(region, float(margin), _at_usual_height(c, stance))
        for region, margin, c, (stance, _) in zip(regions, margins, com_m, asked, strict=True)
    ]


def _at_usual_height(com_m: Vector3, stance: Stance) -> Vector3:
    """The same place seen from above, as high as robots stand over their soles: r* does not depend on the height.

    No higher or lower than the reach goes at that place.
    """
    usual = [
        t.placement.position_m[2] + t.shape.com_height_m for t in soles(stance) if t.shape.com_height_m is not None
    ]
    if not usual:
        return com_m
    z = com_m[2]
    low, high = -np.inf, np.inf
    for at, reach in reach_set(limited(stance)):
        away, up = com_m - at.position_m, at.rotation[2]
        here = away @ at.rotation
        with np.errstate(divide="ignore", invalid="ignore"):
            ends = (np.array([reach.com_low_m, reach.com_high_m]) - here) / up
        steep = np.abs(up) > LEVEL  # one axis at least
        low = max(low, float(ends[:, steep].min(axis=0).max()))
        high = min(high, float(ends[:, steep].max(axis=0).min()))
        half = np.sqrt(max(reach.com_distance_max_m**2 - float(away[:2] @ away[:2]), 0.0))
        low, high = max(low, -half - away[2]), min(high, half - away[2])
    rise = np.clip(np.mean(usual) - z, min(low, 0.0), max(high, 0.0))
    return np.asarray(com_m + np.array([0.0, 0.0, rise]))


def _edges(corners_m: Float[np.ndarray, "s m 2"]) -> tuple[Float[np.ndarray, "s m 3"], Float[np.ndarray, "s m"]]:
    """Outward normals (level) and offsets of the edges of polygons; an edge without length counts as the first one."""
    edge = np.roll(corners_m, -1, axis=1) - corners_m
    length = np.linalg.norm(edge, axis=2)
    rows = np.stack([edge[..., 1], -edge[..., 0], np.zeros(length.shape)], axis=2)
    rows /= np.where(length > 0.0, length, 1.0)[..., np.newaxis]
    offsets = np.einsum("smk,smk->sm", rows[..., :2], corners_m)
    some = length > 0.0
    return np.where(some[..., np.newaxis], rows, rows[:, :1]), np.where(some, offsets, offsets[:, :1])


def _region(stance: Stance) -> Polygon:
    """The support region; of the soles alone where hands and soles squeeze each other, which has no bounded section."""
    for touches in (list(stance.values()), soles(stance)):
        try:
            return _outline(touches)
        except NotEstimable:
            continue
    return ()


def _outline(touches: Sequence[Touch]) -> Polygon:
    if not touches:
        return ()
    at = PointContacts.of([(touch.placement, touch.shape.half_size_m, touch.friction) for touch in touches])
    x, y, _ = at.position_m[0]
    seen = (at.position_m - at.position_m[0]).round(SAME_DIGITS)
    region = region_seen_from_first_point(
        seen.tobytes(), at.rotation.round(SAME_DIGITS).tobytes(), at.friction.tobytes()
    )
    return tuple((float(x + dx), float(y + dy)) for dx, dy in region)


@lru_cache(maxsize=REMEMBERED)
def region_seen_from_first_point(position: bytes, rotation: bytes, friction: bytes) -> Polygon:
    """The region of points given by the bytes of their arrays: on stairs the same stance returns from step to step."""
    contacts = PointContacts(
        np.frombuffer(position).reshape(-1, 3), np.frombuffer(rotation).reshape(-1, 3, 3), np.frombuffer(friction)
    )
    return tuple((float(x), float(y)) for x, y in rest_region_m(contacts))
