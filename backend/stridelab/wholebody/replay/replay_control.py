"""Joint position control of a replay: its gains, and the stabiliser and the recovery that correct it."""

from collections import deque
from dataclasses import dataclass, field
from typing import Final

import mujoco
import numpy as np
import pinocchio as pin
from jaxtyping import Float

from stridelab.conventions import GRAVITY_M_S2, Angles
from stridelab.robots.robot import Robot
from stridelab.wholebody.recovery.recovery import Recovery
from stridelab.wholebody.replay.dcm_feedback import ankles_of
from stridelab.wholebody.replay.mujoco_model import SimulationModel
from stridelab.wholebody.replay.stabiliser import Stabiliser

FULL_SIZE_NM: Final = 776.0
"""Weight times CoM height of TALOS, from which a robot gets the full stiffness."""
YIELD_RAD: Final = 0.058
"""Smallest error of an arm's joint at which its stiffness alone takes its whole torque. HRP-2 and G1 have 0.058 and
more; with the stiffness of its upper arm the forearm of TALOS (3 N m) would have 0.01."""
TILT_LIMIT_1_M: Final = 200.0
"""Largest stiffness of an ankle over weight times the squared half width of its sole: at a penetration of 1 mm of one
edge the ankle then moves the centre of pressure by a fifth of the half width. TALOS has 188, HRP-2 148."""
OVERSHOOT_LIMIT: Final = 1.5
"""Largest eigenvalue of ``dt M^-1 D``: half of the speed is reversed in one step. Beyond 2 the control is unstable; the
bundled robots have 0.4 to 1.45."""
HEAVY_LOAD: Final = 0.05
"""Gravity stiffness ``m g l`` of what a locked joint carries, over the stiffness of an arm, from which on it is held
with that of the torso. The head of QingLong has 0.01, the trunk above its waist 0.25 to 0.35, that of G1 0.1."""
SOFT_STIFFNESS: Final = 0.2
SOFT_DAMPING: Final = 0.08
"""Shares of stiffness and damping of soft gains, for readings that are 10 ms old. The damping is reduced further than
the stiffness: what stops the ankle of G1 in the air (0.012 kg m2) within 1 ms reverses its motion tenfold in 10 ms."""


