"""Durations that ``plan-motion`` leaves to the solver: within what bounds, and the scenario as it was then planned."""

from stridelab.centroidal.freedom import FreeDurations
from stridelab.contacts.reading import DURATION_S
from stridelab.contacts.sequence import ContactSequence
from stridelab.schemas.plans import PhaseDuration, PlanMotionInput
from stridelab.schemas.scenarios import Scenario


def freedom(request: PlanMotionInput, sequence: ContactSequence) -> FreeDurations | None:
    """The bounds that were asked for, tightened so that the outcome is a lawful scenario; None for given durations."""
    if not request.free_durations:
        return None
    least, most = request.duration_range
    durations_s = [phase.duration_s for phase in sequence.phases]
    return FreeDurations(
        shortest=min(1.0, max(least, DURATION_S[0] / min(durations_s))),
        longest=max(1.0, min(most, DURATION_S[1] / max(durations_s))),
    )


def as_planned(scenario: Scenario, sequence: ContactSequence) -> Scenario:
    """The scenario with the durations of the sequence that was planned."""
    phases = [
        phase.model_copy(update={"duration_s": planned.duration_s})
        for phase, planned in zip(scenario.phases, sequence.phases, strict=True)
    ]
    return scenario.model_copy(update={"phases": phases})


def phase_durations(given: ContactSequence, planned: ContactSequence) -> list[PhaseDuration]:
    """Every phase's duration as the scenario gives it, and as it was chosen."""
    return [
        PhaseDuration(given_s=asked.duration_s, chosen_s=found.duration_s)
        for asked, found in zip(given.phases, planned.phases, strict=True)
    ]
