"""A whole-body motion: what the hierarchy produced at every sample."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from stridelab.contacts.sequence import ContactSequence


@dataclass(frozen=True)
class SolverFailure:
    """A sample at which the hierarchy's quadratic programme had no solution."""

    time_s: float
    phase: int
    level: int
    reason: str


@dataclass(frozen=True, eq=False)
class WholeBodyMotion:
    """``n`` samples at ``rate_hz`` in pinocchio's order of coordinates.

    ``q`` ``(n, nq)``, ``v`` and ``a`` ``(n, nv)``, ``tau_nm`` ``(n, nv - 6)``; ``forces_n`` per effector the
    world-frame force on each contact point ``(n, k, 3)``, zero where it does not touch, acting at ``points_m``
    ``(k, 3)`` of the contact frame. ``com_m`` and ``l_nms`` are those of ``q, v``; the references those of the plan.
    """

    sequence: ContactSequence
    rate_hz: float
    time_s: Float[np.ndarray, "n"]
    q: Float[np.ndarray, "n nq"]
    v: Float[np.ndarray, "n nv"]
    a: Float[np.ndarray, "n nv"]
    tau_nm: Float[np.ndarray, "n na"]
    forces_n: Mapping[str, Float[np.ndarray, "n k 3"]]
    points_m: Mapping[str, Float[np.ndarray, "k 3"]]
    com_m: Float[np.ndarray, "n 3"]
    com_v_m_s: Float[np.ndarray, "n 3"]
    l_nms: Float[np.ndarray, "n 3"]
    com_reference_m: Float[np.ndarray, "n 3"]
    com_v_reference_m_s: Float[np.ndarray, "n 3"]
    l_reference_nms: Float[np.ndarray, "n 3"]
    failures: tuple[SolverFailure, ...]
    solve_time_s: float
