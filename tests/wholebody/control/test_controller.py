"""Motions of the whole body obey physics, follow their plan, and end with a reason where they cannot."""

import itertools
from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest

from stridelab.centroidal.plan import CentroidalPlan
from stridelab.centroidal.rest_to_rest import from_rest_to_rest
from stridelab.centroidal.solver import solve
from stridelab.contacts.effector_geometry import effector_shapes
from stridelab.contacts.scenario_io import sequence_of
from stridelab.contacts.scenarios.parts import Walker
from stridelab.contacts.scenarios.stairs import HandRail, Stairs, stairs_with_rail
from stridelab.contacts.sequence import Contact, ContactPhase, ContactSequence
from stridelab.conventions import g
from stridelab.dynamics.spatial import Placement
from stridelab.errors import InvalidInput, NotEstimable
from stridelab.reachability.store import load_proxies
from stridelab.robots.loader import load_robot
from stridelab.robots.robot import Robot
from stridelab.wholebody.certificate.inverse_dynamics import recompute_dynamics
from stridelab.wholebody.control.controller import WholeBodyController
from stridelab.wholebody.control.hierarchical_qp import (
    HierarchyFailure,
    HierarchyResult,
    Inequalities,
    Rows,
    solve_hierarchy,
)
from stridelab.wholebody.control.rigid_body import RigidBody
from stridelab.wholebody.control.task_stack import PhaseHierarchy, SampleTargets, Settings
from stridelab.wholebody.motion import LEVELS, WholeBodyMotion, WholeBodyStopped
from support.robots.plans import sway

Swaying = tuple[CentroidalPlan, WholeBodyMotion]
Patch = pytest.MonkeyPatch
TwoSteps = tuple[ContactSequence, CentroidalPlan, WholeBodyMotion]


def test_the_com_follows_the_plan(swaying: Swaying) -> None:
    _, motion = swaying
    assert motion.failures == ()
    assert np.linalg.norm(motion.com_m - motion.com_reference_m, axis=1).max() < 1e-4
    assert np.ptp(motion.com_m[:, 1]) > 0.05


def test_samples_cover_the_motion(swaying: Swaying) -> None:
    plan, motion = swaying
    assert motion.time_s[0] == 0.0
    assert motion.time_s[-1] == pytest.approx(plan.sequence.duration_s)
    assert np.allclose(np.diff(motion.time_s), 1 / motion.rate_hz)


@pytest.mark.parametrize("which", ["swaying", "two_steps"])
def test_the_rate_of_momentum_is_forces_and_weight(which: str, talos: Robot, request: pytest.FixtureRequest) -> None:
    """d(m v)/dt by central differences of the CoM's velocity, away from where the contacts change. (4.2a)."""
    motion: WholeBodyMotion = request.getfixturevalue(which)[-1]
    dt = 1 / motion.rate_hz
    rate = talos.mass_kg * (motion.com_v_m_s[2:] - motion.com_v_m_s[:-2]) / (2 * dt)
    total = sum(f.sum(axis=1) for f in motion.forces_n.values()) + talos.mass_kg * g
    mean = 0.5 * (total[1:-1] + total[:-2])  # forces are held from one sample to the next
    gap = np.linalg.norm(rate - mean, axis=1)
    assert np.quantile(gap, 0.95) < 1.0
    assert gap.max() < 0.05 * talos.mass_kg * 9.81


def test_power_goes_into_energy(swaying: Swaying, talos: Robot) -> None:
    """Standing contacts do no work: the torques' work is the change of kinetic and potential energy.

    Torques are taken at the beginning of every sample, which leaves an error of first order in its length.
    """
    _, motion = swaying
    data = talos.model.createData()
    energy = np.array(
        [
            pin.computeKineticEnergy(talos.model, data, q, v) + pin.computePotentialEnergy(talos.model, data, q)
            for q, v in zip(motion.q, motion.v, strict=True)
        ]
    )
    v_mean = 0.5 * (motion.v[1:, 6:] + motion.v[:-1, 6:])
    work = np.cumsum((motion.tau_nm[:-1] * v_mean).sum(axis=1)) / motion.rate_hz
    assert np.ptp(energy) > 0.3
    assert np.abs(energy[1:] - energy[0] - work).max() < 0.05 * np.ptp(energy)


