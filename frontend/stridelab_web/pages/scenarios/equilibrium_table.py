"""Static equilibrium of the robot in each phase: results of the scenario check as rows of a table."""

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Literal

from stridelab.schemas.scenarios import Scenario, ScenarioCheck
from stridelab_web.charts import intervals
from stridelab_web.formatting import code_words

Kind = Literal["rest", "motion", "unknown"]
KIND_TEXTS: dict[Kind, str] = {"rest": "yes", "motion": "only passed in motion", "unknown": "not known"}
EQUAL_DIGITS = 4
"""Margins (m) that are equal to so many digits count as equal, as in static/js/editor/validation_text.js."""
Worst = tuple[float, str]
"""The smallest margin (m) and its contact."""


@dataclass(frozen=True)
class PhaseEquilibrium:
    """Equilibrium of one phase. ``margin_m`` as in ``PhaseSupport``; ``edge`` and ``reach_m`` are the smallest."""

    phase: int
    start_s: float
    end_s: float
    effectors: str
    kind: Kind
    margin_m: float | None
    edge: Worst | None
    reach_m: float | None
    region_m: tuple[tuple[float, float], ...]

    @property
    def kind_text(self) -> str:
        """Whether the robot can rest in this phase, as text."""
        return KIND_TEXTS[self.kind]


def phase_equilibria(scenario: Scenario, check: ScenarioCheck) -> tuple[PhaseEquilibrium, ...]:
    """The phases of ``scenario`` in their order."""
    spare = {support.phase: support.margin_m for support in check.support}
    regions = dict(enumerate(check.support_region_m))
    rows, end_s = [], 0.0
    for k, phase in enumerate(scenario.phases):
        start_s, end_s = end_s, end_s + phase.duration_s
        own = [margin for margin in check.margins if margin.phase == k]
        region, margin_m = tuple(regions.get(k, ())), spare.get(k)
        rows.append(
            PhaseEquilibrium(
                phase=k,
                start_s=start_s,
                end_s=end_s,
                effectors=", ".join(code_words(contact.effector) for contact in phase.contacts) or "none",
                kind=_equilibrium_kind(margin_m, bool(region)),
                margin_m=margin_m,
                edge=_smallest_margin((m.edge_m, f"{code_words(m.effector)} on {m.surface}") for m in own),
                reach_m=min((m.reach_m for m in own if m.reach_m is not None), default=None),
                region_m=region,
            )
        )
    return tuple(rows)


def tightest_phase(phases: Iterable[PhaseEquilibrium]) -> PhaseEquilibrium | None:
    """The phase with the smallest margin of the CoM, the first of equal ones; None without margins."""
    with_margin = [phase for phase in phases if phase.margin_m is not None]
    return min(with_margin, key=lambda phase: round(phase.margin_m or 0.0, EQUAL_DIGITS), default=None)


def equilibrium_summary(phases: tuple[PhaseEquilibrium, ...]) -> str:
    """One or two sentences on the phases in which the robot can rest, and on the smallest margin."""
    rest = sum(phase.kind == "rest" for phase in phases)
    if rest == len(phases):
        text = "The robot could stop and rest in every phase."
    else:
        text = f"The robot could stop and rest in {rest} of {len(phases)} phases."
    least = tightest_phase(phases)
    if least is None or least.margin_m is None:
        return text
    room = f"{100 * least.margin_m:.1f} cm to spare" if least.margin_m >= 0 else f"{-100 * least.margin_m:.1f} cm short"
    return f"{text} It has the least room in phase {least.phase}: {room}."


def equilibrium_bars(phases: tuple[PhaseEquilibrium, ...], duration_s: float) -> list[tuple[Kind, intervals.Bar]]:
    """The phases as bars of a strip."""
    drawn = [(phase, intervals.interval_bars([(phase.start_s, phase.end_s)], duration_s)) for phase in phases]
    return [(phase.kind, bar) for phase, bars in drawn for bar in bars]


def _equilibrium_kind(margin_m: float | None, region: bool) -> Kind:
    if margin_m is None:
        return "unknown" if region else "motion"
    return "rest" if margin_m >= 0 else "motion"


def _smallest_margin(values: Iterable[tuple[float | None, str]]) -> Worst | None:
    margins = [(value, whose) for value, whose in values if value is not None]
    return min(margins, default=None)
