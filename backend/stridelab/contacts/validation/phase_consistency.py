"""What carries the robot: the soles of a phase, whether friction can hold them, and whether they overlap.

What must hold from phase to phase: something carries the robot, and nothing jumps.
"""

from collections.abc import Iterator, Mapping, Sequence
from typing import Final

import numpy as np
from scipy.optimize import nnls

from stridelab.contacts.effector_geometry import EffectorShape
from stridelab.contacts.validation.parse import Draft, contact_field
from stridelab.contacts.validation.surface_contact import Stance, Touch
from stridelab.contacts.wrench_cones.contact_points import PointContacts
from stridelab.errors import Fault

CONE_EDGES: Final = 16
"""Edges of the pyramid that stands in for a friction cone, from the inside."""
RESIDUAL: Final = 1e-6
"""Forces that miss the robot's weight by less than this share of it carry it."""


def soles(stance: Stance) -> list[Touch]:
    """The contacts of a phase that can carry the robot."""
    return [touch for touch in stance.values() if touch.shape.kind == "surface"]


def slipping(stance: Stance) -> Touch | None:
    """The steepest sole of a phase whose friction cones cannot carry a weight, None where they can.

    The weight ``e_z`` must be a sum of forces inside the cones of the soles; hands are too weak to count.
    """
    steep = [(steepness(touch), touch) for touch in soles(stance)]
    if not steep or min(angle for angle, _ in steep) <= 0.0:
        return None
    at = PointContacts.of([(touch.placement, None, touch.friction) for _, touch in steep])
    _, residual = nnls(at.forces(CONE_EDGES).reshape(-1, 3).T, np.array([0.0, 0.0, 1.0]))
    return None if residual < RESIDUAL else max(steep, key=lambda found: found[0])[1]


def steepness(touch: Touch) -> float:
    """Angle (rad) by which a contact is too steep to hold by friction alone; negative where it holds."""
    slope = np.arccos(np.clip(touch.placement.rotation[2, 2], -1.0, 1.0))
    return float(slope - np.arctan(touch.friction))


def overlap(one: Touch, other: Touch) -> bool:
    """Whether two soles lie in the same place: no edge of either separates their outlines (seen from above)."""
    if abs(one.placement.position_m[2] - other.placement.position_m[2]) > 0.05:
        return False
    first, second = one.corners_m[:, :2], other.corners_m[:, :2]
    edges = np.vstack([np.diff(first[:3], axis=0), np.diff(second[:3], axis=0)])
    for axis in edges[:, ::-1] * [1.0, -1.0]:
        a, b = first @ axis, second @ axis
        if a.max() <= b.min() or b.max() <= a.min():
            return False
    return True


def pairs(touches: Sequence[Touch]) -> list[tuple[Touch, Touch]]:
    """All pairs."""
    return [(a, b) for i, a in enumerate(touches) for b in touches[i + 1 :]]


PHASES_MAX: Final = 400
"""Longest contact sequence."""
SURFACES_MAX: Final = 200
"""Largest terrain."""
DURATION_MAX_S: Final = 600.0
"""Longest motion."""
SLIDE_M: Final = 0.001
"""Contacts of consecutive phases that are closer than this are the same."""
SLIDE_RAD: Final = np.radians(0.5)


def too_large(draft: Draft) -> Iterator[Fault]:
    """Scenarios that are empty, or too large to be looked at any further."""
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


def unsupported(draft: Draft, effectors: Mapping[str, EffectorShape]) -> Iterator[Fault]:
    """Phases in which nothing, or no sole, touches; changes at which no sole stays."""
    carrying = [{name for name in phase.named if effectors[name].kind == "surface"} for phase in draft.phases]
    for k, (phase, now) in enumerate(zip(draft.phases, carrying, strict=True)):
        if not phase.named:
            yield Fault(f"phases[{k}]", "nothing touches in this phase: flight is not supported")
        elif not now:
            yield Fault(f"phases[{k}]", "no foot touches in this phase: hands alone do not carry the robot")
        elif k and carrying[k - 1] and not now & carrying[k - 1]:
            feet = " and ".join(sorted(carrying[k - 1]))
            yield Fault(
                f"phases[{k}].contacts[{min(now)}]",
                f"{feet} lift off at the moment this foot lands, so that nothing carries the robot: "
                "put a phase with both between",
            )


def sliding(stances: tuple[Stance, ...]) -> Iterator[Fault]:
    """Effectors that are somewhere else in the next phase without having been in the air."""
    for k in range(1, len(stances)):
        for name, touch in stances[k].items():
            before = stances[k - 1].get(name)
            if before is None or before is touch or same_place(before, touch):
                continue
            moved = np.linalg.norm(touch.placement.position_m - before.placement.position_m)
            yield Fault(
                contact_field(k, name),
                f"slides {moved:.3g} m from its place in phase {k - 1} in no time: put a phase without it between",
            )


def same_place(one: Touch, other: Touch) -> bool:
    """Whether two contacts of an effector are one."""
    moved = np.linalg.norm(one.placement.position_m - other.placement.position_m)
    turned = (np.trace(one.placement.rotation.T @ other.placement.rotation) - 1.0) / 2.0
    return bool(moved <= SLIDE_M and turned >= np.cos(SLIDE_RAD))


def out_of_nowhere(draft: Draft, effectors: Mapping[str, EffectorShape]) -> Iterator[Fault]:
    """Feet that land although nothing says where they came from."""
    seen = set(draft.phases[0].named) if draft.phases else set()
    for k, phase in enumerate(draft.phases):
        for name in sorted(phase.named - seen):
            if effectors[name].kind == "surface":
                yield Fault(contact_field(k, name), "lands, but stood nowhere before: let it stand in the first phase")
            seen.add(name)


def colliding(stances: tuple[Stance, ...]) -> Iterator[Fault]:
    """Soles in the same place; each pair of places once."""
    told: set[frozenset[int]] = set()
    for k, stance in enumerate(stances):
        for one, other in pairs(soles(stance)):
            key = frozenset((id(one), id(other)))
            if key not in told and overlap(one, other):
                told.add(key)
                yield Fault(contact_field(k, other.effector), f"stands on the same place as {one.effector}")


def without_friction(draft: Draft, stances: tuple[Stance, ...]) -> Iterator[Fault]:
    """The first contact on every surface whose friction makes no sense."""
    own = {surface.name: surface.friction is not None for surface in draft.terrain.surfaces}
    told: set[str | None] = set()
    for k, stance in enumerate(stances):
        for name, touch in stance.items():
            if touch.surface is None:
                continue
            source = touch.surface if touch.surface in draft.without_friction else None
            if source in told or source not in draft.without_friction or (source is None and own[touch.surface]):
                continue
            told.add(source)
            whose = "the scenario's friction" if source is None else "its friction"
            yield Fault(contact_field(k, name), f"nothing holds it on {touch.surface!r}: {whose} makes no sense")


def sliding_down(stances: tuple[Stance, ...]) -> Iterator[Fault]:
    """Phases whose soles stand on ground that is too steep for their friction; each set of places once."""
    told: set[frozenset[int]] = set()
    for k, stance in enumerate(stances):
        key = frozenset(id(touch) for touch in soles(stance))
        if key in told:
            continue
        told.add(key)
        touch = slipping(stance)
        if touch is not None:
            holds = np.degrees(np.arctan(touch.friction))
            slope = holds + np.degrees(steepness(touch))
            yield Fault(
                contact_field(k, touch.effector),
                f"slips: {touch.surface!r} is {slope:.3g} degrees steep, and friction {touch.friction:g} holds up to "
                f"{holds:.3g} degrees",
            )
