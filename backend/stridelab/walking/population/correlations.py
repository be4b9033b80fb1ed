"""Pearson, Spearman and partial correlations of small samples of subjects, with confidence intervals.

With n subjects and k control variables, atanh(r) is approximately normal with variance 1 / (n - 3 - k) (Fisher 1924);
for ranks the variance is (1 + r^2 / 2) / (n - 3) (Bonett & Wright 2000). The bootstrap interval (BCa, Efron 1987) does
not assume a normal distribution; it resamples subjects, not steps.
"""

from dataclasses import dataclass
from typing import Final, Literal

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.special import ndtr, ndtri, stdtr
from scipy.stats import rankdata

from stridelab.conventions import Series

MIN_SUBJECTS: Final = 4
"""Minimum number of subjects: below four, Fisher's variance is infinite."""
RESAMPLES: Final = 2000
NO_SPREAD: Final = 1e-12
"""Spread (relative to the values) below which a variable is constant and has no correlation."""
PERFECT: Final = 1.0 - 1e-12
SAME: Final = 1e-12
"""Coefficients that differ by less are equal: samples that are permutations of one another differ by rounding alone."""
_95: Final = float(ndtri(0.975))

Interval = tuple[float, float]
Rows = Float[np.ndarray, "b n"]
Kind = Literal["pearson", "spearman"]


@dataclass(frozen=True)
class Correlation:
    """Coefficient with its two-sided p (Student's t) and 95 % intervals: Fisher's and optionally BCa.

    ``controlled`` is the number of control variables; ``ci95`` is None with too few subjects.
    """

    n: int
    r: float
    p: float
    ci95: Interval | None
    bootstrap_ci95: Interval | None = None
    controlled: int = 0


def pearson(x: Series, y: Series, *, draws: Int[np.ndarray, "b n"] | None = None) -> Correlation | None:
    """Correlation of values; None for fewer than four pairs or a constant variable.

    ``draws`` are bootstrap indices for the BCa interval, None to omit it.
    """
    return _correlate_values(x, y, "pearson", draws)


def spearman(x: Series, y: Series, *, draws: Int[np.ndarray, "b n"] | None = None) -> Correlation | None:
    """Correlation of ranks, with mean ranks for ties; None as for ``pearson``."""
    return _correlate_values(x, y, "spearman", draws)


def partial_correlation(x: Series, y: Series, held: Float[np.ndarray, "n k"]) -> Correlation | None:
    """Partial Pearson correlation of x and y, controlled for ``held``.

    None without a degree of freedom, or if a variable is constant or a linear combination of ``held``.
    """
    n, k = held.shape
    if n - 2 - k < 1 or _is_constant(x) or _is_constant(y):
        return None
    design = np.column_stack([np.ones(n), held - held.mean(axis=0)])
    left = []
    for values in (x - x.mean(), y - y.mean()):
        rest = values - design @ np.linalg.lstsq(design, values, rcond=None)[0]
        if np.linalg.norm(rest) < 1e-9 * np.linalg.norm(values):
            return None
        left.append(rest)
    r = _clip_coefficient(float(left[0] @ left[1] / (np.linalg.norm(left[0]) * np.linalg.norm(left[1]))))
    return Correlation(n, r, two_sided_p(r, n - 2 - k), fisher_interval(r, n, controlled=k), controlled=k)


def fisher_interval(r: float, n: int, *, controlled: int = 0, ranks: bool = False) -> Interval | None:
    """95 % interval on Fisher's scale; None for fewer than one degree of freedom."""
    freedom = n - 3 - controlled
    if freedom < 1:
        return None
    if abs(r) >= PERFECT:
        return (r, r)
    half = _95 * float(np.sqrt((1.0 + r * r / 2 if ranks else 1.0) / freedom))
    return (float(np.tanh(np.arctanh(r) - half)), float(np.tanh(np.arctanh(r) + half)))


