"""Distribution of the contact wrench between the two feet.

Each foot carries a force at its centre of pressure and a free moment about the vertical:

    f_i = share_i f_z (t_i + r),   p_i = planned p_i + e,   tau_i = share_i tau

``share_i`` is the planned share of the vertical force, so both feet push and the load passes smoothly. ``t_i`` points
from the foot's centre of pressure towards the centre of mass, ``0.4 (c - p_i) / c_z``, like the force of a leg: the
trailing foot pushes and the leading one brakes. The remainder ``r``, the error ``e`` of the centre of pressure
(distance between the zero-moment points of the exact motion and of the plan; millimetres) and the free moment ``tau``
follow from the condition that the sum is the exact wrench. In flight both wrenches are zero.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np
from jaxtyping import Float

from stridelab.conventions import Points, Series
from stridelab.recordings.recording import Side
from stridelab.simulation.ground_truth import TrueMotion
from stridelab.simulation.human.body_proportions import SIDES
from stridelab.simulation.human.load_transfer import LoadPlan, Plane

_FORCE_LEAN: Final = 0.4
_FLIGHT_N: Final = 1.0
"""Vertical force below which the subject is in flight."""
PlanSeries = Float[np.ndarray, "m"]
PlanPlane = Float[np.ndarray, "m 2"]
"""One value, or one point on the ground, per instant of the plan."""


@dataclass(frozen=True)
class FootWrench:
    """Force on the body at the centre of pressure (on z = 0), and the free moment about the vertical there."""

    force_n: Points
    cop_m: Points
    free_moment_nm: Series

    @property
    def moment_nm(self) -> Points:
        """Moment at the world origin."""
        moment = np.cross(self.cop_m, self.force_n)
        moment[:, 2] += self.free_moment_nm
        return moment


def share_wrench(truth: TrueMotion, load: LoadPlan, plan_time_s: Series) -> Mapping[Side, FootWrench]:
    """Wrench of each foot at the instants of ``truth``; ``plan_time_s`` are the instants of ``load``."""
    t, c = truth.time_s, truth.com_m
    grounded = truth.force_n[:, 2:] > _FLIGHT_N
    f, moment = np.where(grounded, truth.force_n, 0.0), np.where(grounded, truth.moment_nm, 0.0)
    f_z = np.where(grounded, f[:, 2:], 1.0)
    share = {side: np.interp(t, plan_time_s, load.share[side]) for side in SIDES}
    cop: dict[Side, Plane] = {side: _interpolate_plane(t, plan_time_s, load.cop_m[side]) for side in SIDES}
    zmp = np.column_stack([-moment[:, 1], moment[:, 0]]) / f_z
    mean_cop = sum((share[side][:, None] * cop[side] for side in SIDES), np.zeros_like(zmp))
    error = np.where(grounded, zmp - mean_cop, 0.0)
    loaded = {side: np.column_stack([cop[side] + error, np.zeros(len(t))]) for side in SIDES}
    towards = {side: _FORCE_LEAN * (c[:, :2] - loaded[side][:, :2]) / c[:, 2:] for side in SIDES}
    mean = sum((share[side][:, None] * towards[side] for side in SIDES), np.zeros_like(zmp))
    rest = f[:, :2] / f_z - mean
    force = {
        side: (share[side] * f[:, 2])[:, None] * np.column_stack([towards[side] + rest, np.ones(len(t))])
        for side in SIDES
    }
    free = moment[:, 2] - sum((np.cross(loaded[side], force[side])[:, 2] for side in SIDES), np.zeros(len(t)))
    return {side: FootWrench(force[side], loaded[side], share[side] * free) for side in SIDES}


def _interpolate_plane(t: Series, plan_time_s: PlanSeries, track: PlanPlane) -> Plane:
    return np.column_stack([np.interp(t, plan_time_s, track[:, axis]) for axis in range(2)])
