"""Linear model with a random intercept per subject: y_ij = x_ij b + u_i + e_ij, u ~ N(0, tau^2), e ~ N(0, sigma^2).

Steps of one subject are correlated, so eleven subjects with ten steps each are not 110 independent measurements. The
covariance of a subject's n_i values is sigma^2 (1 + lambda 11^T) with lambda = tau^2 / sigma^2; its inverse and
determinant are closed forms, b and sigma^2 are closed forms for a given lambda, and the likelihood is minimised over
lambda alone (restricted likelihood: Patterson & Thompson 1971; profile: Laird & Ware 1982).
"""

from dataclasses import dataclass
from typing import Final, Literal

import numpy as np
from jaxtyping import Float, Int
from scipy.optimize import minimize_scalar
from scipy.special import stdtr, stdtrit

from stridelab.conventions import Series
from stridelab.errors import NotEstimable

LAMBDA_RANGE: Final = (1e-6, 1e7)
"""Search range of tau^2 / sigma^2; 0 is tested separately, and above the range steps of a subject do not differ."""
GRID: Final = 27
EVEN_WITHIN: Final = 1e-9
"""Relative spread within subjects below which a variable counts as constant per subject."""

Method = Literal["reml", "ml"]
Columns = Float[np.ndarray, "N p"]


@dataclass(frozen=True)
class Effect:
    """One coefficient: value, standard error, degrees of freedom, two-sided p and 95 % interval."""

    name: str
    value: float
    sd: float
    freedom: int
    p: float
    ci95: tuple[float, float]


@dataclass(frozen=True)
class MixedModel:
    """The fitted model; ``icc`` is the share of the variance between subjects, given the effects.

    ``log_likelihood`` is the restricted one for ``reml``. ``on_bound`` is True if subjects do not differ by more than
    their steps (tau = 0).
    """

    method: Method
    effects: tuple[Effect, ...]
    subject_sd: float
    step_sd: float
    log_likelihood: float
    n_people: int
    n_steps: int
    on_bound: bool

    @property
    def icc(self) -> float:
        """tau^2 / (tau^2 + sigma^2)."""
        total = self.subject_sd**2 + self.step_sd**2
        return 0.0 if total == 0.0 else self.subject_sd**2 / total

    def effect(self, name: str) -> Effect:
        """Coefficient by name; raises ``KeyError`` if the model does not have it."""
        return {effect.name: effect for effect in self.effects}[name]


def fit_mixed_model(
    y: Series, effects: dict[str, Series], person: Int[np.ndarray, "N"], *, method: Method = "reml"
) -> MixedModel:
    """Fit y on an intercept and ``effects`` (name to values), with a random intercept per ``person`` (any integers).

    Standard errors are conditional on the estimated lambda. Their degrees of freedom are those between subjects for a
    variable that is constant per subject, else those within subjects (Schluchter & Elashoff 1990). Raises
    ``NotEstimable``: ``mixed-model-no-repeats`` if no subject has two steps, ``mixed-model-too-few`` without more
    subjects and steps than coefficients, ``mixed-model-collinear``, and ``mixed-model-steps-alike`` if the steps of
    each subject are equal.
    """
    _, who = np.unique(person, return_inverse=True)
    m, N = int(who.max()) + 1 if len(who) else 0, len(y)
    if m == N:
        raise NotEstimable("mixed-model-no-repeats", "Every subject has only one step, so steps do not repeat.")
    names = ("level", *effects)
    centres = [0.0, *(float(v.mean()) for v in effects.values())]
    X = np.column_stack([np.ones(N), *(v - c for v, c in zip(effects.values(), centres[1:], strict=True))])
    scale = np.array([1.0, *(float(np.std(column)) for column in X[:, 1:].T)])
    if (scale == 0.0).any() or np.linalg.matrix_rank(X / scale) < len(names):
        raise NotEstimable("mixed-model-collinear", f"These do not vary independently: {', '.join(names[1:])}.")
    between = np.array([_is_between_subjects(column, who, m) for column in X.T])
    freedoms = (m - int(between.sum()), N - m - int((~between).sum()))
    if min(freedoms) < 1:
        raise NotEstimable(
            "mixed-model-too-few", f"{m} subjects with {N} steps are too few for {len(names)} coefficients."
        )
    sums = _Sums.from_data(y - y.mean(), X / scale, who, m)
    lam = _best_lambda(sums, method)
    if lam > 0.99 * LAMBDA_RANGE[1]:
        raise NotEstimable("mixed-model-steps-alike", "The steps of each subject are identical: there is no spread.")
    b, rss, gram, objective = sums.solve_for_lambda(lam, method)
    variance = rss / (N - len(names) if method == "reml" else N)
    covariance = variance * np.linalg.inv(gram) / np.outer(scale, scale)
    coefficients = _uncentred_effects(b / scale, covariance, centres, float(y.mean()))
    return MixedModel(
        method=method,
        effects=tuple(
            _effect_statistics(name, value, sd, freedoms[0] if is_between else freedoms[1])
            for name, value, sd, is_between in zip(names, *coefficients, between, strict=True)
        ),
        subject_sd=float(np.sqrt(lam * variance)),
        step_sd=float(np.sqrt(variance)),
        log_likelihood=-0.5 * objective - (float(np.log(scale).sum()) if method == "reml" else 0.0),
        n_people=m,
        n_steps=N,
        on_bound=lam == 0.0,
    )


