"""The certificate of a motion: every property measured anew from ``q, v, a, tau`` and the forces.

Two limits are ours and only inform of how far the stages agree:

* ``angular_momentum_mismatch_max``: the plan does not know the limbs, whose angular momentum the soles have to take up.
  The limit is 5 % of ``m h sqrt(g h)``, h the CoM's height when the robot stands: 11.6 N m s for TALOS, which strides
  of 0.9 m take to 6.7 and stairs to 3.
* ``reachability_log_density_min``: below the 0.1 percentile of an effector's own density the CoM is where next to no
  sampled posture had it.
"""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import pinocchio as pin

from stridelab.centroidal.plan import CentroidalPlan
from stridelab.contacts.sequence import ContactSequence
from stridelab.conventions import GRAVITY_M_S2
from stridelab.reachability.gaussian_mixture import Mixture
from stridelab.reachability.proxy.effector_proxy import Proxy
from stridelab.robots.robot import Robot
from stridelab.wholebody.certificate.certificate import Certificate, Check, Worst
from stridelab.wholebody.certificate.clearance import self_collision, terrain_distances, thinned
from stridelab.wholebody.certificate.hand_load import hand_loads
from stridelab.wholebody.certificate.inverse_dynamics import Recomputed, recompute
from stridelab.wholebody.certificate.landing import touch_downs
from stridelab.wholebody.control.joint_limits import JointLimits
from stridelab.wholebody.motion import WholeBodyMotion

COM_ERROR_M = 5e-4
DYNAMICS_RESIDUAL_N = 1e-8
INTEGRATION_GAP = 1e-6
COLLISION_STEP_S = 0.04
MOMENTUM_SHARE = 0.05
RANGE_SHARE = 0.02
"""Of a joint's range that is kept from either end."""
LIMIT_SHARE = 0.95
"""Of speeds and torques that may be used: what is left is for a robot that is not quite as described."""
RARE = 1e-3
"""Share of an effector's density that counts as out of reach."""
_DRAWS = 8192


def certify(
    robot: Robot,
    sequence: ContactSequence,
    plan: CentroidalPlan,
    proxies: Mapping[str, Proxy],
    motion: WholeBodyMotion,
) -> Certificate:
    """Check ``motion`` of ``robot`` over ``sequence`` against ``plan``; collisions are looked for every 40 ms."""
    found = recompute(robot, sequence, motion)
    worst = Worst(motion.time_s, found.phase)
    chosen, at_times = thinned(motion.time_s, found.phase, max(1, round(COLLISION_STEP_S * motion.rate_hz)))
    return Certificate(
        (
            _failures(motion),
            _com_error(plan, motion, found, worst),
            *touch_downs(robot, sequence, motion, found, worst),
            *_limits(robot, motion, worst),
            *hand_loads(robot, sequence, motion, chosen, at_times),
            _friction(sequence, motion, found, worst),
            worst.at_most("dynamics_residual", found.newton_euler[:, None], "N", DYNAMICS_RESIDUAL_N, [""]),
            worst.at_most(
                "torque_residual", np.abs(found.torque_gap_nm), "N m", DYNAMICS_RESIDUAL_N, robot.joint_names
            ),
            worst.at_most("integration_gap", found.integration_gap[:, None], "m", INTEGRATION_GAP, [""]),
            self_collision(robot, motion.q[chosen], at_times),
            *terrain_distances(robot, sequence, motion.q[chosen], at_times),
            *_reachability(sequence, proxies, found, worst),
            _momentum(robot, plan, motion, found, worst),
        )
    )


def _failures(motion: WholeBodyMotion) -> Check:
    number = float(len(motion.failures))
    if not motion.failures:
        return Check("solver_failures", number, "samples", 0.0)
    first = motion.failures[0]
    return Check("solver_failures", number, "samples", 0.0, False, first.phase, None, first.time_s)


def _com_error(plan: CentroidalPlan, motion: WholeBodyMotion, found: Recomputed, worst: Worst) -> Check:
    """CoM against the plan."""
    planned = np.array([plan.at(float(t)).com_m for t in motion.time_s])
    com_error = np.linalg.norm(found.com_m - planned, axis=1)
    return worst.at_most("com_error_max", com_error[:, None], "m", COM_ERROR_M, [""])


