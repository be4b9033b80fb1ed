"""Checks of the phases of a scenario: soles support the robot, do not slip or overlap, and move only by swings."""

from collections.abc import Iterator, Mapping, Sequence
from typing import Final

import numpy as np
from scipy.optimize import nnls

from stridelab.contacts.effector_geometry import HAND_RADIUS_M, EffectorShape
from stridelab.contacts.validation.parse import Draft, contact_field
from stridelab.contacts.validation.surface_contact import Stance, SurfaceContact
from stridelab.contacts.wrench_cones.contact_points import PointContacts
from stridelab.errors import Fault

CONE_EDGES: Final = 16
"""Edges of the inscribed pyramid that approximates a friction cone."""
SHOE_HEIGHT_M: Final = 0.05
"""Least height above its sole in which a foot is."""
RESIDUAL: Final = 1e-6
"""Relative residual up to which forces balance the robot's weight."""


def sole_contacts(stance: Stance) -> list[SurfaceContact]:
    """The soles in contact, which can support the robot."""
    return [touch for touch in stance.values() if touch.shape.kind == "surface"]


def steepest_if_slipping(stance: Stance) -> SurfaceContact | None:
    """The steepest sole of a phase if its friction cones cannot support the weight, otherwise None.

    The weight ``e_z`` must be a sum of forces inside the friction cones of the soles; hands are not counted.
    """
    steep = [(slip_angle_rad(touch), touch) for touch in sole_contacts(stance)]
    if not steep or min(angle for angle, _ in steep) <= 0.0:
        return None
    at = PointContacts.from_placements([(touch.placement, None, touch.friction) for _, touch in steep])
    _, residual = nnls(at.pyramid_edges(CONE_EDGES).reshape(-1, 3).T, np.array([0.0, 0.0, 1.0]))
    return None if residual < RESIDUAL else max(steep, key=lambda item: item[0])[1]


def slip_angle_rad(touch: SurfaceContact) -> float:
    """Slope of a contact minus its friction angle (rad); positive where the contact slips."""
    slope = np.arccos(np.clip(touch.placement.rotation[2, 2], -1.0, 1.0))
    return float(slope - np.arctan(touch.friction))


def soles_overlap(one: SurfaceContact, other: SurfaceContact) -> bool:
    """Whether two soles overlap: no edge of either separates their outlines (projected onto the ground)."""
    if abs(one.placement.position_m[2] - other.placement.position_m[2]) > SHOE_HEIGHT_M:
        return False
    first, second = one.corners_m[:, :2], other.corners_m[:, :2]
    edges = np.vstack([np.diff(first[:3], axis=0), np.diff(second[:3], axis=0)])
    for axis in edges[:, ::-1] * [1.0, -1.0]:
        a, b = first @ axis, second @ axis
        if a.max() <= b.min() or b.max() <= a.min():
            return False
    return True


def hand_meets(hand: SurfaceContact, other: SurfaceContact) -> bool:
    """Whether the contact sphere of a hand meets that of another hand, or the shoe above another contact's sole."""
    middle_m = hand.placement.act(np.array([[0.0, 0.0, HAND_RADIUS_M]]))
    if other.shape.kind == "point":
        other_m = other.placement.act(np.array([[0.0, 0.0, HAND_RADIUS_M]]))
        return bool(np.linalg.norm(middle_m - other_m) < 2.0 * HAND_RADIUS_M)
    local_m = other.placement.inverse().act(middle_m)[0]
    half_m = np.array(other.shape.half_size_m)
    on_shoe_m = np.append(np.clip(local_m[:2], -half_m, half_m), np.clip(local_m[2], 0.0, SHOE_HEIGHT_M))
    return bool(np.linalg.norm(local_m - on_shoe_m) < HAND_RADIUS_M)


def contact_pairs(touches: Sequence[SurfaceContact]) -> list[tuple[SurfaceContact, SurfaceContact]]:
    """All pairs of contacts."""
    return [(a, b) for i, a in enumerate(touches) for b in touches[i + 1 :]]


PHASES_MAX: Final = 400
"""Maximum number of phases."""
SURFACES_MAX: Final = 200
"""Maximum number of surfaces."""
DURATION_MAX_S: Final = 600.0
"""Maximum duration of the motion."""
SAME_PLACE_M: Final = 0.001
"""Distance up to which contacts of consecutive phases are the same."""
SAME_PLACE_RAD: Final = np.radians(0.5)


def size_faults(draft: Draft) -> Iterator[Fault]:
    """Faults of scenarios that are empty or too large for the other checks."""
    if not draft.phases:
        yield Fault("phases", "there are no phases")
    if len(draft.phases) > PHASES_MAX:
        yield Fault("phases", f"{len(draft.phases)} phases; at most {PHASES_MAX} can be planned")
    if len(draft.terrain.surfaces) > SURFACES_MAX:
        count = len(draft.terrain.surfaces)
        yield Fault("terrain", f"{count} surfaces; at most {SURFACES_MAX} can be checked")
    duration_s = sum(phase.duration_s or 0.0 for phase in draft.phases)
    if duration_s > DURATION_MAX_S:
        yield Fault("phases", f"the motion lasts {duration_s:.4g} s; at most {DURATION_MAX_S:g} s can be planned")


