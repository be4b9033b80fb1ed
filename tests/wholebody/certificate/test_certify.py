"""The certificate passes a good motion and notices every way in which one can be spoilt."""

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any

import numpy as np
import pinocchio as pin
import pytest

from stridelab.centroidal.plan import CentroidalPlan
from stridelab.contacts.sequence import ContactSequence
from stridelab.contacts.terrain import Box, Rail, Terrain
from stridelab.conventions import Vector3
from stridelab.dynamics.spatial import Placement
from stridelab.reachability.gaussian_mixture import Mixture
from stridelab.reachability.proxy.effector_proxy import Proxy
from stridelab.robots.robot import Robot
from stridelab.wholebody.certificate import clearance
from stridelab.wholebody.certificate.certificate import Certificate, Check, WorstValues
from stridelab.wholebody.certificate.certify import certify
from stridelab.wholebody.certificate.clearance import terrain_distances
from stridelab.wholebody.certificate.inverse_dynamics import phase_of_samples
from stridelab.wholebody.motion import SolverFailure, WholeBodyMotion

TwoSteps = tuple[ContactSequence, CentroidalPlan, WholeBodyMotion]
Spoil = Callable[[WholeBodyMotion, Robot], WholeBodyMotion]


def check(certificate: Certificate, name: str) -> Check:
    return next(check for check in certificate.checks if check.name == name)


@pytest.fixture(scope="module")
def good(talos: Robot, two_steps: TwoSteps, proxies: Mapping[str, Proxy]) -> Certificate:
    sequence, plan, motion = two_steps
    return certify(talos, sequence, plan, proxies, motion)


def test_a_good_motion_passes(good: Certificate) -> None:
    assert [check for check in good.checks if not check.passed] == []
    assert good.passed


def test_its_values_are_those_of_the_motion(good: Certificate, talos: Robot, two_steps: TwoSteps) -> None:
    _, _, motion = two_steps
    ratio = np.abs(motion.tau_nm) / talos.model.effortLimit[6:]
    legs = np.array([talos.group[joint] != "arm" for joint in talos.joint_names])
    result = check(good, "torque_ratio_max_legs_torso")
    assert result.value == pytest.approx(ratio[:, legs].max())
    i, j = divmod(int(np.argmax(np.where(legs, ratio, 0.0))), ratio.shape[1])
    assert (result.effector, result.time_s) == (talos.joint_names[j], pytest.approx(motion.time_s[i]))
    com_error = np.linalg.norm(motion.com_m - motion.com_reference_m, axis=1).max()
    assert check(good, "com_error_max").value == pytest.approx(com_error, rel=1e-6)
    assert check(good, "self_collision_pairs").value == 0.0
    assert 0.001 < check(good, "terrain_distance_min").value < 0.06


def test_pairs_that_are_not_measured_change_no_distance(
    talos: Robot, two_steps: TwoSteps, monkeypatch: pytest.MonkeyPatch
) -> None:
    sequence, _, motion = two_steps
    box = Box("block", Placement(np.array([0.35, 0.3, 0.4]), np.eye(3)), np.array([0.2, 0.1, 0.9]), 0.5)
    rail = Rail("rail", np.array([0.0, -0.6, 0.9]), np.array([1.0, -0.5, 1.0]), 0.02, 0.5)
    beside = replace(sequence, terrain=Terrain((*sequence.terrain.surfaces, box, rail)))
    worst = WorstValues(motion.time_s[::40], phase_of_samples(sequence, motion.time_s[::40]))
    rng = np.random.default_rng(3)
    q = motion.q[::40].copy()
    q[:, 7:] += rng.normal(scale=0.15, size=q[:, 7:].shape)
    measured: list[int] = []
    compute = pin.computeDistance

    def count(*arguments: Any) -> Any:
        measured[-1] += 1
        return compute(*arguments)

    monkeypatch.setattr(pin, "computeDistance", count)
    measured.append(0)
    few = terrain_distances(talos, beside, q, worst)
    bounds = clearance._SphereGaps.lower_bounds_m
    monkeypatch.setattr(
        clearance._SphereGaps, "lower_bounds_m", lambda *arguments: np.full_like(bounds(*arguments), -10.0)
    )
    measured.append(0)
    for one, other in zip(terrain_distances(talos, beside, q, worst), few, strict=True):
        assert one.value == pytest.approx(other.value, abs=1e-9), "the solver starts elsewhere"
        assert (one.name, one.phase, one.effector, one.time_s) == (
            other.name,
            other.phase,
            other.effector,
            other.time_s,
        )
    assert measured[0] < 0.2 * measured[1]
    assert {check.effector for check in few} != {None}


