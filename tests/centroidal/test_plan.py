"""Properties that every plan must have, looked at from outside the solver."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from stridelab.centroidal.plan import CentroidalPlan
from stridelab.centroidal.problem import CentroidalProblem
from stridelab.conventions import g


def test_it_converges_and_verifies(plan: CentroidalPlan) -> None:
    assert plan.converged, plan.status
    assert plan.status.startswith("Converged (ipopt: solve succeeded after")
    check = plan.verification
    assert check.dynamics_gap < 1e-10
    assert check.terminal_gap < 1e-10
    assert check.cone_margin_n >= 0.0
    assert check.normal_force_min_n >= 0.0


def test_scipy_integrates_the_planned_forces_to_the_planned_states(plan: CentroidalPlan) -> None:
    """(4.20b), written as (4.2a) and (4.2b)."""

    def rate(_: float, x: np.ndarray, k: int) -> np.ndarray:
        c, v = x[0:3], x[3:6]
        f, moment = np.zeros(3), np.zeros(3)
        for name, contact in plan.sequence.phases[plan.phase[k]].contacts.items():
            for p, force in zip(contact.placement.act(plan.points_m[name]), plan.forces_n[name][k], strict=True):
                f += force
                moment += np.cross(p - c, force)
        return np.concatenate([v, f / plan.mass_kg + g, moment])

    x = np.concatenate([plan.com_m[0], plan.com_v_m_s[0], plan.l_nms[0]])
    for k in range(len(plan.phase)):
        span = (float(plan.time_s[k]), float(plan.time_s[k + 1]))
        x = solve_ivp(rate, span, x, args=(k,), rtol=1e-11, atol=1e-12).y[:, -1]
        assert x[0:3] == pytest.approx(plan.com_m[k + 1], abs=1e-9)
        assert x[3:6] == pytest.approx(plan.com_v_m_s[k + 1], abs=1e-9)
        assert x[6:9] == pytest.approx(plan.l_nms[k + 1], abs=1e-7)


def test_every_force_lies_in_the_cone_of_its_contact_and_is_zero_where_nothing_touches(plan: CentroidalPlan) -> None:
    """(4.20c)."""
    for name, forces in plan.forces_n.items():
        for k, f in enumerate(forces):
            contact = plan.sequence.phases[plan.phase[k]].contacts.get(name)
            if contact is None:
                assert not f.any()
                continue
            local = f @ contact.placement.rotation
            assert (contact.friction * local[:, 2] - np.hypot(local[:, 0], local[:, 1])).min() >= 0.0


def test_it_goes_from_rest_to_rest_and_stays_there(plan: CentroidalPlan, problem: CentroidalProblem) -> None:
    """(4.20d), (4.20e)."""
    assert plan.com_m[[0, -1]] == pytest.approx(np.array([problem.com_start_m, problem.com_end_m]), abs=1e-9)
    for still in (plan.com_v_m_s[[0, -1]], plan.l_nms[[0, -1]], plan.com_a_m_s2[-1]):
        assert np.abs(still).max() < 1e-9


def test_force_and_acceleration_agree(plan: CentroidalPlan) -> None:
    """(4.4a)."""
    total = sum(f.sum(axis=1) for f in plan.forces_n.values())
    assert plan.com_a_m_s2 == pytest.approx(total / plan.mass_kg + g)


def test_between_the_nodes_the_reference_is_smooth_and_its_own_derivative(plan: CentroidalPlan) -> None:
    e = 1e-7
    for k, t in enumerate(plan.time_s[1:-1], start=1):
        before, after = plan.reference_at(float(t) - e), plan.reference_at(float(t) + e)
        assert before.com_m == pytest.approx(after.com_m, abs=1e-6)
        assert before.com_v_m_s == pytest.approx(after.com_v_m_s, abs=1e-5)
        assert plan.reference_at(float(t)).com_m == pytest.approx(plan.com_m[k], abs=1e-12)
        assert plan.reference_at(float(t)).l_nms == pytest.approx(plan.l_nms[k], abs=1e-9)
    for t in np.random.default_rng(0).uniform(0.01, plan.time_s[-1] - 0.01, size=50):
        low, middle, high = (plan.reference_at(float(t) + d) for d in (-e, 0.0, e))
        if low.interval != high.interval:
            continue
        assert (high.com_m - low.com_m) / (2 * e) == pytest.approx(middle.com_v_m_s, abs=1e-6)
        assert (high.com_v_m_s - low.com_v_m_s) / (2 * e) == pytest.approx(middle.com_a_m_s2, abs=1e-5)
        assert (high.l_nms - low.l_nms) / (2 * e) == pytest.approx(middle.l_rate_nm, abs=1e-4)


def test_many_times_at_once_give_the_same_reference(plan: CentroidalPlan) -> None:
    """For splines, and for forces that are constant between the nodes."""
    times_s = np.linspace(-0.5, plan.time_s[-1] + 0.5, 97)
    for one in (plan, replace(plan, curves_n={})):
        batch, forces_n = one.references_at(times_s), one.forces_over(times_s)
        for i, t in enumerate(times_s.tolist()):
            single = one.reference_at(t)
            assert batch[i].interval == single.interval
            for name in ("com_m", "com_v_m_s", "com_a_m_s2", "l_nms", "l_rate_nm"):
                assert getattr(batch[i], name) == pytest.approx(getattr(single, name), rel=1e-12, abs=1e-9), name
            forces_then_n = one.forces_at(t)
            assert forces_n.keys() == forces_then_n.keys()
            for name, force_n in forces_then_n.items():
                assert forces_n[name][i] == pytest.approx(force_n, rel=1e-12, abs=1e-9), name


def test_outside_its_time_the_reference_is_at_rest(plan: CentroidalPlan) -> None:
    assert plan.reference_at(-1.0).com_m == pytest.approx(plan.com_m[0])
    assert plan.reference_at(plan.time_s[-1] + 1.0).com_m == pytest.approx(plan.com_m[-1], abs=1e-9)


def test_the_hand_helps_but_carries_little(plan: CentroidalPlan) -> None:
    hand = np.linalg.norm(plan.forces_n["right_hand"].sum(axis=1), axis=1)
    assert 0.1 < hand.max() < 0.1 * plan.mass_kg * 9.81


def test_the_angular_momentum_stays_near_zero(plan: CentroidalPlan) -> None:
    assert np.abs(plan.l_nms).max() < 0.1
