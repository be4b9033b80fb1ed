"""The mixed model against the closed form of a balanced design, dense matrices, and simulated people."""

import numpy as np
import pytest
from scipy.optimize import minimize
from scipy.stats import multivariate_normal

from stridelab.errors import NotEstimable
from stridelab.walking.population.mixed_model import Method, MixedModel, fit_mixed_model


def steps(
    m: int, n: int, *, seed: int, tau: float = 0.9, sigma: float = 0.4
) -> tuple[np.ndarray, dict[str, np.ndarray], np.ndarray]:
    """n (or fewer) steps of m people: a height each, a speed per step."""
    rng = np.random.default_rng(seed)
    person = np.repeat(np.arange(m), rng.integers(2, n + 1, m) if n > 2 else n)
    height, speed = rng.normal(1.7, 0.08, m)[person], rng.normal(1.2, 0.2, len(person))
    y = 9.0 + 2.0 * height + 1.5 * speed + rng.normal(0, tau, m)[person] + rng.normal(0, sigma, len(person))
    return y, {"height_m": height, "speed_m_s": speed}, person


@pytest.mark.parametrize(("m", "n"), [(11, 2), (5, 10), (30, 4)])
def test_a_balanced_design_has_the_closed_form_of_the_analysis_of_variance(m: int, n: int) -> None:
    rng = np.random.default_rng(m)
    table = 10.0 + rng.normal(0, 1.0, (m, 1)) + rng.normal(0, 0.5, (m, n))
    within = ((table - table.mean(axis=1, keepdims=True)) ** 2).sum() / (m * (n - 1))
    between = n * table.mean(axis=1).var(ddof=1)
    fit = fit_mixed_model(table.ravel(), {}, np.repeat(np.arange(m), n))
    assert fit.step_sd**2 == pytest.approx(within, rel=1e-6)
    assert fit.subject_sd**2 == pytest.approx((between - within) / n, rel=1e-6)
    level = fit.effect("level")
    assert level.value == pytest.approx(table.mean())
    assert level.sd == pytest.approx(np.sqrt(between / (m * n)), rel=1e-6)
    assert level.freedom == m - 1


def test_a_paired_design_has_the_t_of_the_paired_test() -> None:
    rng = np.random.default_rng(7)
    pairs = rng.normal(0, 1.0, (12, 1)) + np.array([0.0, 0.4]) + rng.normal(0, 0.5, (12, 2))
    fit = fit_mixed_model(pairs.ravel(), {"fast": np.tile([0.0, 1.0], 12)}, np.repeat(np.arange(12), 2))
    difference = pairs[:, 1] - pairs[:, 0]
    fast = fit.effect("fast")
    assert fast.value == pytest.approx(difference.mean())
    assert fast.sd == pytest.approx(difference.std(ddof=1) / np.sqrt(12), rel=1e-6)
    assert fast.freedom == 11


@pytest.mark.parametrize("method", ["reml", "ml"])
def test_an_uneven_design_has_the_largest_likelihood_of_the_dense_matrices(method: Method) -> None:
    y, effects, person = steps(9, 7, seed=3)
    X = np.column_stack([np.ones(len(y)), *effects.values()])
    Z = (person[:, None] == np.arange(9)).astype(float)

    def minus_log_likelihood(log_sds: np.ndarray) -> float:
        tau, sigma = np.exp(log_sds)
        V = sigma**2 * np.eye(len(y)) + tau**2 * Z @ Z.T
        W = np.linalg.inv(V)
        b = np.linalg.solve(X.T @ W @ X, X.T @ W @ y)
        plain = -multivariate_normal(X @ b, V).logpdf(y)
        if method == "ml":
            return float(plain)
        return float(plain + 0.5 * np.linalg.slogdet(X.T @ W @ X)[1] - 0.5 * X.shape[1] * np.log(2 * np.pi))

    best = minimize(minus_log_likelihood, [0.0, 0.0], method="Nelder-Mead", options={"xatol": 1e-9, "fatol": 1e-12})
    fit = fit_mixed_model(y, effects, person, method=method)
    assert [fit.subject_sd, fit.step_sd] == pytest.approx(np.exp(best.x), rel=1e-4)
    assert fit.log_likelihood == pytest.approx(-best.fun, abs=1e-7)
    V = fit.step_sd**2 * np.eye(len(y)) + fit.subject_sd**2 * Z @ Z.T
    covariance = np.linalg.inv(X.T @ np.linalg.solve(V, X))
    b = covariance @ X.T @ np.linalg.solve(V, y)
    assert [e.value for e in fit.effects] == pytest.approx(b, rel=1e-6)
    if method == "reml":
        assert [e.sd for e in fit.effects] == pytest.approx(np.sqrt(np.diag(covariance)), rel=1e-6)
    assert {e.name: e.freedom for e in fit.effects} == {"level": 7, "height_m": 7, "speed_m_s": len(y) - 9 - 1}