@dataclass(frozen=True)
class ReplayControl:
    """Joint control of stiffness (N m/rad) and damping (N m s/rad) in legs and torso, ``arm_share`` of it in the arms.

    A rotor inertia of 0.1 kg m^2 and 3000 N m/rad give 28 Hz, well above the motion and well below the 1 kHz steps.
    For robots with ``m g h`` below ``FULL_SIZE_NM`` the stiffness is reduced proportionally, and that of an ankle
    also for a sole that is narrow for the weight: with half width b it tilts on soft ground by its penetration over
    b, and the torque ``k`` against this moves the centre of pressure by ``k / (m g)`` per radian
    (``TILT_LIMIT_1_M``). That of an arm's joint is reduced where its motor is weak: a hand that its surface holds
    cannot follow its joints, and their errors last as long as the contact (``YIELD_RAD``). The damping of a joint is
    limited to ``I / dt``, which stops it within one step; ``I`` is its inertia with all other joints free. That of
    joints which move one light body together is limited further (``OVERSHOOT_LIMIT``). Readings that are
    ``expected_delay_s`` old are predicted (``DelayPredictor``); with ``soft_gains`` they may be 10 ms old
    on the level walks of all bundled robots. Where the stabiliser cannot undo a push, ``recovery``
    leaves the plan and steps; it needs a stabiliser.
    """

    stiffness: float = 3000.0
    damping: float = 100.0
    arm_share: float = 0.1
    expected_delay_s: float = 0.0
    soft_gains: bool = False
    stabiliser: Stabiliser | None = field(default_factory=Stabiliser)
    recovery: Recovery | None = field(default_factory=Recovery)

    def joint_gains(self, robot: Robot, timestep_s: float) -> tuple[Float[np.ndarray, "na"], Float[np.ndarray, "na"]]:
        """Stiffness (N m/rad) and damping (N m s/rad) of every joint, for steps of ``timestep_s``."""
        joints = robot.joint_names
        share = np.array([self.arm_share if robot.group[joint] in ("arm", "head") else 1.0 for joint in joints])
        ankles = {joint for effector in robot.effectors.values() for joint in effector.ankle or ()}
        ankle_share = self.stabiliser.ankle_stiffness if self.stabiliser is not None else 1.0
        softer = np.array([ankle_share if joint in ankles else 1.0 for joint in joints])
        size = _size_share(robot)
        full = self.stiffness * size * share
        if self.stabiliser is not None:
            for joint, limit in ankle_limits(robot).items():
                softer[joint] *= min(1.0, limit / max(full[joint] * softer[joint], 1e-9))
        arms = np.array([robot.group[joint] == "arm" for joint in joints])
        softer[arms] = np.minimum(1.0, robot.model.effortLimit[6:][arms] / np.maximum(YIELD_RAD * full[arms], 1e-9))
        damping = np.minimum(self.damping * size * share * np.sqrt(softer), joint_inertias(robot) / timestep_s)
        damping = _stable_damping(damping, timestep_s * _joint_mobility(robot))
        return (SOFT_STIFFNESS * full * softer, SOFT_DAMPING * damping) if self.soft_gains else (full * softer, damping)

    def gains_with_locked(
        self, robot: Robot, built: SimulationModel
    ) -> tuple[Float[np.ndarray, "na"], Float[np.ndarray, "na"], Float[np.ndarray, "nl"], Float[np.ndarray, "nl"]]:
        """Stiffness and damping of the moving joints, then of the locked ones (N m/rad, N m s/rad).

        A locked joint is held like those of an arm, one that carries the trunk like those of the torso: with the
        stiffness of an arm a trunk on three locked joints of a waist sways at about 1 Hz.
        """
        timestep_s = float(built.model.opt.timestep)
        kp, kd = self.joint_gains(robot, timestep_s)
        locked_kp = np.full(len(built.locked_dof), self.arm_share * self.stiffness)
        locked_kd = np.full(len(built.locked_dof), self.arm_share * self.damping)
        data = _reference_data(robot, built)
        heavy = _gravity_stiffness(robot, built, data) > HEAVY_LOAD * locked_kp
        if not heavy.any():
            return kp, kd, locked_kp, locked_kd
        size = _size_share(robot)
        locked_kp[heavy] = np.maximum(locked_kp[heavy], self.stiffness * size)
        M = np.zeros((built.model.nv, built.model.nv))
        mujoco.mj_fullM(built.model, data, M)
        dofs = np.concatenate([built.moving_dof, built.locked_dof[heavy]])
        mobility_s = timestep_s * np.linalg.inv(M)[np.ix_(dofs, dofs)]
        limit = 1.0 / np.diag(mobility_s)[len(kd) :]
        stiff = np.minimum(np.maximum(locked_kd[heavy], self.damping * size), limit)
        damping = _stable_damping(np.concatenate([kd, stiff]), mobility_s)
        locked_kd[heavy] = damping[len(kd) :]
        return kp, damping[: len(kd)], locked_kp, locked_kd


def ankle_limits(robot: Robot) -> dict[int, float]:
    """Largest stiffness (N m/rad) by the index of an ankle's joint, from the width of the sole across its axis."""
    limits = {}
    for ankle in ankles_of(robot).values():
        for joint, axis in zip(ankle.joints, ankle.axes, strict=True):
            half_m = ankle.half_size_m[1 - int(np.argmax(np.abs(axis[:2])))]
            limits[joint] = TILT_LIMIT_1_M * robot.mass_kg * GRAVITY_M_S2 * half_m**2
    return limits


def joint_inertias(robot: Robot) -> Float[np.ndarray, "na"]:
    """Inertia (kg m2) of every joint in the reference posture, with all other joints free."""
    return np.asarray(1.0 / np.diag(_joint_mobility(robot)))


def _joint_mobility(robot: Robot) -> Float[np.ndarray, "na na"]:
    """Accelerations of the joints per torque, the block of ``M^-1`` of the joints, in the reference posture."""
    data = robot.model.createData()
    pin.crba(robot.model, data, robot.q_reference)
    M = np.triu(data.M) + np.triu(data.M, 1).T
    return np.asarray(np.linalg.inv(M)[6:, 6:])


