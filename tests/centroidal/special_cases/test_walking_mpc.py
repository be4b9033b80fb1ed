"""The quadratic program of the zero-moment point: as least squares, with free steps, and refused inputs."""

from dataclasses import replace

import numpy as np
import pytest

from stridelab.centroidal.special_cases.walking_mpc import (
    Step,
    Support,
    Walk,
    ZmpPlan,
    ZmpQuadraticProgram,
    ZmpWeights,
    level_supports,
)
from stridelab.conventions import GRAVITY_M_S2
from stridelab.errors import InvalidInput, NotEstimable
from support.robots.sequences import foot, phase, rest_to_rest, sequence, two_steps

HEIGHT_M = 0.82
SOLE = np.array([[0.08, 0.045], [-0.08, 0.045], [-0.08, -0.045], [0.08, -0.045]])
WIDE = Support(5.0 * np.array([[1.0, 1.0], [-1.0, 1.0], [-1.0, -1.0], [1.0, -1.0]]))
REST = np.zeros((3, 2))


def walking(n_steps: int, samples: int, speed_m_s: float, programme: ZmpQuadraticProgram) -> tuple[Walk, ZmpPlan]:
    """Left foot stands at y = 0.09; right and left in turn, their places free."""
    supports = [Support(SOLE + np.array([0.0, 0.09]))] * samples
    steps = []
    for j in range(n_steps):
        supports += [Support(SOLE, j)] * samples
        side = -1.0 if j % 2 == 0 else 1.0
        steps.append(
            Step(np.array([-0.3, min(side * 0.16, side * 0.3)]), np.array([0.5, max(side * 0.16, side * 0.3)]))
        )
    walk = Walk(supports, steps, np.array([0.0, 0.09]), (speed_m_s, 0.0), "capturable")
    state = np.array([[0.0, 0.06], [0.2, 0.05], [0.0, 0.0]])
    return walk, programme.solve(state, walk)


def test_without_limits_that_bind_it_is_least_squares() -> None:
    """Written out sample by sample instead of by powers of the integrator."""
    n, dt = 30, 0.05
    programme = ZmpQuadraticProgram(height_m=HEIGHT_M, dt_s=dt, weights=ZmpWeights(1e-3, 0.2, 0.5, 1.0))
    rng = np.random.default_rng(0)
    state = 0.1 * rng.normal(size=(3, 2))
    plan = programme.solve(state, Walk([WIDE] * n, velocity_m_s=(0.3, -0.1)))

    def residual(u: np.ndarray) -> np.ndarray:
        x, residuals = state.copy(), []
        for k in range(n):
            c, v, a = x
            x = np.array([c + dt * v + dt**2 / 2 * a + dt**3 / 6 * u[k], v + dt * a + dt**2 / 2 * u[k], a + dt * u[k]])
            zmp = x[0] - HEIGHT_M / GRAVITY_M_S2 * x[2]
            residuals += [1e-3**0.5 * u[k], 0.2**0.5 * x[2], 0.5**0.5 * (x[1] - [0.3, -0.1]), zmp]
        return np.sqrt(dt) * np.concatenate(residuals)

    base = residual(np.zeros((n, 2)))
    J = np.array([residual(np.eye(2 * n)[i].reshape(n, 2)) - base for i in range(2 * n)]).T
    best = np.linalg.lstsq(J, -base, rcond=None)[0]
    assert plan.cost == pytest.approx(float(np.sum((base + J @ best) ** 2)), rel=1e-6)
    jerk = np.diff(plan.cart.acceleration_m_s2, axis=0) / dt
    assert jerk.ravel() == pytest.approx(best, abs=1e-4 * np.abs(best).max())


def test_the_zero_moment_point_stays_where_it_must_and_the_steps_follow_the_speed() -> None:
    programme = ZmpQuadraticProgram(height_m=HEIGHT_M, dt_s=0.1, weights=ZmpWeights(1e-6, 0.0, 1.0, 0.1))
    walk, plan = walking(6, 8, 0.3, programme)
    assert walk.previous_m is not None
    for support, z in zip(walk.supports, plan.cart.zmp_m[1:], strict=True):
        place = np.zeros(2) if support.step is None else plan.steps_m[support.step]
        normals, offsets = support.edge_half_planes()
        assert (normals @ (z - place) <= offsets + 1e-7).all()
    places = np.vstack([walk.previous_m, plan.steps_m])
    for step, moved in zip(walk.steps, np.diff(places, axis=0), strict=True):
        assert (moved >= step.low_m - 1e-7).all()
        assert (moved <= step.high_m + 1e-7).all()
    assert (np.sign(np.diff(places, axis=0)[:, 1]) == [-1, 1, -1, 1, -1, 1]).all()
    middle = slice(16, 40)
    assert plan.cart.velocity_m_s[middle, 0].mean() == pytest.approx(0.3, abs=0.03)
    end = plan.cart.com_m[-1] + plan.cart.velocity_m_s[-1] * np.sqrt(HEIGHT_M / GRAVITY_M_S2)
    normals, offsets = walk.supports[-1].edge_half_planes()
    assert (normals @ (end - plan.steps_m[-1]) <= offsets + 1e-7).all()


