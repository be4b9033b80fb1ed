"""The body as planned at one sample, as far as the control of a replay needs it: limbs, places and Jacobians."""

from collections.abc import Mapping

import numpy as np
import pinocchio as pin
from jaxtyping import Float, Int

from stridelab.conventions import Vector3
from stridelab.dynamics.spatial import Placement
from stridelab.robots.contact_frames import with_contact_frames
from stridelab.robots.robot import Robot
from stridelab.wholebody.replay.sensors import Seen


class Posed:
    """Kinematics at the configuration of the last ``at``. A limb are the joints of leg or arm that move an effector."""

    def __init__(self, robot: Robot, effectors: tuple[str, ...]) -> None:
        self._model, self._frames = with_contact_frames(robot)
        self._data = self._model.createData()
        self.limb: Mapping[str, Int[np.ndarray, "k"]] = {
            name: self._limb(robot, name) for name in effectors if name in self._frames
        }
        """Per effector the indices of its limb among the actuated joints."""

    def at(self, q: Float[np.ndarray, "nq"]) -> None:
        """Pose the body."""
        pin.computeJointJacobians(self._model, self._data, q)
        pin.updateFramePlacements(self._model, self._data)
        self.base = Placement(q[:3], self._data.oMi[1].rotation.copy())

    def contact(self, effector: str) -> Placement:
        """Where an effector's contact frame is."""
        here = self._data.oMf[self._frames[effector]]
        return Placement(here.translation.copy(), here.rotation.copy())

    def to_the_world(self, place_m: Vector3, seen: Seen) -> Vector3:
        """Where an effector has to be, seen from the planned base, to be at a place whatever the base is off."""
        seen_R = np.asarray(pin.Quaternion(seen.q[3:7]).toRotationMatrix())
        in_seen_base = seen_R.T @ (place_m - seen.q[:3])
        return np.asarray(self.base.rotation @ in_seen_base + self.base.position_m)

    def moved_by_limb(self, effector: str) -> Float[np.ndarray, "6 k"]:
        """Jacobian of the contact frame (linear over angular, world axes) with respect to the joints of its limb."""
        J = pin.getFrameJacobian(self._model, self._data, self._frames[effector], pin.LOCAL_WORLD_ALIGNED)
        return np.asarray(J[:, 6 + self.limb[effector]])

    def torques_nm(self, effector: str, force_n: Vector3) -> Float[np.ndarray, "k"]:
        """Torques of the limb that press with ``force_n`` on what the effector touches, which answers with minus it."""
        return np.asarray(self.moved_by_limb(effector)[:3].T @ force_n)

    def _limb(self, robot: Robot, effector: str) -> Int[np.ndarray, "k"]:
        model = self._model
        joints = model.supports[model.frames[self._frames[effector]].parentJoint]
        limb = [model.joints[j].idx_v - 6 for j in joints if robot.group.get(model.names[j]) in ("leg", "arm")]
        return np.array(limb, dtype=int)
