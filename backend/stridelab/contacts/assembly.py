"""Which surface a contact lies on."""

from collections.abc import Mapping

from stridelab.contacts.reading import Draft
from stridelab.contacts.sequence import Contact, ContactPhase, ContactSequence
from stridelab.contacts.shapes import EffectorShape
from stridelab.contacts.surfaces import touchable
from stridelab.contacts.terrain import Box


def assemble(draft: Draft, effectors: Mapping[str, EffectorShape]) -> ContactSequence:
    """Every contact of a faultless draft on the surface nearest to it."""
    parts = [touchable(s) for s in draft.terrain.surfaces]
    phases = []
    for phase in draft.phases:
        contacts = {}
        for name, placement in phase.contacts.items():
            kind = effectors[name].kind
            usable = [p for p in parts if kind == "point" or isinstance(p.surface, Box)]
            best = min(usable, key=lambda p: float(p.place(placement.position_m[None]).distance_m[0]))
            mu = best.surface.friction or draft.friction
            contacts[name] = Contact(name, placement, best.surface.name, mu, kind)
        phases.append(ContactPhase(phase.duration_s or 0.0, contacts))
    return ContactSequence(draft.name, draft.robot, draft.friction, draft.terrain, tuple(phases))