def test_with_a_tolerance_distances_below_the_lowered_limits_are_those_of_the_certificate(
    talos: Robot, two_steps: TwoSteps
) -> None:
    """A wall beside the left arm: 4.5 mm meet a limit that is lowered to 4 mm, 3.5 mm do not."""
    sequence, _, motion = two_steps
    worst = WorstValues(motion.time_s[::40], phase_of_samples(sequence, motion.time_s[::40]))
    outermost_m = float(sequence.phases[0].contacts["left_foot"].placement.position_m[1])

    def arm_check(wall_y_m: float, tolerance_m: float | None) -> Check:
        wall = Box("wall", Placement(np.array([0.3, wall_y_m, 0.9]), np.eye(3)), np.array([2.0, 0.1, 0.9]), 0.5)
        beside = replace(sequence, terrain=Terrain((*sequence.terrain.surfaces, wall)))
        checks = terrain_distances(talos, beside, motion.q[::40], worst, tolerance_m)
        return next(one for one in checks if one.name == "arm_terrain_distance_min")

    far_m = arm_check(outermost_m + 1.0, None).value
    for gap_m, passes in ((0.0045, True), (0.0035, False)):
        nearer = arm_check(outermost_m + 1.0 - far_m + gap_m, 1e-3)
        assert nearer.limit == pytest.approx(0.004)
        assert nearer.passed is passes
        assert passes or nearer.value == pytest.approx(gap_m, abs=2e-4)
    assert not arm_check(outermost_m + 1.0 - far_m + 0.0045, None).passed, "the certificate has no tolerance"


def moved(motion: WholeBodyMotion, samples: slice, offset: dict[int, float]) -> WholeBodyMotion:
    """The configurations of some samples changed in some coordinates."""
    q = motion.q.copy()
    for coordinate, by in offset.items():
        q[samples, coordinate] += by
    return replace(motion, q=q)


def crossed_legs(motion: WholeBodyMotion, robot: Robot) -> WholeBodyMotion:
    inward = {
        7 + robot.joint_names.index("leg_left_2_joint"): -0.35,
        7 + robot.joint_names.index("leg_right_2_joint"): 0.35,
    }
    return moved(motion, slice(100, 140), inward)


def beyond_its_range(motion: WholeBodyMotion, robot: Robot) -> WholeBodyMotion:
    knee = robot.joint_names.index("leg_left_4_joint")
    q = motion.q.copy()
    q[50, 7 + knee] = robot.model.lowerPositionLimit[7 + knee] - 0.01
    return replace(motion, q=q)


def twisted_foot(motion: WholeBodyMotion, robot: Robot) -> WholeBodyMotion:
    return moved(motion, slice(60, 70), {7 + robot.joint_names.index("leg_left_6_joint"): 0.05})


def fast_landing(motion: WholeBodyMotion, robot: Robot) -> WholeBodyMotion:
    """The sample before the last touch-down a fifth of a millimetre too high."""
    landed = [i for i in range(1, len(motion.time_s)) if _lands(motion, i)]
    return moved(motion, slice(landed[-1] - 1, landed[-1]), {2: 2e-4})


def _lands(motion: WholeBodyMotion, i: int) -> bool:
    before, now = (motion.sequence.phases[motion.sequence.phase_at(float(motion.time_s[k]) + 1e-9)] for k in (i - 1, i))
    return bool(now.contacts.keys() - before.contacts.keys())


def sideways_force(motion: WholeBodyMotion, robot: Robot) -> WholeBodyMotion:
    forces = {name: f.copy() for name, f in motion.forces_n.items()}
    forces["left_foot"][30, 0, 1] += 500.0
    return replace(motion, forces_n=forces)


