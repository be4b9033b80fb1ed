"""What a problem is, and what cannot be one."""

from dataclasses import replace

import numpy as np
import pytest

from stridelab.centroidal.contact_wrench import ContactWrench
from stridelab.centroidal.free_variables import FreeDurations, FreePlacements
from stridelab.centroidal.problem import NODES_PER_PHASE_MIN, CentroidalProblem, Weights, standing_com_m
from stridelab.errors import InvalidInput
from support.robots.sequences import EFFECTORS, PROXIES, foot, hand, phase, rest_to_rest, sequence, two_steps


def test_the_weights_are_those_of_the_thesis() -> None:
    assert (Weights().com_acceleration, Weights().momentum_rate, Weights().likelihood) == (10.0, 10.0, 1.0)


def test_the_grid_has_ten_nodes_per_second_and_its_nodes_on_every_switch() -> None:
    walk = two_steps()
    grid = rest_to_rest(walk).grid()
    assert np.unique(grid.phase, return_counts=True)[1].tolist() == [6, 8, 3, 8, 9]
    assert all(np.abs(grid.time_s - end).min() < 1e-12 for end in walk.ends_s)
    assert np.diff(grid.time_s) == pytest.approx(grid.step_s)


def test_a_short_phase_still_gets_two_intervals() -> None:
    walk = sequence(phase(1.0, foot("left", 0.0)), phase(0.02, foot("left", 0.0), foot("right", 0.0)))
    counts = np.unique(rest_to_rest(walk).grid().phase, return_counts=True)[1]
    assert counts.tolist() == [10, NODES_PER_PHASE_MIN]


def test_soles_are_shrunk_and_points_stay_points(problem: CentroidalProblem) -> None:
    corners = problem.points_m("left_foot")
    assert np.abs(corners) == pytest.approx(np.tile([0.08, 0.045, 0.0], (4, 1)))
    assert problem.points_m("right_hand").tolist() == [[0.0, 0.0, 0.0]]


def test_standing_is_over_the_mean_of_the_soles_whatever_the_hands_do() -> None:
    contacts = phase(1.0, foot("left", 0.3, 0.1), foot("right", 0.1), hand(2.0, 1.0)).contacts
    assert standing_com_m(contacts, 0.8, EFFECTORS) == pytest.approx([0.2, 0.0, 0.85])


def test_limbs_take_one_rate_per_interval(problem: CentroidalProblem) -> None:
    m = len(problem.grid().phase)
    assert replace(problem, limbs_nm=np.zeros((m, 3))).limbs_nm is not None
    assert replace(problem, shape="cubic", limbs_nm=np.zeros((4 * m, 3))).limbs_nm is not None
    with pytest.raises(InvalidInput) as caught:
        replace(problem, limbs_nm=np.zeros((m + 1, 3)))
    assert caught.value.code == "limbs-need-grid"
    with pytest.raises(InvalidInput) as caught:
        replace(problem, limbs_nm=np.zeros((m, 3)), durations=FreeDurations())
    assert caught.value.code == "limbs-need-grid"


def test_hanging_by_the_hand_is_not_standing() -> None:
    with pytest.raises(InvalidInput) as caught:
        standing_com_m(phase(1.0, hand(0.0, 1.0)).contacts, 0.8, EFFECTORS)
    assert caught.value.code == "no-surface-contact"


def test_an_effector_that_the_robot_lacks_is_named(problem: CentroidalProblem) -> None:
    with pytest.raises(InvalidInput) as caught:
        replace(problem, effectors={"left_foot": EFFECTORS["left_foot"]})
    assert caught.value.code == "effector-unknown"
    assert {fault.where for fault in caught.value.faults} == {"right_foot", "right_hand"}


@pytest.mark.parametrize("weight", ["com_acceleration", "momentum_rate", "likelihood", "surface_force", "point_force"])
@pytest.mark.parametrize("value", [-1.0, float("nan"), float("inf")])
def test_a_weight_of_the_wrong_sign_is_named(weight: str, value: float) -> None:
    with pytest.raises(InvalidInput) as caught:
        Weights(**{weight: value})
    assert caught.value.code == "weight-out-of-range"
    assert [fault.where for fault in caught.value.faults] == [f"weights.{weight}"]


def test_a_missing_proxy_is_named_but_none_at_all_is_a_choice(problem: CentroidalProblem) -> None:
    with pytest.raises(InvalidInput) as caught:
        replace(problem, proxies={"left_foot": PROXIES["left_foot"]})
    assert caught.value.code == "proxy-missing"
    assert {fault.where for fault in caught.value.faults} == {"right_foot", "right_hand"}
    assert not replace(problem, proxies={}).proxies


@pytest.mark.parametrize("duration_s", [0.0, -1.0, float("nan"), float("inf")])
def test_phases_that_take_no_time_are_named(duration_s: float) -> None:
    left, right = foot("left", 0.0), foot("right", 0.0)
    walk = sequence(phase(1.0, left, right), phase(duration_s, left), phase(1.0, left, right))
    with pytest.raises(InvalidInput) as caught:
        rest_to_rest(walk)
    assert caught.value.code == "phase-without-duration"
    assert [fault.where for fault in caught.value.faults] == ["phases[1].duration_s"]


@pytest.mark.parametrize("rate_hz", [0.0, -10.0, float("nan")])
def test_a_grid_without_nodes_is_refused(problem: CentroidalProblem, rate_hz: float) -> None:
    with pytest.raises(InvalidInput) as caught:
        replace(problem, node_rate_hz=rate_hz)
    assert caught.value.code == "node-rate-out-of-range"


def test_with_the_wrench_as_control_contacts_stay(problem: CentroidalProblem) -> None:
    with pytest.raises(InvalidInput) as caught:
        replace(problem, control=ContactWrench(), placements=FreePlacements())
    assert caught.value.code == "placements-need-forces"


@pytest.mark.parametrize("mass_kg", [0.0, -1.0, float("nan"), float("inf")])
def test_a_mass_must_be_positive(problem: CentroidalProblem, mass_kg: float) -> None:
    with pytest.raises(InvalidInput, match="mass"):
        replace(problem, mass_kg=mass_kg)


def test_a_centre_of_mass_must_be_a_place(problem: CentroidalProblem) -> None:
    with pytest.raises(InvalidInput, match="centre of mass"):
        replace(problem, com_end_m=np.array([0.0, np.nan, 1.0]))
