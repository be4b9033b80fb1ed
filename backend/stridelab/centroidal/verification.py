"""Verification of a plan, independent of the solver: no CasADi, no momentum about a fixed point, no rays.

Forces that are constant or cubic over an interval give a polynomial motion; with c(t), (4.2b) is a polynomial too, of
degree 8 at most, and integrated exactly by the Gauss rule with five points t_i and weights w_i:

    c(t) = c + t c' + int (t - s) a ds,   c'(t) = c' + int a ds,   a = sum f / m + g
    L_c+ = L_c + h sum_i w_i (sum p x f(t_i) - c(t_i) x sum f(t_i))

A force spline is in its cone if its control points are (``force_splines``).
"""

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Float, Int

from stridelab.centroidal.boundary_conditions import AT_REST, Start, Terminal, capture_region
from stridelab.centroidal.force_splines import DEGREE, bernstein_weights, gauss_rule
from stridelab.centroidal.plan import CentroidalPlan, Verification
from stridelab.contacts.sequence import ContactSequence
from stridelab.conventions import Points, Vector3, g

N_GAUSS = 5
DYNAMICS_GAP_MAX = 1e-8
"""Largest gap (m, m/s, Nms) between intervals of a converged plan."""
TERMINAL_GAP_MAX = 1e-6
"""Largest gap (m, m/s, Nms) at the end of a converged plan."""
CONE_SLACK_N = 3e-4
"""Tolerance of the friction cones: a millionth of the weight of the lightest robot."""


@dataclass(frozen=True, eq=False)
class Motion:
    """The motion to verify: states at ``n`` nodes, world-frame forces of every contact point between them.

    ``forces_n`` and ``curves_n`` as in ``CentroidalPlan``.
    """

    time_s: Float[np.ndarray, "n"]
    phase: Int[np.ndarray, "m"]
    com_m: Float[np.ndarray, "n 3"]
    com_v_m_s: Float[np.ndarray, "n 3"]
    l_nms: Float[np.ndarray, "n 3"]
    forces_n: Mapping[str, Float[np.ndarray, "m k 3"]]
    points_m: Mapping[str, Float[np.ndarray, "k 3"]]
    curves_n: Mapping[str, Float[np.ndarray, "m 4 k 3"]] = field(default_factory=dict)

    @property
    def controls_n(self) -> Mapping[str, Float[np.ndarray, "m d k 3"]]:
        """Control points of the forces: four for splines, one for constant forces."""
        return self.curves_n or {name: f[:, None] for name, f in self.forces_n.items()}

    @property
    def degree(self) -> int:
        """Polynomial degree of the forces between nodes."""
        return DEGREE if self.curves_n else 0


def total_force_n(motion: Motion) -> Points:
    """Mean sum of all contact forces, per interval ``(m, 3)``."""
    total = np.zeros((len(motion.phase), 3))
    for f in motion.forces_n.values():
        total += f.sum(axis=1)
    return total


@dataclass(frozen=True, eq=False)
class IntervalStates:
    """States of all ``m`` intervals at the same share of their length: CoM, velocity, acceleration, rate of L_c."""

    com_m: Points
    com_v_m_s: Points
    com_a_m_s2: Points
    l_rate_nm: Points


Wrenches = tuple[Float[np.ndarray, "m d 3"], Float[np.ndarray, "m d 3"]]
"""Control points of ``sum f`` and of ``sum p x f`` about the world origin, in every interval."""


def interval_states(mass_kg: float, motion: Motion, wrenches: Wrenches, share: float) -> IntervalStates:
    """Integrate (4.2) from the node before every interval up to ``share`` of its length."""
    h = np.diff(motion.time_s)[:, None]
    c, v = motion.com_m[:-1], motion.com_v_m_s[:-1]
    F, M = wrenches
    value_weights, first_integral, second_integral, _ = bernstein_weights(share, motion.degree)
    f = np.tensordot(value_weights, F, (0, 1))
    com = c + h * share * v + h**2 * (np.tensordot(second_integral, F, (0, 1)) / mass_kg + share**2 / 2 * g)
    velocity = v + h * (np.tensordot(first_integral, F, (0, 1)) / mass_kg + share * g)
    return IntervalStates(com, velocity, f / mass_kg + g, np.tensordot(value_weights, M, (0, 1)) - np.cross(com, f))