@dataclass(frozen=True)
class _Sums:
    """Sufficient statistics of the likelihood: totals over the steps, and sums per subject."""

    counts: Series
    XX: Float[np.ndarray, "p p"]
    Xy: Float[np.ndarray, "p"]
    yy: float
    X_of: Float[np.ndarray, "m p"]
    y_of: Float[np.ndarray, "m"]

    @classmethod
    def from_data(cls, y: Series, X: Columns, who: Int[np.ndarray, "N"], m: int) -> "_Sums":
        X_of, y_of = np.zeros((m, X.shape[1])), np.zeros(m)
        np.add.at(X_of, who, X)
        np.add.at(y_of, who, y)
        return cls(np.bincount(who, minlength=m).astype(float), X.T @ X, X.T @ y, float(y @ y), X_of, y_of)

    def solve_for_lambda(
        self, lam: float, method: Method
    ) -> tuple[Float[np.ndarray, "p"], float, Float[np.ndarray, "p p"], float]:
        """b, weighted residual sum of squares, weighted Gram matrix, and -2 log likelihood for one lambda."""
        shared = lam / (1.0 + lam * self.counts)  # (1 + lambda 11^T)^-1 = 1 - shared 11^T
        gram = self.XX - (self.X_of * shared[:, None]).T @ self.X_of
        right = self.Xy - self.X_of.T @ (shared * self.y_of)
        b = np.linalg.solve(gram, right)
        rss = max(self.yy - float(shared @ self.y_of**2) - float(right @ b), np.finfo(float).tiny)
        N, p = float(self.counts.sum()), len(b)
        volume = float(np.log1p(lam * self.counts).sum())
        if method == "ml":
            return b, rss, gram, N * (np.log(2 * np.pi * rss / N) + 1.0) + volume
        free = N - p
        restricted = float(np.linalg.slogdet(gram)[1])
        return b, rss, gram, free * (np.log(2 * np.pi * rss / free) + 1.0) + volume + restricted


def _best_lambda(sums: _Sums, method: Method) -> float:
    """Minimum over a grid of log lambda, refined between its neighbours; 0 if that is as good."""

    def objective(log_lambda: float) -> float:
        return float(sums.solve_for_lambda(float(np.exp(log_lambda)), method)[3])

    grid = np.linspace(np.log(LAMBDA_RANGE[0]), np.log(LAMBDA_RANGE[1]), GRID)
    values = [objective(float(x)) for x in grid]
    k = int(np.argmin(values))
    refined = minimize_scalar(
        objective, bounds=(grid[max(k - 1, 0)], grid[min(k + 1, GRID - 1)]), method="bounded", options={"xatol": 1e-10}
    )
    return 0.0 if sums.solve_for_lambda(0.0, method)[3] <= refined.fun + 1e-9 else float(np.exp(refined.x))


def _is_between_subjects(column: Series, who: Int[np.ndarray, "N"], m: int) -> bool:
    means = np.bincount(who, column, minlength=m) / np.bincount(who, minlength=m)
    return bool(np.abs(column - means[who]).max() <= EVEN_WITHIN * max(float(np.abs(column).max()), 1e-300))


def _uncentred_effects(
    b: Float[np.ndarray, "p"], covariance: Float[np.ndarray, "p p"], centres: list[float], y_mean: float
) -> tuple[list[float], list[float]]:
    """Coefficients and standard errors for variables that are not centred at their means."""
    to_origin = np.eye(len(b))
    to_origin[0, 1:] = -np.array(centres[1:])
    value = to_origin @ b
    value[0] += y_mean
    sd = np.sqrt(np.maximum(np.diag(to_origin @ covariance @ to_origin.T), 0.0))
    return value.tolist(), sd.tolist()


def _effect_statistics(name: str, value: float, sd: float, freedom: int) -> Effect:
    half = float(stdtrit(freedom, 0.975)) * sd
    p = float(2.0 * stdtr(freedom, -abs(value) / sd)) if sd > 0.0 else 0.0
    return Effect(name, value, sd, freedom, p, (value - half, value + half))
