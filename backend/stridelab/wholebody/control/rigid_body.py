"""Rigid-body quantities for the tasks at one state ``(q, v)``, each computed once.

M a + h = S' tau + J' f        equations of motion (2.1), (4.1), S' tau = (0, tau)
A_g a + dA_g v = d(m c', L)/dt      centroidal map (4.3) and its drift
J a + dJ v = (p'', w')         classical acceleration of a frame, in world axes

``J`` of the whole body contains every joint's motion about the world origin, linear over angular: for a point p moved
by some of the joints, ``n' p' = (n, p x n)' J v`` over their columns.
"""

from typing import NamedTuple

import numpy as np
import pinocchio as pin
from jaxtyping import Float

from stridelab.robots.contact_frames import with_contact_frames
from stridelab.robots.robot import Robot


class FrameState(NamedTuple):
    """A frame's placement, its Jacobian ``(6, nv)`` (linear over angular, world axes), velocity and drift ``dJ v``."""

    position_m: Float[np.ndarray, "3"]
    rotation: Float[np.ndarray, "3 3"]
    J: Float[np.ndarray, "6 nv"]
    velocity: Float[np.ndarray, "6"]
    drift: Float[np.ndarray, "6"]


class RigidBody:
    """The body at the state of the last ``update``. Frames are named by effector; ``base`` has the trunk's axes."""

    def __init__(self, robot: Robot) -> None:
        self.model, frames = with_contact_frames(robot)
        self._frames = {**frames, "base": self.model.getFrameId(robot.base_frame)}
        self._R_base_trunk = robot.R_base_trunk
        self._data = self.model.createData()
        self._drift = self.model.createData()
        self._zero = np.zeros(self.model.nv)
        self.mass_kg = float(pin.computeTotalMass(self.model))

    def update(self, q: Float[np.ndarray, "nq"], v: Float[np.ndarray, "nv"]) -> None:
        """Compute all terms at ``(q, v)``."""
        model, data, drift = self.model, self._data, self._drift
        self._frame_states: dict[str, FrameState] = {}
        self.q, self.v = q, v
        pin.computeAllTerms(model, data, q, v)
        pin.computeCentroidalMomentumTimeVariation(model, drift, q, v, self._zero)
        self.M: Float[np.ndarray, "nv nv"] = data.M
        self.h: Float[np.ndarray, "nv"] = data.nle
        self.com_m: Float[np.ndarray, "3"] = data.com[0].copy()
        self.com_v_m_s: Float[np.ndarray, "3"] = data.vcom[0].copy()
        self.l_nms: Float[np.ndarray, "3"] = data.hg.angular.copy()
        self.A_g: Float[np.ndarray, "6 nv"] = data.Ag
        self.J: Float[np.ndarray, "6 nv"] = data.J
        self.A_g_drift: Float[np.ndarray, "6"] = drift.dhg.vector

    @property
    def data(self) -> pin.Data:
        """Pinocchio's data at the state."""
        return self._data

    def frame_state(self, name: str) -> FrameState:
        """State of the contact frame of effector ``name``, or of the trunk at the ``base`` frame."""
        if name not in self._frame_states:
            index, model, data = self._frames[name], self.model, self._data
            placement = pin.updateFramePlacement(model, data, index)
            J = pin.getFrameJacobian(model, data, index, pin.LOCAL_WORLD_ALIGNED)
            drift = pin.getFrameClassicalAcceleration(model, self._drift, index, pin.LOCAL_WORLD_ALIGNED).vector
            R = placement.rotation @ self._R_base_trunk if name == "base" else placement.rotation.copy()
            self._frame_states[name] = FrameState(placement.translation.copy(), R, J, J @ self.v, drift)
        return self._frame_states[name]
