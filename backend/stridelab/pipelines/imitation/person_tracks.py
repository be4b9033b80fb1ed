"""The recorded person in the scene and on the clock of the robot that imitates the walk.

The body is scaled by the ratio s of the heights of the hips; its way ahead, that of the CoM, by the share of the steps
in addition, and so is its way up or down stairs. Times are those of the person times ``sqrt(s) / pace``, with the mean
offset of the strikes.
"""

from collections.abc import Mapping, Sequence
from math import cos, sin
from typing import Any, Final

import numpy as np
from jaxtyping import Float

from stridelab.conventions import Points, Series
from stridelab.measures.walk_motion import AHEAD, UP, WalkMotion
from stridelab.pipelines.gait_measures.recording import MeasuredRecording
from stridelab.pipelines.imitation.recorded_walk import RecordedWalk
from stridelab.pipelines.imitation.robot_walk import RobotWalk, straightening_frame

COM: Final = "com"
HEEL, BALL, TIP = slice(0, 2), slice(2, 4), 4


def person_columns(
    measured: MeasuredRecording,
    recorded: RecordedWalk,
    walk: RobotWalk,
    pace: float,
    phases: Sequence[Mapping[str, Any]],
) -> dict[str, np.ndarray]:
    """Table of the person's points: ``time_s`` of the plan, and per point ``<name>_x_m``, ``_y_m``, ``_z_m``.

    Points are ``com``, the joint centres that are known (``l_knee``), and ``heel``, ``ball`` and ``toe`` of both feet;
    rows before the start and after the end of the plan are left out. Empty if no strike of the walk is recorded.
    """
    motion, geometric = measured.motion, measured.prepared.geometric
    points = {COM: motion.com_m}
    for side, foot in motion.feet.items():
        ends = {"heel": HEEL, "ball": BALL, "toe": slice(TIP, TIP + 1)}
        points |= {f"{side[0]}_{name}": foot.outline_m[:, part].mean(axis=1) for name, part in ends.items()}
    for name, track in geometric.joint_centres_m.items():
        points.setdefault(name, _in_walk(motion, geometric.time_s, track))
    return tracks_of_robot(motion.time_s, points, recorded, walk, pace, [float(one["duration_s"]) for one in phases])


def tracks_of_robot(
    time_s: Series,
    points: Mapping[str, Points],
    recorded: RecordedWalk,
    walk: RobotWalk,
    pace: float,
    durations_s: Sequence[float],
) -> dict[str, np.ndarray]:
    """``points`` in the axes of the walk, among them ``com``, in the scene and on the clock of the robot's plan."""
    ends_s = np.cumsum(durations_s)
    # foothold k > 0 is struck at the end of its swing, phase 2 k - 1
    struck = [k for k in range(1, len(recorded.strikes_s)) if np.isfinite(recorded.strikes_s[k])]
    if not struck:
        return {}
    rate = walk.time_scale / pace
    offset_s = float(np.mean([ends_s[2 * k - 1] - rate * recorded.strikes_s[k] for k in struck]))
    plan_s = rate * time_s + offset_s
    inside = (plan_s >= 0.0) & (plan_s <= ends_s[-1])
    turn_rad, origin_m = straightening_frame(recorded.footholds)
    R = np.array([[cos(turn_rad), sin(turn_rad), 0.0], [-sin(turn_rad), cos(turn_rad), 0.0], [0.0, 0.0, 1.0]])
    com_ahead_m = (points[COM] @ R.T)[:, AHEAD] - origin_m[AHEAD]
    floor_m = 0.0 if recorded.is_level else _median_floor_m(time_s, points[COM], recorded)
    com_up_m = 0.0 if recorded.is_level else points[COM][:, UP] - floor_m - recorded.com_height_m
    columns = {"time_s": plan_s[inside]}
    for name, track in points.items():
        placed = track @ R.T - [*origin_m, 0.0]
        placed[:, AHEAD] += (walk.step_share - 1.0) * com_ahead_m
        placed[:, UP] += (walk.step_share - 1.0) * com_up_m - floor_m
        columns |= {f"{name}_{axis}_m": walk.length_scale * placed[inside, k] for k, axis in enumerate("xyz")}
    return columns


def _median_floor_m(time_s: Series, com_m: Points, recorded: RecordedWalk) -> float:
    """Height of the lowest foothold: the CoM at the strikes is ``com_height_m`` above the mean of two footholds."""
    heights = [hold.height_m for hold in recorded.footholds]
    at_strikes = [
        np.interp(strike_s, time_s, com_m[:, UP]) - 0.5 * (heights[k - 1] + heights[k])
        for k, strike_s in enumerate(recorded.strikes_s)
        if k > 0 and np.isfinite(strike_s)
    ]
    return float(np.median(at_strikes)) - recorded.com_height_m


def _in_walk(motion: WalkMotion, time_s: Series, track: Points) -> Float[np.ndarray, "n 3"]:
    """A track of the world in the axes of the walk, at the instants of ``motion``."""
    known = np.isfinite(track).all(axis=1)
    if known.sum() < 2:
        return np.full((len(motion.time_s), 3), np.nan)
    moved = np.column_stack([np.interp(motion.time_s, time_s[known], column[known]) for column in track.T])
    shown = np.interp(motion.time_s, time_s, known.astype(float)) > 0.99
    return np.where(shown[:, None], (moved - motion.origin_m) @ motion.frame.T, np.nan)
