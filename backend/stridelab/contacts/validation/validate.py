"""Validation of scenarios before planning; faults name the phase and the effector.

The HTTP interface, the command line and the jobs use the same checks. They do not solve for a motion: a valid scenario
can still be infeasible.
"""

import re
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from stridelab.contacts.effector_geometry import FOOT_CLEARANCE_M, EffectorShape, foot_clearance_m
from stridelab.contacts.sequence import Contact, ContactPhase, ContactSequence
from stridelab.contacts.validation.parse import Draft, contact_field, parse_scenario
from stridelab.contacts.validation.phase_consistency import (
    friction_faults,
    jump_faults,
    landing_faults,
    overlap_faults,
    size_faults,
    slip_faults,
    support_faults,
)
from stridelab.contacts.validation.reach_slack import check_reach
from stridelab.contacts.validation.static_equilibrium import (
    StaticEquilibrium,
    phases_without_rest,
    rest_faults,
    static_equilibria,
)
from stridelab.contacts.validation.surface_contact import (
    Stance,
    SurfaceContact,
    contacts_on_surfaces,
    swing_collisions,
    trunk_collisions,
)
from stridelab.errors import Fault

PHASE = re.compile(r"phases\[(\d+)\]")


@dataclass(frozen=True)
class Remark:
    """A warning: a stable code and a message."""

    code: str
    message: str


@dataclass(frozen=True)
class Margin:
    """Margins of one contact in one phase; fields as in ``schemas.scenarios.ContactMargin``."""

    phase: int
    effector: str
    surface: str | None
    height_m: float | None
    edge_m: float | None
    reach_m: float | None


@dataclass(frozen=True)
class ValidationReport:
    """Validation result of a scenario: faults in the order of the phases, warnings and margins.

    ``rests`` is the static equilibrium of every phase.
    """

    faults: tuple[Fault, ...]
    remarks: tuple[Remark, ...]
    margins: tuple[Margin, ...]
    rests: tuple[StaticEquilibrium, ...]
    duration_s: float

    @property
    def valid(self) -> bool:
        """Whether a motion may be planned."""
        return not self.faults


def validate_scenario(scenario: Mapping[str, Any], effectors: Mapping[str, EffectorShape]) -> ValidationReport:
    """Validate a scenario, ``schemas.scenarios.Scenario`` as a mapping, for a robot with these effectors."""
    return validate_and_build(scenario, effectors)[0]


def validate_and_build(
    scenario: Mapping[str, Any], effectors: Mapping[str, EffectorShape]
) -> tuple[ValidationReport, ContactSequence | None]:
    """Return the validation result, and the contact sequence if there are no faults."""
    draft = parse_scenario(scenario, effectors)
    duration_s = float(sum(phase.duration_s or 0.0 for phase in draft.phases))
    outsized = tuple(size_faults(draft))
    if outsized:
        return ValidationReport(
            (*outsized, *draft.faults), (), (), (StaticEquilibrium(()),) * len(draft.phases), duration_s
        ), None
    stances = contacts_on_surfaces(draft, effectors)
    reach = check_reach(stances)
    equilibria = static_equilibria(stances, reach.slacks)
    faults = [*_contact_faults(draft, stances, effectors), *reach.faults, *rest_faults(equilibria)]
    report = ValidationReport(
        faults=tuple(sorted(faults, key=_fault_phase)),
        remarks=(*_warnings(draft, stances, effectors), *_equilibrium_warnings(equilibria)),
        margins=tuple(
            Margin(k, name, touch.surface, touch.height_m, touch.edge_m, None if slack is None else slack.slack_m)
            for k, (stance, slack) in enumerate(zip(stances, reach.slacks, strict=True))
            for name, touch in stance.items()
        ),
        rests=equilibria,
        duration_s=duration_s,
    )
    return report, _build_sequence(draft, stances) if report.valid else None


def build_validated(scenario: Mapping[str, Any], effectors: Mapping[str, EffectorShape]) -> ContactSequence:
    """The contact sequence of a scenario that has been validated: faults are not looked for again."""
    draft = parse_scenario(scenario, effectors)
    return _build_sequence(draft, contacts_on_surfaces(draft, effectors))


