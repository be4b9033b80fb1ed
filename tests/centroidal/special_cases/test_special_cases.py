"""The special cases of 4.7 against the general problem (4.20), under the assumptions that make them one of its cases.

Level ground, no densities, hardly a weight on forces, angular momentum dear, friction to spare.
"""

from dataclasses import replace

import numpy as np
import pytest

from stridelab.centroidal.contact_wrench import point_contacts
from stridelab.centroidal.plan import CentroidalPlan
from stridelab.centroidal.problem import CentroidalProblem, Weights
from stridelab.centroidal.solver import solve
from stridelab.centroidal.special_cases.minimum_jerk import MinimumJerk, margins_n
from stridelab.centroidal.special_cases.preview_control import PreviewControl
from stridelab.centroidal.special_cases.walking_mpc import Walk, ZmpQuadraticProgram, ZmpWeights, level_supports
from stridelab.contacts.wrench_cones.wrench_feasibility import conic_margin
from stridelab.conventions import g
from stridelab.dynamics.wrench import zmp_of_motion
from support.robots.sequences import COM_HEIGHT_M, MASS_KG, foot, phase, rest_to_rest, sequence, two_steps

RATE_HZ = 20.0
LEVEL = Weights(com_acceleration=10.0, momentum_rate=100.0, likelihood=0.0, surface_force=1e-4)


@pytest.fixture(scope="module")
def level() -> CentroidalProblem:
    return rest_to_rest(two_steps(0.25, friction=0.8), proxies={}, weights=LEVEL, node_rate_hz=RATE_HZ)


@pytest.fixture(scope="module")
def general(level: CentroidalProblem) -> CentroidalPlan:
    plan = solve(level)
    assert plan.converged, plan.status
    return plan


def mean_zmp_m(plan: CentroidalPlan) -> np.ndarray:
    """Of every interval: a constant wrench has its centre of pressure where the mean CoM has its ZMP."""
    h = np.diff(plan.time_s)[:, None]
    com = plan.com_m[:-1] + h / 2 * plan.com_v_m_s[:-1] + h**2 / 6 * plan.com_a_m_s2
    return zmp_of_motion(com, plan.com_a_m_s2, np.diff(plan.l_nms, axis=0) / h, MASS_KG)


def test_the_general_plan_satisfies_the_assumptions(level: CentroidalProblem, general: CentroidalPlan) -> None:
    assert np.abs(general.l_nms).max() < 1e-3
    assert np.ptp(general.com_m[:, 2]) < 0.02
    for i, z in zip(general.phase, mean_zmp_m(general), strict=True):
        corners = np.vstack([t.points_m[:, :2] for t in level.contact_patches(int(i), np.zeros(3))])
        assert (z >= corners.min(axis=0) - 1e-6).all()
        assert (z <= corners.max(axis=0) + 1e-6).all()


def test_the_programme_of_the_zmp_is_the_general_problem_at_an_even_height(
    level: CentroidalProblem, general: CentroidalPlan
) -> None:
    """Costs ``w_c int |c''|^2`` on both sides; the general one may bob and so be the cheaper, by a little."""
    dt = 1.0 / RATE_HZ
    programme = ZmpQuadraticProgram(
        height_m=COM_HEIGHT_M, dt_s=dt, weights=ZmpWeights(1e-7, LEVEL.com_acceleration, 0.0, 0.0)
    )
    walk = Walk(level_supports(level, dt), end="rest", goal_m=level.com_end_m[:2])
    plan = programme.solve(np.vstack([level.com_start_m[:2], np.zeros((2, 2))]), walk)
    ours = general.cost_terms["com_acceleration"]
    assert plan.cost == pytest.approx(ours, rel=0.005)
    assert np.abs(plan.cart.com_m - general.com_m[:, :2]).max() < 0.005
    assert np.abs(plan.cart.zmp_m[1:] - mean_zmp_m(general)).max() < 0.05
    finer = ZmpQuadraticProgram(height_m=COM_HEIGHT_M, dt_s=dt / 2, weights=programme.weights)
    closer = finer.solve(
        np.vstack([level.com_start_m[:2], np.zeros((2, 2))]), replace(walk, supports=level_supports(level, dt / 2))
    )
    assert abs(closer.cost - ours) < abs(plan.cost - ours)