def two_sided_p(r: float, freedom: int) -> float:
    """Two-sided p of a coefficient by Student's t with ``freedom`` degrees of freedom."""
    if abs(r) >= PERFECT:
        return 0.0
    t = abs(r) * np.sqrt(freedom / (1.0 - r * r))
    return float(2.0 * stdtr(freedom, -t))


def bootstrap_indices(n: int, *, seed: int, count: int = RESAMPLES) -> Int[np.ndarray, "count n"]:
    """Bootstrap indices: ``count`` samples of n subjects drawn with replacement, reproducible by ``seed``."""
    return np.random.default_rng(seed).integers(0, n, size=(count, n))


def holm_correction(p: Series) -> Series:
    """p-values corrected for multiple comparisons (Holm 1979), in the given order."""
    order = np.argsort(p)
    factors = len(p) - np.arange(len(p))
    corrected = np.empty_like(p)
    corrected[order] = np.minimum(np.maximum.accumulate(p[order] * factors), 1.0)
    return corrected


def _correlate_values(x: Series, y: Series, kind: Kind, draws: Int[np.ndarray, "b n"] | None) -> Correlation | None:
    n = len(x)
    if n < MIN_SUBJECTS or _is_constant(x) or _is_constant(y):
        return None
    r = float(_row_coefficients(x[None], y[None], kind)[0])
    ci95 = fisher_interval(r, n, ranks=kind == "spearman")
    return Correlation(
        n, r, two_sided_p(r, n - 2), ci95, None if draws is None else _bca_interval(x, y, kind, r, draws)
    )


def _bca_interval(x: Series, y: Series, kind: Kind, r: float, draws: Int[np.ndarray, "b n"]) -> Interval | None:
    """Bias-corrected and accelerated 95 % interval (Efron 1987); None if most samples have no correlation."""
    n = len(x)
    drawn = _row_coefficients(x[draws], y[draws], kind)
    drawn = drawn[np.isfinite(drawn)]
    if len(drawn) < len(draws) // 2:
        return None
    others = np.array([np.delete(np.arange(n), i) for i in range(n)])
    without = _row_coefficients(x[others], y[others], kind)
    if not np.isfinite(without).all():
        return None
    below = float((drawn < r - SAME).mean() + (drawn <= r + SAME).mean()) / 2
    if not 0.0 < below < 1.0:  # nearly all samples have the same coefficient
        return (float(drawn.min()), float(drawn.max()))
    off = without.mean() - without
    spread = float((off**2).sum())
    skew = 0.0 if spread == 0.0 else float((off**3).sum()) / (6.0 * spread**1.5)
    bias = float(ndtri(below))
    ends = np.array([bias - _95, bias + _95])
    low, high = np.quantile(drawn, ndtr(bias + ends / (1.0 - skew * ends)))
    return (float(low), float(high))


def _row_coefficients(x: Rows, y: Rows, kind: Kind) -> Float[np.ndarray, "b"]:
    """Coefficient of every row; NaN for a constant row."""
    if kind == "spearman":
        x, y = rankdata(x, axis=1), rankdata(y, axis=1)
    dx, dy = x - x.mean(axis=1, keepdims=True), y - y.mean(axis=1, keepdims=True)
    size = np.sqrt((dx**2).sum(axis=1) * (dy**2).sum(axis=1))
    flat = _flat_rows(x, dx) | _flat_rows(y, dy)
    r = np.full(len(x), np.nan)
    np.divide((dx * dy).sum(axis=1), size, out=r, where=~flat)
    return np.asarray(np.clip(r, -1.0, 1.0))


def _flat_rows(rows: Rows, deviations: Rows) -> Bool[np.ndarray, "b"]:
    return np.asarray(np.abs(deviations).max(axis=1) <= NO_SPREAD * np.abs(rows).max(axis=1))


def _is_constant(values: Series) -> bool:
    return bool(np.ptp(values) <= NO_SPREAD * np.abs(values).max())


def _clip_coefficient(r: float) -> float:
    return min(max(r, -1.0), 1.0)
