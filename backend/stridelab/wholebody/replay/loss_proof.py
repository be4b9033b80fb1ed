"""Sufficient condition that a pushed robot cannot come to rest, whatever it does within five premises.

In a horizontal direction, the CoM x at constant height z above level soles follows ``x'' = l (x - p)``, ``l = g / z``,
with the centre of pressure p behind the edge s(t) of the support, while the angular momentum L about the CoM changes
the velocity by at most ``(|L_0| + L_max) / (m z)``. Comparison gives the slowest motion: that change at once, p = s,
the largest l while x < s and the smallest one after it. Premises:

1. only soles touch, and all surfaces are level and at one height,
2. the CoM height is within that of the learned densities of the feet, without ``RARE_SHARE`` of it at either end,
3. ``L_max`` is the limit of the certificate (``momentum_limit_nms``),
4. a sole lands on a surface, and its edge within ``r`` of the CoM: the reach of the densities, without ``RARE_SHARE``,
   and half the sole's diagonal,
5. a swing takes at least 1 / ``PACE_MAX`` of the plan's: the present one of its rest or, put down where it began, of
   its past, and later ones of the shortest.

With a landing every T, ``s = x + r``, the velocity v at landings becomes ``v cosh(w T) - r w sinh(w T)``, w^2 the
largest l: it grows for ever from ``v > r w coth(w T / 2)`` on. Where the surfaces end, at S, no later landing helps:
the CoM passes S with ``v > w (S - x)``.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np
import pinocchio as pin
from jaxtyping import Float

from stridelab.contacts.sequence import ContactSequence
from stridelab.contacts.terrain import Box
from stridelab.conventions import GRAVITY_M_S2, Points
from stridelab.reachability.proxy.effector_proxy import Proxy
from stridelab.robots.robot import Robot
from stridelab.wholebody.certificate.certify import RARE_SHARE, momentum_limit_nms
from stridelab.wholebody.limb_kinematics import LimbKinematics
from stridelab.wholebody.replay.log import LOADED_N, Replay

PACE_MAX: Final = 2.5
"""Fastest pace of the step adjustment, as a multiple of the plan's."""
LEVEL_M: Final = 0.005
DIRECTIONS: Final = 72
LANDINGS: Final = 20
STEP_S: Final = 0.002
_DRAWS: Final = 8192


@dataclass(frozen=True, eq=False)
class LossPremises:
    """Numbers of the premises for one robot on one terrain, as far as they do not depend on the state.

    ``edges_m`` are the corners of all surfaces, ``reach_m`` is r, ``height_m`` the range of CoM heights above a sole,
    ``momentum_nms`` is L_max, ``swing_s`` the shortest swing at ``PACE_MAX``.
    """

    edges_m: Float[np.ndarray, "k 2"]
    reach_m: float
    height_m: tuple[float, float]
    momentum_nms: float
    swing_s: float

    @staticmethod
    def of_sequence(robot: Robot, sequence: ContactSequence, proxies: Mapping[str, Proxy]) -> "LossPremises | None":
        """None where the premises do not hold: hands, rails, surfaces of different heights, no swing, no density."""
        soles = [name for name in sequence.effectors if robot.effectors[name].kind == "surface"]
        boxes = [surface for surface in sequence.terrain.surfaces if isinstance(surface, Box)]
        if len(soles) < len(sequence.effectors) or len(boxes) < len(sequence.terrain.surfaces):
            return None
        tops = np.concatenate([_top_corners(box) for box in boxes])
        if np.ptp(tops[:, 2]) > LEVEL_M or any(name not in proxies for name in soles):
            return None
        rng = np.random.default_rng(0)
        draws = [proxies[name].mixture.sample(_DRAWS, rng) for name in soles]
        half = max(float(np.hypot(*(robot.effectors[name].contact_half_size_m or (0.0, 0.0)))) for name in soles)
        reach_m = max(float(np.quantile(np.hypot(*draw[:, :2].T), 1.0 - RARE_SHARE)) for draw in draws) + half
        low_m, high_m = np.quantile([draw[:, 2] for draw in draws], [RARE_SHARE, 1.0 - RARE_SHARE], axis=1)
        height_m = (float(low_m.min()), float(high_m.max()))
        if height_m[0] <= 0.0:
            return None
        swings_s = [end_s - start_s for name in soles for start_s, end_s in _swings_s(sequence, name)]
        if not swings_s:
            return None
        return LossPremises(tops[:, :2], reach_m, height_m, momentum_limit_nms(robot), min(swings_s) / PACE_MAX)

    def slowest_escape(self, v_m_s: float, gap_m: float, end_m: float, landing_s: float) -> bool:
        """Whether the slowest motion in one direction never ends.

        ``v_m_s`` is the velocity without the share of the angular momentum, ``gap_m`` the distance from the CoM to the
        edge of the support, ``end_m`` that to the end of the surfaces, ``landing_s`` the time to the next landing.
        """
        low, high = (np.sqrt(GRAVITY_M_S2 / z) for z in self.height_m[::-1])
        fastest = self.reach_m * high / np.tanh(high * self.swing_s / 2.0)
        s, end, x = min(gap_m, end_m), end_m, 0.0
        for _ in range(LANDINGS):
            for _ in range(int(landing_s / STEP_S)):
                if v_m_s <= 0.0:
                    return False
                if s >= end and v_m_s > high * max(end - x, 0.0):
                    return True
                w = high if x < s else low
                c, d = np.cosh(w * STEP_S), np.sinh(w * STEP_S)
                x, v_m_s = s + (x - s) * c + v_m_s / w * d, (x - s) * w * d + v_m_s * c
            if v_m_s > fastest:
                return True
            s, landing_s = max(s, min(x + self.reach_m, end)), self.swing_s
        return False


