"""A recorded walk scaled to a robot: a scenario of steps between two stances, on level ground or on stairs.

With l the height of the hips above the floor, of the person as measured and of the robot in its reference posture,
lengths scale with ``s = l_robot / l_person`` and times with ``sqrt(s)``, so that at pace 1 both walk at the same Froude
number ``v^2 / (g l)`` (Hof 1996). Times are divided by the pace. Steps are at least as wide as the soles need.

The robot starts and ends at rest with its feet side by side, which few recordings show: it starts beside the first
foothold and closes its feet beside the last one.

Stairs are as wide as the floor; every tread holds the footholds of one height. Rises scale as lengths do, and treads
are at least as deep as the shoes need.
"""

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import cos, radians, sin, sqrt
from typing import Any, Final

import numpy as np
import pinocchio as pin
from jaxtyping import Float

from stridelab.contacts.scenarios.parts import Contacts, box, contact, phase, scenario
from stridelab.contacts.scenarios.robot_scenes import TREAD_MARGIN_M
from stridelab.contacts.scenarios.stairs import TOE_GAP_M
from stridelab.errors import InvalidInput
from stridelab.pipelines.commissioning.commission_robot import foot_places_m
from stridelab.pipelines.imitation.recorded_walk import Foothold, RecordedWalk, rises_of
from stridelab.recordings.recording import Side
from stridelab.robots.robot import Robot
from stridelab.wholebody.shoe_check import largest_shoe_m

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
TALOS_HIP_M: Final = 0.75
LEG_JOINTS: Final = 3
"""Joints of a hip, whose mean height is that of the hip."""


