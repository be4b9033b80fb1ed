"""The hierarchy against a sequential reference, its strictness, and what it says when there is no solution."""

import numpy as np
import pytest
from scipy.optimize import minimize

from stridelab.centroidal.native.availability import NativeSolver, NativeUnavailable, native_availability
from stridelab.wholebody.control import hierarchical_qp
from stridelab.wholebody.control.hierarchical_qp import Inequalities, Rows, minimum_violations, solve_hierarchy

N = 12
needs_module = pytest.mark.skipif(not isinstance(native_availability(), NativeSolver), reason="the module is not built")


@pytest.fixture(autouse=True, params=[pytest.param("module", marks=needs_module), "numpy"])
def reduction(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> None:
    """Every test runs with the C++ module and without it."""
    if request.param == "numpy":
        monkeypatch.setattr(hierarchical_qp, "native_availability", lambda: NativeUnavailable("not in this test"))


def problem(seed: int, tight: float) -> tuple[Rows, list[Rows], Inequalities]:
    """Random levels; ``tight`` scales the room that the inequalities leave around a point of the equalities."""
    rng = np.random.default_rng(seed)
    equality = Rows(rng.normal(size=(3, N)), rng.normal(size=3))
    levels = [Rows(rng.normal(size=(m, N)), rng.normal(size=m) * 3.0) for m in (4, 3, 10)]
    inside = np.linalg.lstsq(equality.A, equality.b)[0]
    G = rng.normal(size=(15, N))
    room = tight * rng.uniform(0.5, 1.5, size=15)
    return equality, levels, Inequalities(G, G @ inside - room, G @ inside + 2.0 * room)


def residual(rows: Rows, z: np.ndarray) -> float:
    return float(np.linalg.norm(rows.A @ z - rows.b))


def reference(equality: Rows, levels: list[Rows], bounds: Inequalities) -> list[float]:
    """Optimal residual of every level, one constrained least-squares problem after the other."""
    held = [(equality.A, equality.b)]
    best: list[float] = []
    z = np.linalg.lstsq(equality.A, equality.b)[0]
    for A, b in levels:
        constraints = [{"type": "eq", "fun": lambda x, A=A_, b=b_: A @ x - b} for A_, b_ in held]
        constraints.append({"type": "ineq", "fun": lambda x: np.concatenate(
            [bounds.upper - bounds.G @ x, bounds.G @ x - bounds.lower])})  # fmt: skip
        result = minimize(
            lambda x, A=A, b=b: 0.5 * np.sum((A @ x - b) ** 2),
            z,
            jac=lambda x, A=A, b=b: A.T @ (A @ x - b),
            constraints=constraints,
            method="SLSQP",
            options={"maxiter": 500, "ftol": 1e-14},
        )
        z = result.x
        best.append(float(np.linalg.norm(A @ z - b)))
        held.append((A, A @ z))
    return best


@pytest.mark.parametrize("tight", [0.4, 1.5, 50.0])
@pytest.mark.parametrize("seed", range(12))
def test_every_level_is_as_good_as_the_levels_above_allow(seed: int, tight: float) -> None:
    equality, levels, bounds = problem(seed, tight)
    result = solve_hierarchy(equality, levels, bounds)
    assert result.failure is None
    assert np.allclose(equality.A @ result.z, equality.b, atol=1e-9)
    assert np.all(bounds.G @ result.z <= bounds.upper + 1e-6)
    assert np.all(bounds.G @ result.z >= bounds.lower - 1e-6)
    for level, best in zip(levels, reference(equality, levels, bounds), strict=True):
        assert residual(level, result.z) == pytest.approx(best, abs=2e-5)


@pytest.mark.parametrize("tight", [0.4, 50.0])
@pytest.mark.parametrize("seed", range(20))
def test_a_lower_level_never_disturbs_a_higher_one(seed: int, tight: float) -> None:
    equality, levels, bounds = problem(seed, tight)
    both, other = levels[:2], [*levels[:2], Rows(-5.0 * levels[2].A, levels[2].b + 7.0)]
    with_third, with_other = solve_hierarchy(equality, levels, bounds), solve_hierarchy(equality, other, bounds)
    alone = solve_hierarchy(equality, both, bounds)
    for level in both:
        assert np.allclose(level.A @ with_third.z, level.A @ with_other.z, atol=1e-7)
        assert residual(level, with_third.z) == pytest.approx(residual(level, alone.z), abs=1e-7)
    assert np.allclose(levels[0].A @ with_third.z, levels[0].A @ alone.z, atol=1e-8)


def test_levels_that_can_be_met_cost_one_programme_and_others_one_each() -> None:
    equality, levels, bounds = problem(0, 50.0)
    assert solve_hierarchy(equality, levels, bounds).quadratic_programs == 1
    equality, levels, bounds = problem(0, 0.4)
    assert solve_hierarchy(equality, levels, bounds).quadratic_programs == 1 + len(levels)


def test_the_shortcut_gives_what_the_cascade_gives() -> None:
    """A level of full rank split in two hits the shortcut; the same rows twice over are rank deficient and do not."""
    equality, levels, bounds = problem(3, 50.0)
    twice = Rows(np.vstack([levels[0].A, levels[0].A]), np.concatenate([levels[0].b, levels[0].b + 1e-3]))
    middle = Rows(levels[0].A, levels[0].b + 5e-4)
    quick, slow = (
        solve_hierarchy(equality, [middle, *levels[1:]], bounds),
        solve_hierarchy(equality, [twice, *levels[1:]], bounds),
    )
    assert quick.quadratic_programs == 1
    assert slow.quadratic_programs == 3
    assert np.allclose(quick.z, slow.z, atol=1e-5)


def test_equalities_that_contradict_each_other_fail_on_level_0() -> None:
    equality, levels, bounds = problem(1, 1.0)
    torn = Rows(np.vstack([equality.A, equality.A[:1]]), np.append(equality.b, equality.b[0] + 1.0))
    result = solve_hierarchy(torn, levels, bounds)
    assert result.failure is not None
    assert result.failure.level == 0
    assert "contradict" in result.failure.reason


def test_repeated_equalities_are_no_contradiction() -> None:
    equality, levels, bounds = problem(1, 1.0)
    twice = Rows(np.vstack([equality.A, equality.A]), np.concatenate([equality.b, equality.b]))
    assert np.allclose(solve_hierarchy(twice, levels, bounds).z, solve_hierarchy(equality, levels, bounds).z, atol=1e-6)


def test_inequalities_that_cannot_hold_fail_on_level_1_and_are_named() -> None:
    equality, levels, bounds = problem(2, 1.0)
    against = Inequalities(
        np.vstack([bounds.G, equality.A[:1]]),
        np.append(bounds.lower, equality.b[0] + 2.0),
        np.append(bounds.upper, np.inf),
    )
    result = solve_hierarchy(equality, levels, against)
    assert result.failure is not None
    assert result.failure.level == 1
    missed = minimum_violations(equality, against, np.arange(16) == 15)
    assert missed is not None
    assert missed[-1] == pytest.approx(2.0, rel=1e-3)
    assert np.count_nonzero(missed) == 1
    assert minimum_violations(equality, against, np.arange(16) < 15) is None
    everywhere = minimum_violations(equality, against, np.ones(16, dtype=bool))
    assert everywhere is not None
    assert int(np.argmax(everywhere)) == 15
    allowed = minimum_violations(equality, bounds, np.ones(15, dtype=bool))
    assert allowed is not None
    assert allowed.max() < 1e-4