def test_forces_act_only_on_what_touches(two_steps: TwoSteps) -> None:
    sequence, _, motion = two_steps
    assert motion.failures == ()
    for name in sequence.effectors:
        for t, f in zip(motion.time_s, motion.forces_n[name], strict=True):
            touches = name in sequence.phases[sequence.phase_at(float(t) + 1e-9)].contacts
            assert touches == bool(np.any(f))


def test_a_second_run_gives_the_same_motion(talos: Robot) -> None:
    plan = sway(talos, duration_s=0.4, amplitude_m=0.01, period_s=0.4)
    one, two = (WholeBodyController().run(talos, plan.sequence, plan) for _ in range(2))
    assert np.array_equal(one.q, two.q)
    assert np.array_equal(one.tau_nm, two.tau_nm)


def test_progress_is_reported(talos: Robot) -> None:
    plan = sway(talos, duration_s=0.4, amplitude_m=0.01, period_s=0.4)
    reported: list[tuple[float, str]] = []
    WholeBodyController().run(
        talos, plan.sequence, plan, lambda fraction, message: reported.append((fraction, message))
    )
    fractions = [fraction for fraction, _ in reported]
    assert fractions == sorted(fractions)
    assert 0.0 <= fractions[0] <= fractions[-1] <= 1.0
    assert "0.4 s" in reported[0][1]


def test_a_hand_that_has_not_touched_anything_yet_is_led_to_its_first_contact(talos: Robot) -> None:
    plan = sway(talos, duration_s=2.0, amplitude_m=0.01, period_s=1.0)
    feet = plan.sequence.phases[0].contacts
    place = Placement.from_wxyz([0.20, -0.45, 0.75])
    hand = Contact("right_hand", place, "table", 0.5, "point")
    phases = (ContactPhase(1.2, feet), ContactPhase(0.8, {**feet, "right_hand": hand}))
    sequence = replace(plan.sequence, phases=phases)
    forces = {**plan.forces_n, "right_hand": np.zeros((len(plan.com_a_m_s2), 1, 3))}
    motion = WholeBodyController().run(talos, sequence, replace(plan, sequence=sequence, forces_n=forces))
    assert motion.failures == ()
    result = recompute_dynamics(talos, sequence, motion).contact_points_m["right_hand"][:, 0]
    touching = motion.time_s >= 1.2
    assert np.linalg.norm(result[0] - place.position_m) > 0.1
    assert np.linalg.norm(result[touching] - place.position_m, axis=1).max() < 1e-3


@pytest.mark.parametrize(
    ("weight", "least_n", "most_n"), [(Settings().hand_force_weight, 0.0, 15.0), (1e-3, 80.0, 200.0)]
)
def test_a_hand_does_not_correct_the_momentum_of_the_limbs(
    talos: Robot, weight: float, least_n: float, most_n: float
) -> None:
    """On one sole, with a swinging arm and no force planned on the hand. With the soles' weight it would take all."""
    plan, body, v = sway(talos), RigidBody(talos), np.zeros(talos.model.nv)
    v[[6 + talos.joint_names.index(joint) for joint in ("arm_left_1_joint", "arm_left_2_joint", "torso_2_joint")]] = 1.0
    body.update(talos.q_reference, v)
    hand = Contact("right_hand", Placement(body.frame_state("right_hand").position_m, np.eye(3)), "rail", 0.5, "point")
    contacts = {"left_foot": plan.sequence.phases[0].contacts["left_foot"], "right_hand": hand}
    forces_n = {**plan.forces_at(0.0), "right_hand": np.zeros((1, 3))}
    settings, still = replace(Settings(), hand_force_weight=weight), np.zeros(3)
    programme = PhaseHierarchy(talos, body, contacts, {}, settings)
    stacked = programme.stack_forces_n({name: forces[None] for name, forces in forces_n.items()})[0]
    targets = SampleTargets(0.0, plan.reference_at(0.0), (np.eye(3), still, still), stacked)
    result = solve_hierarchy(*programme.build_rows(targets))
    assert result.failure is None
    assert np.linalg.norm(body.l_nms) > 2.0
    assert least_n <= np.linalg.norm(programme.forces_n(result.z)["right_hand"]) < most_n