def is_loss_proved(
    robot: Robot, sequence: ContactSequence, premises: LossPremises, replay: Replay, time_s: float
) -> bool:
    """Whether no motion within the premises brings the robot to rest from its state in ``replay`` at ``time_s``."""
    i = min(int(np.searchsorted(replay.time_s, time_s)), len(replay.time_s) - 1)
    data = robot.model.createData()
    h = pin.computeCentroidalMomentum(robot.model, data, replay.q[i], replay.v[i])
    c, v = data.com[0][:2], h.linear[:2] / robot.mass_kg
    given_m_s = (float(np.linalg.norm(h.angular[:2])) + premises.momentum_nms) / (robot.mass_kg * premises.height_m[0])
    support_m = _support_corners_m(robot, sequence, replay, i)
    if not len(support_m):
        return False
    landing_s = _next_landing_s(sequence, premises.swing_s, float(replay.plan_time_s[i]))
    for angle in 2.0 * np.pi * np.arange(DIRECTIONS) / DIRECTIONS:
        n = np.array([np.cos(angle), np.sin(angle)])
        speed = float(v @ n) - given_m_s
        gap, end = (float(((points - c) @ n).max()) for points in (support_m, premises.edges_m))
        if speed > 0.0 and premises.slowest_escape(speed, gap, end, landing_s):
            return True
    return False


def _support_corners_m(robot: Robot, sequence: ContactSequence, replay: Replay, i: int) -> Float[np.ndarray, "k 2"]:
    """Corners of the soles that are loaded or planned to be in contact."""
    planned = sequence.phases[sequence.phase_at(float(replay.plan_time_s[i]))].contacts
    soles = [
        name
        for name in sequence.effectors
        if robot.effectors[name].kind == "surface"
        and (name in planned or np.linalg.norm(replay.forces_n[name][i]) > LOADED_N)
    ]
    kinematics = LimbKinematics(robot, tuple(soles))
    kinematics.set_configuration(replay.q[i])
    corners = [kinematics.contact_placement(name).act(robot.effectors[name].points_m())[:, :2] for name in soles]
    return np.concatenate([np.zeros((0, 2)), *corners])


def _next_landing_s(sequence: ContactSequence, swing_s: float, time_s: float) -> float:
    """Shortest time from ``time_s`` of the plan to a landing: of a swing in progress, else of a new one."""
    for name in sequence.effectors:
        for start_s, end_s in _swings_s(sequence, name):
            if start_s <= time_s < end_s:
                return min(end_s - time_s, time_s - start_s) / PACE_MAX
    return swing_s


def _swings_s(sequence: ContactSequence, effector: str) -> list[tuple[float, float]]:
    """Start and end of every swing of an effector between two contacts."""
    swings: list[tuple[float, float]] = []
    began_s: float | None = None
    for k, phase in enumerate(sequence.phases):
        if effector not in phase.contacts:
            began_s = float(sequence.starts_s[k]) if began_s is None and k else began_s
        elif began_s is not None:
            swings.append((began_s, float(sequence.starts_s[k])))
            began_s = None
    return swings


def _top_corners(box: Box) -> Points:
    x, y, z = box.size_m / 2.0
    return np.asarray(box.placement.act(np.array([[x, y, z], [x, -y, z], [-x, y, z], [-x, -y, z]])))
