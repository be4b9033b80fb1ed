"""The swings of a contact sequence."""

from dataclasses import replace
from functools import lru_cache

import numpy as np

from stridelab.contacts.effector_geometry import sole_points_m
from stridelab.contacts.sequence import ContactSequence
from stridelab.contacts.swing import SwingCurve, passing_shift_m, required_rise_m
from stridelab.contacts.swing_windows import gentle_windows
from stridelab.dynamics.spatial import Placement
from stridelab.errors import InvalidInput


@lru_cache(maxsize=256)
def swing_of(sequence: ContactSequence, effector: str, phase: int) -> SwingCurve:
    """The swing of ``effector`` during ``phase``, from its last contact to its next.

    A swing may last several phases: ``t_s`` of the curve counts from its lift-off, ``SwingCurve.starts_s``. Raises
    ``InvalidInput`` (``no-swing``) if the effector is in contact in that phase, or has no contact before or after it.
    """
    start, end = sequence.last_contact(effector, phase), sequence.next_contact(effector, phase)
    if effector in sequence.phases[phase].contacts or start is None or end is None:
        raise InvalidInput("no-swing", f"{effector} does not swing from one contact to another in phase {phase}")
    first, last = phase, phase
    while effector not in sequence.phases[first - 1].contacts:
        first -= 1
    while effector not in sequence.phases[last + 1].contacts:
        last += 1
    starts_s = float(sequence.starts_s[first])
    duration_s = float(sequence.ends_s[last]) - starts_s
    shifts = [
        passing_shift_m(start, end, contact)
        for contact in sequence.phases[phase].contacts.values()
        if contact.kind == start.kind == "surface"
    ]
    side_m = max(shifts, key=lambda shift: float(shift @ shift), default=np.zeros(3))
    sole_m = sole_points_m(start.half_size_m)
    rises_m = [
        required_rise_m(
            Placement(start.placement.position_m + shift, start.placement.rotation),
            Placement(end.placement.position_m + shift, end.placement.rotation),
            sole_m,
            sequence.terrain,
            sequence.foot_clearance_m,
        )
        for shift in ((np.zeros(3), side_m) if side_m.any() else (np.zeros(3),))
    ]
    curve = SwingCurve(start.placement, end.placement, duration_s, start.kind, starts_s, max(rises_m), side_m)
    if start.kind == "point" or start.half_size_m is None:
        return curve
    windows = gentle_windows(curve, start.half_size_m, sequence.terrain, (start.surface, end.surface))
    return curve if windows == curve.profile else replace(curve, windows=windows)