@dataclass(frozen=True)
class RobotScale:
    """Dimensions of a robot that scale a walk: height of the hips, least step width.

    ``toe_m`` and ``heel_m``: how far its shoes reach before and behind the middle of their soles.
    """

    robot: str
    hip_height_m: float
    step_width_min_m: float
    toe_m: float = 0.1
    heel_m: float = 0.1

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
        width_m = max(soles_m + SOLES_GAP_SHARE * hip_m, 2.0 * foot_places_m(robot))
        return cls(robot.name, hip_m, width_m, *largest_shoe_m(robot))

    @property
    def toe_gap_m(self) -> float:
        """Distance from a shoe to a riser: that of TALOS' stairs, by the height of the hips."""
        return TOE_GAP_M * self.hip_height_m / TALOS_HIP_M

    @property
    def tread_m(self) -> float:
        """Least depth of a tread between two others."""
        return self.toe_m + self.heel_m + self.toe_gap_m + TREAD_MARGIN_M


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
    """Footholds and times of the robot at pace 1; arrays as in ``RecordedWalk``. ``scale`` is that of the robot.

    ``length_scale`` and ``time_scale`` are the ratios robot over person, without ``step_share``, by which all steps are
    shortened further, rises too. ``widened_m`` is the mean distance by which a step became wider than the scaled one,
    ``deepened_m`` that by which the steps from tread to tread became longer. The last ``repeated`` footholds are not
    recorded.
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
    scale: RobotScale
    deepened_m: float = 0.0

    @property
    def rise_m(self) -> float:
        """Mean height from a tread to the next one, negative downwards; 0 on level ground."""
        rises = [rise for rise in rises_of(self.footholds) if rise != 0.0]
        return float(np.mean(rises)) if rises else 0.0

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
        low, high = (places.min(axis=0) - MARGIN_M).tolist(), (places.max(axis=0) + MARGIN_M).tolist()
        edges = [low[0], *self._riser_places_m(), high[0]]
        heights = [walk[0].height_m, *(b.height_m for a, b in itertools.pairwise(walk) if b.height_m != a.height_m)]
        names = ["floor"] if len(heights) == 1 else [f"tread {k}" for k in range(1, len(heights) + 1)]
        treads = [
            box(name, (start, end), (low[1], high[1]), (-0.2, height))
            for name, start, end, height in zip(names, edges, edges[1:], heights, strict=False)
        ]
        scale = self.step_share * self.length_scale
        text = f"A person's steps, scaled to {self.robot} by {scale:.2f}, at {pace:.2f} of the scaled pace."
        return scenario(name, text, self.robot, treads, phases)

    def _riser_places_m(self) -> list[float]:
        """Where the height changes: ``toe_gap_m`` from the nearer shoe, and half of what is left from it."""
        toe_m, heel_m, gap_m = self.scale.toe_m, self.scale.heel_m, self.scale.toe_gap_m
        places = []
        for one, other in itertools.pairwise(self.footholds):
            if other.height_m != one.height_m:
                free = (one.position_m[0] + toe_m, other.position_m[0] - heel_m)
                share = 0.5 * (free[1] - free[0] - gap_m)
                places.append(float(free[0] + gap_m + share if other.height_m > one.height_m else free[0] + share))
        return places


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
    heights_m = step_share * ratio * np.array([hold.height_m for hold in walk.footholds])
    ahead_m = _deep_enough(step_share * places[:, 0], heights_m, robot.tread_m)
    holds = tuple(
        Foothold(hold.side, np.array([x, sign * y]), _limited_yaw(hold.side, hold.yaw_rad - turn), float(z))
        for hold, x, sign, y, z in zip(walk.footholds, ahead_m, signs, wide, heights_m, strict=True)
    )
    stairs = np.diff(heights_m) != 0.0
    deepened = np.diff(ahead_m) - step_share * np.diff(places[:, 0])
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
        scale=robot,
        deepened_m=float(deepened[stairs].mean()) if stairs.any() else 0.0,
    )


def _deep_enough(
    ahead_m: Float[np.ndarray, "n"], heights_m: Float[np.ndarray, "n"], tread_m: float
) -> Float[np.ndarray, "n"]:
    """Places ahead, those on different treads at least ``tread_m`` apart."""
    steps_m = np.diff(ahead_m)
    longer_m = np.where(np.diff(heights_m) != 0.0, np.maximum(steps_m, tread_m), steps_m)
    return np.asarray(ahead_m[0] + np.concatenate([[0.0], np.cumsum(longer_m)]))


def _with_more_strides(walk: RecordedWalk, least: int) -> RecordedWalk:
    """The walk with its last stride repeated until it has ``least`` footholds."""
    holds, swings, supports = list(walk.footholds), walk.swing_s.tolist(), walk.double_support_s.tolist()
    stride_m = holds[-1].position_m - holds[-3].position_m
    rise_m = holds[-1].height_m - holds[-3].height_m
    while len(holds) < least:
        before = holds[-2]
        place_m = before.position_m + stride_m
        holds.append(replace(before, position_m=place_m, height_m=before.height_m + rise_m))
        swings.append(swings[-2])
        supports.append(supports[-2])
    lowest_m = min(hold.height_m for hold in holds)
    holds = [replace(hold, height_m=hold.height_m - lowest_m) for hold in holds]
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
    return Foothold(other, np.array([x, -sign * max(sign * y, 0.5 * width_m)]), -hold.yaw_rad, hold.height_m)


def _contact(hold: Foothold) -> dict[str, Any]:
    half = 0.5 * hold.yaw_rad
    x, y = (float(value) for value in hold.position_m)
    return contact(_effector(hold), (x, y, hold.height_m), (cos(half), 0.0, 0.0, sin(half)))


def _effector(hold: Foothold) -> str:
    return f"{hold.side}_foot"


def _sign(side: Side) -> float:
    return 1.0 if side == "left" else -1.0


def mean_speed_m_s(scenario_phases: Sequence[dict[str, Any]]) -> float:
    """Distance of the feet over the time between the two rests."""
    moving_s = sum(one["duration_s"] for one in scenario_phases[1:-1])
    ahead = [np.mean([c["position_m"][0] for c in scenario_phases[i]["contacts"]]) for i in (0, -1)]
    return float((ahead[1] - ahead[0]) / moving_s)