def support_faults(draft: Draft, effectors: Mapping[str, EffectorShape]) -> Iterator[Fault]:
    """Faults of phases without contacts or without soles, and of transitions that keep no sole in contact."""
    carrying = [{name for name in phase.named if effectors[name].kind == "surface"} for phase in draft.phases]
    for k, (phase, now) in enumerate(zip(draft.phases, carrying, strict=True)):
        if not phase.named:
            yield Fault(f"phases[{k}]", "no contacts in this phase: flight is not supported")
        elif not now:
            yield Fault(f"phases[{k}]", "no foot is in contact in this phase: hands alone do not support the robot")
        elif k and carrying[k - 1] and not now & carrying[k - 1]:
            feet = " and ".join(sorted(carrying[k - 1]))
            yield Fault(
                f"phases[{k}].contacts[{min(now)}]",
                f"{feet} lift off at the moment this foot lands, so that nothing supports the robot: "
                "insert a phase with both in contact",
            )


def jump_faults(stances: tuple[Stance, ...]) -> Iterator[Fault]:
    """Faults of effectors that change position between consecutive phases without a swing."""
    for k in range(1, len(stances)):
        for name, touch in stances[k].items():
            before = stances[k - 1].get(name)
            if before is None or before is touch or same_place(before, touch):
                continue
            moved = np.linalg.norm(touch.placement.position_m - before.placement.position_m)
            yield Fault(
                contact_field(k, name),
                f"slides {moved:.3g} m from its position in phase {k - 1}: insert a phase without this contact",
            )


def same_place(one: SurfaceContact, other: SurfaceContact) -> bool:
    """Whether two contacts of an effector are equal within tolerance."""
    moved = np.linalg.norm(one.placement.position_m - other.placement.position_m)
    turned = (np.trace(one.placement.rotation.T @ other.placement.rotation) - 1.0) / 2.0
    return bool(moved <= SAME_PLACE_M and turned >= np.cos(SAME_PLACE_RAD))


def landing_faults(draft: Draft, effectors: Mapping[str, EffectorShape]) -> Iterator[Fault]:
    """Faults of feet that land without an earlier contact."""
    seen = set(draft.phases[0].named) if draft.phases else set()
    for k, phase in enumerate(draft.phases):
        for name in sorted(phase.named - seen):
            if effectors[name].kind == "surface":
                yield Fault(contact_field(k, name), "lands without an earlier contact: add it to the first phase")
            seen.add(name)


def overlap_faults(stances: tuple[Stance, ...]) -> Iterator[Fault]:
    """Faults of overlapping soles, and of hands in the place of another hand or of a sole; each pair once."""
    reported: set[frozenset[int]] = set()
    for k, stance in enumerate(stances):
        soles, hands = sole_contacts(stance), [touch for touch in stance.values() if touch.shape.kind == "point"]
        pairs = [*contact_pairs(soles), *contact_pairs(hands), *((sole, hand) for sole in soles for hand in hands)]
        for one, other in pairs:
            key = frozenset((id(one), id(other)))
            is_hand = other.shape.kind == "point"
            if key not in reported and (hand_meets(other, one) if is_hand else soles_overlap(one, other)):
                reported.add(key)
                text = f"is in the place of {one.effector}" if is_hand else f"overlaps {one.effector}"
                yield Fault(contact_field(k, other.effector), text)


def friction_faults(draft: Draft, stances: tuple[Stance, ...]) -> Iterator[Fault]:
    """Faults of the first contact on every surface with an invalid friction."""
    own = {surface.name: surface.friction is not None for surface in draft.terrain.surfaces}
    reported: set[str | None] = set()
    for k, stance in enumerate(stances):
        for name, touch in stance.items():
            if touch.surface is None:
                continue
            source = touch.surface if touch.surface in draft.invalid_friction else None
            if source in reported or source not in draft.invalid_friction or (source is None and own[touch.surface]):
                continue
            reported.add(source)
            whose = "the scenario's friction" if source is None else "its friction"
            yield Fault(contact_field(k, name), f"cannot hold on {touch.surface!r}: {whose} is invalid")


def slip_faults(stances: tuple[Stance, ...]) -> Iterator[Fault]:
    """Faults of phases whose soles slip on steep ground; each set of placements once."""
    reported: set[frozenset[int]] = set()
    for k, stance in enumerate(stances):
        key = frozenset(id(touch) for touch in sole_contacts(stance))
        if key in reported:
            continue
        reported.add(key)
        touch = steepest_if_slipping(stance)
        if touch is not None:
            friction_deg = np.degrees(np.arctan(touch.friction))
            slope_deg = friction_deg + np.degrees(slip_angle_rad(touch))
            yield Fault(
                contact_field(k, touch.effector),
                f"slips: {touch.surface!r} is {slope_deg:.3g} degrees steep, and friction {touch.friction:g} holds "
                f"up to {friction_deg:.3g} degrees",
            )
