"""Foot placement model: the lateral position of the next foot from the state of the CoM (Wang and Srinivasan 2014).

    y_foot - y_com = b_0 + b_1 y + b_2 v_y

with y and v_y the lateral position, relative to the standing foot, and velocity of the CoM in the middle of the swing
before the step; signs are mirrored so that both sides pool. The residual is the part of the placement that the state
of the CoM does not explain.
"""

from collections.abc import Sequence
from typing import Final

import numpy as np

from stridelab.measures.measure import Measure
from stridelab.measures.walk_motion import LEFT, OTHER_SIDE, WalkMotion
from stridelab.walking.steps import GaitStep

LEAST_STEPS: Final = 12
"""Number of steps below which a regression on two variables is not reported."""


def foot_placement(motions: Sequence[tuple[WalkMotion, Sequence[GaitStep]]]) -> list[Measure]:
    """``foot_placement_gain_{position,velocity}``, ``foot_placement_residual`` and ``.._explained`` over all steps.

    Empty with fewer than ``LEAST_STEPS`` steps. Gains are the coefficients ``b_1`` (without unit) and ``b_2`` (in s).
    """
    rows = [row for motion, steps in motions for step in steps if (row := _row(motion, step)) is not None]
    if len(rows) < LEAST_STEPS:
        return []
    table = np.array(rows)
    predictors = np.column_stack([np.ones(len(table)), table[:, :2]])
    placed = table[:, 2]
    solution, _, rank, _ = np.linalg.lstsq(predictors, placed, rcond=None)
    if rank < predictors.shape[1]:
        return []
    residual = placed - predictors @ solution
    variance = float(residual @ residual) / (len(table) - predictors.shape[1])
    sd = np.sqrt(variance * np.diag(np.linalg.inv(predictors.T @ predictors)))
    explained = 1.0 - float(residual @ residual) / float(((placed - placed.mean()) ** 2).sum())
    spread_sd = float(np.sqrt(variance / (2 * (len(table) - predictors.shape[1]))))
    return [
        Measure("foot_placement_gain_position", float(solution[1]), float(sd[1]), "1"),
        Measure("foot_placement_gain_velocity", float(solution[2]), float(sd[2]), "s"),
        Measure("foot_placement_residual", float(np.sqrt(variance)), spread_sd, "m"),
        Measure("foot_placement_explained", explained, None, "1"),
    ]


def _row(motion: WalkMotion, step: GaitStep) -> tuple[float, float, float] | None:
    middle_s = 0.5 * (step.lift_off_s + step.strike_s)
    if OTHER_SIDE[step.side] not in motion.feet or not motion.covers(step.lift_off_s, step.strike_s):
        return None
    outwards = 1.0 if step.side == "left" else -1.0
    standing = motion.interpolate_track(motion.feet[OTHER_SIDE[step.side]].heel_m, step.lift_off_s)[LEFT]
    com, velocity = (
        motion.interpolate_track(motion.com_m, middle_s)[LEFT],
        motion.interpolate_track(motion.velocity_m_s, middle_s)[LEFT],
    )
    placed = motion.interpolate_track(motion.feet[step.side].heel_m, step.strike_s)[LEFT]
    row = (outwards * (com - standing), outwards * velocity, outwards * (placed - com))
    return (float(row[0]), float(row[1]), float(row[2])) if np.isfinite(row).all() else None
