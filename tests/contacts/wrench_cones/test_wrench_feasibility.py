"""The margin of a wrench, against closed forms, a conic solver, and a cutting-plane method on linear programmes."""

import math

import clarabel
import numpy as np
import pytest
from scipy import sparse
from scipy.optimize import linprog

from stridelab.contacts.wrench_cones.contact_points import PointContacts
from stridelab.contacts.wrench_cones.wrench_feasibility import conic_margin, linear_margin
from stridelab.dynamics.spatial import Placement
from stridelab.errors import InvalidInput
from stridelab.reproduction.studies.random_contact_sets import random_contacts, random_wrench

HAND = PointContacts.from_placements([(Placement.from_wxyz((1.0, 2.0, 0.0)), None, 0.5)])
GRIP = PointContacts.from_placements(
    [
        (Placement.from_wxyz((0.0, 0.0, 0.0), (math.sqrt(0.5), 0.0, math.sqrt(0.5), 0.0)), None, 0.5),
        (Placement.from_wxyz((0.3, 0.0, 0.0), (math.sqrt(0.5), 0.0, -math.sqrt(0.5), 0.0)), None, 0.5),
    ]
)


def at_the_hand(force: list[float]) -> np.ndarray:
    return np.concatenate([force, np.cross(HAND.position_m[0], force)])


def by_cutting_planes(contacts: PointContacts, wrench: np.ndarray) -> float:
    """The same programme by HiGHS alone: cones cut off by their tangent planes where the last answer left them."""
    n, center = len(contacts.position_m), contacts.position_m.mean(axis=0)
    size = float(np.linalg.norm(wrench[:3]))
    target = np.concatenate([wrench[:3], wrench[3:] - np.cross(center, wrench[:3])]) / size
    angles = [(i, a) for i in range(n) for a in 2.0 * np.pi * np.arange(8) / 8]
    t = math.inf
    for _ in range(30):
        rows = np.zeros((len(angles), 3 * n + 1))
        for row, (i, a) in zip(rows, angles, strict=True):
            row[3 * i : 3 * i + 3] = contacts.rotation[i] @ [np.cos(a), np.sin(a), -contacts.friction[i]]
            row[-1] = 1.0
        result = linprog(
            np.append(np.zeros(3 * n), -1.0),
            A_ub=rows,
            b_ub=np.zeros(len(rows)),
            A_eq=np.hstack([contacts.grasp_matrix(center), np.zeros((6, 1))]),
            b_eq=target,
            bounds=[(None, None)] * (3 * n + 1),
            options={"primal_feasibility_tolerance": 1e-10, "dual_feasibility_tolerance": 1e-10},
        )
        t = float(result.x[-1])
        local = np.einsum("nka,nk->na", contacts.rotation, result.x[:-1].reshape(n, 3))
        beyond = np.hypot(local[:, 0], local[:, 1]) + t - contacts.friction * local[:, 2]
        if beyond.max() < 1e-11:
            break
        angles += [(i, math.atan2(local[i, 1], local[i, 0])) for i in range(n) if beyond[i] > 1e-12]
    return t * size


def by_clarabel(contacts: PointContacts, wrench: np.ndarray) -> float | None:
    """The same programme by an interior-point solver for cones, which keeps the sum of the forces as equations.

    None where it finds no forces: lengths are divided by the contacts' spread, forces by that of the wrench.
    """
    n, center = len(contacts.position_m), contacts.position_m.mean(axis=0)
    size = float(np.linalg.norm(wrench[:3]))
    spread = float(np.abs(contacts.position_m - center).max())
    scale = np.repeat([1.0, 1.0 / spread], 3)
    moment = wrench[3:] - np.cross(center, wrench[:3])
    rows, right = np.zeros((6 + 3 * n, 3 * n + 1)), np.zeros(6 + 3 * n)
    rows[:6, :-1] = scale[:, np.newaxis] * contacts.grasp_matrix(center)
    right[:6] = scale * np.concatenate([wrench[:3], moment]) / size
    for i in range(n):
        x, y, normal = contacts.rotation[i].T
        # (mu f_n - t, f_x, f_y) lies in the second-order cone; the solver wants right - rows (f, t) in it
        rows[6 + 3 * i : 9 + 3 * i, 3 * i : 3 * i + 3] = -np.array([contacts.friction[i] * normal, x, y])
        rows[6 + 3 * i, -1] = 1.0
    settings = clarabel.DefaultSettings()
    settings.verbose = False
    settings.tol_gap_abs = settings.tol_gap_rel = settings.tol_feas = 1e-11
    cones = [clarabel.ZeroConeT(6), *[clarabel.SecondOrderConeT(3)] * n]
    nothing = sparse.csc_matrix((3 * n + 1, 3 * n + 1))
    objective = np.append(np.zeros(3 * n), -1.0)
    result = clarabel.DefaultSolver(nothing, objective, sparse.csc_matrix(rows), right, cones, settings).solve()
    solved = result.status in (clarabel.SolverStatus.Solved, clarabel.SolverStatus.AlmostSolved)
    return float(result.x[-1]) * size if solved else None


