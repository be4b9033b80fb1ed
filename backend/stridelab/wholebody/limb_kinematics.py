"""Kinematics of the planned body at one sample for the replay controllers: limbs, contact placements, Jacobians."""

from collections.abc import Mapping

import numpy as np
import pinocchio as pin
from jaxtyping import Float, Int

from stridelab.conventions import Rotation, Vector3
from stridelab.dynamics.spatial import Placement
from stridelab.robots.contact_frames import with_contact_frames
from stridelab.robots.robot import Robot
from stridelab.wholebody.replay.sensors import SensedState


class LimbKinematics:
    """Kinematics at the last ``set_configuration``. A limb consists of the leg or arm joints that move an effector."""

    def __init__(self, robot: Robot, effectors: tuple[str, ...]) -> None:
        self._model, self._frames = with_contact_frames(robot)
        self._data = self._model.createData()
        self._placements: dict[str, Placement] = {}
        self._measured: tuple[SensedState, Rotation] | None = None
        self.limb: Mapping[str, Int[np.ndarray, "k"]] = {
            name: self._limb_joints(robot, name) for name in effectors if name in self._frames
        }
        """Per effector the indices of its limb among the actuated joints."""

    def set_configuration(self, q: Float[np.ndarray, "nq"]) -> None:
        """Compute the kinematics at ``q``."""
        pin.computeJointJacobians(self._model, self._data, q)
        pin.updateFramePlacements(self._model, self._data)
        self._placements.clear()
        self.base = Placement(q[:3], self._data.oMi[1].rotation.copy())

    def contact_placement(self, effector: str) -> Placement:
        """Placement of an effector's contact frame."""
        if effector not in self._placements:
            placement = self._data.oMf[self._frames[effector]]
            self._placements[effector] = Placement(placement.translation.copy(), placement.rotation.copy())
        return self._placements[effector]

    def compensate_base_error(self, target_m: Vector3, measured: SensedState) -> Vector3:
        """Position relative to the planned base that puts an effector at ``target_m`` despite the error of the base."""
        if self._measured is None or self._measured[0] is not measured:
            self._measured = measured, np.asarray(pin.Quaternion(measured.q[3:7]).toRotationMatrix())
        in_measured_base = self._measured[1].T @ (target_m - measured.q[:3])
        return np.asarray(self.base.rotation @ in_measured_base + self.base.position_m)

    def limb_jacobian(self, effector: str) -> Float[np.ndarray, "6 k"]:
        """Jacobian of the contact frame (linear over angular, world axes) with respect to the joints of its limb."""
        J = pin.getFrameJacobian(self._model, self._data, self._frames[effector], pin.LOCAL_WORLD_ALIGNED)
        return np.asarray(J[:, 6 + self.limb[effector]])

    def torque_limits_nm(self, effector: str) -> Float[np.ndarray, "k"]:
        """Torque limits of the joints of an effector's limb."""
        return np.asarray(self._model.effortLimit[6 + self.limb[effector]])

    def strengths(self, effector: str) -> Float[np.ndarray, "k"]:
        """Torque limits of the joints of an effector's limb, relative to their mean."""
        limits_nm = self.torque_limits_nm(effector)
        return np.asarray(limits_nm / limits_nm.mean())

    def torques_nm(self, effector: str, force_n: Vector3) -> Float[np.ndarray, "k"]:
        """Torques of the limb that exert ``force_n`` on the contact surface of an effector."""
        return np.asarray(self.limb_jacobian(effector)[:3].T @ force_n)

    def _limb_joints(self, robot: Robot, effector: str) -> Int[np.ndarray, "k"]:
        model = self._model
        joints = model.supports[model.frames[self._frames[effector]].parentJoint]
        limb = [model.joints[j].idx_v - 6 for j in joints if robot.group.get(model.names[j]) in ("leg", "arm")]
        return np.array(limb, dtype=int)