def _stable_damping(
    damping: Float[np.ndarray, "na"], mobility_s: Float[np.ndarray, "na na"]
) -> Float[np.ndarray, "na"]:
    """Reduce the damping of the joints that share a mode which one step of ``mobility_s = dt M^-1`` overshoots.

    A mode with the eigenvalue ``mu`` of ``dt M^-1 D`` keeps ``1 - mu`` of its speed. Joints that all move one light
    body, such as hips and waist a pelvis, have ``mu > 1`` together where each alone has at most 1.
    """
    while True:
        root = np.sqrt(damping)
        mu, modes = np.linalg.eigh(root[:, None] * mobility_s * root)
        if mu[-1] <= OVERSHOOT_LIMIT + 1e-9:
            return damping
        share = modes[:, -1] ** 2
        damping = damping * (1.0 - (1.0 - OVERSHOOT_LIMIT / mu[-1]) * share / share.max())


def _size_share(robot: Robot) -> float:
    """Share of the full stiffness, from weight times height of the CoM."""
    height_m = pin.centerOfMass(robot.model, robot.model.createData(), robot.q_reference)[2]  # the soles are on z = 0
    return float(min(1.0, robot.mass_kg * GRAVITY_M_S2 * height_m / FULL_SIZE_NM))


def _reference_data(robot: Robot, built: SimulationModel) -> mujoco.MjData:
    """Places and mass matrix of the simulated robot in the reference posture."""
    data = mujoco.MjData(built.model)
    x, y, z, w = robot.q_reference[3:7]
    data.qpos[:7] = [*robot.q_reference[:3], w, x, y, z]
    data.qpos[built.moving_qpos] = robot.q_reference[7:]
    data.qpos[built.locked_qpos] = built.locked_rad
    mujoco.mj_forward(built.model, data)
    return data


def _gravity_stiffness(robot: Robot, built: SimulationModel, data: mujoco.MjData) -> Float[np.ndarray, "nl"]:
    """``m g l`` (N m/rad) of what each locked joint carries: the side of it without soles."""
    model = built.model
    soles = {body for name, body in built.body.items() if robot.effectors[name].kind == "surface"}
    standing = {ancestor for body in soles for ancestor in _ancestor_bodies(model, body)}
    total_kg, total_com_m = float(model.body_subtreemass[1]), data.subtree_com[1]
    result = np.zeros(len(built.locked_dof))
    for k, dof in enumerate(built.locked_dof):
        joint = int(model.dof_jntid[dof])
        body = int(model.jnt_bodyid[joint])
        mass_kg, com_m = float(model.body_subtreemass[body]), data.subtree_com[body]
        if body in standing:
            rest_kg = total_kg - mass_kg
            com_m = (total_kg * total_com_m - mass_kg * com_m) / max(rest_kg, 1e-9)
            mass_kg = rest_kg
        result[k] = mass_kg * GRAVITY_M_S2 * float(np.linalg.norm(com_m - data.xanchor[joint]))
    return result


def _ancestor_bodies(model: mujoco.MjModel, body: int) -> list[int]:
    """A body and those that it hangs on, without the world."""
    chain = []
    while body:
        chain.append(body)
        body = int(model.body_parentid[body])
    return chain


class DelayPredictor:
    """Feedback of the joints for readings that are n steps old, from what was commanded since (a Smith predictor).

    Without a disturbance, an error ``e`` of a joint moves as ``I e'' = -tau`` under the feedback torque alone, so that

        e' <- e' - tau_k dt / I ,     e <- e + e' dt

    over the torques of the last n steps leads from the error of the old reading to the present one (Smith 1957).
    Against a constant load, such as that on a standing leg, the control is softer the longer the delay is.
    """

    def __init__(
        self, kp: Angles, kd: Angles, inertia_kgm2: Angles, expected_delay_s: float, timestep_s: float
    ) -> None:
        self._kp, self._kd, self._inertia, self._dt_s = kp, kd, inertia_kgm2, timestep_s
        n = round(expected_delay_s / timestep_s)
        self._given: deque[tuple[np.ndarray, np.ndarray]] = deque(maxlen=n + 1)
        self._taus: deque[np.ndarray] = deque(maxlen=n)

    def feedback_nm(self, q_command: Angles, v_command: Angles, q_read: Angles, v_read: Angles) -> Angles:
        """Feedback torques for the next step."""
        self._given.append((q_command, v_command))
        q_then, v_then = self._given[0]
        error, rate = q_then - q_read, v_then - v_read
        for tau in self._taus:
            rate = rate - tau * (self._dt_s / self._inertia)
            error = error + rate * self._dt_s
        result = self._kp * error + self._kd * rate
        self._taus.append(result)
        return np.asarray(result)
