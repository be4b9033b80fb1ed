"""What the solver chose where it was free to: the contact sequence with its durations and placements."""

from dataclasses import replace

from stridelab.centroidal.transcription import Transcription
from stridelab.contacts.sequence import Contact, ContactSequence
from stridelab.conventions import Series


def chosen(programme: Transcription, w: Series) -> ContactSequence:
    """The sequence of the problem, or with what ``w`` says of durations and contacts."""
    problem, layout = programme.problem, programme.layout
    sequence = problem.sequence
    if not (problem.durations or problem.placements):
        return sequence
    durations_s = [
        float(w[layout.durations[i]]) if problem.durations else phase.duration_s
        for i, phase in enumerate(sequence.phases)
    ]
    contacts: list[dict[str, Contact]] = [dict(phase.contacts) for phase in sequence.phases]
    for stay, at in zip(programme.movable, layout.shifts, strict=True):
        place = stay.contact.placement
        moved = replace(place, position_m=place.position_m + place.rotation[:, :2] @ w[at : at + 2])
        for i in range(stay.first, stay.last + 1):
            contacts[i][stay.contact.effector] = replace(stay.contact, placement=moved)
    phases = [
        replace(phase, duration_s=duration_s, contacts=touching)
        for phase, duration_s, touching in zip(sequence.phases, durations_s, contacts, strict=True)
    ]
    return replace(sequence, phases=tuple(phases))