def test_preview_control_moves_as_the_general_problem_allows_at_a_price(
    level: CentroidalProblem, general: CentroidalPlan
) -> None:
    """Kajita's law through the middles of the soles: the cones allow it, and it costs more than the optimum."""
    dt = 0.005
    starts, ends = level.sequence.starts_s, level.sequence.ends_s
    t = np.arange(round(level.sequence.duration_s / dt)) * dt
    alone = [(i, next(iter(p.contacts.values()))) for i, p in enumerate(level.sequence.phases) if len(p.contacts) == 1]
    knots = [(0.0, level.com_start_m), (ends[0] - 0.4, level.com_start_m)]
    for i, contact in alone:
        knots += [(starts[i], contact.placement.position_m), (ends[i], contact.placement.position_m)]
    knots += [(starts[-1] + 0.4, level.com_end_m), (ends[-1], level.com_end_m)]
    at_s, at = np.array([time for time, _ in knots]), np.array([place for _, place in knots])
    reference_m = np.column_stack([np.interp(t, at_s, at[:, axis]) for axis in range(2)])
    cart = PreviewControl(height_m=COM_HEIGHT_M, dt_s=dt).follow(reference_m)
    margins = []
    for k in range(0, len(t), 20):
        touches = level.contact_patches(level.sequence.phase_at(float(t[k])), np.zeros(3))
        force = MASS_KG * (np.append(cart.acceleration_m_s2[k], 0.0) - g)
        com = np.append(cart.com_m[k], COM_HEIGHT_M)
        margins.append(conic_margin(point_contacts(touches), np.concatenate([force, np.cross(com, force)])).margin_n)
    assert min(margins) > 0.0
    cost = LEVEL.com_acceleration * dt * float((cart.acceleration_m_s2**2).sum())
    assert np.abs(cart.com_m[-1] - level.com_end_m[:2]).max() < 0.03
    assert general.cost_terms["com_acceleration"] < cost


def test_least_jerk_and_least_acceleration_are_each_best_at_their_own_cost() -> None:
    """Both feet stay, the CoM goes 4 cm ahead: the cones do not bind, so that both optima have a closed form.

    Least acceleration from rest to rest without the last condition would be the cubic; ours ends without acceleration.
    """
    T, d = 2.0, 0.04
    standing = sequence(phase(T, foot("left", 0.0, friction=0.8), foot("right", 0.0, friction=0.8)))
    base = rest_to_rest(standing, proxies={}, weights=LEVEL, node_rate_hz=40.0)
    problem = replace(base, com_end_m=base.com_end_m + np.array([d, 0.0, 0.0]))
    plan = solve(problem)
    assert plan.converged, plan.status
    least = MinimumJerk.through_points(np.array([0.0, T]), np.array([problem.com_start_m, problem.com_end_m]))
    times = np.linspace(0.0, T - 1e-6, 41)
    assert margins_n(problem, least, times).min() > 0.0, "the jerk's motion is one that (4.20) allows"
    ours = plan.cost_terms["com_acceleration"] / LEVEL.com_acceleration
    assert ours == pytest.approx(12.0 * d**2 / T**3, rel=0.05)  # the cubic's, and a little for the end
    of_least = 120.0 / 7.0 * d**2 / T**3
    fine = np.linspace(0.0, T, 4001)
    assert np.trapezoid((least.evaluate_at(fine, 2) ** 2).sum(axis=1), fine) == pytest.approx(of_least, rel=1e-4)
    assert ours < of_least
    jerk = np.diff(plan.com_a_m_s2, axis=0) * 40.0
    assert least.cost < float((jerk**2).sum()) / 40.0
