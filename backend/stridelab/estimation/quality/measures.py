"""Computes the values that the checks of a recording compare with their limits."""

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from stridelab.body.geometric_com import GeometricCom
from stridelab.conventions import GRAVITY_M_S2, Mask
from stridelab.estimation.estimator import ComEstimate
from stridelab.estimation.evaluation.physics_residuals import force_residual_track_n
from stridelab.estimation.quality.accelerations import acceleration_difference
from stridelab.estimation.quality.body_hull import distance_outside_m
from stridelab.estimation.quality.body_weight import dynamic_mass_kg
from stridelab.estimation.quality.limb_lengths import length_change
from stridelab.estimation.quality.pressure import PlatePressure, plate_pressures
from stridelab.recordings.gap_filling import true_runs
from stridelab.recordings.recording import Recording, WrenchTrack

NAN = math.nan


@dataclass(frozen=True)
class Recorded:
    """Inputs of an estimate.

    ``with_force`` is False if the wrench is a placeholder without force. ``standing_mass_kg`` is the mass measured by
    the plates in the static trial of the same subject, None without one. ``stated_mass_kg`` is the mass given by the
    user or the file, which may differ from the mass in use.
    """

    recording: Recording
    landmarks: Mapping[str, str]
    geometric: GeometricCom
    wrench: WrenchTrack
    mass_kg: float
    with_force: bool = True
    standing_mass_kg: float | None = None
    stated_mass_kg: float | None = None

    @property
    def mass_to_check_kg(self) -> float:
        """Mass to compare with the plates: the stated one, since the mass in use may come from the plates."""
        return self.mass_kg if self.stated_mass_kg is None else self.stated_mass_kg


@dataclass(frozen=True)
class Measures:
    """One value per check; NaN if it cannot be computed.

    ``axis`` is that of ``acceleration_difference``, ``leg`` the segment of ``leg_length_change``.
    """

    normalised_innovations: float = NAN
    force_residual: float = NAN
    acceleration_difference: float = NAN
    axis: str = ""
    horizontal_bias_m: float = NAN
    vertical_bias_m: float = NAN
    outside_body_m: float = NAN
    motion_mass_kg: float = NAN
    standing_mass_kg: float = NAN
    leg_length_change: float = NAN
    leg: str = ""
    plates: tuple[PlatePressure, ...] = ()


def compute_measures(recorded: Recorded, estimate: ComEstimate) -> Measures:
    """Compute the values of one estimate; those that need force are NaN if no force was used."""
    geometric, wrench = recorded.geometric, recorded.wrench
    first = int(np.argmin(np.abs(geometric.time_s - estimate.time_s[0])))
    used = slice(first, first + len(estimate.time_s))
    outside_m = distance_outside_m(estimate.com_m, _body_points(recorded, used))
    leg = length_change({name: track[used] for name, track in geometric.joint_centres_m.items()})
    common = Measures(
        outside_body_m=float(np.nanpercentile(outside_m, 95.0)) if np.isfinite(outside_m).any() else NAN,
        leg_length_change=NAN if leg is None else leg[1],
        leg="" if leg is None else leg[0],
    )
    if not recorded.with_force:
        return common
    complete = wrench.complete[used]
    offset_m = (estimate.com_m - geometric.com_m[used])[complete]
    apart = acceleration_difference(geometric, wrench, recorded.mass_kg)
    horizontal_m, vertical_m = NAN, NAN
    if np.isfinite(offset_m).all(axis=1).any():
        x, y, z = np.nanmean(offset_m, axis=0)
        horizontal_m, vertical_m = float(np.hypot(x, y)), float(abs(z))
    return Measures(
        normalised_innovations=estimate.diagnostics.get("normalised_innovations", NAN),
        force_residual=_relative_force_residual(recorded, estimate, complete),
        acceleration_difference=NAN if apart is None else apart[1],
        axis="" if apart is None else apart[0],
        horizontal_bias_m=horizontal_m,
        vertical_bias_m=vertical_m,
        outside_body_m=common.outside_body_m,
        motion_mass_kg=_motion_mass_kg(recorded),
        standing_mass_kg=NAN if recorded.standing_mass_kg is None else recorded.standing_mass_kg,
        leg_length_change=common.leg_length_change,
        leg=common.leg,
        plates=plate_pressures(recorded.recording, recorded.landmarks, wrench.complete, wrench.latency_applied_s),
    )


def _body_points(recorded: Recorded, used: slice) -> np.ndarray:
    """Landmark markers, joint centres and segments' centres of mass: frames x points x 3."""
    markers, geometric = recorded.recording.markers_m, recorded.geometric
    labels = dict.fromkeys(recorded.landmarks.values())
    tracks = [markers[label] for label in labels if label in markers]
    tracks += list(geometric.joint_centres_m.values())
    tracks += [segment.com_m for segment in geometric.segments.values()]
    if not tracks:
        return np.full((used.stop - used.start, 1, 3), np.nan)
    return np.stack(tracks, axis=1)[used]


def _relative_force_residual(recorded: Recorded, estimate: ComEstimate, complete: Mask) -> float:
    """RMS of the residual over the frames with all force, all axes together, over the body weight."""
    if len(estimate.time_s) < 20:
        return NAN
    r = force_residual_track_n(estimate, recorded.wrench, recorded.mass_kg)[complete]
    r = r[np.isfinite(r).all(axis=1)]
    if len(r) == 0:
        return NAN
    return float(np.sqrt(np.mean(np.sum(r**2, axis=1)))) / (recorded.mass_kg * GRAVITY_M_S2)


def _motion_mass_kg(recorded: Recorded) -> float:
    """Mass from force and motion over the longest stretch with both."""
    geometric, wrench = recorded.geometric, recorded.wrench
    known = wrench.complete & np.isfinite(geometric.com_m).all(axis=1) & np.isfinite(wrench.force_n).all(axis=1)
    if not known.any():
        return NAN
    i, j = max(true_runs(known), key=lambda run: run[1] - run[0])
    if j - i < 10:
        return NAN
    return dynamic_mass_kg(geometric.time_s[i:j], geometric.com_m[i:j, 2], wrench.force_n[i:j, 2])
