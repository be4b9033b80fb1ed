"""Whether the robot reaches all contacts of a phase, and those of two phases at the moment between them, at once."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from stridelab.contacts.validation.parse import contact_field
from stridelab.contacts.validation.phase_consistency import same_place
from stridelab.contacts.validation.reach_slack import ReachSet, Slack, slacks
from stridelab.contacts.validation.surface_contact import Stance, Touch, shift
from stridelab.conventions import Vector3
from stridelab.dynamics.spatial import Placement
from stridelab.errors import Fault

REACH_TOLERANCE_M: Final = 0.001
"""Reach limits that are missed by less count as kept."""
SHIFTS_MAX: Final = 12
"""Rounds in which the nearest place within reach is sought."""
FAR_M: Final = 3.0
"""What is farther off than this may be a mistake of units."""
PULL_MIN: Final = 0.02
"""A contact that pulls less has no part in the conflict."""


@dataclass(frozen=True, eq=False)
class Closeness:
    """Slack of the reach limits per phase, None without limits, and the faults."""

    slacks: tuple[Slack | None, ...]
    faults: tuple[Fault, ...]


def closeness(stances: tuple[Stance, ...]) -> Closeness:
    """Check all phases and all changes; equal sets of contacts are solved once."""
    moments = [(k, limited(stance)) for k, stance in enumerate(stances)]
    for k in range(1, len(stances)):
        both = limited(_merged(stances[k - 1], stances[k]))
        if len(both) > max(len(moments[k - 1][1]), len(moments[k][1])):
            moments.append((k, both))
    unique = {_key(touches): touches for _, touches in moments if touches}
    found = dict(zip(unique, slacks([reach_set(touches) for touches in unique.values()]), strict=True))
    faults: list[Fault] = []
    told: set[frozenset[int]] = set()
    for k, touches in sorted(moments, key=lambda moment: moment[0]):
        slack = found.get(_key(touches))
        if slack is None or slack.slack_m >= -REACH_TOLERANCE_M:
            continue
        conflict = [i for i, pull in enumerate(slack.pull) if np.linalg.norm(pull) > PULL_MIN]
        key = frozenset(id(touches[i]) for i in conflict)
        if key not in told:
            told.add(key)
            faults.append(_fault(k, touches, conflict, slack, stances[k - 1] if k else {}))
    return Closeness(tuple(found.get(_key(touches)) for _, touches in moments[: len(stances)]), tuple(faults))


def limited(stance: Stance) -> list[Touch]:
    """Contacts with known limits, in a fixed order."""
    return [touch for _, touch in sorted(stance.items()) if touch.shape.reach is not None]


def _merged(before: Stance, after: Stance) -> Stance:
    """Contacts of both phases; an effector that moves without leaving the ground counts where it arrives."""
    return {**before, **after}


def _key(touches: Sequence[Touch]) -> tuple[int, ...]:
    return tuple(id(touch) for touch in touches)


def reach_set(touches: Sequence[Touch], shifts: dict[int, Vector3] | None = None) -> ReachSet:
    """The limits of some contacts, shifted by number."""
    moved = shifts or {}
    return [
        (Placement(t.placement.position_m + moved.get(i, 0.0), t.placement.rotation), t.shape.reach)
        for i, t in enumerate(touches)
        if t.shape.reach is not None
    ]


def _fault(k: int, touches: list[Touch], conflict: list[int], slack: Slack, before: Stance) -> Fault:
    """Blame the contact that came last, and say how far it would have to move for all limits to hold."""
    blamed = max(conflict or range(len(touches)), key=lambda i: (_is_new(touches[i], before), i))
    others = [touches[i].effector for i in conflict if i != blamed]
    missing = _missing_m(touches, blamed, slack)
    distance = float(np.linalg.norm(missing))
    units = " (are all lengths in metres?)" if distance > FAR_M else ""
    anchor = " and ".join(others) or "the robot's reach"
    return Fault(
        contact_field(k, touches[blamed].effector),
        f"{distance:.2f} m too far from {anchor} for this robot: {shift(missing)}{units}",
    )


def _is_new(touch: Touch, before: Stance) -> bool:
    stood = before.get(touch.effector)
    return stood is None or not same_place(stood, touch)


def _missing_m(touches: list[Touch], blamed: int, slack: Slack) -> Vector3:
    """Shift of one contact that brings the slack to zero, along the gradient of the slack."""
    total = np.zeros(3)
    for _ in range(SHIFTS_MAX):
        pull = slack.pull[blamed]
        strength = float(np.linalg.norm(pull))
        if slack.slack_m >= -REACH_TOLERANCE_M or strength < PULL_MIN:
            break
        total = total - slack.slack_m / strength**2 * pull
        (slack,) = slacks([reach_set(touches, {blamed: total})])
    return total
