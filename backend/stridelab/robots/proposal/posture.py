"""Rest posture by optimisation: upright on level soles, knees bent, CoM above the soles, arms beside the body.

Every limb solves a bounded nonlinear least-squares problem in its joint angles: a leg for the pose of its sole, which
is below the hip at a share ``EXTENSIONS`` of its greatest distance, an arm for the place of its hand, and both weakly
for 0.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from itertools import product
from typing import Final

import numpy as np
import pinocchio as pin
from jaxtyping import Float
from scipy.optimize import least_squares

from stridelab.conventions import Rotation, Vector3
from stridelab.robots.proposal.limbs import Chain, Limbs, not_humanoid
from stridelab.robots.proposal.soles import Sole

EXTENSIONS: Final = (0.97, 0.95, 0.93, 0.91, 0.89, 0.87)
"""Heights of the hips above the soles over the greatest possible one that are tried until the knees bend enough."""
KNEE_RAD: Final = 0.6
STARTS: Final = 6
DRAWS: Final = 600
LEG_TOLERANCE: Final = 0.01
"""Largest error of a sole: rad, and relative to the length of the leg."""
HAND: Final = (0.35, 0.0, -0.62)
"""Place of a hand relative to its shoulder, over the length of the arm: ahead, (outwards), up."""
FOOT_GAP: Final = 0.03
"""Least distance of a foot from the middle, over the length of the leg."""
CENTRING: Final = 4
MARGIN: Final = 0.03
GRAVITY: Final = 9.81
LOWER: Final = (0.0, 0.03, 0.06)
"""Heights of single supports below that of the rest posture, over the length of the leg."""
SWINGS: Final = (0.0, 0.15, -0.15)
"""Places of the lifted sole ahead, over the length of the leg: half a step of the first walk."""
TILTS_RAD: Final = (0.0, 0.1, -0.1, 0.2, -0.2)
"""Tilts of the trunk to the side, in the order in which they are tried."""
LIFT: Final = 0.07
"""Height of the lifted sole, over the length of the leg: 6 cm for TALOS."""


def rest_posture(
    model: pin.Model, limbs: Limbs, soles: Sequence[Sole], outwards: float, torso_rad: Mapping[int, float] | None = None
) -> tuple[Float[np.ndarray, "nq"], float]:
    """Configuration of the full model, and the length of the legs (hip to sole, m).

    ``outwards`` is the distance of the hands from the shoulders to the side, over the length of the arms;
    ``torso_rad`` are angles of joints of the torso, which are else at 0.
    Raises ``InvalidInput`` (``robot-not-humanoid``) if the soles cannot be level below the hips.
    """
    solver = _Limb(model, limbs.R_root)
    q = solver.neutral()
    for joint, angle in (torso_rad or {}).items():
        q[model.joints[joint].idx_q] = angle
    leg_m = min(solver.reach_m(q, leg, leg[2], sole.centre_m) for leg, sole in zip(limbs.legs, soles, strict=True))
    for arm, side in zip(limbs.arms, (1.0, -1.0), strict=False):
        q = solver.place_hand(q, arm, side * outwards)
    hips = [solver.joint_position(q, leg[2]) for leg in limbs.legs]
    apart_m = max(*(abs(hip[1]) for hip in hips), *(sole.foot_half_size_m[1] + FOOT_GAP * leg_m for sole in soles))
    straight, ahead_m = q, float(np.mean([hip[0] for hip in hips]))
    standing: np.ndarray | None = None
    for extension in EXTENSIONS:
        level = float(np.mean([hip[2] for hip in hips])) - extension * leg_m
        q, unreached = straight, None
        for _ in range(CENTRING):
            for leg, sole, hip in zip(limbs.legs, soles, hips, strict=True):
                target_m = np.array([ahead_m, np.copysign(apart_m, hip[1]), level])
                q, reached = solver.place_sole(q, leg, sole, target_m, leg_m)
                unreached = unreached if reached else leg
            ahead_m = float(solver.com_position(q)[0])
        standing = q if unreached is None else standing
        if unreached is None and solver.bend_rad(q, straight, limbs.legs[0]) >= KNEE_RAD:
            break
    if standing is None:
        raise not_humanoid(
            f"the leg that starts at {model.names[(unreached or limbs.legs[0])[0]]!r} cannot put its sole level below "
            "the hip with bent knees within the joints' ranges",
            "reference",
        )
    return standing, leg_m


def single_supports(
    model: pin.Model, limbs: Limbs, soles: Sequence[Sole], q: Float[np.ndarray, "nq"], leg_m: float
) -> Iterator[tuple[int, Rotation, Float[np.ndarray, "nq"]]]:
    """Postures on one sole, which is below the CoM: the index of its leg, axes ahead, left and up in the root link.

    The other sole is lifted beside it, ahead of it and behind it, as in the first walk; the hips are as high as in
    ``q`` and lower. The trunk is upright, or tilted to the side where hips do not reach inwards. What a leg does not
    reach is left out.
    """
    for stance, lower in product((0, 1), LOWER):
        for tilt in TILTS_RAD:
            R = limbs.R_root @ pin.utils.rotate("x", tilt)
            postures = list(_single_support(_Limb(model, R), limbs, soles, q, leg_m, stance, lower))
            if postures:
                yield from ((stance, R, posture) for posture in postures)
                break


def _single_support(
    solver: "_Limb", limbs: Limbs, soles: Sequence[Sole], q: np.ndarray, leg_m: float, stance: int, lower: float
) -> Iterator[Float[np.ndarray, "nq"]]:
    """Postures on the sole of one leg at one height of the hips."""
    pin.forwardKinematics(solver.model, solver.data, q)
    at_rest = [
        solver.R.T @ solver.data.oMi[leg[-1]].act(sole.centre_m) for leg, sole in zip(limbs.legs, soles, strict=True)
    ]
    other, above = 1 - stance, np.array([0.0, 0.0, at_rest[stance][2] + lower * leg_m])
    for ahead in SWINGS:
        beside_m = np.array([ahead * leg_m, at_rest[other][1] - at_rest[stance][1], LIFT * leg_m])
        posture = q
        for _ in range(CENTRING - 1):
            target_m = solver.com_position(posture) * (1.0, 1.0, 0.0) + above
            posture, stands = solver.place_sole(
                posture, limbs.legs[stance], soles[stance], target_m, leg_m, nearest=True
            )
            if not stands:
                return
            posture, lifted = solver.place_sole(
                posture, limbs.legs[other], soles[other], target_m + beside_m, leg_m, nearest=True
            )
        if lifted:
            yield posture


def standing_torques_nm(
    model: pin.Model, foot: int, R: Rotation, q: Float[np.ndarray, "nq"]
) -> Float[np.ndarray, "nv"]:
    """Generalised forces that hold the posture ``q`` on the sole of the joint ``foot`` against gravity.

    The force of the ground acts below the CoM, so that the six of the root link are 0; ``R`` has the axes ahead, left
    and up of the world in the root link.
    """
    model = pin.Model(model)
    data = model.createData()
    model.gravity.linear = -GRAVITY * R[:, 2]
    torques_nm = pin.computeGeneralizedGravity(model, data, q)
    com = pin.centerOfMass(model, data, q)
    pin.computeJointJacobians(model, data, q)
    J = pin.getJointJacobian(model, data, foot, pin.LOCAL_WORLD_ALIGNED)
    force_n = GRAVITY * float(pin.computeTotalMass(model)) * R[:, 2]
    moment_nm = np.cross(com - data.oMi[foot].translation, force_n)
    return np.asarray(torques_nm - J[:3].T @ force_n - J[3:].T @ moment_nm)


class _Limb:
    """Kinematics of limbs in forward, left and up axes of the root link."""

    def __init__(self, model: pin.Model, R_root: Rotation) -> None:
        self.model, self.data, self.R = model, model.createData(), R_root

    def neutral(self) -> np.ndarray:
        """All joints at 0, or at the nearest angle within their range and a margin."""
        q = pin.neutral(self.model)
        low, high = self.model.lowerPositionLimit[7:], self.model.upperPositionLimit[7:]
        margin = np.minimum(MARGIN, 0.25 * (high - low))
        q[7:] = np.clip(0.0, low + margin, high - margin)
        return np.asarray(q)

    def joint_position(self, q: np.ndarray, joint: int) -> Vector3:
        """Origin of a joint."""
        pin.forwardKinematics(self.model, self.data, q)
        return np.asarray(self.R.T @ self.data.oMi[joint].translation)

    def com_position(self, q: np.ndarray) -> Vector3:
        """Centre of mass."""
        return np.asarray(self.R.T @ pin.centerOfMass(self.model, self.data, q))

    def bend_rad(self, q: np.ndarray, straight: np.ndarray, leg: Chain) -> float:
        """Largest change of an angle between hip and ankle from the configuration ``straight``."""
        index = [self.model.joints[joint].idx_q for joint in leg[2:-2]]
        return float(np.abs(q[index] - straight[index]).max())

    def reach_m(self, q: np.ndarray, chain: Chain, start: int, end_m: Vector3) -> float:
        """Greatest distance from the joint ``start`` to a point on the last body, over random angles of the chain."""
        rng, q = np.random.default_rng(0), q.copy()
        index, low, high = self._range(chain)
        longest = 0.0
        for _ in range(DRAWS):
            pin.forwardKinematics(self.model, self.data, q)
            end = self.data.oMi[chain[-1]].act(end_m)
            longest = max(longest, float(np.linalg.norm(end - self.data.oMi[start].translation)))
            q[index] = rng.uniform(low, high)
        return longest

    def place_sole(
        self, q: np.ndarray, leg: Chain, sole: Sole, target_m: Vector3, leg_m: float, *, nearest: bool = False
    ) -> tuple[np.ndarray, bool]:
        """``q`` with the sole level, ahead and as near to ``target_m`` as possible, and whether it is there.

        With ``nearest`` the search ends with the first start that gets there, which is ``q``.
        """

        def sole_error(T: pin.SE3) -> tuple[np.ndarray, np.ndarray]:
            R = self.R.T @ T.rotation @ sole.R
            position = self.R.T @ T.act(sole.centre_m)
            turn = pin.Jlog3(R) @ sole.R.T
            moved = self.R.T @ T.rotation @ np.hstack([np.eye(3), -pin.skew(sole.centre_m)])
            J = np.vstack([moved / leg_m, np.hstack([np.zeros((3, 3)), turn])])
            return np.concatenate([(position - target_m) / leg_m, pin.log3(R)]), J

        def is_there(error: np.ndarray) -> bool:
            return bool(np.abs(error).max() <= LEG_TOLERANCE)

        solved = self._solve_angles(q, leg, sole_error, weight=1e-3, enough=is_there if nearest else None)
        pin.forwardKinematics(self.model, self.data, solved)
        return solved, is_there(sole_error(self.data.oMi[leg[-1]])[0])

    def place_hand(self, q: np.ndarray, arm: Chain, outwards: float) -> np.ndarray:
        """``q`` with the end of the arm near its place beside the body."""
        length_m = self.reach_m(q, arm, arm[0], np.zeros(3))
        shoulder = self.joint_position(q, arm[0])
        target_m = shoulder + length_m * np.array([HAND[0], outwards, HAND[2]])

        def hand_error(T: pin.SE3) -> tuple[np.ndarray, np.ndarray]:
            J = np.hstack([self.R.T @ T.rotation, np.zeros((3, 3))])
            scale_m = max(length_m, 1e-3)
            return (self.R.T @ T.translation - target_m) / scale_m, J / scale_m

        return self._solve_angles(q, arm, hand_error, weight=0.05)

    def _range(self, chain: Chain) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        index = np.array([self.model.joints[joint].idx_q for joint in chain])
        low, high = self.model.lowerPositionLimit[index], self.model.upperPositionLimit[index]
        margin = np.minimum(MARGIN, 0.25 * (high - low))
        return index, low + margin, high - margin

    def _solve_angles(
        self,
        q: np.ndarray,
        chain: Chain,
        end_error: Callable[[pin.SE3], tuple[np.ndarray, np.ndarray]],
        weight: float,
        enough: Callable[[np.ndarray], bool] | None = None,
    ) -> np.ndarray:
        """``q`` with the angles of ``chain`` that make the smallest ``end_error`` of its last body.

        ``end_error`` returns it for a pose of that body, and their derivative by its velocity in its own axes.
        """
        index, low, high = self._range(chain)
        columns = [self.model.joints[joint].idx_v for joint in chain]
        middle = np.clip(0.0, low, high)
        rng = np.random.default_rng(1)
        best, least = q, np.inf
        q_tried = q.copy()

        def error_at(angles: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
            q_tried[index] = angles
            pin.forwardKinematics(self.model, self.data, q_tried)
            return end_error(self.data.oMi[chain[-1]])

        def residuals_at(angles: np.ndarray) -> np.ndarray:
            return np.concatenate([error_at(angles)[0], weight * (angles - middle)])

        def slopes_at(angles: np.ndarray) -> np.ndarray:
            slope = error_at(angles)[1]
            J = pin.computeJointJacobian(self.model, self.data, q_tried, chain[-1])
            return np.vstack([slope @ J[:, columns], weight * np.eye(len(chain))])

        for start in range(STARTS):
            spread = 0.0 if start == 0 else 0.35
            first = np.clip(q[index] + spread * rng.uniform(low - middle, high - middle), low + 1e-9, high - 1e-9)
            solved = least_squares(residuals_at, first, slopes_at, bounds=(low, high), max_nfev=60)
            if solved.cost < 0.9 * least:
                least, best = solved.cost, q.copy()
                best[index] = solved.x
            if enough is not None and enough(solved.fun[: -len(chain)]):
                break
        return best
