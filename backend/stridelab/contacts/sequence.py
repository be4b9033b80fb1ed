"""Contact sequences (section 4.2): the contacts of every phase of a motion.

A ``Scenario`` of the HTTP API becomes a ``ContactSequence`` once it is validated; the centroidal and the whole-body
stage read no other contact data.
"""

from bisect import bisect_right
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Literal

import numpy as np
from jaxtyping import Int

from stridelab.contacts.effector_geometry import FOOT_CLEARANCE_M
from stridelab.contacts.terrain import Terrain
from stridelab.conventions import Series
from stridelab.dynamics.spatial import Placement


@dataclass(frozen=True, eq=False)
class Contact:
    """One effector on one surface. ``placement`` is T_world_contact of the effector's contact frame.

    ``kind`` is the effector's: a sole (``surface``, with the half edges of its rectangle) or a hand (``point``).
    """

    effector: str
    placement: Placement
    surface: str
    friction: float
    kind: Literal["surface", "point"] = "surface"
    half_size_m: tuple[float, float] | None = None


@dataclass(frozen=True, eq=False)
class ContactPhase:
    """An interval in which the set of contacts does not change; ``contacts`` by effector."""

    duration_s: float
    contacts: Mapping[str, Contact]


@dataclass(frozen=True, eq=False)
class ContactSequence:
    """Consecutive phases on a terrain, for a robot. The motion starts and ends at rest.

    ``start_com_height_m`` is the initial height of the CoM above the mean of the soles; None: the robot's usual height.
    ``foot_clearance_m`` is the rise of the robot's soles in level swings.
    """

    name: str
    robot: str
    friction: float
    terrain: Terrain
    phases: tuple[ContactPhase, ...]
    start_com_height_m: float | None = None
    foot_clearance_m: float = FOOT_CLEARANCE_M

    @cached_property
    def ends_s(self) -> Series:
        """End of every phase ``(n_phases,)``, in seconds from the start."""
        return np.cumsum(self.durations_s)

    @cached_property
    def _end_list_s(self) -> list[float]:
        return [float(end) for end in self.ends_s]

    @cached_property
    def starts_s(self) -> Series:
        """Start of every phase ``(n_phases,)``."""
        return np.concatenate([[0.0], self.ends_s[:-1]])

    @cached_property
    def durations_s(self) -> Series:
        """Duration of every phase ``(n_phases,)``."""
        return np.array([phase.duration_s for phase in self.phases])

    @property
    def duration_s(self) -> float:
        """Length of the whole motion."""
        return float(self.ends_s[-1])

    @cached_property
    def effectors(self) -> tuple[str, ...]:
        """All effectors with a contact, in the order of their first contact."""
        return tuple(dict.fromkeys(name for phase in self.phases for name in phase.contacts))

    @cached_property
    def headings_rad(self) -> Series:
        """Heading of the trunk in every phase ``(n_phases,)``, unwrapped: the mean yaw of the soles.

        A swinging sole counts with its last contact, or with its first one before that; 0 if there is no sole.
        """
        yaws_rad: list[float] = []
        for phase in range(len(self.phases)):
            places = [self.last_contact(name, phase) or self.next_contact(name, phase) for name in self.effectors]
            yaws_rad.append(_mean_yaw([c for c in places if c is not None and c.kind == "surface"]))
        return np.unwrap(yaws_rad)

    def phase_at(self, time_s: float) -> int:
        """Index of the phase at ``time_s``; a boundary belongs to the phase that begins there."""
        return min(bisect_right(self._end_list_s, time_s), len(self.phases) - 1)

    def phases_at(self, time_s: Series) -> Int[np.ndarray, "n"]:
        """Indices of the phases at ``time_s`` ``(n,)``, as ``phase_at``."""
        return np.minimum(np.searchsorted(self.ends_s, time_s, side="right"), len(self.phases) - 1)

    def last_contact(self, effector: str, phase: int) -> Contact | None:
        """The contact of ``effector`` in ``phase``, or its last one before."""
        return next((p.contacts[effector] for p in self.phases[phase::-1] if effector in p.contacts), None)

    def next_contact(self, effector: str, phase: int) -> Contact | None:
        """The contact of ``effector`` in ``phase``, or its first one after."""
        return next((p.contacts[effector] for p in self.phases[phase:] if effector in p.contacts), None)

    def with_durations(self, durations_s: Series) -> "ContactSequence":
        """The same contacts in phases of other durations ``(n_phases,)``."""
        phases = tuple(replace(p, duration_s=s) for p, s in zip(self.phases, durations_s.tolist(), strict=True))
        return replace(self, phases=phases)

    def map_contacts(self, change: Callable[[int, Contact], Contact]) -> "ContactSequence":
        """The sequence with ``change(phase, contact)`` in the place of every contact."""
        changed = ((p, [change(i, c) for c in p.contacts.values()]) for i, p in enumerate(self.phases))
        phases = (replace(phase, contacts={c.effector: c for c in own}) for phase, own in changed)
        return replace(self, phases=tuple(phases))


def _mean_yaw(contacts: list[Contact]) -> float:
    ahead = np.sum([contact.placement.rotation[:2, 0] for contact in contacts], axis=0) if contacts else (1.0, 0.0)
    return float(np.arctan2(ahead[1], ahead[0]))
