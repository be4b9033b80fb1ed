"""The minimum-jerk spline against its closed form and a dense discretisation, and the conditions that it assumes."""

import numpy as np
import pytest

from stridelab.centroidal.special_cases.minimum_jerk import MinimumJerk, margins_n, through_supports
from stridelab.errors import InvalidInput
from support.robots.sequences import COM_HEIGHT_M, phase, rest_to_rest, sequence, two_steps

TIMES = np.array([0.0, 0.7, 1.1, 2.0, 3.0])
PLACES = np.array([[0.0, 0.0, 0.8], [0.1, 0.05, 0.82], [0.2, -0.05, 0.8], [0.4, 0.02, 0.85], [0.5, 0.0, 0.8]])


def test_between_two_places_it_is_the_quintic_of_flash_and_hogan() -> None:
    ends = np.array([[0.1, 0.0, 0.8], [0.6, -0.2, 0.9]])
    motion = MinimumJerk.through_points(np.array([0.5, 2.5]), ends)
    tau = np.linspace(0.0, 1.0, 21)
    share = 10.0 * tau**3 - 15.0 * tau**4 + 6.0 * tau**5
    assert motion.evaluate_at(0.5 + 2.0 * tau) == pytest.approx(ends[0] + np.outer(share, ends[1] - ends[0]), abs=1e-12)
    assert motion.cost == pytest.approx(720.0 / 2.0**5 * np.sum((ends[1] - ends[0]) ** 2), rel=1e-12)
    assert motion.evaluate_at(np.array([0.0, 3.0])) == pytest.approx(ends)


def test_it_passes_the_places_and_four_derivatives_are_continuous() -> None:
    motion = MinimumJerk.through_points(TIMES, PLACES)
    assert motion.evaluate_at(TIMES) == pytest.approx(PLACES, abs=1e-12)
    for derivative in range(5):
        before, after = (motion.evaluate_at(TIMES[1:-1] + e, derivative) for e in (-1e-9, 1e-9))
        assert before == pytest.approx(after, abs=1e-5)
    assert motion.evaluate_at(TIMES[[0, -1]], 1) == pytest.approx(np.zeros((2, 3)), abs=1e-12)
    assert motion.evaluate_at(TIMES[[0, -1]], 2) == pytest.approx(np.zeros((2, 3)), abs=1e-12)
    times = np.linspace(0.05, 2.95, 30)
    for derivative in range(1, 4):
        slope = (
            motion.evaluate_at(times + 1e-5, derivative - 1) - motion.evaluate_at(times - 1e-5, derivative - 1)
        ) / 2e-5
        assert slope == pytest.approx(motion.evaluate_at(times, derivative), abs=1e-5)


def test_no_motion_through_the_places_has_less_jerk() -> None:
    """Against least squares over a jerk that is constant on 300 intervals: better by discretisation only."""
    motion, h, n = MinimumJerk.through_points(TIMES, PLACES), 0.01, 300
    A, B = np.array([[1, h, h * h / 2], [0, 1, h], [0, 0, 1.0]]), np.array([h**3 / 6, h * h / 2, h])
    rows = []
    for time_s, states in [*((t, (0,)) for t in TIMES[1:-1]), (TIMES[-1], (0, 1, 2))]:
        k = round(time_s / h)
        responses = [np.linalg.matrix_power(A, k - 1 - i) @ B if i < k else np.zeros(3) for i in range(n)]
        rows += [np.array(responses)[:, s] for s in states]
    best = 0.0
    for axis in range(3):
        goal = np.append(PLACES[1:, axis] - PLACES[0, axis], [0.0, 0.0])
        u = np.linalg.lstsq(np.array(rows), goal, rcond=None)[0]
        best += h * float(u @ u)
    assert motion.cost == pytest.approx(best, rel=2e-3)
    assert motion.cost <= best


def test_the_assumed_force_cones_can_be_checked() -> None:
    """Slow enough, and over the supports, the cones hold; ten times as fast they do not."""
    problem = rest_to_rest(two_steps(0.2, friction=0.6))
    motion = through_supports(problem, COM_HEIGHT_M)
    times = np.linspace(0.0, problem.sequence.duration_s - 1e-9, 35)
    standing = margins_n(problem, motion, times[[0, -1]])
    assert (standing > 0.0).all()
    hasty = MinimumJerk.through_points(motion.time_s / 10.0, motion.com_m)
    assert margins_n(problem, hasty, times / 10.0).min() < -100.0


def test_invalid_values_are_refused() -> None:
    for times, places in ((TIMES[:1], PLACES[:1]), (TIMES[[0, 0]], PLACES[:2])):
        with pytest.raises(InvalidInput) as refusal:
            MinimumJerk.through_points(times, places)
        assert refusal.value.code == "minimum-jerk-invalid"
    problem = rest_to_rest(two_steps())
    hop = sequence(problem.sequence.phases[0], phase(0.1), problem.sequence.phases[-1])
    with pytest.raises(InvalidInput):
        through_supports(rest_to_rest(hop), COM_HEIGHT_M)
