"""Contact sequences made by hand, and the centroidal problems over them.

Contact sequences, effectors and reachability mixtures made by hand, for tests that need no robot and no files.

Problems of the centroidal stage over the sequences made by hand.

The centroidal problems of the bundled scenarios.

The C++ solver and ipopt on the same problem, in the same cones.

How hard a robot may be pushed under way (section 4.8): the boundary, found by bisection.

At a time of a plan the CoM gets a velocity on top of its own. The push is recovered from where the rest of the contact
sequence, at its given times and places, still leads to the goal at rest, with what is left of the cost as it may be.
"""

import json
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, Final

import numpy as np
import pytest

from stridelab.centroidal.native.availability import native_can_solve
from stridelab.centroidal.plan import CentroidalPlan
from stridelab.centroidal.problem import CentroidalProblem, standing_com_m
from stridelab.centroidal.receding_horizon import SOLVE_LIMITS, RecedingHorizon, State
from stridelab.centroidal.rest_to_rest import from_rest_to_rest
from stridelab.centroidal.solver import solve
from stridelab.contacts.effector_geometry import effector_shapes
from stridelab.contacts.scenario_io import sequence_of
from stridelab.contacts.sequence import Contact, ContactPhase, ContactSequence
from stridelab.contacts.terrain import Box, Terrain
from stridelab.conventions import Vector3
from stridelab.dynamics.spatial import Placement
from stridelab.machine.models_folder import models_dir
from stridelab.reachability.gaussian_mixture import Mixture
from stridelab.reachability.proxy.effector_proxy import Proxy
from stridelab.reachability.store import load_proxies
from stridelab.robots.loader import load_robot
from stridelab.robots.robot import Effector

MASS_KG = 90.0
COM_HEIGHT_M = 0.82
FOOT_Y_M = 0.09

EFFECTORS = {
    "left_foot": Effector("left_foot", "left_sole", "surface", Placement.identity(), (0.10, 0.06)),
    "right_foot": Effector("right_foot", "right_sole", "surface", Placement.identity(), (0.10, 0.06)),
    "right_hand": Effector("right_hand", "right_gripper", "point", Placement.identity()),
}


def foot(side: str, x_m: float, z_m: float = 0.0, friction: float = 0.3) -> Contact:
    y = FOOT_Y_M if side == "left" else -FOOT_Y_M
    return Contact(f"{side}_foot", Placement.from_wxyz((x_m, y, z_m)), "ground", friction)


def hand(x_m: float, z_m: float, slope: float = 0.0, friction: float = 0.3) -> Contact:
    half = -np.arctan(slope) / 2
    place = Placement.from_wxyz((x_m, -0.5, z_m), (np.cos(half), 0.0, np.sin(half), 0.0))
    return Contact("right_hand", place, "rail", friction)


def phase(duration_s: float, *contacts: Contact) -> ContactPhase:
    return ContactPhase(duration_s, {contact.effector: contact for contact in contacts})


def sequence(*phases: ContactPhase, name: str = "by hand") -> ContactSequence:
    ground = Box("ground", Placement.from_wxyz((0.0, 0.0, -0.05)), np.array([10.0, 10.0, 0.1]))
    return ContactSequence(name, "nobody", 0.3, Terrain((ground,)), phases)


def two_steps(step_m: float = 0.2, friction: float = 0.3) -> ContactSequence:
    """Right, then left foot ``step_m`` ahead: 3.4 s."""
    left, right = foot("left", 0.0, friction=friction), foot("right", 0.0, friction=friction)
    left_ahead, right_ahead = foot("left", step_m, friction=friction), foot("right", step_m, friction=friction)
    return sequence(
        phase(0.6, left, right),
        phase(0.8, left),
        phase(0.3, left, right_ahead),
        phase(0.8, right_ahead),
        phase(0.9, left_ahead, right_ahead),
    )


def mirrored(walk: ContactSequence) -> ContactSequence:
    """The same walk seen in a mirror: y changes sign, left and right their names (contacts must be level)."""
    names = {"left_foot": "right_foot", "right_foot": "left_foot"}

    def flip(contact: Contact) -> Contact:
        position = contact.placement.position_m * np.array([1.0, -1.0, 1.0])
        return Contact(names[contact.effector], Placement(position, np.eye(3)), contact.surface, contact.friction)

    phases = [ContactPhase(p.duration_s, {c.effector: c for c in map(flip, p.contacts.values())}) for p in walk.phases]
    return sequence(*phases, name="mirrored")


def foot_mixture(side: str) -> Mixture:
    """Seven components along an arc of 0.85 m over the ankle, in the sole's frame."""
    angle = np.deg2rad(np.arange(-36.0, 37.0, 12.0))
    weights = np.exp(-0.5 * (angle / np.deg2rad(22.0)) ** 2)
    y = 0.085 if side == "right" else -0.085
    means = np.column_stack([0.85 * np.sin(angle), np.full(7, y), 0.85 * np.cos(angle)])
    return Mixture(weights / weights.sum(), means, _tilted(angle, (0.09, 0.07, 0.055)))


def hand_mixture() -> Mixture:
    """Seven components around a place behind, left of and below the right hand."""
    angle = np.deg2rad(np.arange(-60.0, 61.0, 20.0))
    means = np.column_stack([-0.30 + 0.25 * np.sin(angle), np.full(7, 0.42), -0.10 + 0.10 * np.cos(angle)])
    return Mixture(np.full(7, 1.0 / 7.0), means, _tilted(angle, (0.16, 0.12, 0.14)))


