"""Capture-point feedback: the required centre of pressure, and the ankle torques and leg forces that produce it.

The divergent component of motion ``xi = c + c' / w`` with ``w = sqrt(g / h)`` diverges from the centre of pressure z,

    xi' = w (xi - z) ,

so that with ``e = xi - xi_ref`` the centre of pressure is shifted by ``d = k e + k_i w int e dt`` (Englsberger 2015,
Morisawa 2012); the integral compensates constant errors: a load, a slope, an offset of the CoM. It does not grow in the
direction in which the soles are exhausted: on stairs that are climbed with one foot on each, that error has the other
sign at the next step, which began with the integral of this one. The part of ``d`` that
the soles can realise within their rectangles becomes ankle torques: a force ``f_z`` shifted by ``d`` turns the foot
with ``d x f``, which the joint with axis ``a`` opposes by ``-a (d x f)``. On two soles load is also transferred from
one to the other: of a grid of load shares, the one is used whose total shift is closest to d.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
import pinocchio as pin
from jaxtyping import Float

from stridelab.contacts.effector_geometry import FOOT_CLEARANCE_M, foot_clearance_m
from stridelab.conventions import GRAVITY_M_S2, Rotation, Vector3
from stridelab.robots.robot import Robot

_MIN_LOAD_SHARE = 0.05
"""Minimum share of the load on each of two soles."""
_N_SHARES = 41
_TRANSFER_COST_M = 0.01
"""Cost of transferring all the load, in units of the error of the centre of pressure."""
_MISSED_M = 1e-6
"""A shorter part of the shift is realised."""
MIN_COM_HEIGHT_M = 0.15
"""Lower bound of the CoM height in the pendulum model."""
Shift = Float[np.ndarray, "2"]


@dataclass(frozen=True, eq=False)
class Ankle:
    """Two joints next to a sole: their indices among the actuated joints and their axes in the contact frame."""

    joints: tuple[int, int]
    axes: Float[np.ndarray, "2 3"]
    half_size_m: tuple[float, float]


@dataclass(frozen=True, eq=False)
class Sole:
    """A sole in contact: its placement, planned normal force, and centre of pressure in the contact frame (x, y)."""

    position_m: Vector3
    rotation: Rotation
    load_n: float
    pressure_m: Shift


@dataclass(frozen=True)
class CapturePointFeedback:
    """Feedback with ``gain`` of the capture point error and ``integral_gain`` of its integral, up to ``integral_m``.

    The centre of pressure keeps ``edge_m`` from the edges of the soles; at most the share ``transfer`` of the weight is
    transferred between two of them.
    """

    gain: float = 3.0
    integral_gain: float = 0.3
    integral_m: float = 0.03
    edge_m: float = 0.005
    transfer: float = 1.0

    def scaled_by(self, size: float) -> "CapturePointFeedback":
        """For a robot of ``size`` times the lengths."""
        return replace(self, integral_m=size * self.integral_m, edge_m=size * self.edge_m)

    def shift_m(self, error_m: Shift, integral_m: Shift) -> Shift:
        """Shift of the centre of pressure for an error of the capture point and its integral times w."""
        return self.gain * error_m + self.integral_gain * integral_m

    @staticmethod
    def integrable_m(error_m: Shift, missed_m: Shift) -> Shift:
        """The part of an error that the integral grows by while the soles miss ``missed_m`` of the shift."""
        size_m = math.hypot(*missed_m)
        if size_m < _MISSED_M:
            return error_m
        towards = missed_m / size_m
        return np.asarray(error_m - max(0.0, float(error_m @ towards)) * towards)

    def distribute_shift(
        self, shift_m: Shift, soles: Mapping[str, Sole], half_size_m: Mapping[str, tuple[float, float]]
    ) -> tuple[dict[str, Shift], dict[str, float], Shift]:
        """Per sole the shift of its centre of pressure (contact frame) and the load transferred to it (N).

        The last value is the part of ``shift_m`` that the soles cannot realise.
        """
        if len(soles) != 2:
            own_shifts = {name: self._clip_to_sole(shift_m, sole, half_size_m[name]) for name, sole in soles.items()}
            gained = dict.fromkeys(soles, 0.0)
            realised_m = [own_shifts[name] @ sole.rotation[:2, :2].T for name, sole in soles.items()]
            missed_m = shift_m - np.mean(realised_m, axis=0)
        else:
            a, b = soles.values()
            total_n = a.load_n + b.load_n
            # load shares of the first sole, the planned one first; ``rest`` is left to the soles themselves
            planned = a.load_n / total_n
            least, most = (
                min(max(planned + sign * self.transfer, _MIN_LOAD_SHARE), 1.0 - _MIN_LOAD_SHARE) for sign in (-1.0, 1.0)
            )
            shares = np.empty(1 + _N_SHARES)
            shares[0], shares[1:] = planned, _even_shares(min(least, planned), max(most, planned))
            sole_offset = (_pressure_m(a) - _pressure_m(b))[:2]
            rest = shift_m - (shares - planned)[:, None] * sole_offset
            shifts = [self._clip_to_sole(rest, sole, half_size_m[name]) for name, sole in soles.items()]
            realised = [shift @ sole.rotation[:2, :2].T for shift, sole in zip(shifts, soles.values(), strict=True)]
            error = rest - shares[:, None] * realised[0] - (1.0 - shares)[:, None] * realised[1]
            best = int(np.argmin((error**2).sum(axis=1) + _TRANSFER_COST_M**2 * (shares - planned) ** 2))
            own_shifts = {name: shift[best] for name, shift in zip(soles, shifts, strict=True)}
            missed_m = error[best]
            moved_n = float(shares[best] - planned) * total_n
            gained = dict(zip(soles, (moved_n, -moved_n), strict=True))
        return own_shifts, gained, missed_m

    def _clip_to_sole(self, shift_m: np.ndarray, sole: Sole, half_size_m: tuple[float, float]) -> np.ndarray:
        """Clip shifts ``(..., 2)`` in world axes to the sole; the result is in its contact frame."""
        half = np.array(half_size_m) - self.edge_m
        low, high = np.minimum(-half - sole.pressure_m, 0.0), np.maximum(half - sole.pressure_m, 0.0)
        return np.asarray(np.minimum(np.maximum(shift_m @ sole.rotation[:2, :2], low), high))


@lru_cache(maxsize=8)
def _even_shares(least: float, most: float) -> Float[np.ndarray, "n"]:
    """``_N_SHARES`` shares from ``least`` to ``most``, which are nearly always the same."""
    shares = np.linspace(least, most, _N_SHARES)
    shares.flags.writeable = False
    return shares


def _pressure_m(sole: Sole) -> Vector3:
    """Planned centre of pressure of a sole in the world."""
    return np.asarray(sole.position_m + sole.rotation[:, :2] @ sole.pressure_m)


def pendulum_rate(com_height_m: float) -> float:
    """Rate ``w`` (1/s) of the linear inverted pendulum."""
    return math.sqrt(GRAVITY_M_S2 / max(com_height_m, MIN_COM_HEIGHT_M))


def size_share(robot: Robot) -> float:
    """Size of a robot over that for which lengths and forces of the replay were chosen, at most 1.

    It is below 1 where the swings are lower, too: for a CoM below 0.55 m in the reference posture.
    """
    com_m = pin.centerOfMass(robot.model, robot.model.createData(), robot.q_reference)
    return foot_clearance_m(float(com_m[2])) / FOOT_CLEARANCE_M


def ankle_torques_nm(ankle: Ankle, shift_m: Shift, load_n: float) -> Float[np.ndarray, "2"]:
    """Torques of the two joints that shift the centre of pressure by ``shift_m`` in the contact frame."""
    dx, dy = shift_m
    return np.asarray(ankle.axes @ np.array([-dy * load_n, dx * load_n, 0.0]))


def ankles_of(robot: Robot) -> dict[str, Ankle]:
    """The two-joint ankles of all soles; joint axes in the reference posture."""
    data = robot.model.createData()
    ankles = {}
    for name, effector in robot.effectors.items():
        if effector.ankle is None or effector.contact_half_size_m is None:
            continue
        frame = robot.model.getFrameId(effector.frame)
        J = pin.computeFrameJacobian(robot.model, data, robot.q_reference, frame, pin.ReferenceFrame.LOCAL)
        columns = [robot.model.joints[robot.model.getJointId(joint)].idx_v for joint in effector.ankle]
        axes = (effector.T_frame_contact.rotation.T @ J[3:, columns]).T
        first, second = (column - 6 for column in columns)
        ankles[name] = Ankle((first, second), np.ascontiguousarray(axes), effector.contact_half_size_m)
    return ankles
