"""The rows of one contact phase by the C++ module, in a tenth of the time of ``task_stack``.

They are the same up to rounding, in the same order; without the module, those of ``task_stack`` are used.
"""

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from jaxtyping import Float

from stridelab.centroidal.native.availability import NativeSolver, native_availability
from stridelab.contacts.sequence import Contact
from stridelab.conventions import Angles, Points
from stridelab.wholebody.control.hierarchical_qp import Inequalities, Rows
from stridelab.wholebody.control.joint_limits import JointLimits
from stridelab.wholebody.control.rigid_body import RigidBody
from stridelab.wholebody.control.tasks import RANGE_AHEAD_S

if TYPE_CHECKING:
    from stridelab.wholebody.control.task_stack import SampleTargets, Settings

SwingTarget = tuple[np.ndarray, ...]
"""Position, velocity, acceleration, rotation, angular velocity and acceleration of a swinging effector."""
MAX_AVOIDANCE_ROWS = 64


class NativeRows:
    """Arrays of one phase, which every call of ``build_rows`` fills anew.

    ``contacts`` and ``swings`` map effectors to whether they are surfaces; ``bounds`` is filled except for its rows of
    torques, from ``torque_row`` on, and those of joint ranges after them.
    """

    def __init__(
        self,
        body: RigidBody,
        settings: "Settings",
        contacts: Mapping[str, Contact],
        points_m: Mapping[str, Points],
        swings: Mapping[str, bool],
        limits: JointLimits,
        joints: Mapping[str, Any],
        bounds: Inequalities,
        torque_row: int,
    ) -> None:
        native = native_availability()
        assert isinstance(native, NativeSolver), "only used where the module is available"
        self._body, self._frames, self._bounds = body, (*contacts, *swings, "base"), bounds
        surfaces = [contact.kind == "surface" for contact in contacts.values()]
        nz, na = bounds.G.shape[1], len(limits.torque_nm)
        self._fixed = 6 + sum(6 if surface else 3 for surface in surfaces)
        followed = 3 + sum(6 if surface else 3 for surface in swings.values())
        weighted = 6 + na + len(joints["ankles"]) + len(joints["force_weight"]) + MAX_AVOIDANCE_ROWS
        weighted += 3 * (len(surfaces) + len(swings))
        self._A, self._b = np.zeros((self._fixed + followed, nz)), np.zeros(self._fixed + followed)
        self._A_2, self._b_2 = np.zeros((weighted, nz)), np.zeros(weighted)
        self._no_pairs = np.zeros((0, 6 + na)), np.zeros(0), np.zeros(0)
        s = settings
        gains = {True: s.contact, False: s.hand_contact}
        self._rows = native.module.BodyRows(
            contacts=[
                (surface, gains[surface], contact.placement.position_m, contact.placement.rotation, points_m[name])
                for (name, contact), surface in zip(contacts.items(), surfaces, strict=True)
            ],
            swings_surface=list(swings.values()),
            joints={
                "lower_rad": limits.lower_rad,
                "upper_rad": limits.upper_rad,
                "velocity_rad_s": limits.velocity_rad_s,
                "torque_nm": limits.torque_nm,
                **joints,
            },
            settings={
                **{name: getattr(s, name) for name in ("com", "effector", "base", "posture", "hand", "ankle")},
                **{name: getattr(s, name) for name in ("momentum_weight", "momentum_per_s", "base_weight")},
                **{name: getattr(s, name) for name in ("hand_weight", "ankle_weight", "ankle_acts_rad")},
                **{name: getattr(s, name) for name in ("barrier_per_s", "velocity_rate_per_s", "acceleration_rad_s2")},
                "mass_kg": body.mass_kg,
                "ankle_ahead_s": RANGE_AHEAD_S,
            },
            arrays=[self._A, self._b, self._A_2, self._b_2, *bounds],
            torque_row=torque_row,
        )

    def build_rows(
        self,
        instant: "SampleTargets",
        swings: Sequence[SwingTarget],
        planned_n: Float[np.ndarray, "nf"],
        avoidance: tuple[Rows, Angles] | None,
    ) -> tuple[Rows, list[Rows], Inequalities]:
        """``PhaseHierarchy.build_rows``, valid until the next call."""
        body, r = self._body, instant.reference
        m = self._rows.fill(
            (body.q, body.v, body.M, body.h, body.A_g, body.A_g_drift, body.com_m, body.com_v_m_s, body.l_nms),
            [body.frame_state(name) for name in self._frames],
            (r.com_m, r.com_v_m_s, r.com_a_m_s2, r.l_nms, r.l_rate_nm),
            instant.base,
            list(swings),
            planned_n,
            self._no_pairs if avoidance is None else (*avoidance[0], avoidance[1]),
        )
        n = self._fixed
        levels = [Rows(self._A[n:], self._b[n:]), Rows(self._A_2[:m], self._b_2[:m])]
        return Rows(self._A[:n], self._b[:n]), levels, self._bounds