def test_steps_that_are_chosen_are_those_that_would_be_best_if_given() -> None:
    programme = ZmpQuadraticProgram(height_m=HEIGHT_M, dt_s=0.1, weights=ZmpWeights(1e-6, 0.0, 1.0, 0.1))
    walk, plan = walking(4, 8, 0.3, programme)
    state = np.array([[0.0, 0.06], [0.2, 0.05], [0.0, 0.0]])

    def given(places: np.ndarray) -> ZmpPlan:
        fixed = [Support(s.corners_m + (0.0 if s.step is None else places[s.step])) for s in walk.supports]
        return programme.solve(state, replace(walk, supports=fixed, steps=(), previous_m=None))

    same = given(plan.steps_m)
    assert same.cost == pytest.approx(plan.cost, rel=1e-5)
    assert same.cart.com_m == pytest.approx(plan.cart.com_m, abs=1e-4)
    rng = np.random.default_rng(1)
    for _ in range(5):
        aside = np.column_stack([0.01 * rng.normal(size=len(plan.steps_m)), np.zeros(len(plan.steps_m))])
        assert given(plan.steps_m + aside).cost > plan.cost  # sideways they are at their limits


def test_rest_over_a_goal_is_reached() -> None:
    supports = level_supports(rest_to_rest(two_steps()), 0.1)
    programme = ZmpQuadraticProgram(height_m=HEIGHT_M, dt_s=0.1)
    plan = programme.solve(REST, Walk(supports, end="rest", goal_m=np.array([0.2, 0.0])))
    assert len(plan.cart.com_m) == 35
    assert plan.cart.com_m[-1] == pytest.approx([0.2, 0.0], abs=1e-6)
    assert plan.cart.velocity_m_s[-1] == pytest.approx([0.0, 0.0], abs=1e-6)
    assert plan.cart.acceleration_m_s2[-1] == pytest.approx([0.0, 0.0], abs=1e-5)


def test_a_goal_too_far_away_is_infeasible() -> None:
    supports = level_supports(rest_to_rest(two_steps()), 0.1)
    with pytest.raises(NotEstimable) as refusal:
        ZmpQuadraticProgram(height_m=HEIGHT_M).solve(REST, Walk(supports, end="rest", goal_m=np.array([3.0, 0.0])))
    assert refusal.value.code == "zmp-programme-infeasible"


def test_contacts_that_are_not_level_are_refused() -> None:
    stair = sequence(
        phase(0.5, foot("left", 0.0), foot("right", 0.0)), phase(0.5, foot("left", 0.0), foot("right", 0.2, 0.1))
    )
    for walk in (stair, sequence(phase(0.5, foot("left", 0.0)), phase(0.1), phase(0.5, foot("left", 0.0)))):
        with pytest.raises(InvalidInput) as refusal:
            level_supports(replace(rest_to_rest(two_steps()), sequence=walk), 0.1)
        assert refusal.value.code == "contacts-not-level"


@pytest.mark.parametrize(
    "wrong",
    [
        {"height_m": 0.0},
        {"dt_s": -0.1},
        {"weights": ZmpWeights(jerk=0.0)},
        {"weights": ZmpWeights(zmp=-1.0)},
        {"weights": ZmpWeights(velocity=float("nan"))},
    ],
)
def test_numbers_that_make_no_sense_are_refused(wrong: dict[str, object]) -> None:
    with pytest.raises(InvalidInput) as refusal:
        ZmpQuadraticProgram(**{"height_m": HEIGHT_M, **wrong})
    assert refusal.value.code == "zmp-programme-invalid"


@pytest.mark.parametrize(
    ("walk", "where"),
    [
        (Walk([]), "supports"),
        (Walk([WIDE], [Step(np.zeros(2), np.ones(2))]), "previous_m"),
        (Walk([WIDE], end="rest"), "goal_m"),
        (Walk([Support(SOLE, 0)]), "supports"),
    ],
)
def test_walks_that_lack_something_are_refused(walk: Walk, where: str) -> None:
    with pytest.raises(InvalidInput) as refusal:
        ZmpQuadraticProgram(height_m=HEIGHT_M).solve(REST, walk)
    assert refusal.value.faults[0].where == where
