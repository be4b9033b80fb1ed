"""A recorded walk scaled to a robot: a scenario of level steps between two stances.

With l the height of the hips above the floor, of the person as measured and of the robot in its reference posture,
lengths scale with ``s = l_robot / l_person`` and times with ``sqrt(s)``, so that at pace 1 both walk at the same Froude
number ``v^2 / (g l)`` (Hof 1996). Times are divided by the pace. Steps are at least as wide as the soles need.

The robot starts and ends at rest with its feet side by side, which few recordings show: it starts beside the first
foothold and closes its feet beside the last one.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import cos, radians, sin, sqrt
from typing import Any, Final

import numpy as np
import pinocchio as pin
from jaxtyping import Float

from stridelab.contacts.scenarios.parts import Contacts, box, contact, phase, scenario
from stridelab.errors import InvalidInput
from stridelab.pipelines.commissioning.commission_robot import foot_places_m
from stridelab.pipelines.imitation.recorded_walk import Foothold, RecordedWalk
from stridelab.recordings.recording import Side
from stridelab.robots.robot import Robot

ENDS_S: Final = 1.0
"""Time at rest at both ends."""
TOE_OUT_RAD: Final = (radians(-3.0), radians(15.0))
"""Range of the soles' yaw outwards; a recorded foot beyond it is turned to the nearest end."""
MARGIN_M: Final = 1.5
"""Floor around the footholds."""
SOLES_GAP_SHARE: Final = 0.107
"""Least gap between the soles over the height of the hips: TALOS' thighs touch on long steps with less than 8 cm."""
LEAST_FOOTHOLDS: Final = 6
"""Footholds of the robot; of a shorter recording the last stride is repeated."""
LEG_JOINTS: Final = 3
"""Joints of a hip, whose mean height is that of the hip."""


@dataclass(frozen=True)
class RobotScale:
    """Dimensions of a robot that scale a walk: height of the hips, least step width, and the sole (half edges)."""

    robot: str
    hip_height_m: float
    step_width_min_m: float

    @classmethod
    def of_robot(cls, robot: Robot) -> "RobotScale":
        """Dimensions in the reference posture.

        Raises ``InvalidInput`` (``feet-missing``) for a robot without two soles.
        """
        soles = [robot.effectors.get(f"{side}_foot") for side in ("left", "right")]
        sizes = [sole.contact_half_size_m for sole in soles if sole is not None and sole.contact_half_size_m]
        if len(sizes) < 2:
            raise InvalidInput(
                "feet-missing", f"An imitation needs two soles, left_foot and right_foot, of {robot.name}."
            )
        data = robot.model.createData()
        pin.forwardKinematics(robot.model, data, robot.q_reference)
        hip_m = float(np.mean([data.oMi[joint].translation[2] for joint in _hip_joints(robot)]))
        soles_m = sizes[0][1] + sizes[1][1]
        return cls(robot.name, hip_m, max(soles_m + SOLES_GAP_SHARE * hip_m, 2.0 * foot_places_m(robot)))


def _hip_joints(robot: Robot) -> list[int]:
    """The first joints of both legs after the last joint that they share."""
    model = robot.model
    chains = []
    for side in ("left", "right"):
        joint = model.frames[model.getFrameId(robot.effectors[f"{side}_foot"].frame)].parentJoint
        chains.append(list(model.supports[joint]))
    shared = set(chains[0]) & set(chains[1])
    return [joint for chain in chains for joint in [j for j in chain if j not in shared][:LEG_JOINTS]]


@dataclass(frozen=True)
class RobotWalk:
    """Footholds and times of the robot at pace 1; arrays as in ``RecordedWalk``.

    ``length_scale`` and ``time_scale`` are the ratios robot over person, without ``step_share``, by which all steps are
    shortened further. ``widened_m`` is the mean distance by which a step became wider than the scaled one. The last
    ``repeated`` footholds are not recorded.
    """

    robot: str
    footholds: tuple[Foothold, ...]
    swing_s: Float[np.ndarray, "n"]
    double_support_s: Float[np.ndarray, "n"]
    length_scale: float
    time_scale: float
    step_share: float
    widened_m: float
    step_width_min_m: float
    repeated: int

    def scenario(self, name: str, pace: float) -> dict[str, Any]:
        """The scenario (``schemas.scenarios.Scenario`` as a mapping) with all times divided by ``pace``."""
        walk = self.footholds
        standing: Contacts = {}
        for hold in (_beside(walk[0], self.step_width_min_m), walk[0]):
            standing[_effector(hold)] = _contact(hold)
        phases = [phase(ENDS_S, standing)]
        closing = _beside(walk[-1], self.step_width_min_m)
        for k, hold in enumerate([*walk[1:], closing], 1):
            timed = min(k, len(walk) - 1)
            moving = _effector(hold)
            swing_s, support_s = float(self.swing_s[timed]) / pace, float(self.double_support_s[timed]) / pace
            phases.append(phase(round(swing_s, 4), {n: c for n, c in standing.items() if n != moving}))
            standing[moving] = _contact(hold)
            phases.append(phase(round(support_s, 4), standing))
        phases[-1]["duration_s"] = ENDS_S
        places = np.array([hold.position_m for hold in walk])
        low, high = places.min(axis=0) - MARGIN_M, places.max(axis=0) + MARGIN_M
        floor = box("floor", (low[0], high[0]), (low[1], high[1]), (-0.2, 0.0))
        scale = self.step_share * self.length_scale
        text = f"A person's steps, scaled to {self.robot} by {scale:.2f}, at {pace:.2f} of the scaled pace."
        return scenario(name, text, self.robot, [floor], phases)


