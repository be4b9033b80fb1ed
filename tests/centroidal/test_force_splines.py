"""Continuous controls: the spline's own properties, and a motion whose forces are splines."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.integrate import quad, solve_ivp
from scipy.interpolate import BPoly

from stridelab.centroidal.contact_wrench import ContactWrench
from stridelab.centroidal.cost_terms import cost_terms
from stridelab.centroidal.force_splines import bernstein_weights, control_points, gauss_rule
from stridelab.centroidal.free_variables import FreeDurations, FreePlacements
from stridelab.centroidal.nlp.nlp import OBJECTIVE_SCALE
from stridelab.centroidal.nlp.transcription import transcribe
from stridelab.centroidal.plan import CentroidalPlan
from stridelab.centroidal.point_forces import CircularCones
from stridelab.centroidal.problem import CentroidalProblem
from stridelab.centroidal.solver import motion_from_variables, solve
from stridelab.centroidal.verification import is_verified, motion_of, verify
from stridelab.centroidal.warm_start import warm_start_point
from stridelab.conventions import g
from stridelab.errors import InvalidInput

E = 1e-6


@pytest.fixture(scope="module")
def smooth(problem: CentroidalProblem) -> CentroidalProblem:
    return replace(problem, shape="cubic")


@pytest.fixture(scope="module")
def spline(smooth: CentroidalProblem) -> CentroidalPlan:
    plan = solve(smooth)
    assert plan.converged, plan.status
    return plan


def test_weights_are_those_of_scipy_and_their_integrals() -> None:
    basis = [BPoly(np.eye(4)[:, i : i + 1], [0.0, 1.0]) for i in range(4)]
    for s in (0.0, 0.3, 1.0):
        assert_allclose(bernstein_weights(s)[0], [float(b(s)) for b in basis], atol=1e-15)
        assert_allclose(bernstein_weights(s)[1], [quad(b, 0.0, s)[0] for b in basis], atol=1e-12)
        assert_allclose(
            bernstein_weights(s)[2], [quad(lambda t, b=b, s=s: (s - t) * b(t), 0.0, s)[0] for b in basis], atol=1e-12
        )
        assert bernstein_weights(s, degree=0)[2] == pytest.approx([s**2 / 2])


def test_gauss_is_exact_to_its_degree_and_no_further() -> None:
    for degree, close in ((7, True), (8, False)):
        integral = sum(w * s**degree for s, w in gauss_rule(4))
        assert (abs(integral - 1.0 / (degree + 1)) < 1e-14) == close


def test_intervals_of_any_length_join_with_value_and_rate_and_rest_at_the_ends() -> None:
    rng = np.random.default_rng(0)
    h, inner = rng.uniform(0.05, 0.3, 6), rng.uniform(size=(6, 2, 5, 3))
    f = control_points(inner, h)
    assert_allclose(f[:-1, 3], f[1:, 0])
    rate = 3.0 * np.diff(f, axis=1) / h[:, None, None, None]
    assert_allclose(rate[:-1, 2], rate[1:, 0], atol=1e-12)
    assert not rate[0, 0].any()
    assert not rate[-1, 2].any()
    assert f.min() >= inner.min()  # convex combinations all
    assert f.max() <= inner.max()


def test_forces_have_no_jump_and_no_kink(spline: CentroidalPlan) -> None:
    for t in spline.time_s[1:-1]:
        before, after = spline.forces_at(float(t) - E), spline.forces_at(float(t) + E)
        before_2, after_2 = spline.forces_at(float(t) - 2 * E), spline.forces_at(float(t) + 2 * E)
        for name, f in after.items():
            assert_allclose(before[name], f, atol=0.1)
            assert_allclose((before[name] - before_2[name]) / E, (after_2[name] - f) / E, atol=2.0)


def test_a_foot_is_loaded_from_zero_and_unloaded_to_zero(spline: CentroidalPlan) -> None:
    ends_s = spline.sequence.ends_s
    assert not spline.forces_at(float(ends_s[0]))["right_hand"].any()  # it comes
    lifted = spline.forces_at(float(ends_s[1]) - E)["right_foot"]  # it goes
    assert np.abs(lifted).max() < 1e-6
    assert np.abs(spline.forces_at(float(ends_s[1]) + 0.3)["right_foot"]).max() == 0.0


def test_every_force_of_a_curve_is_in_its_cone(spline: CentroidalPlan) -> None:
    for t in np.linspace(0.0, float(spline.time_s[-1]), 500):
        phase = spline.sequence.phases[spline.phase[spline.reference_at(float(t)).interval]]
        for name, f in spline.forces_at(float(t)).items():
            if name in phase.contacts:
                local = f @ phase.contacts[name].placement.rotation
                friction = phase.contacts[name].friction
                assert (friction * local[:, 2] - np.hypot(local[:, 0], local[:, 1])).min() > -1e-9
            else:
                assert np.abs(f).max() == 0.0


def test_scipy_integrates_the_curves_to_the_planned_states(spline: CentroidalPlan) -> None:
    def rate(t: float, x: np.ndarray) -> np.ndarray:
        c, v = x[0:3], x[3:6]
        f, moment = np.zeros(3), np.zeros(3)
        contacts = spline.sequence.phases[spline.phase[spline.reference_at(t).interval]].contacts
        for name, forces in spline.forces_at(t).items():
            if name in contacts:
                for p, force in zip(contacts[name].placement.act(spline.points_m[name]), forces, strict=True):
                    f += force
                    moment += np.cross(p - c, force)
        return np.concatenate([v, f / spline.mass_kg + g, moment])

    x = np.concatenate([spline.com_m[0], spline.com_v_m_s[0], spline.l_nms[0]])
    for k in range(len(spline.phase)):
        span = (float(spline.time_s[k]), float(spline.time_s[k + 1]))
        x = solve_ivp(rate, span, x, rtol=1e-10, atol=1e-11).y[:, -1]
        assert_allclose(x[0:6], np.concatenate([spline.com_m[k + 1], spline.com_v_m_s[k + 1]]), atol=1e-8)
        assert_allclose(x[6:9], spline.l_nms[k + 1], atol=1e-6)


def test_the_reference_is_its_own_derivative_and_runs_through_the_nodes(spline: CentroidalPlan) -> None:
    for k, t in enumerate(spline.time_s[:-1]):
        assert_allclose(spline.reference_at(float(t)).l_nms, spline.l_nms[k], atol=1e-9)
        before = spline.reference_at(float(spline.time_s[k + 1]) - 1e-12)
        assert_allclose(before.com_m, spline.com_m[k + 1], atol=1e-9)
        assert_allclose(before.l_nms, spline.l_nms[k + 1], atol=1e-8)
    for t in np.random.default_rng(0).uniform(0.01, spline.time_s[-1] - 0.01, size=50):
        low, middle, high = (spline.reference_at(float(t) + d) for d in (-E, 0.0, E))
        assert_allclose((high.com_m - low.com_m) / (2 * E), middle.com_v_m_s, atol=1e-6)
        assert_allclose((high.com_v_m_s - low.com_v_m_s) / (2 * E), middle.com_a_m_s2, atol=1e-6)
        assert_allclose((high.l_nms - low.l_nms) / (2 * E), middle.l_rate_nm, atol=1e-4)


def test_the_objective_is_the_sum_of_the_cost_terms(smooth: CentroidalProblem, spline: CentroidalPlan) -> None:
    assert spline.solution is not None
    of = transcribe(replace(smooth, weights=replace(smooth.weights, surface_force=3.0)))
    w = spline.solution.point.w
    terms = cost_terms(of.problem, motion_from_variables(of, of.problem.sequence, w))
    assert float(of.compiled.nlp.value(w, of.p)) == pytest.approx(OBJECTIVE_SCALE * sum(terms.values()), rel=1e-9)


def test_gradient_and_rows_against_finite_differences(smooth: CentroidalProblem) -> None:
    of, rng = transcribe(replace(smooth, placements=FreePlacements(), node_rate_hz=5.0)), np.random.default_rng(1)
    f, w = of.compiled.nlp, of.guess + 0.01 * rng.standard_normal(of.layout.n)
    for d in rng.standard_normal((4, of.layout.n)):
        slope = (float(f.value(w + E * d, of.p)) - float(f.value(w - E * d, of.p))) / (2 * E)
        assert f.gradient(w, of.p).full().ravel() @ d == pytest.approx(slope, rel=1e-5)
        across = (f.rows(w + E * d, of.p).full() - f.rows(w - E * d, of.p).full()).ravel() / (2 * E)
        assert_allclose(f.jacobian(w, of.p).full() @ d, across, atol=1e-6)
    H = f.hessian(w, of.p, 1.0, np.zeros(of.layout.n_rows), 1.0).full()
    assert np.array_equal(H, np.triu(H))


def test_verification_sees_a_control_point_outside_its_cone(smooth: CentroidalProblem, spline: CentroidalPlan) -> None:
    curve = spline.curves_n["left_foot"].copy()
    curve[3, 1, 0, 0] += 300.0
    bad = replace(motion_of(spline), curves_n={**spline.curves_n, "left_foot": curve})
    residuals = verify(spline.sequence, spline.mass_kg, bad, smooth.com_start_m, smooth.com_end_m)
    assert not is_verified(residuals)
    assert residuals.cone_margin_n < 0.0
    assert residuals.dynamics_gap > 1e-3


def test_placements_and_circular_cones_and_warm_starts_go_along(
    smooth: CentroidalProblem, spline: CentroidalPlan
) -> None:
    assert solve(replace(smooth, placements=FreePlacements())).converged
    assert solve(replace(smooth, control=CircularCones()), "ipopt").converged
    warm = solve(smooth, start=warm_start_point(spline, smooth))
    assert warm.converged
    assert warm.iterations <= spline.iterations // 2
    assert solve(smooth, start=warm_start_point(solve(replace(smooth, shape="constant")), smooth)).converged


def test_the_motion_is_nearly_that_of_constants(spline: CentroidalPlan, plan: CentroidalPlan) -> None:
    assert spline.objective == pytest.approx(plan.objective, abs=0.5)
    assert spline.com_m == pytest.approx(plan.com_m, abs=0.03)


@pytest.mark.parametrize(
    ("settings", "code"),
    [({"control": ContactWrench()}, "shape-needs-forces"), ({"durations": FreeDurations()}, "shape-needs-durations")],
)
def test_unsupported_options_of_splines_are_refused(
    problem: CentroidalProblem, settings: dict[str, Any], code: str
) -> None:
    with pytest.raises(InvalidInput) as refused:
        replace(problem, shape="cubic", **settings)
    assert refused.value.code == code


def test_fatrop_is_refused(smooth: CentroidalProblem) -> None:
    with pytest.raises(InvalidInput) as refused:
        solve(smooth, "fatrop")
    assert refused.value.code == "shape-needs-ipopt"