def wrenches_of(sequence: ContactSequence, motion: Motion) -> Wrenches:
    """Total contact wrench of a motion."""
    controls = motion.controls_n
    F = np.zeros((len(motion.phase), motion.degree + 1, 3))
    M = F.copy()
    for f in controls.values():
        F += f.sum(axis=2)
    for i, phase in enumerate(sequence.phases):
        during = motion.phase == i
        for name, contact in phase.contacts.items():
            points_m = contact.placement.act(motion.points_m[name])
            M[during] += np.cross(points_m, controls[name][during]).sum(axis=2)
    return F, M


def verify(
    sequence: ContactSequence,
    mass_kg: float,
    motion: Motion,
    com_start_m: Vector3,
    com_end_m: Vector3,
    start: Start = AT_REST,
    terminal: Terminal = "rest",
    end: Start = AT_REST,
) -> Verification:
    """Integrate the forces and check every cone; forces of effectors without contact count as violations.

    A capturable end must meet the goal's height and the hull of the last contact points, not the goal's position; a
    moving one the velocity and the momentum of ``end``.
    """
    h = np.diff(motion.time_s)[:, None]
    c, v, L = motion.com_m, motion.com_v_m_s, motion.l_nms
    wrenches = wrenches_of(sequence, motion)
    end_states = interval_states(mass_kg, motion, wrenches, 1.0)
    momentum_rate = sum(w * interval_states(mass_kg, motion, wrenches, s).l_rate_nm for s, w in gauss_rule(N_GAUSS))
    gaps = [
        c[1:] - end_states.com_m,
        v[1:] - end_states.com_v_m_s,
        L[1:] - L[:-1] - h * momentum_rate,
        c[0] - com_start_m,
        v[0] - start.com_v_m_s,
        L[0] - start.l_nms,
    ]
    final = end if terminal == "moving" else AT_REST
    ends = [c[-1] - com_end_m, v[-1] - final.com_v_m_s, L[-1] - final.l_nms]
    if terminal == "capturable":
        last = sequence.phases[-1].contacts
        support = capture_region([at.placement.act(motion.points_m[name]) for name, at in last.items()], com_end_m)
        excess_m = support.excess_m(c[-1], v[-1])
        ends = [np.array([c[-1, 2] - com_end_m[2], v[-1, 2], excess_m]), L[-1]]
    cone_margin_n, normal_force_min_n = _cone_margins(sequence, motion)
    return Verification(
        dynamics_gap=float(max(np.abs(gap).max() for gap in gaps)),
        terminal_gap=float(max(np.abs(end).max() for end in ends)),
        cone_margin_n=cone_margin_n,
        normal_force_min_n=normal_force_min_n,
    )


def motion_of(plan: CentroidalPlan) -> Motion:
    """The motion of a plan, without solver data, as input of ``verify``."""
    return Motion(
        plan.time_s,
        plan.phase,
        plan.com_m,
        plan.com_v_m_s,
        plan.l_nms,
        plan.forces_n,
        plan.points_m,
        plan.curves_n,
    )


def is_verified(verification: Verification) -> bool:
    """Whether a plan with these values is a solution; NaN is not."""
    return (
        verification.dynamics_gap <= DYNAMICS_GAP_MAX
        and verification.terminal_gap <= TERMINAL_GAP_MAX
        and verification.cone_margin_n >= -CONE_SLACK_N
        and verification.normal_force_min_n >= -CONE_SLACK_N
    )


def _cone_margins(sequence: ContactSequence, motion: Motion) -> tuple[float, float]:
    """Smallest ``mu f_n - |f_t|`` and smallest ``f_n`` of all contact points; a force without contact counts -|f|."""
    margins, normals = [np.inf], [np.inf]
    for name, controls in motion.controls_n.items():
        for i, phase in enumerate(sequence.phases):
            during = controls[motion.phase == i]
            contact = phase.contacts.get(name)
            if contact is not None:
                local = during @ contact.placement.rotation
                margin = contact.friction * local[..., 2] - np.linalg.norm(local[..., :2], axis=-1)
                margins.append(float(margin.min(initial=np.inf)))
                normals.append(float(local[..., 2].min(initial=np.inf)))
            elif during.any():
                margins.append(-float(np.linalg.norm(during.reshape(len(during), -1), axis=1).max()))
                normals.append(margins[-1])
    return min(margins), min(normals)
