"""Certification of a motion: every property is recomputed from ``q, v, a, tau`` and the forces.

Two limits measure the agreement between the planning stages:

* ``angular_momentum_mismatch_max``: the plan does not model the limbs, whose angular momentum the soles must absorb.
  The limit is 5 % of ``m h sqrt(g h)``, h the standing CoM height: 11.6 N m s for TALOS, of which strides of 0.9 m use
  6.7 and stairs 3.
* ``reachability_log_density_min``: below the 0.1 percentile of an effector's own density almost no sampled posture had
  the CoM there.
"""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace

import numpy as np
import pinocchio as pin

from stridelab.centroidal.plan import CentroidalPlan
from stridelab.contacts.sequence import ContactSequence
from stridelab.conventions import GRAVITY_M_S2, Points
from stridelab.reachability.gaussian_mixture import Mixture
from stridelab.reachability.proxy.effector_proxy import Proxy
from stridelab.robots.robot import Robot
from stridelab.wholebody.certificate.certificate import Certificate, Check, WorstValues
from stridelab.wholebody.certificate.clearance import self_collision, terrain_distances, thin_samples
from stridelab.wholebody.certificate.contact_checks import hand_loads, touch_downs
from stridelab.wholebody.certificate.inverse_dynamics import Recomputed, recompute_dynamics
from stridelab.wholebody.control.joint_limits import JointLimits
from stridelab.wholebody.motion import WholeBodyMotion

COM_ERROR_M = 5e-4
DYNAMICS_RESIDUAL_N = 1e-8
INTEGRATION_GAP = 1e-6
COLLISION_STEP_S = 0.04
MOMENTUM_SHARE = 0.05
RANGE_SHARE = 0.02
"""Required distance from either end of a joint's range, as a share of it."""
LIMIT_SHARE = 0.95
"""Usable share of speed and torque limits; the rest is a reserve for model errors."""
RARE_SHARE = 1e-3
"""Share of an effector's density that counts as out of reach."""
_DRAWS = 8192


def certify(
    robot: Robot,
    sequence: ContactSequence,
    plan: CentroidalPlan,
    proxies: Mapping[str, Proxy],
    motion: WholeBodyMotion,
    watch: Callable[[Check], None] | None = None,
) -> Certificate:
    """Check ``motion`` of ``robot`` over ``sequence`` against ``plan``; collisions are checked every 40 ms.

    ``watch`` receives every check as soon as it is computed.
    """
    checks = []
    for check in _all_checks(robot, sequence, plan, proxies, motion):
        checks.append(check)
        if watch is not None:
            watch(check)
    return Certificate(tuple(checks))


def _all_checks(
    robot: Robot,
    sequence: ContactSequence,
    plan: CentroidalPlan,
    proxies: Mapping[str, Proxy],
    motion: WholeBodyMotion,
) -> Iterator[Check]:
    """The checks of the certificate, computed one after the other."""
    recomputed = recompute_dynamics(robot, sequence, motion)
    worst = WorstValues(motion.time_s, recomputed.phase)
    samples, at_times = thin_samples(motion.time_s, recomputed.phase, max(1, round(COLLISION_STEP_S * motion.rate_hz)))
    yield _solver_failures(motion)
    planned = plan.references_at(motion.time_s)
    yield _com_error(planned.com_m, recomputed, worst)
    yield from touch_downs(robot, sequence, motion, recomputed, worst)
    yield from _joint_limits(robot, motion, worst)
    yield from hand_loads(robot, sequence, motion, samples, at_times)
    yield _friction_margin(sequence, motion, recomputed, worst)
    yield worst.at_most("dynamics_residual", recomputed.newton_euler[:, None], "N", DYNAMICS_RESIDUAL_N, [""])
    torque_gap_nm = np.abs(recomputed.torque_gap_nm)
    yield worst.at_most("torque_residual", torque_gap_nm, "N m", DYNAMICS_RESIDUAL_N, robot.joint_names)
    yield worst.at_most("integration_gap", recomputed.integration_gap[:, None], "m", INTEGRATION_GAP, [""])
    yield self_collision(robot, motion.q[samples], at_times)
    yield from terrain_distances(robot, sequence, motion.q[samples], at_times)
    yield from _reachability_margin(sequence, proxies, recomputed, worst)
    yield _momentum_mismatch(robot, planned.l_nms, recomputed, worst)


def _solver_failures(motion: WholeBodyMotion) -> Check:
    number = float(len(motion.failures))
    if not motion.failures:
        return Check("solver_failures", number, "samples", 0.0)
    first = motion.failures[0]
    return Check("solver_failures", number, "samples", 0.0, False, first.phase, None, first.time_s)


def _com_error(planned_com_m: Points, recomputed: Recomputed, worst: WorstValues) -> Check:
    """CoM error against the plan."""
    com_error = np.linalg.norm(recomputed.com_m - planned_com_m, axis=1)
    return worst.at_most("com_error_max", com_error[:, None], "m", COM_ERROR_M, [""])