def _tilted(angle: np.ndarray, sd_m: tuple[float, float, float]) -> np.ndarray:
    covariances = []
    for a in angle:
        R = np.array([[np.cos(a), 0.0, np.sin(a)], [0.0, 1.0, 0.0], [-np.sin(a), 0.0, np.cos(a)]])
        S = R @ np.diag(np.square(sd_m)) @ R.T
        covariances.append((S + S.T) / 2)
    return np.array(covariances)


MIXTURES = {
    "left_foot": foot_mixture("left"),
    "right_foot": foot_mixture("right"),
    "right_hand": hand_mixture(),
}
PROXIES = {name: Proxy(mixture) for name, mixture in MIXTURES.items()}


def rest_to_rest(
    walk: ContactSequence, proxies: Mapping[str, Proxy] = PROXIES, height_m: float = COM_HEIGHT_M, **settings: Any
) -> CentroidalProblem:
    """From standing over the first phase to standing over the last."""
    start, end = (standing_com_m(walk.phases[i].contacts, height_m, EFFECTORS) for i in (0, -1))
    return CentroidalProblem(walk, MASS_KG, EFFECTORS, proxies, start, end, **settings)


def with_a_contact_between(**settings: Any) -> CentroidalProblem:
    """Two steps: the right foot's first landing is neither the start nor the goal."""
    left, right, ahead, far = foot("left", 0.0), foot("right", 0.0), foot("right", 0.25), foot("left", 0.45)
    walk = sequence(
        phase(0.6, left, right),
        phase(0.8, left),
        phase(0.4, left, ahead),
        phase(0.8, ahead),
        phase(0.4, far, ahead),
        phase(0.8, far),
        phase(0.8, far, foot("right", 0.45)),
    )
    return rest_to_rest(walk, **settings)


TALOS_COM_HEIGHT_M = 0.86


def bundled(scenario: str, **settings: Any) -> CentroidalProblem:
    """TALOS from rest to rest over a scenario of ``models/scenarios``, with the bundled proxies."""
    robot, sequence = load_robot("talos"), _sequence(scenario, "talos")
    start, end = (standing_com_m(sequence.phases[i].contacts, TALOS_COM_HEIGHT_M, robot.effectors) for i in (0, -1))
    problem = CentroidalProblem(sequence, robot.mass_kg, robot.effectors, load_proxies("talos"), start, end)
    return replace(problem, **settings)


def rail_of_hrp2(**settings: Any) -> CentroidalProblem:
    """The third experiment for HRP-2."""
    sequence = _sequence("stairs-with-rail-hrp2", "hrp2")
    return replace(from_rest_to_rest(load_robot("hrp2"), sequence, load_proxies("hrp2")), **settings)


def _sequence(scenario: str, robot: str) -> ContactSequence:
    text = (models_dir() / "scenarios" / f"{scenario}.json").read_text(encoding="utf-8")
    return sequence_of(json.loads(text), effector_shapes(robot))


def total(plan: CentroidalPlan) -> float:
    return sum(plan.cost_terms.values())


def assert_same(problem: CentroidalProblem) -> CentroidalPlan:
    ours, theirs = solve(problem, "native"), solve(problem, "ipopt")
    assert ours.converged, ours.status
    assert theirs.converged, theirs.status
    assert total(ours) == pytest.approx(total(theirs), rel=1e-5, abs=1e-4)
    assert ours.com_m == pytest.approx(theirs.com_m, abs=1e-4)
    assert ours.solution is not None
    residuals = ours.solution.attempts[-1].residuals
    assert residuals is not None
    assert residuals.kkt_error <= 1e-6
    return ours


MOST_M_S: Final = 5.0
"""Harder pushes are not tried."""
CLOSE_M_S: Final = 0.005
"""The bisection ends there."""


@dataclass(frozen=True)
class Boundary:
    """``held_m_s`` was recovered from, ``lost_m_s`` was not (infinite: even the hardest was)."""

    held_m_s: float
    lost_m_s: float


def push_boundary(problem: CentroidalProblem, plan: CentroidalPlan, time_s: float, direction: Vector3) -> Boundary:
    """Bisect the size of a push along ``direction`` (of length one) at ``time_s`` of a plan of ``problem``."""
    there = plan.reference_at(time_s)
    horizon = RecedingHorizon(problem=problem, horizon_s=max(problem.sequence.duration_s, 1.0))

    def recovered(size_m_s: float) -> bool:
        state = State(there.com_m, there.com_v_m_s + size_m_s * np.asarray(direction), there.l_nms)
        rest = horizon.horizon_problem(time_s, state)
        return solve(rest, "native" if native_can_solve(rest) else "ipopt", SOLVE_LIMITS).converged

    if recovered(MOST_M_S):
        return Boundary(MOST_M_S, np.inf)
    held_m_s, lost_m_s = 0.0, MOST_M_S
    while lost_m_s - held_m_s > CLOSE_M_S:
        middle = 0.5 * (held_m_s + lost_m_s)
        held_m_s, lost_m_s = (middle, lost_m_s) if recovered(middle) else (held_m_s, middle)
    return Boundary(held_m_s, lost_m_s)
