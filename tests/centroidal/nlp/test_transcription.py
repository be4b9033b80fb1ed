"""The nonlinear programme: derivatives against finite differences, rows against what they mean."""

from dataclasses import replace

import numpy as np
import pytest

from stridelab.centroidal.contact_wrench import ContactWrench
from stridelab.centroidal.control import Control
from stridelab.centroidal.cost_terms import cost_terms
from stridelab.centroidal.free_variables import FreeDurations, FreePlacements
from stridelab.centroidal.nlp.nlp import OBJECTIVE_SCALE
from stridelab.centroidal.nlp.solvers import run_solver
from stridelab.centroidal.nlp.transcription import Transcription, transcribe
from stridelab.centroidal.plan import objective
from stridelab.centroidal.point_forces import CircularCones, Pyramids
from stridelab.centroidal.problem import CentroidalProblem, Weights
from stridelab.centroidal.solver import motion_from_variables
from support.robots.sequences import foot, phase, rest_to_rest, sequence


@pytest.fixture(scope="module")
def programme(problem: CentroidalProblem) -> Transcription:
    return transcribe(problem)


def directions(n: int) -> np.ndarray:
    return np.random.default_rng(5).standard_normal((6, n))


def value(of: Transcription, w: np.ndarray) -> float:
    return float(of.compiled.nlp.value(w, of.p))


def gradient(of: Transcription, w: np.ndarray) -> np.ndarray:
    return of.compiled.nlp.gradient(w, of.p).full().ravel()


def rows(of: Transcription, w: np.ndarray) -> np.ndarray:
    return of.compiled.nlp.rows(w, of.p).full().ravel()


def curvature(of: Transcription, w: np.ndarray, lam: np.ndarray | None = None, s: float = 1.0, theta: float = 1.0):
    """The whole symmetric matrix, from its upper triangle."""
    lam = np.zeros(of.layout.n_rows) if lam is None else lam
    upper = of.compiled.nlp.hessian(w, of.p, s, lam, theta).full()
    assert np.array_equal(upper, np.triu(upper))
    return upper + np.triu(upper, 1).T


def test_gradient_against_finite_differences(programme: Transcription) -> None:
    w, e = programme.guess, 1e-6
    for d in directions(programme.layout.n):
        slope = (value(programme, w + e * d) - value(programme, w - e * d)) / (2 * e)
        assert gradient(programme, w) @ d == pytest.approx(slope, rel=1e-6)


def test_curvature_against_finite_differences_where_gauss_newton_is_exact() -> None:
    standing = transcribe(rest_to_rest(sequence(phase(0.4, foot("left", 0.0), foot("right", 0.0)))))
    w, e = standing.guess, 1e-6
    H = curvature(standing, w)
    for d in directions(standing.layout.n):
        bend = (gradient(standing, w + e * d) - gradient(standing, w - e * d)) / (2 * e)
        assert H @ d == pytest.approx(bend, rel=1e-5, abs=1e-5 * np.abs(bend).max())


@pytest.mark.parametrize("control", [Pyramids(), CircularCones(), ContactWrench()], ids=lambda c: type(c).__name__)
def test_rows_and_their_curvature_against_finite_differences(problem: CentroidalProblem, control: Control) -> None:
    of = transcribe(replace(problem, control=control, node_rate_hz=5.0))
    rng, e = np.random.default_rng(1), 1e-5
    w = of.guess + 0.1 * rng.standard_normal(of.layout.n)
    lam = rng.standard_normal(of.layout.n_rows)
    assert_rows(of, w, lam, e)


@pytest.mark.parametrize("fixed_total", [True, False])
def test_with_durations_and_contacts_free_all_derivatives_are_exact(
    problem: CentroidalProblem, fixed_total: bool
) -> None:
    free = replace(
        problem,
        durations=FreeDurations(fixed_total=fixed_total, price_per_s=3.0),
        placements=FreePlacements(),
        node_rate_hz=5.0,
    )
    of, rng, e = transcribe(free), np.random.default_rng(1), 1e-5
    w = of.guess + 0.01 * rng.standard_normal(of.layout.n)
    lam = rng.standard_normal(of.layout.n_rows)
    assert_rows(of, w, lam, e)
    H = curvature(of, w)
    for d in directions(of.layout.n):
        slope = (value(of, w + e * d) - value(of, w - e * d)) / (2 * e)
        assert gradient(of, w) @ d == pytest.approx(slope, rel=1e-6)
        bend = (gradient(of, w + e * d) - gradient(of, w - e * d)) / (2 * e)
        assert H @ d == pytest.approx(bend, rel=1e-5, abs=1e-5 * np.abs(bend).max())


def assert_rows(of: Transcription, w: np.ndarray, lam: np.ndarray, e: float) -> None:
    def J(w: np.ndarray) -> np.ndarray:
        return of.compiled.nlp.jacobian(w, of.p).full()

    H = curvature(of, w, lam, s=0.0)
    for d in directions(of.layout.n):
        assert J(w) @ d == pytest.approx((rows(of, w + e * d) - rows(of, w - e * d)) / (2 * e), abs=1e-7)
        assert H @ d == pytest.approx((J(w + e * d) - J(w - e * d)).T @ lam / (2 * e), abs=1e-6)


def test_with_the_majoriser_the_curvature_is_positive_semidefinite() -> None:
    step = sequence(phase(0.2, foot("left", 0.0), foot("right", 0.0)), phase(0.2, foot("left", 0.0)))
    programme = transcribe(rest_to_rest(step))
    w = programme.guess + 0.1 * directions(programme.layout.n)[0]
    eigenvalues = np.linalg.eigvalsh(curvature(programme, w, theta=0.0))
    assert eigenvalues.min() > -1e-9 * eigenvalues.max()


def test_the_objective_is_the_sum_of_the_cost_terms_of_any_motion(programme: Transcription) -> None:
    """(4.20a)."""
    other = transcribe(replace(programme.problem, weights=Weights(likelihood=0.1, point_force=30.0)))
    w = run_solver("ipopt", other).point.w
    terms = cost_terms(programme.problem, motion_from_variables(programme, programme.problem.sequence, w))
    assert value(programme, w) == pytest.approx(OBJECTIVE_SCALE * sum(terms.values()), rel=1e-9)
    assert objective(terms) == pytest.approx(sum(terms.values()) - terms["surface_force"] - terms["point_force"])


def test_problems_alike_in_structure_share_what_was_compiled(programme: Transcription) -> None:
    problem = programme.problem
    other = replace(problem, mass_kg=70.0, weights=Weights(likelihood=0.3), com_end_m=problem.com_end_m + 0.01)
    assert transcribe(other).compiled is programme.compiled
    assert transcribe(replace(problem, control=CircularCones())).compiled is not programme.compiled
    assert transcribe(replace(problem, node_rate_hz=20.0)).compiled is not programme.compiled


def test_the_guess_is_the_thesis_start(programme: Transcription) -> None:
    problem = programme.problem
    motion = motion_from_variables(programme, problem.sequence, programme.guess)
    share = motion.time_s / motion.time_s[-1]
    line = problem.com_start_m + share[:, None] * (problem.com_end_m - problem.com_start_m)
    assert motion.com_m == pytest.approx(line)
    assert not motion.com_v_m_s.any()
    total = sum(f.sum(axis=(0, 1)) for f in motion.forces_n.values()) / len(motion.phase)
    assert total[2] == pytest.approx(problem.weight_n, rel=0.02)