def scale_walk(recorded: RecordedWalk, robot: RobotScale, *, step_share: float = 1.0) -> RobotWalk:
    """The walk of a person for a robot; its first foothold lies at x = 0, its middle line is the x axis.

    ``step_share`` shortens all steps beyond the scale of the legs; it does not change the times.
    """
    walk = _with_more_strides(recorded, LEAST_FOOTHOLDS)
    ratio = robot.hip_height_m / walk.hip_height_m
    signs = np.array([_sign(hold.side) for hold in walk.footholds])
    turn, origin_m = straightening_frame(walk.footholds)
    places = ratio * (np.array([hold.position_m for hold in walk.footholds]) @ _turned_back(turn).T - origin_m)
    aside = signs * places[:, 1]
    wide = np.maximum(aside, 0.5 * robot.step_width_min_m)
    holds = tuple(
        Foothold(hold.side, np.array([step_share * x, sign * y]), _limited_yaw(hold.side, hold.yaw_rad - turn))
        for hold, x, sign, y in zip(walk.footholds, places[:, 0], signs, wide, strict=True)
    )
    return RobotWalk(
        robot=robot.robot,
        footholds=holds,
        swing_s=sqrt(ratio) * walk.swing_s,
        double_support_s=sqrt(ratio) * walk.double_support_s,
        length_scale=ratio,
        time_scale=sqrt(ratio),
        step_share=step_share,
        widened_m=float(np.mean(_widths(wide) - _widths(aside))),
        step_width_min_m=robot.step_width_min_m,
        repeated=len(walk.footholds) - len(recorded.footholds),
    )


def _with_more_strides(walk: RecordedWalk, least: int) -> RecordedWalk:
    """The walk with its last stride repeated until it has ``least`` footholds."""
    holds, swings, supports = list(walk.footholds), walk.swing_s.tolist(), walk.double_support_s.tolist()
    stride_m = holds[-1].position_m - holds[-3].position_m
    while len(holds) < least:
        before = holds[-2]
        holds.append(replace(before, position_m=before.position_m + stride_m))
        swings.append(swings[-2])
        supports.append(supports[-2])
    strikes_s = np.concatenate([walk.strikes_s, np.full(len(holds) - len(walk.strikes_s), np.nan)])
    return replace(
        walk,
        footholds=tuple(holds),
        swing_s=np.array(swings),
        double_support_s=np.array(supports),
        strikes_s=strikes_s,
    )


def _direction_rad(places: Float[np.ndarray, "n 2"], signs: Float[np.ndarray, "n"]) -> float:
    """Direction of the middle line of the steps: b of the least squares ``y = a + b x + w/2 sign``."""
    rows = np.column_stack([np.ones(len(signs)), places[:, 0], signs])
    return float(np.arctan(np.linalg.lstsq(rows, places[:, 1], rcond=None)[0][1]))


def straightening_frame(footholds: Sequence[Foothold]) -> tuple[float, Float[np.ndarray, "2"]]:
    """Angle by which a walk is turned back so that its middle line becomes the x axis, and its origin (after that)."""
    places = np.array([hold.position_m for hold in footholds])
    signs = np.array([_sign(hold.side) for hold in footholds])
    turn = _direction_rad(places, signs)
    turned = places @ _turned_back(turn).T
    rows = np.column_stack([np.ones(len(signs)), signs])
    middle = np.linalg.lstsq(rows, turned[:, 1], rcond=None)[0][0]
    return turn, np.array([turned[0, 0], middle])


def _turned_back(angle_rad: float) -> Float[np.ndarray, "2 2"]:
    return np.array([[cos(angle_rad), sin(angle_rad)], [-sin(angle_rad), cos(angle_rad)]])


def _widths(aside_m: Float[np.ndarray, "n"]) -> Float[np.ndarray, "m"]:
    return np.asarray(aside_m[1:] + aside_m[:-1])


def _limited_yaw(side: Side, yaw_rad: float) -> float:
    outwards = _sign(side) * yaw_rad
    return _sign(side) * float(np.clip(outwards, *TOE_OUT_RAD))


def _beside(hold: Foothold, width_m: float) -> Foothold:
    """The foothold of the other foot beside ``hold``, as far from the middle line, at least ``width_m`` away."""
    x, y = hold.position_m
    sign = _sign(hold.side)
    other: Side = "right" if hold.side == "left" else "left"
    return Foothold(other, np.array([x, -sign * max(sign * y, 0.5 * width_m)]), -hold.yaw_rad)


def _contact(hold: Foothold) -> dict[str, Any]:
    half = 0.5 * hold.yaw_rad
    x, y = (float(value) for value in hold.position_m)
    return contact(_effector(hold), (x, y, 0.0), (cos(half), 0.0, 0.0, sin(half)))


def _effector(hold: Foothold) -> str:
    return f"{hold.side}_foot"


def _sign(side: Side) -> float:
    return 1.0 if side == "left" else -1.0


def mean_speed_m_s(scenario_phases: Sequence[dict[str, Any]]) -> float:
    """Distance of the feet over the time between the two rests."""
    moving_s = sum(one["duration_s"] for one in scenario_phases[1:-1])
    ahead = [np.mean([c["position_m"][0] for c in scenario_phases[i]["contacts"]]) for i in (0, -1)]
    return float((ahead[1] - ahead[0]) / moving_s)
