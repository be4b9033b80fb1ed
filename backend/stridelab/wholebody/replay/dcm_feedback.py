"""Capture-point feedback: where the centre of pressure has to be, and what ankles and legs do for it.

The divergent component of motion ``xi = c + c' / w`` with ``w = sqrt(g / h)`` runs away from the centre of pressure z,

    xi' = w (xi - z) ,

so that with ``e = xi - xi_ref`` the pressure is moved ahead of it, by ``d = k e + k_i w int e dt`` (Englsberger 2015,
Morisawa 2012); the integral finds what is constantly wrong: a load, a slope, a CoM that is not where it is thought.
What of ``d`` the soles can do within their rectangles becomes ankle torques: a force ``f_z`` shifted by ``d`` turns the
foot with ``d x f``, which the joint with axis ``a`` has to oppose by ``-a (d x f)``. On two soles load is shifted from
one to the other as well: of a row of shares the one with which pressure and soles together come closest to d.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import pinocchio as pin
from jaxtyping import Float

from stridelab.conventions import GRAVITY_M_S2, Rotation, Vector3
from stridelab.robots.robot import Robot

_LEAST_SHARE = 0.05
"""Of the weight, that each of two soles keeps."""
_TRIED = 41
_UNPLANNED_M = 0.01
"""What a shift of all the load counts beside a centre of pressure that is missed."""
LOWEST_COM_M = 0.3
"""Below this the pendulum is no model of the robot any more."""
Shift = Float[np.ndarray, "2"]


@dataclass(frozen=True, eq=False)
class Ankle:
    """Two joints next to a sole: their indices among the actuated joints and their axes in the contact frame."""

    joints: tuple[int, int]
    axes: Float[np.ndarray, "2 3"]
    half_size_m: tuple[float, float]


@dataclass(frozen=True, eq=False)
class Sole:
    """A sole stood on: where it is, the planned normal force on it and its centre in the contact frame (x, y)."""

    position_m: Vector3
    rotation: Rotation
    load_n: float
    pressure_m: Shift


@dataclass(frozen=True)
class CapturePoint:
    """``gain`` of the capture point's error and ``integral_gain`` of its integral, held within ``integral_m``.

    The centre of pressure stays ``edge_m`` inside the soles; no more than ``transfer`` of the weight is shifted between
    two of them.
    """

    gain: float = 3.0
    integral_gain: float = 0.3
    integral_m: float = 0.03
    edge_m: float = 0.005
    transfer: float = 1.0

    def shift_m(self, error_m: Shift, integral_m: Shift) -> Shift:
        """Of the centre of pressure, for an error of the capture point and its integral times w."""
        return self.gain * error_m + self.integral_gain * integral_m

    def spread(
        self, shift_m: Shift, soles: Mapping[str, Sole], half_size_m: Mapping[str, tuple[float, float]]
    ) -> tuple[dict[str, Shift], dict[str, float]]:
        """Per sole the shift of its own centre of pressure (contact frame) and the load that it gains (N)."""
        own = {name: self._within(shift_m, sole, half_size_m[name]) for name, sole in soles.items()}
        gained = dict.fromkeys(soles, 0.0)
        if len(soles) == 2:
            a, b = soles.values()
            total_n = a.load_n + b.load_n
            # shares of the first sole, the planned one first; each with what the soles themselves would have to do
            planned = a.load_n / total_n
            most = np.clip([planned - self.transfer, planned + self.transfer], _LEAST_SHARE, 1.0 - _LEAST_SHARE)
            shares = np.append(planned, np.linspace(min(most[0], planned), max(most[1], planned), _TRIED))
            apart = (_pressure_m(a) - _pressure_m(b))[:2]
            rest = shift_m - (shares - planned)[:, None] * apart
            shifts = [self._within(rest, sole, half_size_m[name]) for name, sole in soles.items()]
            done = [shift @ sole.rotation[:2, :2].T for shift, sole in zip(shifts, soles.values(), strict=True)]
            missed = rest - shares[:, None] * done[0] - (1.0 - shares)[:, None] * done[1]
            best = int(np.argmin((missed**2).sum(axis=1) + _UNPLANNED_M**2 * (shares - planned) ** 2))
            own = {name: shift[best] for name, shift in zip(soles, shifts, strict=True)}
            moved_n = float(shares[best] - planned) * total_n
            gained = dict(zip(soles, (moved_n, -moved_n), strict=True))
        return own, gained

    def _within(self, shift_m: np.ndarray, sole: Sole, half_size_m: tuple[float, float]) -> np.ndarray:
        """Shifts ``(..., 2)`` in world axes as far as the sole allows, in its contact frame."""
        half = np.array(half_size_m) - self.edge_m
        low, high = np.minimum(-half - sole.pressure_m, 0.0), np.maximum(half - sole.pressure_m, 0.0)
        return np.asarray(np.clip(shift_m @ sole.rotation[:2, :2], low, high))


def _pressure_m(sole: Sole) -> Vector3:
    """Where a sole is planned to be pressed."""
    return np.asarray(sole.position_m + sole.rotation[:, :2] @ sole.pressure_m)


def pendulum_rate(com_height_m: float) -> float:
    """``w`` (1/s)."""
    return float(np.sqrt(GRAVITY_M_S2 / max(com_height_m, LOWEST_COM_M)))


def ankle_torques_nm(ankle: Ankle, shift_m: Shift, load_n: float) -> Float[np.ndarray, "2"]:
    """Of the two joints, for a centre of pressure that moves by ``shift_m`` in the contact frame."""
    dx, dy = shift_m
    return np.asarray(ankle.axes @ np.array([-dy * load_n, dx * load_n, 0.0]))


def ankles_of(robot: Robot) -> dict[str, Ankle]:
    """The ankles of all soles that have two joints; axes as they stand in the reference posture."""
    data = robot.model.createData()
    found = {}
    for name, effector in robot.effectors.items():
        if effector.ankle is None or effector.contact_half_size_m is None:
            continue
        frame = robot.model.getFrameId(effector.frame)
        J = pin.computeFrameJacobian(robot.model, data, robot.q_reference, frame, pin.ReferenceFrame.LOCAL)
        columns = [robot.model.joints[robot.model.getJointId(joint)].idx_v for joint in effector.ankle]
        axes = (effector.T_frame_contact.rotation.T @ J[3:, columns]).T
        first, second = (column - 6 for column in columns)
        found[name] = Ankle((first, second), np.ascontiguousarray(axes), effector.contact_half_size_m)
    return found
