"""The nonlinear programme: derivatives against finite differences, rows against what they mean."""

from dataclasses import replace

import numpy as np
import pytest

from stridelab.centroidal.cost import cost_terms, objective
from stridelab.centroidal.objective import SCALE
from stridelab.centroidal.problem import CentroidalProblem, Weights
from stridelab.centroidal.solve import read
from stridelab.centroidal.solvers import DEFAULT_LIMITS, run
from stridelab.centroidal.transcription import Transcription, transcribe
from support.centroidal_problems import rest_to_rest
from support.sequences import foot, phase, sequence


@pytest.fixture(scope="module")
def programme(problem: CentroidalProblem) -> Transcription:
    return transcribe(problem)


def directions(n: int) -> np.ndarray:
    return np.random.default_rng(5).standard_normal((6, n))


def test_gradient_against_finite_differences(programme: Transcription) -> None:
    w, e, function = programme.guess, 1e-6, programme.objective
    gradient = function.gradient(w)
    assert gradient.is_dense()
    for d in directions(programme.layout.n):
        slope = float(function.value(w + e * d) - function.value(w - e * d)) / (2 * e)
        assert gradient.full().ravel() @ d == pytest.approx(slope, rel=1e-6)


def test_curvature_against_finite_differences_where_gauss_newton_is_exact() -> None:
    standing = transcribe(rest_to_rest(sequence(phase(0.4, foot("left", 0.0), foot("right", 0.0)))))
    w, e, function = standing.guess, 1e-6, standing.objective
    upper = function.curvature(w, 1.0).full()
    H = upper + np.triu(upper, 1).T
    assert np.array_equal(upper, np.triu(upper))
    for d in directions(standing.layout.n):
        bend = (function.gradient(w + e * d) - function.gradient(w - e * d)).full().ravel() / (2 * e)
        assert H @ d == pytest.approx(bend, rel=1e-5, abs=1e-5 * np.abs(bend).max())


def test_with_the_majoriser_the_curvature_is_positive_semidefinite() -> None:
    step = sequence(phase(0.2, foot("left", 0.0), foot("right", 0.0)), phase(0.2, foot("left", 0.0)))
    programme = transcribe(rest_to_rest(step))
    w = programme.guess + 0.1 * directions(programme.layout.n)[0]
    upper = programme.objective.curvature(w, 0.0).full()
    eigenvalues = np.linalg.eigvalsh(upper + np.triu(upper, 1).T)
    assert eigenvalues.min() > -1e-9 * eigenvalues.max()


def test_the_objective_is_the_sum_of_the_cost_terms_of_any_motion(programme: Transcription) -> None:
    other = transcribe(replace(programme.problem, weights=Weights(likelihood=0.1, point_force=30.0)))
    w = run("ipopt", other, DEFAULT_LIMITS).w
    terms = cost_terms(programme.problem, read(programme, w))
    assert float(programme.objective.value(w)) == pytest.approx(SCALE * sum(terms.values()), rel=1e-9)
    assert objective(terms) == pytest.approx(sum(terms.values()) - terms["surface_force"] - terms["point_force"])


def test_the_guess_is_the_thesis_start(programme: Transcription) -> None:
    problem = programme.problem
    motion = read(programme, programme.guess)
    share = motion.time_s / motion.time_s[-1]
    line = problem.com_start_m + share[:, None] * (problem.com_end_m - problem.com_start_m)
    assert motion.com_m == pytest.approx(line)
    assert not motion.com_v_m_s.any()
    total = sum(f.sum(axis=(0, 1)) for f in motion.forces_n.values()) / len(motion.phase)
    assert total[2] == pytest.approx(problem.weight_n, rel=0.02)
