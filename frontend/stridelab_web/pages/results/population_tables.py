"""Correlations and mixed models of a population as text, with the thesis' values."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

from stridelab.schemas.population import CorrelationResult, MixedModelResult, StudyPopulationSummary
from stridelab.translations.catalogue import gettext, ngettext
from stridelab_web.formatting import code_words
from stridelab_web.pages.results.cycloid_steps import PARAMETERS, Parameter
from stridelab_web.pages.results.population_charts import AGAINST

THESIS_P: Final = {
    ("R_m", "height_m"): "p < 0.01",
    ("r_m", "height_m"): "p < 0.01",
    ("z0_m", "height_m"): "p ≤ 0.001",
    ("omega_rad_s", "height_m"): "weak, p ≥ 0.83",
}
"""The p values of the thesis (figs. 3.7 to 3.9), which prints no coefficient for omega."""
NAMED: Final = 3
"""Correlations that the answer names, the strongest ones."""
LETTERS: Final = {p.key: p.letter for p in PARAMETERS}
QUANTITY_NAMES: Final = {a.key: a.name.lower() for a in AGAINST}


@dataclass(frozen=True)
class Row:
    """One correlation as text; ``clear`` if its interval excludes zero. Ranks and partials have intervals."""

    pair: CorrelationResult
    letter: str
    against: str
    r: str
    interval: str
    bootstrap: str
    p: str
    p_holm: str
    ranks: tuple[str, str]
    partials: tuple[tuple[str, str], ...]
    thesis: str
    clear: bool


@dataclass(frozen=True)
class ModelRow:
    """One mixed model as text."""

    model: MixedModelResult
    letter: str
    effects: tuple[str, ...]
    between: str
    within: str
    unit: str


def correlation_rows(summary: StudyPopulationSummary) -> tuple[Row, ...]:
    """All correlations in the order of the pages: by group, parameter, and quantity."""
    groups = list(dict.fromkeys(pair.group for pair in summary.correlations))
    letters, places = list(LETTERS), list(QUANTITY_NAMES)

    def sort_key(pair: CorrelationResult) -> tuple[int, int, int]:
        return groups.index(pair.group), letters.index(pair.parameter), places.index(pair.against)

    return tuple(_correlation_row(pair) for pair in sorted(summary.correlations, key=sort_key))


def _correlation_row(pair: CorrelationResult) -> Row:
    partials = {one.on: (f"{one.r:+.2f}", interval_text(one.ci95)) for one in pair.partial}
    ranks = ("–", "") if pair.spearman is None else (f"{pair.spearman:+.2f}", interval_text(pair.spearman_ci95))
    thesis = [] if pair.thesis is None else [f"{pair.thesis:.2f}"]
    if thesis_p := THESIS_P.get((pair.parameter, pair.against)):
        thesis.append(thesis_p)
    return Row(
        pair=pair,
        letter=LETTERS[pair.parameter],
        against=gettext(QUANTITY_NAMES[pair.against]),
        r=f"{pair.r:+.2f}",
        interval=interval_text(pair.ci95),
        bootstrap=interval_text(pair.bootstrap_ci95),
        p=p_value_text(pair.p),
        p_holm=p_value_text(pair.p_holm),
        ranks=ranks,
        partials=tuple(("", "") if a.key == pair.against else partials.get(a.key, ("–", "")) for a in AGAINST),
        thesis=", ".join(thesis),
        clear=pair.ci95 is not None and (pair.ci95[0] > 0 or pair.ci95[1] < 0),
    )


def population_answer(summary: StudyPopulationSummary, rows: Sequence[Row]) -> str:
    """The answer of a study: which parameters of the wheel correlate clearly, in the group of all subjects."""
    group = rows[0].pair.group if rows else ""
    own = [row for row in rows if row.pair.group == group]
    clear = sorted((row for row in own if row.clear), key=lambda row: -abs(row.pair.r))
    people = ngettext("%(num)s subject", "%(num)s subjects", len(summary.subjects))
    if not own:
        return gettext("%(people)s: too few for a correlation.", people=people)
    if not clear:
        return gettext(
            "%(people)s: none of %(number)s correlations is clear (every 95 %% interval contains zero).",
            people=people,
            number=len(own),
        )
    named = ", ".join(
        gettext("%(parameter)s with %(quantity)s (r = %(r)s)", parameter=row.letter, quantity=row.against, r=row.r)
        for row in clear[:NAMED]
    )
    if len(clear) > NAMED:
        named = gettext("%(checks)s and %(number)s more", checks=named, number=len(clear) - NAMED)
    return gettext(
        "%(people)s: %(clear)s of %(number)s correlations are clear (95 %% interval without zero): %(named)s.",
        people=people,
        clear=len(clear),
        number=len(own),
        named=named,
    )


def model_rows(summary: StudyPopulationSummary) -> tuple[ModelRow, ...]:
    """All mixed models."""
    by_key = {p.key: p for p in PARAMETERS}
    return tuple(_model_row(one, by_key[one.parameter]) for one in summary.mixed_models)


def _model_row(one: MixedModelResult, parameter: Parameter) -> ModelRow:
    factor, unit = parameter.factor, parameter.unit
    effects = tuple(
        f"{gettext(QUANTITY_NAMES.get(e.name, code_words(e.name)))}: {three_digits(factor * e.value)}"
        f" [{three_digits(factor * e.ci95[0])}, {three_digits(factor * e.ci95[1])}]"
        for e in one.effects
    )
    between, within = three_digits(factor * one.subject_sd), three_digits(factor * one.step_sd)
    return ModelRow(one, parameter.letter, effects, between, within, unit)


def interval_text(bounds: Sequence[float] | None) -> str:
    """An interval with two decimals; empty for None."""
    return "" if bounds is None else f"[{bounds[0]:z.2f}, {bounds[1]:z.2f}]"


def three_digits(value: float) -> str:
    """Three digits, without an exponent."""
    return f"{float(f'{value:.3g}'):zf}".rstrip("0").rstrip(".")


def p_value_text(p: float) -> str:
    """A p value to three decimals."""
    return "< 0.001" if p < 0.001 else f"{p:.3f}"