def test_without_contacts_the_body_falls(talos: Robot) -> None:
    """The CoM cannot be held, whatever level 1 asks for; the level is met as well as it can be, and that is g."""
    body = RigidBody(talos)
    body.update(talos.q_reference, np.zeros(talos.model.nv))
    plan = sway(talos)
    programme = PhaseHierarchy(talos, body, {}, {}, Settings())
    still = np.zeros(3)
    equality, levels, bounds = programme.build_rows(
        SampleTargets(0.0, plan.reference_at(0.0), (np.eye(3), still, still), np.zeros(0))
    )
    result = solve_hierarchy(equality, levels, bounds)
    assert result.failure is None
    c_a = (body.A_g[:3] @ result.z + body.A_g_drift[:3]) / talos.mass_kg
    assert np.allclose(c_a, g, atol=1e-6)


def test_a_plan_that_cannot_be_followed_ends_with_time_phase_and_limits(talos: Robot) -> None:
    plan = sway(talos, duration_s=2.0, amplitude_m=0.6, period_s=1.0)
    with pytest.raises(NotEstimable) as ended:
        WholeBodyController().run(talos, plan.sequence, plan)
    error = ended.value
    assert error.code == "whole-body-failed"
    assert "phase 0" in error.message
    assert " s (" in error.message
    assert error.faults
    assert all(fault.where == "phases[0]" for fault in error.faults)


def test_a_programme_without_solution_names_the_torques_that_ran_out(talos: Robot) -> None:
    plan = sway(talos, duration_s=1.0, amplitude_m=0.01, period_s=1.0)
    weak = pin.Model(talos.model)
    weak.effortLimit = 0.05 * talos.model.effortLimit
    with pytest.raises(NotEstimable) as ended:
        WholeBodyController().run(replace(talos, model=weak), plan.sequence, plan)
    assert ended.value.code == "whole-body-failed"
    assert any("torque of leg" in fault.message for fault in ended.value.faults)


def test_many_failures_end_the_run_even_when_others_succeed_between(talos: Robot, monkeypatch: Patch) -> None:
    plan = sway(talos, duration_s=0.4, amplitude_m=0.01, period_s=0.4)
    fail_at(monkeypatch, lambda sample: sample % 2 == 1)
    with pytest.raises(NotEstimable) as ended:
        WholeBodyController().run(talos, plan.sequence, plan)
    assert "21 samples had no solution" in ended.value.message
    assert "0.16 s" in ended.value.message


def test_a_single_failure_is_counted_and_bridged(talos: Robot, monkeypatch: Patch) -> None:
    plan = sway(talos, duration_s=0.4, amplitude_m=0.01, period_s=0.4)
    fail_at(monkeypatch, lambda sample: sample == 30)
    motion = WholeBodyController().run(talos, plan.sequence, plan)
    assert [(round(f.time_s, 6), f.phase, f.level) for f in motion.failures] == [(0.12, 0, 2)]
    assert np.array_equal(motion.a[30], motion.a[29])
    assert not np.array_equal(motion.a[31], motion.a[30])