def force_in_the_air(motion: WholeBodyMotion, robot: Robot) -> WholeBodyMotion:
    forces = {name: f.copy() for name, f in motion.forces_n.items()}
    i = int(np.flatnonzero(~forces["right_foot"].any(axis=(1, 2)))[0])
    forces["right_foot"][i, 0, 2] = 1.0
    return replace(motion, forces_n=forces)


SPOILT: dict[str, tuple[Spoil, str]] = {
    "solver_failures": (lambda m, r: replace(m, failures=(SolverFailure(0.5, 0, 1, "no solution"),)), ""),
    "com_error_max": (lambda m, r: moved(m, slice(20, 21), {0: 0.002}), ""),
    "landing_error_max": (lambda m, r: moved(m, slice(None), {1: 0.002}), "foot"),
    "landing_angle_max": (lambda m, r: moved(m, slice(None), {3: 0.004}), "foot"),
    "touch_down_speed_max": (fast_landing, "foot"),
    "contact_drift_max": (twisted_foot, "left_foot"),
    "joint_limit_margin": (beyond_its_range, "leg_left_4_joint"),
    "velocity_ratio_max": (lambda m, r: replace(m, v=m.v * 20.0), "leg"),
    "torque_ratio_max_legs_torso": (lambda m, r: replace(m, tau_nm=m.tau_nm * 3.0), "leg"),
    "torque_ratio_max_arms": (lambda m, r: replace(m, tau_nm=m.tau_nm * 6.0), "arm"),
    "friction_cone_margin": (sideways_force, "left_foot"),
    "dynamics_residual": (lambda m, r: replace(m, a=m.a + 0.01), ""),
    "torque_residual": (lambda m, r: replace(m, tau_nm=m.tau_nm * 1.001), "leg"),
    "integration_gap": (lambda m, r: moved(m, slice(7, 8), {20: 1e-5}), ""),
    "self_collision_pairs": (crossed_legs, " and "),
    "terrain_distance_min": (lambda m, r: moved(m, slice(200, None), {2: -0.05}), "leg"),
    "arm_terrain_distance_min": (lambda m, r: moved(m, slice(200, None), {2: -0.8}), "gripper"),
    "leg_terrain_distance_min": (lambda m, r: moved(m, slice(200, None), {2: -0.008}), "leg"),
    "angular_momentum_mismatch_max": (lambda m, r: replace(m, v=m.v * 20.0), ""),
}


@pytest.mark.parametrize("name", SPOILT)
def test_a_spoilt_motion_fails_the_check_of_what_was_spoilt(name: str, talos: Robot, two_steps: TwoSteps) -> None:
    sequence, plan, motion = two_steps
    spoil, effector = SPOILT[name]
    result = check(certify(talos, sequence, plan, {}, spoil(motion, talos)), name)
    assert not result.passed
    assert result.phase is not None
    assert effector in (result.effector or "")


@pytest.mark.parametrize(("share", "passes"), [(0.019, False), (0.021, True)])
def test_a_joint_keeps_two_percent_of_its_range(share: float, passes: bool, talos: Robot, two_steps: TwoSteps) -> None:
    sequence, plan, motion = two_steps
    elbow = 7 + talos.joint_names.index("arm_left_4_joint")
    lower, upper = talos.model.lowerPositionLimit[elbow], talos.model.upperPositionLimit[elbow]
    q = motion.q.copy()
    q[50, elbow] = upper - share * (upper - lower)
    result = check(certify(talos, sequence, plan, {}, replace(motion, q=q)), "joint_limit_margin")
    assert result.passed is passes
    assert (result.effector, result.time_s) == ("arm_left_4_joint", pytest.approx(motion.time_s[50]))
    assert result.value == pytest.approx(share * (upper - lower))
    assert result.limit == pytest.approx(0.02 * (upper - lower))


