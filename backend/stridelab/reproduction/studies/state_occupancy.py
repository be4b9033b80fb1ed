"""Occupancy of the state and its rate, p(x, x') of (4.11), of which (4.13) keeps the position of the CoM.

    x = (c, c', L_c),     x' = (c', c'', L_c')

Postures are those from which the densities of the CoM are learned. With one sole fixed to the ground (6 rows J v = 0),
joint rates and torques are drawn uniformly in their limits; the base follows from J, the accelerations from the forward
dynamics, and the contact force f and moment n at the sole give

    c'' = f / m + g,     L_c' = n + (p - c) x f .

The wrench is that of a sole that neither slips nor tilts, whatever it takes: friction and the edges of the sole are
the cone (4.20c), which is a constraint of its own.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import islice
from typing import Final

import numpy as np
import pinocchio as pin
from jaxtyping import Float, Int

from stridelab.centroidal.plan import CentroidalPlan
from stridelab.centroidal.problem import CentroidalProblem
from stridelab.centroidal.state_density import StateDensity
from stridelab.conventions import Points, Series, g
from stridelab.reachability.card import Measure
from stridelab.reachability.learning.com_sampling import configuration_stream
from stridelab.robots.contact_frames import with_contact_frames
from stridelab.robots.robot import Robot

MIRROR: Final = np.array([1.0, -1.0, 1.0, -1.0, 1.0, -1.0])
"""Reflection at the sagittal plane of a velocity (or acceleration) and a momentum (or its rate), an axial vector."""


@dataclass(frozen=True, eq=False)
class StateSamples:
    """Sampled rates, axes of the sole: CoM velocity (m/s), momentum (N m s), CoM acceleration, momentum rate (N m)."""

    com_v_m_s: Points
    l_nms: Points
    com_a_m_s2: Points
    l_rate_nm: Points

    def velocities(self) -> Float[np.ndarray, "n 6"]:
        """``(c', L_c)``."""
        return np.hstack([self.com_v_m_s, self.l_nms])

    def rates(self) -> Float[np.ndarray, "n 6"]:
        """``(c'', L_c')``."""
        return np.hstack([self.com_a_m_s2, self.l_rate_nm])


def sample_states(robot: Robot, effector: str, samples: int, seed: int, measure: Measure) -> StateSamples:
    """``samples`` states of a robot on one sole. Raises as ``configuration_stream`` does."""
    rng = np.random.default_rng(seed)
    model, frames = with_contact_frames(robot)
    data, frame, joints = model.createData(), frames[effector], slice(6, model.nv)
    rows = np.empty((4, samples, 3))
    for a, q in enumerate(islice(configuration_stream(robot, measure, rng), samples)):
        v, tau = np.zeros(model.nv), np.zeros(model.nv)
        v[joints] = rng.uniform(-1.0, 1.0, model.nv - 6) * model.velocityLimit[joints]
        tau[joints] = rng.uniform(-1.0, 1.0, model.nv - 6) * model.effortLimit[joints]
        J = pin.computeFrameJacobian(model, data, q, frame, pin.LOCAL_WORLD_ALIGNED)
        v[:6] = -np.linalg.solve(J[:, :6], J[:, joints] @ v[joints])
        pin.forwardKinematics(model, data, q, v, np.zeros(model.nv))
        pin.updateFramePlacements(model, data)
        drift = pin.getFrameClassicalAcceleration(model, data, frame, pin.LOCAL_WORLD_ALIGNED).vector
        pin.computeAllTerms(model, data, q, v)
        pin.forwardDynamics(model, data, tau, J, drift)
        f, n = np.array(data.lambda_c[:3]), np.array(data.lambda_c[3:])
        c, T = pin.centerOfMass(model, data, q, v), data.oMf[frame]
        momentum = pin.computeCentroidalMomentum(model, data, q, v)
        mass_kg = pin.computeTotalMass(model)
        rates = (data.vcom[0], momentum.angular, f / mass_kg + g, n + np.cross(T.translation - c, f))
        rows[:, a] = np.array(rates) @ T.rotation
    return StateSamples(*rows)


def densities_of_soles(samples: StateSamples) -> dict[str, StateDensity]:
    """Normal densities over both soles of a symmetric robot, from states on the right one."""
    return {
        "right_foot": StateDensity.of_samples(samples.velocities(), samples.rates()),
        "left_foot": StateDensity.of_samples(samples.velocities() * MIRROR, samples.rates() * MIRROR),
    }


def rates_of_plan(plan: CentroidalPlan) -> tuple[Float[np.ndarray, "m 6"], Float[np.ndarray, "m 6"]]:
    """``(c', L_c)`` at the first node of every interval and the mean ``(c'', L_c')``; soles along the world axes."""
    l_rate_nm = np.diff(plan.l_nms, axis=0) / np.diff(plan.time_s)[:, None]
    velocities = np.hstack([plan.com_v_m_s, plan.l_nms])[:-1]
    return velocities, np.hstack([plan.com_a_m_s2, l_rate_nm])


def nats_below_mode(samples: Float[np.ndarray, "n 6"], points: Float[np.ndarray, "k 6"]) -> Float[np.ndarray, "k"]:
    """``log p`` at the mode minus ``log p`` at points, of the normal distribution with the samples' moments."""
    away = points - samples.mean(axis=0)
    return np.asarray(0.5 * np.einsum("ka,ab,kb->k", away, np.linalg.inv(np.cov(samples.T)), away))


def change_within_phases(log_p: Series, phase: Int[np.ndarray, "n"]) -> float:
    """Largest range of a log-density (nats) within one contact phase: what a plan could gain by it at most."""
    return float(max(np.ptp(log_p[phase == i]) for i in np.unique(phase)))


def state_log_density(densities: Mapping[str, StateDensity], plan: CentroidalPlan) -> Series:
    """``sum_i log p_i(c', L) + log p_i(c'', L')`` of the soles in contact, per interval of a plan."""
    velocities, rates = rates_of_plan(plan)
    log_p = np.zeros(len(plan.phase))
    for i, phase in enumerate(plan.sequence.phases):
        during = plan.phase == i
        for name in phase.contacts.keys() & densities.keys():
            rotation = phase.contacts[name].placement.rotation
            log_p[during] += densities[name].log_density(velocities[during], rates[during], rotation).sum(axis=1)
    return log_p


def position_log_density(problem: CentroidalProblem, plan: CentroidalPlan) -> Series:
    """``sum_i log p_i(c)`` of (4.13) at the first node of every interval."""
    log_p = np.zeros(len(plan.phase))
    for i, phase in enumerate(plan.sequence.phases):
        during, heading_rad = plan.phase == i, float(plan.sequence.headings_rad[i])
        for name, contact in phase.contacts.items():
            log_p[during] += problem.proxies[name].log_density(plan.com_m[:-1][during], contact.placement, heading_rad)
    return log_p