def test_a_start_out_of_reach_is_refused(talos: Robot) -> None:
    plan = sway(talos)
    high = replace(plan, com_m=plan.com_m + np.array([0.0, 0.0, 0.4]))
    with pytest.raises(NotEstimable) as refused:
        WholeBodyController().run(talos, plan.sequence, high)
    assert refused.value.code == "stance-unreachable"
    assert "centre of mass" in refused.value.message


def test_a_rate_without_samples_is_refused(talos: Robot) -> None:
    plan = sway(talos)
    with pytest.raises(InvalidInput) as refused:
        WholeBodyController(rate_hz=0.01).run(talos, plan.sequence, plan)
    assert refused.value.code == "sample-time"


def fail_at(monkeypatch: Patch, fails: Callable[[int], bool]) -> None:
    """Let the hierarchy have no solution at some samples."""
    count = itertools.count()

    def flaky(equality: Rows, levels: Sequence[Rows], bounds: Inequalities) -> HierarchyResult:
        result = solve_hierarchy(equality, levels, bounds)
        return result._replace(failure=HierarchyFailure(2, "made to fail")) if fails(next(count)) else result

    monkeypatch.setattr("stridelab.wholebody.control.controller.solve_hierarchy", flaky)


def test_what_stops_a_motion_keeps_it_until_then_and_names_the_level(talos: Robot) -> None:
    plan = sway(talos, duration_s=2.0, amplitude_m=0.6, period_s=1.0)
    with pytest.raises(WholeBodyStopped) as ended:
        WholeBodyController().run(talos, plan.sequence, plan)
    stopped = ended.value
    assert stopped.phase == 0
    assert f"is {stopped.level} ({LEVELS[stopped.level]})" in stopped.message
    assert stopped.names
    n = len(stopped.motion.time_s)
    assert 1 < n < 2.0 * 250.0
    assert stopped.time_s == pytest.approx((n - 1) / 250.0)
    assert stopped.motion.q.shape == (n, talos.model.nq)
    assert all(forces.shape[0] == n for forces in stopped.motion.forces_n.values())
    assert np.abs(np.linalg.norm(stopped.motion.q[:, 3:7], axis=1) - 1.0).max() < 1e-9


def test_a_motion_that_stops_at_once_shows_where_it_stands(talos: Robot, monkeypatch: Patch) -> None:
    plan = sway(talos, duration_s=0.4, amplitude_m=0.01, period_s=0.4)
    fail_at(monkeypatch, lambda _: True)
    with pytest.raises(WholeBodyStopped) as ended:
        WholeBodyController(failures_in_a_row=0).run(talos, plan.sequence, plan)
    assert ended.value.motion.q.shape == (1, talos.model.nq)
    assert np.linalg.norm(ended.value.motion.q[0, 3:7]) == pytest.approx(1.0)


def test_a_hand_stays_where_it_has_touched_while_its_arm_turns() -> None:
    """The arm turns about the contact point at up to 5 rad/s, which the steps of the integration do not follow."""
    g1 = load_robot("g1")
    rail = HandRail(height_m=0.75, y_m=-0.32)
    scenario = stairs_with_rail(Stairs(2, 0.05), rail, walker=Walker("g1", 0.1185, 0.107, 0.101))
    sequence = sequence_of(scenario, effector_shapes("g1"))
    motion = WholeBodyController().run(g1, sequence, solve(from_rest_to_rest(g1, sequence, load_proxies("g1"))))
    body, touched_m, moved_m = RigidBody(g1), None, 0.0
    for q, v, phase in zip(motion.q, motion.v, sequence.phases_at(motion.time_s + 1e-9), strict=True):
        if "right_hand" not in sequence.phases[phase].contacts:
            touched_m = None
            continue
        body.update(q, v)
        at_m = body.frame_state("right_hand").position_m
        touched_m = at_m if touched_m is None else touched_m
        moved_m = max(moved_m, float(np.linalg.norm(at_m - touched_m)))
    assert moved_m < 5e-5