def _joint_limits(robot: Robot, motion: WholeBodyMotion, worst: WorstValues) -> tuple[Check, ...]:
    """Joint ranges, speeds, and torques of legs and torso and of the arms.

    The range margin is that of the joint with the smallest share of its range left.
    """
    limits, joints = JointLimits.of_model(robot.model), robot.joint_names
    angles, range_rad = motion.q[:, 7:], limits.upper_rad - limits.lower_rad
    share = np.minimum(angles - limits.lower_rad, limits.upper_rad - angles) / range_rad
    nearest = worst.at_least("joint_limit_margin", share, "rad", RANGE_SHARE, joints)
    scale = range_rad[joints.index(nearest.effector)] if nearest.effector else 1.0
    speed = np.abs(motion.v[:, 6:]) / limits.velocity_rad_s
    torque = np.abs(motion.tau_nm) / limits.torque_nm
    arm = np.array([robot.group[joint] == "arm" for joint in joints])

    def torque_ratio(name: str, selected: np.ndarray) -> Check:
        chosen = [joint for joint, is_one in zip(joints, selected, strict=True) if is_one]
        return worst.at_most(name, torque[:, selected], "1", LIMIT_SHARE, chosen)

    return (
        replace(nearest, value=float(nearest.value * scale), limit=float(RANGE_SHARE * scale)),
        worst.at_most("velocity_ratio_max", speed, "1", LIMIT_SHARE, joints),
        torque_ratio("torque_ratio_max_legs_torso", ~arm),
        torque_ratio("torque_ratio_max_arms", arm),
    )


def _friction_margin(
    sequence: ContactSequence, motion: WholeBodyMotion, recomputed: Recomputed, worst: WorstValues
) -> Check:
    """Margin of the exact cones, ``mu f_n - |f_t|``, with the surface's normal; a force without contact counts -|f|."""
    names = sequence.effectors
    margin = np.full((len(motion.time_s), len(names)), np.inf)
    for column, name in enumerate(names):
        for phase, contact_phase in enumerate(sequence.phases):
            samples = recomputed.phase == phase
            f = motion.forces_n[name][samples]
            contact = contact_phase.contacts.get(name)
            if contact is None:
                force = np.linalg.norm(f, axis=2).max(axis=1, initial=0.0)
                margin[samples, column] = np.where(force > 0.0, -force, np.inf)
                continue
            n = contact.placement.rotation[:, 2]
            f_n = (f * n).sum(axis=2)
            f_t = np.linalg.norm(f - f_n[..., None] * n, axis=2)
            margin[samples, column] = (contact.friction * f_n - f_t).min(axis=1)
    return worst.at_least("friction_cone_margin", margin, "N", 0.0, names)


def _reachability_margin(
    sequence: ContactSequence, proxies: Mapping[str, Proxy], recomputed: Recomputed, worst: WorstValues
) -> tuple[Check, ...]:
    """Log-density of the CoM, for the effector with the smallest margin above its 0.1 percentile."""
    names = [name for name in sequence.effectors if name in proxies]
    if not names:
        return ()
    log_p = np.full((len(recomputed.phase), len(names)), np.inf)
    rare = np.array([_rare_log_density(proxies[name].mixture) for name in names])
    for column, name in enumerate(names):
        for phase, contact_phase in enumerate(sequence.phases):
            contact, samples = contact_phase.contacts.get(name), recomputed.phase == phase
            if contact is not None and samples.any():
                heading_rad = float(sequence.headings_rad[phase])
                log_p[samples, column] = proxies[name].log_density(
                    recomputed.com_m[samples], contact.placement, heading_rad
                )
    column = int(np.argmin((log_p - rare).min(axis=0)))
    names_of_worst = names[column : column + 1]
    return (
        worst.at_least("reachability_log_density_min", log_p[:, [column]], "nats", float(rare[column]), names_of_worst),
    )


def _rare_log_density(mixture: Mixture) -> float:
    """``RARE_SHARE`` quantile of the mixture's log-density, estimated from samples with a fixed seed."""
    draws = mixture.sample(_DRAWS, np.random.default_rng(0))
    return float(np.quantile(mixture.log_density(draws), RARE_SHARE))


def _momentum_mismatch(robot: Robot, planned_l_nms: Points, recomputed: Recomputed, worst: WorstValues) -> Check:
    """Angular momentum about the CoM compared with the plan."""
    mismatch = np.linalg.norm(recomputed.l_nms - planned_l_nms, axis=1)
    limit = momentum_limit_nms(robot)
    return worst.at_most("angular_momentum_mismatch_max", mismatch[:, None], "N m s", limit, [""])


def momentum_limit_nms(robot: Robot) -> float:
    """Largest difference of the angular momentum about the CoM from that of the plan, which is about zero."""
    h = float(pin.centerOfMass(robot.model, robot.model.createData(), robot.q_reference)[2])
    return MOMENTUM_SHARE * robot.mass_kg * h * float(np.sqrt(GRAVITY_M_S2 * h))