def test_people_who_are_all_alike_have_no_spread_of_their_own() -> None:
    table = np.tile([1.0, 2.0, 3.0, 2.5], 6)
    fit = fit_mixed_model(table, {}, np.repeat(np.arange(6), 4))
    assert fit.on_bound
    assert fit.subject_sd == 0.0
    assert fit.icc == 0.0
    assert fit.step_sd == pytest.approx(table.std(ddof=1))


def test_the_parameters_of_simulated_people_are_recovered() -> None:
    fits = [fit_mixed_model(*steps(24, 6, seed=s)) for s in range(200)]
    assert np.mean([f.subject_sd**2 for f in fits]) == pytest.approx(0.81, rel=0.05)
    assert np.mean([f.step_sd**2 for f in fits]) == pytest.approx(0.16, rel=0.05)

    def cover(name: str, truth: float) -> float:
        def holds(fit: MixedModel) -> bool:
            low, high = fit.effect(name).ci95
            return low <= truth <= high

        return float(np.mean([holds(f) for f in fits]))

    assert 0.91 <= cover("height_m", 2.0) <= 0.985
    assert 0.91 <= cover("speed_m_s", 1.5) <= 0.985


def test_intervals_of_steps_taken_for_people_are_too_narrow() -> None:
    """What the model is for: an effect of height that is not there."""
    sure_of_steps = sure_of_people = 0
    for seed in range(150):
        rng = np.random.default_rng(seed)
        person = np.repeat(np.arange(11), 10)
        height = rng.normal(1.7, 0.08, 11)[person]
        y = rng.normal(0, 1.0, 11)[person] + rng.normal(0, 0.3, 110)
        t = np.corrcoef(height, y)[0, 1]
        sure_of_steps += abs(t) * np.sqrt(108 / (1 - t**2)) > 1.98
        sure_of_people += fit_mixed_model(y, {"height_m": height}, person).effect("height_m").p < 0.05
    assert sure_of_steps > 75
    assert sure_of_people < 16


def test_units_do_not_matter() -> None:
    y, effects, person = steps(9, 5, seed=1)
    metres = fit_mixed_model(y, effects, person)
    scaled = fit_mixed_model(1e3 * y, {n: 1e3 * v for n, v in effects.items()}, person + 100)
    assert [e.value for e in scaled.effects[1:]] == pytest.approx([e.value for e in metres.effects[1:]])
    assert scaled.subject_sd == pytest.approx(1e3 * metres.subject_sd, rel=1e-6)


@pytest.mark.parametrize(
    ("code", "y", "effects", "person"),
    [
        ("mixed-model-no-repeats", [1.0, 2.0, 3.0], {}, [0, 1, 2]),
        ("mixed-model-no-repeats", [], {}, []),
        ("mixed-model-too-few", [1.0, 2.0, 3.0], {"height_m": [1.6, 1.6, 1.7]}, [0, 0, 1]),
        ("mixed-model-too-few", [1.0, 2.0], {}, [0, 0]),
        ("mixed-model-steps-alike", [1.0, 1.0, 2.0, 2.0, 4.0, 4.0], {}, [0, 0, 1, 1, 2, 2]),
        ("mixed-model-collinear", [1.0, 2.0, 3.0, 5.0, 4.0, 7.0], {"height_m": [1.7] * 6}, [0, 0, 1, 1, 2, 2]),
    ],
)
def test_a_design_that_cannot_be_fitted_is_refused(
    code: str, y: list[float], effects: dict[str, list[float]], person: list[int]
) -> None:
    with pytest.raises(NotEstimable) as refused:
        fit_mixed_model(np.array(y), {n: np.array(v) for n, v in effects.items()}, np.array(person, dtype=np.int64))
    assert refused.value.code == code