def validate_quickly(
    scenario: Mapping[str, Any], effectors: Mapping[str, EffectorShape]
) -> tuple[tuple[Fault, ...], ContactSequence | None]:
    """Faster ``validate_and_build`` for interactive use (half the time): no static equilibrium, margins or warnings."""
    draft = parse_scenario(scenario, effectors)
    outsized = tuple(size_faults(draft))
    if outsized:
        return (*outsized, *draft.faults), None
    stances = contacts_on_surfaces(draft, effectors)
    faults = tuple(
        sorted([*_contact_faults(draft, stances, effectors), *check_reach(stances).faults], key=_fault_phase)
    )
    return faults, None if faults else _build_sequence(draft, stances)


def _contact_faults(draft: Draft, stances: tuple[Stance, ...], effectors: Mapping[str, EffectorShape]) -> list[Fault]:
    """Faults of single contacts and of consecutive phases; of what moves in between, if there are no others."""
    faults = [
        *draft.faults,
        *support_faults(draft, effectors),
        *landing_faults(draft, effectors),
        *_placement_faults(stances),
        *jump_faults(stances),
        *overlap_faults(stances),
        *slip_faults(stances),
        *friction_faults(draft, stances),
    ]
    return faults or _obstruction_faults(draft, stances, effectors)


def _obstruction_faults(
    draft: Draft, stances: tuple[Stance, ...], effectors: Mapping[str, EffectorShape]
) -> list[Fault]:
    """Faults of swings and of the trunk that pass through the terrain; each obstacle once for the trunk."""
    faults = [
        Fault(
            contact_field(phase, effector),
            f"its swing in phase {phase} passes {100 * depth:.1f} cm deep through {box!r}",
        )
        for phase, effector, box, depth in swing_collisions(stances, draft.terrain)
    ]
    height_m = max((one.com_height_m for one in effectors.values() if one.com_height_m is not None), default=None)
    if height_m is not None:
        first: dict[str, int] = {}
        for phase, name in trunk_collisions(stances, draft.terrain, height_m):
            first.setdefault(name, phase)
        faults += [Fault(f"phases[{k}]", f"the trunk would pass through {name!r}") for name, k in first.items()]
    return faults


def _placement_faults(stances: tuple[Stance, ...]) -> list[Fault]:
    """Faults of single contacts, each at its first occurrence."""
    first: dict[int, tuple[int, SurfaceContact]] = {}
    for k, stance in enumerate(stances):
        for touch in stance.values():
            first.setdefault(id(touch), (k, touch))
    return [Fault(contact_field(k, t.effector), problem) for k, t in first.values() for problem in t.problems]


def _warnings(draft: Draft, stances: tuple[Stance, ...], effectors: Mapping[str, EffectorShape]) -> list[Remark]:
    remarks: list[Remark] = []
    used = sorted({name for stance in stances for name in stance})
    unknown = [name for name in used if effectors[name].reach is None]
    if unknown:
        remarks.append(
            Remark(
                "reach-unknown", f"the reach of {', '.join(unknown)} is not checked: no learned limits are available"
            )
        )
    late = [name for name in used if effectors[name].kind == "point" and name not in draft.phases[0].named]
    if late:
        message = (
            f"{', '.join(late)} has no contact in the first phase: its first swing starts from the initial posture"
        )
        remarks.append(Remark("hand-comes-late", message))
    return remarks


def _equilibrium_warnings(equilibria: tuple[StaticEquilibrium, ...]) -> list[Remark]:
    phases = phases_without_rest(equilibria)
    if not phases:
        return []
    named = f"phase {phases[0]}" if len(phases) == 1 else f"phases {', '.join(map(str, phases))}"
    return [Remark("passed-in-motion", f"the robot cannot stop in {named}: its contacts allow no static equilibrium")]


def _fault_phase(fault: Fault) -> int:
    match = PHASE.match(fault.where)
    return int(match[1]) if match else -1


def _build_sequence(draft: Draft, stances: tuple[Stance, ...]) -> ContactSequence:
    phases = tuple(
        ContactPhase(phase.duration_s or 0.0, {name: _build_contact(touch) for name, touch in stance.items()})
        for phase, stance in zip(draft.phases, stances, strict=True)
    )
    clearance_m = min(
        (foot_clearance_m(t.shape.com_height_m) for s in stances for t in s.values()), default=FOOT_CLEARANCE_M
    )
    return ContactSequence(
        draft.name, draft.robot, draft.friction, draft.terrain, phases, draft.start_com_height_m, clearance_m
    )


def _build_contact(touch: SurfaceContact) -> Contact:
    shape = touch.shape
    return Contact(touch.effector, touch.placement, touch.surface or "", touch.friction, shape.kind, shape.half_size_m)
