"""Checks that all contacts of a phase, and of two phases at their transition, are within reach at the same time."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from stridelab.contacts.validation.parse import contact_field
from stridelab.contacts.validation.phase_consistency import same_place
from stridelab.contacts.validation.reach_slack import ReachSet, Slack, reach_slacks
from stridelab.contacts.validation.surface_contact import Stance, SurfaceContact, displacement_text
from stridelab.conventions import Vector3
from stridelab.dynamics.spatial import Placement
from stridelab.errors import Fault

REACH_TOLERANCE_M: Final = 0.001
"""Tolerance of the reach limits."""
SHIFTS_MAX: Final = 12
"""Maximum iterations of the search for the nearest position within reach."""
FAR_M: Final = 3.0
"""Distance beyond which the fault asks whether lengths are in metres."""
PULL_MIN: Final = 0.02
"""Minimum pull of a contact that counts as part of a conflict."""


@dataclass(frozen=True, eq=False)
class ReachCheck:
    """Slack of the reach limits per phase, None without limits, and the faults."""

    slacks: tuple[Slack | None, ...]
    faults: tuple[Fault, ...]


def check_reach(stances: tuple[Stance, ...]) -> ReachCheck:
    """Check all phases and all transitions; equal sets of contacts are solved once."""
    moments = [(k, contacts_with_limits(stance)) for k, stance in enumerate(stances)]
    for k in range(1, len(stances)):
        both = contacts_with_limits(_merge_stances(stances[k - 1], stances[k]))
        if len(both) > max(len(moments[k - 1][1]), len(moments[k][1])):
            moments.append((k, both))
    unique = {_identity_key(touches): touches for _, touches in moments if touches}
    slack_by_set = dict(zip(unique, reach_slacks([reach_set(touches) for touches in unique.values()]), strict=True))
    faults: list[Fault] = []
    reported: set[frozenset[int]] = set()
    for k, touches in sorted(moments, key=lambda moment: moment[0]):
        slack = slack_by_set.get(_identity_key(touches))
        if slack is None or slack.slack_m >= -REACH_TOLERANCE_M:
            continue
        conflict = [i for i, pull in enumerate(slack.gradient) if np.linalg.norm(pull) > PULL_MIN]
        key = frozenset(id(touches[i]) for i in conflict)
        if key not in reported:
            reported.add(key)
            faults.append(_reach_fault(k, touches, conflict, slack, stances[k - 1] if k else {}))
    return ReachCheck(
        tuple(slack_by_set.get(_identity_key(touches)) for _, touches in moments[: len(stances)]), tuple(faults)
    )


def contacts_with_limits(stance: Stance) -> list[SurfaceContact]:
    """Contacts with reach limits, sorted by effector."""
    return [touch for _, touch in sorted(stance.items()) if touch.shape.reach is not None]


def _merge_stances(before: Stance, after: Stance) -> Stance:
    """Contacts of both phases; an effector in both counts with its contact in ``after``."""
    return {**before, **after}


def _identity_key(touches: Sequence[SurfaceContact]) -> tuple[int, ...]:
    return tuple(id(touch) for touch in touches)


def reach_set(touches: Sequence[SurfaceContact], shifts: dict[int, Vector3] | None = None) -> ReachSet:
    """The reach limits of contacts, some of them shifted (by index)."""
    moved = shifts or {}
    return [
        (Placement(t.placement.position_m + moved.get(i, 0.0), t.placement.rotation), t.shape.reach)
        for i, t in enumerate(touches)
        if t.shape.reach is not None
    ]


def _reach_fault(
    k: int, touches: list[SurfaceContact], conflict: list[int], slack: Slack, previous_stance: Stance
) -> Fault:
    """The fault of the newest contact in a conflict, with the displacement that satisfies all limits."""
    blamed = max(conflict or range(len(touches)), key=lambda i: (_is_new(touches[i], previous_stance), i))
    others = [touches[i].effector for i in conflict if i != blamed]
    missing = _displacement_into_reach_m(touches, blamed, slack)
    distance = float(np.linalg.norm(missing))
    units = " (are all lengths in metres?)" if distance > FAR_M else ""
    anchor = " and ".join(others) or "the robot's reach"
    return Fault(
        contact_field(k, touches[blamed].effector),
        f"{distance:.2f} m too far from {anchor} for this robot: {displacement_text(missing)}{units}",
    )


def _is_new(touch: SurfaceContact, before: Stance) -> bool:
    previous = before.get(touch.effector)
    return previous is None or not same_place(previous, touch)


def _displacement_into_reach_m(touches: list[SurfaceContact], blamed: int, slack: Slack) -> Vector3:
    """Displacement of one contact along the gradient of the slack that brings the slack to zero."""
    total = np.zeros(3)
    for _ in range(SHIFTS_MAX):
        pull = slack.gradient[blamed]
        strength = float(np.linalg.norm(pull))
        if slack.slack_m >= -REACH_TOLERANCE_M or strength < PULL_MIN:
            break
        total = total - slack.slack_m / strength**2 * pull
        (slack,) = reach_slacks([reach_set(touches, {blamed: total})])
    return total
