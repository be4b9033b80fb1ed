"""Free variables besides the motion: durations of phases and placements of contacts on their surfaces."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

from stridelab.contacts.sequence import Contact, ContactSequence
from stridelab.conventions import Vector3
from stridelab.errors import InvalidInput


@dataclass(frozen=True)
class FreeDurations:
    """Every phase lasts between ``shortest`` and ``longest`` times its duration in the sequence.

    The total duration is fixed, or, with ``fixed_total`` False, each second costs ``price_per_s``. Raises
    ``InvalidInput`` (``durations-out-of-range``) unless ``0 < shortest <= 1 <= longest`` and the price is not negative.
    """

    shortest: float = 0.6
    longest: float = 1.6
    fixed_total: bool = True
    price_per_s: float = 0.0

    def __post_init__(self) -> None:
        if not (0.0 < self.shortest <= 1.0 <= self.longest < float("inf")):
            raise InvalidInput(
                "durations-out-of-range",
                f"Phases may last from {self.shortest} to {self.longest} times their duration: 1 must lie between.",
            )
        if not 0.0 <= self.price_per_s < float("inf"):
            raise InvalidInput("durations-out-of-range", f"A second cannot cost {self.price_per_s}.")


@dataclass(frozen=True)
class FreePlacements:
    """Every contact that begins and ends within the motion may move by ``reach_m`` along x and y of its own frame.

    Contacts of the first and of the last phase are fixed. Raises ``InvalidInput`` (``placements-out-of-range``) for a
    reach that is negative or not finite.
    """

    reach_m: tuple[float, float] = (0.03, 0.02)

    def __post_init__(self) -> None:
        if not all(0.0 <= reach < float("inf") for reach in self.reach_m):
            raise InvalidInput("placements-out-of-range", f"A contact cannot move by {self.reach_m} m.")


@dataclass(frozen=True, eq=False)
class ContactSpan:
    """One contact from touch-down to lift-off: phases ``first`` to ``last``, both included."""

    contact: Contact
    first: int
    last: int


def contact_spans(sequence: ContactSequence) -> list[ContactSpan]:
    """All contacts of a sequence, each from its touch-down to its lift-off."""
    spans: list[ContactSpan] = []
    for name in sequence.effectors:
        first = None
        for i, phase in enumerate(sequence.phases):
            in_contact = name in phase.contacts
            if in_contact and first is None:
                first = i
            ends = i + 1 == len(sequence.phases) or name not in sequence.phases[i + 1].contacts
            if in_contact and ends and first is not None:
                spans.append(ContactSpan(phase.contacts[name], first, i))
                first = None
    return spans


def movable_spans(sequence: ContactSequence) -> list[ContactSpan]:
    """The contacts that begin after the first phase and end before the last."""
    return [span for span in contact_spans(sequence) if span.first > 0 and span.last < len(sequence.phases) - 1]


def move_contacts(
    sequence: ContactSequence, spans: Sequence[ContactSpan], shifts_m: Sequence[Vector3]
) -> ContactSequence:
    """The sequence with the contacts of ``spans`` moved by one shift each, in world axes."""
    moved: dict[tuple[int, str], Contact] = {}
    for span, shift_m in zip(spans, shifts_m, strict=True):
        place, phases = span.contact.placement, range(span.first, span.last + 1)
        contact = replace(span.contact, placement=replace(place, position_m=place.position_m + shift_m))
        moved |= {(phase, contact.effector): contact for phase in phases}
    return sequence.map_contacts(lambda phase, c: moved.get((phase, c.effector), c)) if moved else sequence