def _limits(robot: Robot, motion: WholeBodyMotion, worst: Worst) -> tuple[Check, ...]:
    """Joint ranges, speeds, and torques of the joints that carry the body and of the arms.

    The margin of the range is that of the joint that keeps the smallest share of its range.
    """
    limits, joints = JointLimits.of(robot.model), robot.joint_names
    angles, range_rad = motion.q[:, 7:], limits.upper_rad - limits.lower_rad
    share = np.minimum(angles - limits.lower_rad, limits.upper_rad - angles) / range_rad
    nearest = worst.at_least("joint_limit_margin", share, "rad", RANGE_SHARE, joints)
    of = range_rad[joints.index(nearest.effector)] if nearest.effector else 1.0
    speed = np.abs(motion.v[:, 6:]) / limits.velocity_rad_s
    torque = np.abs(motion.tau_nm) / limits.torque_nm
    arm = np.array([robot.group[joint] == "arm" for joint in joints])

    def ratio(name: str, of: np.ndarray) -> Check:
        chosen = [joint for joint, is_one in zip(joints, of, strict=True) if is_one]
        return worst.at_most(name, torque[:, of], "1", LIMIT_SHARE, chosen)

    return (
        replace(nearest, value=float(nearest.value * of), limit=float(RANGE_SHARE * of)),
        worst.at_most("velocity_ratio_max", speed, "1", LIMIT_SHARE, joints),
        ratio("torque_ratio_max_legs_torso", ~arm),
        ratio("torque_ratio_max_arms", arm),
    )


def _friction(sequence: ContactSequence, motion: WholeBodyMotion, found: Recomputed, worst: Worst) -> Check:
    """Exact cones at all points, ``mu f_n - |f_t|``; a force on an effector in the air is outside by all of it.

    The normal is that of the surface, not of the sole.
    """
    names = sequence.effectors
    margin = np.full((len(motion.time_s), len(names)), np.inf)
    for column, name in enumerate(names):
        for phase, of_phase in enumerate(sequence.phases):
            chosen = found.phase == phase
            f = motion.forces_n[name][chosen]
            contact = of_phase.contacts.get(name)
            if contact is None:
                size = np.linalg.norm(f, axis=2).max(axis=1, initial=0.0)
                margin[chosen, column] = np.where(size > 0.0, -size, np.inf)
                continue
            n = contact.placement.rotation[:, 2]
            f_n = (f * n).sum(axis=2)
            f_t = np.linalg.norm(f - f_n[..., None] * n, axis=2)
            margin[chosen, column] = (contact.friction * f_n - f_t).min(axis=1)
    return worst.at_least("friction_cone_margin", margin, "N", 0.0, names)


def _reachability(
    sequence: ContactSequence, proxies: Mapping[str, Proxy], found: Recomputed, worst: Worst
) -> tuple[Check, ...]:
    """Log-density of the CoM in every contact's proxy, the one that is least above its effector's 0.1 percentile."""
    names = [name for name in sequence.effectors if name in proxies]
    if not names:
        return ()
    log_p = np.full((len(found.phase), len(names)), np.inf)
    rare = np.array([_percentile(proxies[name].mixture) for name in names])
    for column, name in enumerate(names):
        for phase, of_phase in enumerate(sequence.phases):
            contact, chosen = of_phase.contacts.get(name), found.phase == phase
            if contact is not None and chosen.any():
                heading_rad = float(sequence.headings_rad[phase])
                log_p[chosen, column] = proxies[name].log_density(found.com_m[chosen], contact.placement, heading_rad)
    column = int(np.argmin((log_p - rare).min(axis=0)))
    of = names[column : column + 1]
    return (worst.at_least("reachability_log_density_min", log_p[:, [column]], "nats", float(rare[column]), of),)


def _percentile(mixture: Mixture) -> float:
    """Log-density below which only the share ``RARE`` of the mixture lies, from a fixed draw."""
    draws = mixture.sample(_DRAWS, np.random.default_rng(0))
    return float(np.quantile(mixture.log_density(draws), RARE))


def _momentum(robot: Robot, plan: CentroidalPlan, motion: WholeBodyMotion, found: Recomputed, worst: Worst) -> Check:
    """Angular momentum about the CoM against the plan's."""
    planned = np.array([plan.at(float(t)).l_nms for t in motion.time_s])
    mismatch = np.linalg.norm(found.l_nms - planned, axis=1)
    data = robot.model.createData()
    h = float(pin.centerOfMass(robot.model, data, robot.q_reference)[2])
    limit = MOMENTUM_SHARE * robot.mass_kg * h * float(np.sqrt(GRAVITY_M_S2 * h))
    return worst.at_most("angular_momentum_mismatch_max", mismatch[:, None], "N m s", limit, [""])