@pytest.mark.parametrize(
    ("force", "margin"), [([0, 0, 100], 50), ([30, 40, 200], 50), ([30, 40, 90], -5), ([6, 8, 0], -10)]
)
def test_one_hand_in_closed_form(force: list[float], margin: float) -> None:
    held = conic_margin(HAND, at_the_hand(force))
    assert held.margin_n == pytest.approx(margin, abs=1e-6)
    np.testing.assert_allclose(held.forces_n, [force], atol=1e-9)
    pyramid = linear_margin(HAND, at_the_hand(force), 400).margin_n
    assert pyramid == pytest.approx(margin, abs=0.01)


def test_a_thousand_wrenches_agree_with_a_conic_solver() -> None:
    """To a micronewton for wrenches of a kilonewton; where there are no forces, the solver finds none either."""
    rng = np.random.default_rng(0)
    apart_n, not_held = [], []
    for k in range(1000):
        contacts = random_contacts(rng, 2 + k % 3)
        wrench = random_wrench(rng, contacts)
        margin_n, theirs_n = conic_margin(contacts, wrench).margin_n, by_clarabel(contacts, wrench)
        if math.isfinite(margin_n) and theirs_n is not None:
            apart_n.append(abs(margin_n - theirs_n))
        else:
            assert (margin_n, theirs_n) == (-math.inf, None)
            not_held.append(len(contacts.position_m))
    assert (len(apart_n), not_held) == (977, [2] * 23)  # two hands cannot turn a body about the line through them
    assert max(apart_n) < 1e-6


def test_it_agrees_with_an_independent_method() -> None:
    rng = np.random.default_rng(0)
    compared = 0
    for k in range(30):
        contacts = random_contacts(rng, 2 + k % 3)
        wrench = random_wrench(rng, contacts)
        held = conic_margin(contacts, wrench)
        if math.isfinite(held.margin_n):
            assert held.margin_n == pytest.approx(by_cutting_planes(contacts, wrench), abs=1e-6)
            compared += 1
    assert compared >= 25


def test_the_forces_bear_witness() -> None:
    """They add up to the wrench, and every point keeps the margin."""
    rng = np.random.default_rng(1)
    for k in range(12):
        contacts = random_contacts(rng, 3 + k % 2)
        wrench = random_wrench(rng, contacts)
        held = conic_margin(contacts, wrench)
        total = np.concatenate([held.forces_n.sum(axis=0), np.cross(contacts.position_m, held.forces_n).sum(axis=0)])
        np.testing.assert_allclose(total, wrench, atol=1e-8)
        local = np.einsum("nka,nk->na", contacts.rotation, held.forces_n)
        spare = contacts.friction * local[:, 2] - np.hypot(local[:, 0], local[:, 1])
        assert spare.min() >= held.margin_n - 1e-8


def test_pyramids_approach_the_circle_from_inside() -> None:
    rng = np.random.default_rng(2)
    contacts = random_contacts(rng, 3)
    wrench = contacts.wrench_rays().sum(axis=0) * 30.0
    exact = conic_margin(contacts, wrench).margin_n
    pyramids = [linear_margin(contacts, wrench, n).margin_n for n in (4, 8, 16, 64)]
    assert exact > 0.0
    assert pyramids == sorted(pyramids)
    assert pyramids[-1] == pytest.approx(exact, rel=2e-3)
    assert pyramids[-1] < exact


def test_point_and_unit_of_length_do_not_matter() -> None:
    rng = np.random.default_rng(3)
    contacts = random_contacts(rng, 3)
    wrench, shift = random_wrench(rng, contacts), np.array([50.0, -3.0, 8.0])
    moved = np.concatenate([wrench[:3], 1000.0 * (wrench[3:] + np.cross(shift, wrench[:3]))])
    there = conic_margin(contacts.in_frame(shift, 1000.0), moved).margin_n
    assert there == pytest.approx(conic_margin(contacts, wrench).margin_n, abs=1e-6)


def test_margins_without_bound() -> None:
    """A grip holds anything but a turn about the line through its points, which no force at all gives."""
    held = conic_margin(GRIP, np.array([0.0, 0.0, 10.0, 0.0, -1.5, 0.0]))
    assert held.margin_n == math.inf
    np.testing.assert_allclose(held.forces_n.sum(axis=0), [0.0, 0.0, 10.0], atol=1e-6)
    assert conic_margin(GRIP, np.array([0.0, 0.0, 10.0, 1.0, -1.5, 0.0])).margin_n == -math.inf
    assert linear_margin(GRIP, np.array([0.0, 0.0, 10.0, 1.0, -1.5, 0.0])).margin_n == -math.inf


def test_a_wrench_that_is_not_finite_is_refused() -> None:
    with pytest.raises(InvalidInput) as raised:
        conic_margin(HAND, np.array([0.0, 0.0, np.nan, 0.0, 0.0, 0.0]))
    assert raised.value.code == "wrench-invalid"
