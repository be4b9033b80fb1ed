"""Durations chosen by the solver beside the given ones, as a strip of phases and as a table."""

import itertools
from collections.abc import Sequence
from dataclasses import dataclass

from stridelab.schemas.plans import PhaseDuration
from stridelab.schemas.scenarios import Scenario
from stridelab_web.charts import intervals
from stridelab_web.formatting import code_words


@dataclass(frozen=True)
class DurationRow:
    """One phase; ``share`` is the chosen duration divided by the given one."""

    phase: int
    contacts: str
    given_s: float
    chosen_s: float
    share: float


@dataclass(frozen=True)
class ChosenDurations:
    """Bars per phase of both timings on one axis of ``length_s``, the rows of the table, and both in a sentence."""

    given: tuple[intervals.Bar, ...]
    chosen: tuple[intervals.Bar, ...]
    ticks: tuple[intervals.Tick, ...]
    rows: tuple[DurationRow, ...]
    summary_text: str
    length_s: float


def chosen_durations(durations: Sequence[PhaseDuration], scenario: Scenario) -> ChosenDurations:
    """Values of the page of a plan with free durations."""
    length_s = max(sum(phase.given_s for phase in durations), sum(phase.chosen_s for phase in durations))
    rows = tuple(
        DurationRow(
            k,
            ", ".join(code_words(contact.effector) for contact in scenario.phases[k].contacts) or "none",
            phase.given_s,
            phase.chosen_s,
            phase.chosen_s / phase.given_s,
        )
        for k, phase in enumerate(durations)
    )
    least, most = min(rows, key=lambda row: row.share), max(rows, key=lambda row: row.share)
    return ChosenDurations(
        given=_phase_bars([phase.given_s for phase in durations], length_s),
        chosen=_phase_bars([phase.chosen_s for phase in durations], length_s),
        ticks=intervals.time_ticks(length_s),
        rows=rows,
        summary_text=f"The durations are between {least.share:.2f} (phase {least.phase}) and {most.share:.2f} times "
        f"(phase {most.phase}) those of the scenario.",
        length_s=length_s,
    )


def _phase_bars(durations_s: Sequence[float], length_s: float) -> tuple[intervals.Bar, ...]:
    ends_s = [0.0, *itertools.accumulate(durations_s)]
    return intervals.interval_bars(itertools.pairwise(ends_s), length_s)
