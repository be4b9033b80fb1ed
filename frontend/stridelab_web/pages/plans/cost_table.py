"""The cost of a plan by term: integral, weight, their product, and a bar."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

from stridelab.schemas.plans import CostWeights, PlanMotionSummary
from stridelab_web.formatting import code_words
from stridelab_web.pages.terms.plans import cost_term
from stridelab_web.pages.terms.term import Term

SMALL_S: Final = 0.01
REGULARISERS: Final = ("surface_force", "point_force")
"""Regularisation terms, which are not part of the objective."""
DENSITY: Final = "log_density_"
WRENCH: Final = "wrench"
"""Formulation (input of the job) whose control is the wrench."""
NOT_MINIMISED: Final = (
    "The control of this plan is the wrench: the cost of the forces was not minimised. The forces were computed from "
    "the wrench afterwards, so these two rows cannot be compared with those of a plan whose control is the forces."
)


@dataclass(frozen=True)
class _Kind:
    """A kind of term: ``sign`` is the integral as a formula; units of the integral and of the weight."""

    name: str
    sign: str
    unit: str
    weight: str
    weight_unit: str


_KINDS: Final = {
    "com_acceleration": _Kind("CoM acceleration", "∫ |c̈|² dt", "m²/s³", "com_acceleration", "s⁴/m²"),
    "momentum_rate": _Kind("Angular momentum rate", "∫ |L̇|² dt", "N² m² s", "momentum_rate", "1/(N m)²"),
    "surface_force": _Kind("Forces on soles", "∫ Σ |f / mg|² dt", "s", "surface_force", ""),
    "point_force": _Kind("Forces on hands", "∫ Σ |f / mg|² dt", "s", "point_force", ""),
}


@dataclass(frozen=True)
class CostRow:
    """One term; ``x`` and ``width`` place its bar in percent, a ``regulariser`` is not in the objective."""

    key: str
    name: str
    sign: str
    integral: str
    weight: str
    cost: str
    x: float
    width: float
    regulariser: bool
    explained: Term | None


def cost_rows(summary: PlanMotionSummary) -> list[CostRow]:
    """The terms of the objective, then the regularisers; empty if the plan has none."""
    terms = in_order(summary.cost_terms)
    low, high = min(0.0, 0.0, *terms.values()), max(0.0, 0.0, *terms.values())
    scale = 100.0 / (high - low or 1.0)
    return [
        CostRow(
            key=key,
            name=term_name(key),
            sign=_kind_of_term(key).sign,
            integral=_integral_text(key, value, summary.weights),
            weight=_weight_text(key, summary.weights),
            cost=cost_text(value),
            x=round(scale * (min(value, 0.0) - low), 2),
            width=round(scale * abs(value), 2),
            regulariser=key in REGULARISERS,
            explained=cost_term(key),
        )
        for key, value in terms.items()
    ]


def in_order(terms: Mapping[str, float]) -> dict[str, float]:
    """Terms in the order of the pages: motion, densities by effector, regularisers."""
    ranks = {"com_acceleration": 0, "momentum_rate": 1} | {name: 3 + k for k, name in enumerate(REGULARISERS)}
    return {key: terms[key] for key in sorted(terms, key=lambda key: (ranks.get(key, 2), key))}


def term_name(key: str) -> str:
    """Name of a term of the cost."""
    return _kind_of_term(key).name


def cost_text(value: float, sign: str = "-") -> str:
    """A cost in seconds to four decimals, or to three digits if it is small. ``sign`` as in format specifications."""
    if value == 0:
        return "0 s"
    return f"{value:{sign}.3g} s" if 0 < abs(value) < SMALL_S else f"{value:{sign}z.4f} s"


def weight_of(key: str, weights: CostWeights | None) -> float | None:
    """Weight of a term, or None if unknown."""
    return None if weights is None else float(getattr(weights, _kind_of_term(key).weight))


def _kind_of_term(key: str) -> _Kind:
    if key in _KINDS:
        return _KINDS[key]
    effector = code_words(key.removeprefix(DENSITY))
    return _Kind(f"Negative log-likelihood, {effector}", "−∫ log p(c) dt", "s", "likelihood", "")


def _integral_text(key: str, value: float, weights: CostWeights | None) -> str:
    weight = weight_of(key, weights)
    return f"{value / weight:.4g} {_kind_of_term(key).unit}" if weight else "–"


def _weight_text(key: str, weights: CostWeights | None) -> str:
    weight = weight_of(key, weights)
    return "–" if weight is None else f"{weight:.6g} {_kind_of_term(key).weight_unit}".strip()
