"""Formatting of numbers, verdicts and columns of a reproduction for pages and terminals."""

from collections.abc import Iterable, Mapping
from typing import Final

import numpy as np

from stridelab.reproduction.claims import OUTCOMES, Claim, Column, NoInterval, Outcome, format_three_digits
from stridelab.reproduction.common.intervals import share_interval

UNITS: Final = {"m_s2": ("m/s²", 1.0), "m_s": ("m/s", 1.0), "m": ("mm", 1e3), "s": ("ms", 1e3), "n": ("N", 1.0)}
"""Printed unit and scale by the unit suffix of a column name; longer suffixes come first."""


def format_quantity(value: float, unit: str) -> str:
    """Format with three digits; metres and seconds below 0.1 in thousandths, a ratio without unit."""
    if unit in ("m", "s") and 0 < abs(value) < 0.1:
        value, unit = 1000 * value, f"m{unit}"
    return format_three_digits(value) if unit == "1" else f"{format_three_digits(value)} {unit}"


def claim_numbers(claim: Claim) -> tuple[str, str]:
    """The thesis' number (or words) and ours, as text."""
    thesis = claim.thesis if isinstance(claim.thesis, str) else format_quantity(claim.thesis, claim.unit)
    return thesis, format_quantity(claim.ours, claim.unit)


SOURCES: Final = {"thesis": "thesis", "words": "its words", "ours": "our aim"}
"""Whose the bounds of a claim are."""


def holds_text(claim: Claim) -> str:
    """Range of our number in which the claim holds, and whose bounds these are: "≤ 3.5 mm (thesis)"."""
    low, high = (None if b is None else format_quantity(b, claim.unit) for b in (claim.holds_from, claim.holds_to))
    if low is not None and high is not None:
        text = low if low == high else f"{low} to {high}"
    elif high is not None:
        text = f"{'<' if claim.strict else '≤'} {high}"
    else:
        text = f"{'>' if claim.strict else '≥'} {low}"
    return f"{text} ({SOURCES[claim.threshold]})"


def overturned_by(claim: Claim) -> str:
    """What would overturn the verdict, as a sentence."""
    bounds = holds_text(claim).rpartition(" (")[0]
    what = "number" if claim.interval is None else "95 % interval"
    if claim.verdict == "undecided":
        return f"Decided by an interval inside or outside {bounds}."
    return f"Overturned by a {what} {'outside' if claim.verdict in ('met', 'beaten') else 'inside'} {bounds}."


NO_INTERVAL: Final[dict[NoInterval, str]] = {
    "deterministic": "deterministic",
    "in_claim": "sampling error is in the claim",
    "one_case": "one case, no interval",
    "one_sample": "one sample, no interval",
    "machine_time": "time of one machine, no interval",
}


def uncertainty_text(claim: Claim) -> str:
    """95 % interval of our number; of the share of cases in the range for a claim on every case; or why it has none."""
    if claim.interval is not None:
        low, high = (format_quantity(bound, claim.unit) for bound in claim.interval)
        return f"95 % from {low} to {high}"
    if claim.cases_inside is not None and claim.n is not None:
        low, high = map(format_three_digits, share_interval(claim.cases_inside, claim.n))
        return f"{claim.cases_inside} of {claim.n} in the range, 95 % from {low} to {high} of all"
    return "" if claim.no_interval is None else NO_INTERVAL[claim.no_interval]


def basis_text(claim: Claim) -> str:
    """What our number is computed from: evidence, number of cases, solver, comparator, and ``uncertainty_text``.

    "simulated, n = 50; 95 % from 0.2 to 0.3", "simulated, deterministic, n = 1".
    """
    certain = claim.no_interval == "deterministic"
    parts = [f"{claim.evidence}, {'deterministic, ' if certain else ''}n = {claim.n}"]
    if claim.solver is not None:
        parts.append(f"solver {claim.solver}")
    if claim.comparator is not None:
        parts.append(f"against {claim.comparator}")
    if not certain and (text := uncertainty_text(claim)):
        parts.append(text)
    return "; ".join(parts)


def count_outcomes(claims: Iterable[Claim]) -> dict[Outcome, int]:
    """Number of claims by verdict on the thesis, and of our aims reached and missed, in the order of ``OUTCOMES``."""
    given = [claim.outcome for claim in claims]
    return {outcome: given.count(outcome) for outcome in OUTCOMES}


def table_cells(columns: Mapping[str, Column]) -> tuple[list[str], list[tuple[str, ...]]]:
    """Headings and rows of a table; the unit suffix of a column name moves into its heading."""
    heads, values = zip(*(_format_column(name, column) for name, column in columns.items()), strict=True)
    return list(heads), list(zip(*values, strict=True))


def _format_column(name: str, values: Column) -> tuple[str, list[str]]:
    if values.dtype.kind not in "fi":
        return name.replace("_", " "), [str(value) for value in values]
    ending = next((ending for ending in UNITS if name.endswith(f"_{ending}")), None)
    unit, scale = UNITS[ending] if ending else ("", 1.0)
    head = name.removesuffix(f"_{ending}")
    written = ["" if not np.isfinite(value) else format_three_digits(scale * value) for value in values.astype(float)]
    return f"{head} {unit}".replace("_", " ").strip(), written
