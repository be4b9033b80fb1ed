"""A plan checked by plain arithmetic: no CasADi, no momentum about a fixed point, no rays.

Forces constant over an interval give a polynomial motion; with c(t) at hand, (4.2b) is integrated exactly too:

    c+ = c + h c' + h^2/2 a,   c'+ = c' + h a,   a = sum f / m + g
    L_c+ = L_c + sum p x (h f) - (h c + h^2/2 c' + h^3/6 a) x sum f
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from stridelab.centroidal.conditions import AT_REST, Start, Terminal, capture
from stridelab.centroidal.plan import CentroidalPlan, Verification
from stridelab.contacts.sequence import ContactSequence
from stridelab.conventions import Points, Vector3, g

DYNAMICS_GAP_MAX = 1e-8
"""Largest gap (m, m/s, Nms) between intervals of a plan that may call itself converged."""
TERMINAL_GAP_MAX = 1e-6
"""The same at the end."""
CONE_SLACK_N = 3e-4
"""How far outside a friction cone a force may lie: a millionth of the weight of the lightest robot."""


@dataclass(frozen=True, eq=False)
class Motion:
    """What there is to verify: states at ``n`` nodes, world-frame forces of every contact point between them."""

    time_s: Float[np.ndarray, "n"]
    phase: Int[np.ndarray, "m"]
    com_m: Float[np.ndarray, "n 3"]
    com_v_m_s: Float[np.ndarray, "n 3"]
    l_nms: Float[np.ndarray, "n 3"]
    forces_n: Mapping[str, Float[np.ndarray, "m k 3"]]
    points_m: Mapping[str, Float[np.ndarray, "k 3"]]


def total_force_n(motion: Motion) -> Points:
    """Sum of all contact forces, per interval ``(m, 3)``."""
    total = np.zeros((len(motion.phase), 3))
    for f in motion.forces_n.values():
        total += f.sum(axis=1)
    return total


def moment_nm(sequence: ContactSequence, motion: Motion) -> Points:
    """``sum p x f`` about the world origin, per interval ``(m, 3)``."""
    total = np.zeros((len(motion.phase), 3))
    for i, phase in enumerate(sequence.phases):
        during = motion.phase == i
        for name, contact in phase.contacts.items():
            points_m = contact.placement.act(motion.points_m[name])
            total[during] += np.cross(points_m, motion.forces_n[name][during]).sum(axis=1)
    return total


def verify(
    sequence: ContactSequence,
    mass_kg: float,
    motion: Motion,
    com_start_m: Vector3,
    com_end_m: Vector3,
    start: Start = AT_REST,
    terminal: Terminal = "rest",
) -> Verification:
    """Integrate the forces and look at every cone; forces of effectors that do not touch count as outside.

    A capturable end may miss the goal's place, but neither its height nor the hull of the last contact points.
    """
    h = np.diff(motion.time_s)[:, None]
    c, v, L = motion.com_m, motion.com_v_m_s, motion.l_nms
    f = total_force_n(motion)
    a = f / mass_kg + g
    swept = h * c[:-1] + h**2 / 2 * v[:-1] + h**3 / 6 * a
    c_next = c[:-1] + h * v[:-1] + h**2 / 2 * a
    v_next = v[:-1] + h * a
    L_next = L[:-1] + h * moment_nm(sequence, motion) - np.cross(swept, f)
    gaps = [
        c[1:] - c_next,
        v[1:] - v_next,
        L[1:] - L_next,
        c[0] - com_start_m,
        v[0] - start.com_v_m_s,
        L[0] - start.l_nms,
    ]
    ends = [c[-1] - com_end_m, v[-1], L[-1]]
    if terminal == "capturable":
        last = sequence.phases[-1].contacts
        support = capture([at.placement.act(motion.points_m[name]) for name, at in last.items()], com_end_m)
        outside = support.excess_m(c[-1], v[-1])
        ends = [np.array([c[-1, 2] - com_end_m[2], v[-1, 2], outside]), L[-1]]
    cone_margin_n, normal_force_min_n = _cones(sequence, motion)
    return Verification(
        dynamics_gap=float(max(np.abs(gap).max() for gap in gaps)),
        terminal_gap=float(max(np.abs(end).max() for end in ends)),
        cone_margin_n=cone_margin_n,
        normal_force_min_n=normal_force_min_n,
    )


def motion_of(plan: CentroidalPlan) -> Motion:
    """What a plan says that happens, without how it was found: ``verify`` it, however old it is."""
    return Motion(plan.time_s, plan.phase, plan.com_m, plan.com_v_m_s, plan.l_nms, plan.forces_n, plan.points_m)


def holds(verification: Verification) -> bool:
    """Whether a plan with these figures is a solution; NaN is not."""
    return (
        verification.dynamics_gap <= DYNAMICS_GAP_MAX
        and verification.terminal_gap <= TERMINAL_GAP_MAX
        and verification.cone_margin_n >= -CONE_SLACK_N
        and verification.normal_force_min_n >= -CONE_SLACK_N
    )


def _cones(sequence: ContactSequence, motion: Motion) -> tuple[float, float]:
    """Smallest ``mu f_n - |f_t|`` and smallest ``f_n`` of all points that touch; a force where nothing does is -|f|."""
    margins, normals = [np.inf], [np.inf]
    for name, forces in motion.forces_n.items():
        for i, phase in enumerate(sequence.phases):
            during = forces[motion.phase == i]
            contact = phase.contacts.get(name)
            if contact is not None:
                local = during @ contact.placement.rotation
                margin = contact.friction * local[..., 2] - np.linalg.norm(local[..., :2], axis=-1)
                margins.append(float(margin.min(initial=np.inf)))
                normals.append(float(local[..., 2].min(initial=np.inf)))
            elif during.any():
                margins.append(-float(np.linalg.norm(during, axis=(1, 2)).max()))
                normals.append(margins[-1])
    return min(margins), min(normals)