@pytest.mark.parametrize(("ratio", "passes"), [(0.949, True), (0.951, False)])
def test_speeds_and_torques_keep_a_twentieth(ratio: float, passes: bool, talos: Robot, two_steps: TwoSteps) -> None:
    sequence, plan, motion = two_steps
    knee, elbow = (talos.joint_names.index(name) for name in ("leg_left_4_joint", "arm_left_4_joint"))
    v, tau = motion.v.copy(), motion.tau_nm.copy()
    v[40, 6 + knee] = ratio * talos.model.velocityLimit[6 + knee]
    tau[41, knee] = -ratio * talos.model.effortLimit[6 + knee]
    tau[42, elbow] = ratio * talos.model.effortLimit[6 + elbow]
    certificate = certify(talos, sequence, plan, {}, replace(motion, v=v, tau_nm=tau))
    for name in ("velocity_ratio_max", "torque_ratio_max_legs_torso", "torque_ratio_max_arms"):
        result = check(certificate, name)
        assert result.value == pytest.approx(ratio)
        assert result.passed is passes


def test_every_check_can_fail(good: Certificate) -> None:
    assert {check.name for check in good.checks} == {*SPOILT, "reachability_log_density_min"}


def test_a_force_on_a_foot_in_the_air_is_noticed(talos: Robot, two_steps: TwoSteps) -> None:
    sequence, plan, motion = two_steps
    result = check(certify(talos, sequence, plan, {}, force_in_the_air(motion, talos)), "friction_cone_margin")
    assert result.value == pytest.approx(-1.0)
    assert result.effector == "right_foot"


def test_nan_passes_nothing(talos: Robot, two_steps: TwoSteps) -> None:
    sequence, plan, motion = two_steps
    tau = motion.tau_nm.copy()
    tau[10, 3] = np.nan
    certificate = certify(talos, sequence, plan, {}, replace(motion, tau_nm=tau))
    assert not check(certificate, "torque_ratio_max_legs_torso").passed
    assert not check(certificate, "torque_residual").passed


def test_a_com_where_no_posture_had_it_is_noticed(
    talos: Robot, two_steps: TwoSteps, proxies: Mapping[str, Proxy], good: Certificate
) -> None:
    sequence, plan, motion = two_steps
    p = proxies["left_foot"].mixture
    far = Proxy(Mixture(p.weights, p.means_m + 0.9, p.covariances_m2))
    result = check(
        certify(talos, sequence, plan, {**proxies, "left_foot": far}, motion), "reachability_log_density_min"
    )
    assert not result.passed
    assert result.effector == "left_foot"
    assert check(good, "reachability_log_density_min").value > check(good, "reachability_log_density_min").limit


@pytest.mark.parametrize(
    ("surface", "link"),
    [
        (Box("kerb", Placement.from_wxyz([0.2, -0.09, 0.02]), np.array([0.02, 0.1, 0.04])), "leg_right_6_link"),
        (Box("beam", Placement.from_wxyz([0.35, 0.0, 0.4]), np.array([0.3, 1.0, 0.04])), "leg_"),
        (Rail("low rail", np.array([-1.0, -0.09, 0.3]), np.array([1.0, -0.09, 0.3]), 0.02), "leg_right"),
    ],
    ids=["kerb under the swing", "beam at the knees", "rail through the leg"],
)
def test_terrain_in_the_way_is_noticed(talos: Robot, two_steps: TwoSteps, surface: Box | Rail, link: str) -> None:
    sequence, plan, motion = two_steps
    crowded = replace(sequence, terrain=Terrain.from_surfaces([*sequence.terrain.surfaces, surface]))
    result = check(certify(talos, crowded, plan, {}, motion), "terrain_distance_min")
    assert not result.passed
    assert result.effector is not None
    assert result.effector.startswith(link)


def test_a_foot_across_two_boxes_of_one_height_touches_neither(talos: Robot, two_steps: TwoSteps) -> None:
    """The ground cut under the standing feet: the second box carries as the first one does."""
    sequence, plan, motion = two_steps
    halves = [
        Box(name, Placement.from_wxyz([x, 0.0, -0.5]), _size(3.0, 4.0, 1.0))
        for name, x in (("ground", -1.48), ("more", 1.52))
    ]
    cut = replace(sequence, terrain=Terrain.from_surfaces(halves))
    whole = check(certify(talos, sequence, plan, {}, motion), "terrain_distance_min")
    assert check(certify(talos, cut, plan, {}, motion), "terrain_distance_min").value == pytest.approx(
        whole.value, abs=2e-3
    )


def _size(x: float, y: float, z: float) -> Vector3:
    return np.array([x, y, z])
