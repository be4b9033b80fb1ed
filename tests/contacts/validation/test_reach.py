"""The common slack of reach limits, against a general solver and against numbers reckoned by hand."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import linprog, minimize
from scipy.spatial.transform import Rotation as ScipyRotation

from stridelab.contacts.effector_geometry import EffectorReach
from stridelab.contacts.validation.reach_slack import ACCURACY_M, ReachSet, reach_slacks
from stridelab.dynamics.spatial import Placement

FAR = 50.0


def upright(position_m: tuple[float, float, float]) -> Placement:
    return Placement.from_wxyz(position_m)


def random_set(rng: np.random.Generator, n: int, far: bool) -> ReachSet:
    group = []
    for _ in range(n):
        low = rng.uniform(-1.0, 0.0, 3)
        high = low + rng.uniform(0.3, 2.0, 3)
        radius = FAR if far else float(rng.uniform(0.4, 1.3))
        rotation = ScipyRotation.random(random_state=rng).as_matrix()
        reach = EffectorReach((*low.tolist(),), (*high.tolist(),), radius)
        group.append((Placement(rng.normal(size=3) * 0.5, rotation), reach))
    return group


def residuals(group: ReachSet, x: np.ndarray) -> np.ndarray:
    """What is left of every limit at CoM ``x[:3]`` and slack ``x[3]``."""
    left: list[float] = []
    for at, reach in group:
        local = at.rotation.T @ (x[:3] - at.position_m)
        left += [*(local - reach.com_low_m - x[3]), *(reach.com_high_m - local - x[3])]
        left.append(reach.com_distance_max_m - x[3] - float(np.linalg.norm(x[:3] - at.position_m)))
    return np.array(left)


def test_boxes_alone_are_a_linear_programme() -> None:
    rng = np.random.default_rng(5)
    sets = [random_set(rng, int(n), far=True) for n in rng.integers(1, 6, 30)]
    for group, result in zip(sets, reach_slacks(sets), strict=True):
        rows = np.vstack([sign * at.rotation.T for at, _ in group for sign in (1.0, -1.0)])
        limits = np.concatenate(
            [
                sign * (at.rotation.T @ at.position_m) + np.array(bound) * sign
                for at, reach in group
                for sign, bound in ((1.0, reach.com_high_m), (-1.0, reach.com_low_m))
            ]
        )
        A = np.hstack([rows, np.ones((len(rows), 1))])
        truth = linprog([0.0, 0.0, 0.0, -1.0], A_ub=A, b_ub=limits, bounds=(None, None))
        assert result.slack_m == pytest.approx(-truth.fun, abs=ACCURACY_M)


def test_boxes_and_spheres_agree_with_a_general_solver() -> None:
    rng = np.random.default_rng(6)
    sets = [random_set(rng, int(n), far=False) for n in rng.integers(1, 5, 20)]
    for group, result in zip(sets, reach_slacks(sets), strict=True):
        start = np.append(result.com_m + 0.05, result.slack_m - 0.5)
        limits = {"type": "ineq", "fun": lambda x, group=group: residuals(group, x)}
        truth = minimize(lambda x: -x[3], start, constraints=[limits], method="SLSQP", options={"ftol": 1e-12})
        assert result.slack_m == pytest.approx(-truth.fun, abs=3 * ACCURACY_M)


@settings(max_examples=40, deadline=None)
@given(st.integers(0, 2**31), st.integers(1, 6), st.booleans())
def test_the_position_keeps_all_limits_and_the_pulls_balance(seed: int, n: int, far: bool) -> None:
    group = random_set(np.random.default_rng(seed), n, far)
    (result,) = reach_slacks([group])
    assert residuals(group, np.append(result.com_m, result.slack_m)).min() > 0.0
    np.testing.assert_allclose(result.gradient.sum(axis=0), 0.0, atol=1e-3)


def test_two_heights_leave_half_of_what_they_lack() -> None:
    reach = EffectorReach((-2.0, -2.0, 0.2), (2.0, 2.0, 1.0), FAR)
    group = [(upright((0.0, 0.1, 0.0)), reach), (upright((0.3, -0.1, 1.5)), reach)]
    (result,) = reach_slacks([group])
    assert result.slack_m == pytest.approx(-0.35, abs=ACCURACY_M)
    np.testing.assert_allclose(result.gradient, [[0.0, 0.0, 0.5], [0.0, 0.0, -0.5]], atol=1e-3)


def test_one_sphere_holds_its_radius() -> None:
    (result,) = reach_slacks([[(upright((1.0, 2.0, 3.0)), EffectorReach((-9.0, -9.0, -9.0), (9.0, 9.0, 9.0), 1.2))]])
    assert result.slack_m == pytest.approx(1.2, abs=ACCURACY_M)
    np.testing.assert_allclose(result.com_m, [1.0, 2.0, 3.0], atol=1e-3)


def test_sets_of_different_sizes_do_not_disturb_each_other() -> None:
    rng = np.random.default_rng(7)
    sets = [random_set(rng, n, far=False) for n in (1, 4, 2)]
    together = [result.slack_m for result in reach_slacks(sets)]
    alone = [reach_slacks([group])[0].slack_m for group in sets]
    np.testing.assert_allclose(together, alone, atol=2 * ACCURACY_M)


def test_nothing_to_solve() -> None:
    assert reach_slacks([]) == []
