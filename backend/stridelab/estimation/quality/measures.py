"""Computes the values that the checks of a recording compare with their limits.

Compares the force predicted from the markers alone with that of the plates: m (g'' - gravity) - f without fusion.

A fused estimate follows the force, and a smoother with learned noise levels may attribute a reversed force channel to
marker noise. The geometric centre of mass does not depend on the force, so its acceleration validates it per axis.

Body mass from force and markers together, in any movement.

    m (c'' - g) = f   integrated twice:   z(t) + g t^2 / 2 = z_0 + v_0 t + (1/m) int int f_z

is linear in z_0, v_0 and 1/m, so least squares gives the mass of a subject who walks, jumps or stands up, without
periodicity. Over T seconds the column of 1/m differs from a straight line by 0.037 g T^2 RMS: 0.13 m in 0.6 s, compared
with millimetres of error in the height of the geometric centre of mass.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from jaxtyping import Float

from stridelab.body.geometric_com import GeometricCom
from stridelab.conventions import GRAVITY_M_S2, Mask, Series
from stridelab.dynamics.wrench import contact_force
from stridelab.estimation.differentiation import low_pass, smoothed_derivatives, walk_frame
from stridelab.estimation.estimator import ComEstimate
from stridelab.estimation.evaluation.physics_residuals import MOMENTUM_BAND_HZ, assess_flight, force_residual_track_n
from stridelab.estimation.quality.body_checks import (
    distance_outside_m,
    leg_mass_share,
    length_change,
    mean_body_axis,
    thigh_over_trunk,
)
from stridelab.estimation.quality.channel_gain import ChannelGain, channel_gains, exchange_ratio
from stridelab.estimation.quality.plate_checks import (
    PlatePressure,
    force_balance,
    has_no_trunk,
    plate_pressures,
    unmarked_shares,
)
from stridelab.recordings.clipped_force import clipped_share
from stridelab.recordings.gap_filling import true_runs
from stridelab.recordings.recording import Recording, WrenchTrack

AXES: Final = ("along the walk", "across the walk", "vertically")
EDGE: Final = 0.6
"""Periods of the band that are excluded at either end because of filter transients."""
_MIN_SAMPLES = 10
MIN_CONTRADICTING_SHARE: Final = 0.15
"""Standard deviation of the vertical force of a walk over the weight; half of it is that of the fore-aft force."""


@dataclass(frozen=True)
class AccelerationDifference:
    """Standard deviations on the named axis, over the weight: of the difference, and of the measured force itself.

    ``tilt`` is the mean of the horizontal difference over the weight: the sine of the angle between the vertical of
    the file and gravity; ``lean`` is this mean along x and y. NaN where less than ``MIN_TILT_S`` is compared.
    ``unmarked_share`` is that of ``unmarked_shares``, in runs.
    """

    axis: str
    share: float
    force_share: float
    unmarked_share: float
    tilt: float = math.nan
    lean: tuple[float, float] = (math.nan, math.nan)


MIN_TILT_S: Final = 0.8
"""Shortest time for the mean force: an error of 0.1 m/s in the velocity at either end is then 0.018 of the weight."""
EXPLAINED_SHARE: Final = 0.5
"""Difference over the variation of the force at which markers and force have lost half of their common signal."""


def contradicting_share(
    force_share: float | Float[np.ndarray, "3"], unmarked_share: float | Float[np.ndarray, "3"]
) -> Float[np.ndarray, "*axes"]:
    """Difference over the weight at which markers and force contradict each other.

    Half of the variation of the force, at least ``MIN_CONTRADICTING_SHARE``, and what an unmarked trunk may differ by.
    """
    own = np.maximum(EXPLAINED_SHARE * np.asarray(force_share), MIN_CONTRADICTING_SHARE)
    return np.asarray(np.hypot(own, unmarked_share))


def acceleration_difference(
    geometric: GeometricCom, wrench: WrenchTrack, mass_kg: float
) -> AccelerationDifference | None:
    """The axis on which markers and force differ most, and by how much: standard deviations over the weight.

    An axis on which they contradict each other comes before one on which they only differ more.

    Both are low-passed to 6 Hz. A constant difference is excluded: errors of the mass or of a plate's zero have other
    checks. The longest stretch with both signals is used; None if it is too short.
    """
    known = wrench.complete & np.isfinite(wrench.force_n).all(axis=1) & np.isfinite(geometric.com_m).all(axis=1)
    if not known.any():
        return None
    i, j = max(true_runs(known), key=lambda run: run[1] - run[0])
    rate_hz = (len(wrench.time_s) - 1) / (wrench.time_s[-1] - wrench.time_s[0])
    edge = int(np.ceil(EDGE * rate_hz / MOMENTUM_BAND_HZ))
    if j - i < 2 * edge + _MIN_SAMPLES:
        return None
    velocity, acceleration = smoothed_derivatives(geometric.com_m[i:j], rate_hz, MOMENTUM_BAND_HZ)
    force_n = low_pass(wrench.force_n[i:j], rate_hz, MOMENTUM_BAND_HZ)
    frame, weight_n = walk_frame(velocity - geometric.ground_m_s), mass_kg * GRAVITY_M_S2
    apart = (contact_force(acceleration, mass_kg) - force_n)[edge:-edge] @ frame.T
    share, force_share = apart.std(axis=0) / weight_n, (force_n[edge:-edge] @ frame.T).std(axis=0) / weight_n
    tilt, lean, unmarked = math.nan, (math.nan, math.nan), np.zeros(3)
    if len(apart) >= MIN_TILT_S * rate_hz:
        tilt = float(np.linalg.norm(apart[:, :2].mean(axis=0))) / weight_n
        x, y, _ = apart.mean(axis=0) @ frame / weight_n
        lean = (float(x), float(y))
    runs = EXPLAINED_SHARE * force_share[2] > MIN_CONTRADICTING_SHARE
    if runs and has_no_trunk(geometric) and "lumbar" in geometric.joint_centres_m:
        pelvis_m = geometric.joint_centres_m["lumbar"][i:j]
        unmarked = unmarked_shares(smoothed_derivatives(pelvis_m, rate_hz, MOMENTUM_BAND_HZ)[1][edge:-edge] @ frame.T)
    # the large vertical forces of a run allow more than a walk's, and must not hide an axis that contradicts
    contradicts = share > contradicting_share(force_share, unmarked)
    worst = int(np.argmax(np.where(contradicts, 1.0, 0.0) * share.max() + share))
    of_worst = float(share[worst]), float(force_share[worst]), float(unmarked[worst])
    return AccelerationDifference(AXES[worst], *of_worst, tilt, lean)


NAN = math.nan


@dataclass(frozen=True)
class Recorded:
    """Inputs of an estimate.

    ``with_force`` is False if the wrench is a placeholder without force. ``standing_mass_kg`` is the mass measured by
    the plates in the static trial of the same subject, None without one. ``stated_mass_kg`` is the mass given by the
    user or the file, which may differ from the mass in use; ``mass_sd_kg`` is the standard deviation of the latter if
    the plates measured it, else None. ``names_proposed``: no set and no user named the markers.
    """

    recording: Recording
    landmarks: Mapping[str, str]
    geometric: GeometricCom
    wrench: WrenchTrack
    mass_kg: float
    with_force: bool = True
    standing_mass_kg: float | None = None
    stated_mass_kg: float | None = None
    mass_sd_kg: float | None = None
    names_proposed: bool = False

    @property
    def mass_to_check_kg(self) -> float:
        """Mass to compare with the plates: the stated one, since the mass in use may come from the plates."""
        return self.mass_kg if self.stated_mass_kg is None else self.stated_mass_kg


@dataclass(frozen=True)
class Measures:
    """One value per check; NaN if it cannot be computed.

    ``lean_bias_m`` is the part of the horizontal bias that the mean horizontal force explains: without it, the force
    would act through a centre of mass that is so much nearer to the markers'.
    ``axis``, ``force_share`` and ``unmarked_share`` are those of ``acceleration_difference``, ``leg`` is the segment of
    ``leg_length_change``. ``model_leg_share`` is the share of the legs in a body model's mass,
    None without a model. ``body_angle_deg`` and ``upper_end`` are those of ``mean_body_axis``. ``clipped_share`` is the
    share of its loaded time at which ``clipped_plate`` is overloaded, the most of all plates; 0 if none is.
    """

    force_tilt: float = NAN
    normalised_innovations: float = NAN
    force_residual: float = NAN
    acceleration_difference: float = NAN
    axis: str = ""
    force_share: float = 0.0
    unmarked_share: float = 0.0
    horizontal_bias_m: float = NAN
    lean_bias_m: float = NAN
    vertical_bias_m: float = NAN
    largest_difference_m: float = NAN
    outside_body_m: float = NAN
    motion_mass_kg: float = NAN
    standing_mass_kg: float = NAN
    mass_uncertainty: float = NAN
    flight_acceleration: float = NAN
    leg_length_change: float = NAN
    leg: str = ""
    model_leg_share: float | None = None
    names_proposed: bool = False
    thigh_over_trunk: float = NAN
    body_angle_deg: float = NAN
    upper_end: str = ""
    plates: tuple[PlatePressure, ...] = ()
    gains: tuple[ChannelGain, ...] = ()
    exchange_ratio: float = NAN
    clipped_plate: int = 0
    clipped_share: float = 0.0


def compute_measures(recorded: Recorded, estimate: ComEstimate) -> Measures:
    """Compute the values of one estimate; those that need force are NaN if no force was used."""
    geometric, wrench = recorded.geometric, recorded.wrench
    first = int(np.argmin(np.abs(geometric.time_s - estimate.time_s[0])))
    used = slice(first, first + len(estimate.time_s))
    outside_m = distance_outside_m(estimate.com_m, _body_points(recorded, used))
    leg = length_change({name: track[used] for name, track in geometric.joint_centres_m.items()})
    angle_deg, upper_end = mean_body_axis(geometric, used)
    common = Measures(
        outside_body_m=float(np.nanpercentile(outside_m, 95.0)) if np.isfinite(outside_m).any() else NAN,
        leg_length_change=NAN if leg is None else leg[1],
        leg="" if leg is None else leg[0],
        model_leg_share=leg_mass_share(recorded.recording.segments),
        thigh_over_trunk=thigh_over_trunk(geometric, used),
        body_angle_deg=angle_deg,
        upper_end=upper_end,
        names_proposed=recorded.names_proposed,
    )
    if not recorded.with_force:
        return common
    complete = wrench.complete[used]
    offset_m = (estimate.com_m - geometric.com_m[used])[complete]
    apart = acceleration_difference(geometric, wrench, recorded.mass_kg)
    used_plates = [plate for plate in recorded.recording.plates if plate.use]
    shares = {plate.index: clipped_share(plate, recorded.recording.force_rate_hz) for plate in used_plates}
    clipped_plate = max(shares, key=lambda index: shares[index], default=0)
    balance = force_balance(recorded.recording, geometric, wrench, recorded.mass_kg)
    horizontal_m, vertical_m, largest_m, lean_m = NAN, NAN, NAN, NAN
    if np.isfinite(offset_m).all(axis=1).any():
        x, y, z = np.nanmean(offset_m, axis=0)
        horizontal_m, vertical_m = float(np.hypot(x, y)), float(abs(z))
        largest_m = float(np.nanmax(np.linalg.norm(offset_m, axis=1)))
        if apart is not None and horizontal_m > 0.0:
            height_m = float(np.nanmean(geometric.com_m[used][complete, 2]))
            lean_m = height_m * (apart.lean[0] * x + apart.lean[1] * y) / horizontal_m
    return replace(
        common,
        force_tilt=NAN if apart is None else apart.tilt,
        normalised_innovations=estimate.diagnostics.get("normalised_innovations", NAN),
        force_residual=_relative_force_residual(recorded, estimate, complete),
        acceleration_difference=NAN if apart is None else apart.share,
        axis="" if apart is None else apart.axis,
        force_share=0.0 if apart is None else apart.force_share,
        unmarked_share=0.0 if apart is None else apart.unmarked_share,
        horizontal_bias_m=horizontal_m,
        lean_bias_m=lean_m,
        vertical_bias_m=vertical_m,
        largest_difference_m=largest_m,
        motion_mass_kg=_motion_mass_kg(recorded),
        standing_mass_kg=NAN if recorded.standing_mass_kg is None else recorded.standing_mass_kg,
        mass_uncertainty=NAN if recorded.mass_sd_kg is None else recorded.mass_sd_kg / recorded.mass_kg,
        flight_acceleration=_flight_acceleration_error(recorded, estimate),
        plates=plate_pressures(recorded.recording, recorded.landmarks, wrench.complete, wrench.latency_applied_s),
        gains=channel_gains(balance),
        exchange_ratio=exchange_ratio(balance),
        clipped_plate=clipped_plate,
        clipped_share=shares.get(clipped_plate, 0.0),
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


def _flight_acceleration_error(recorded: Recorded, estimate: ComEstimate) -> float:
    """Deviation of the estimate's vertical acceleration from -g in flight, as a share of g.

    Flights lie where all force is measured and is zero; NaN without any.
    """
    wrench = recorded.wrench
    measured_n = np.where(wrench.complete[:, None], wrench.force_n, NAN)
    flight = assess_flight(estimate, replace(wrench, force_n=measured_n))
    return NAN if flight is None else abs(flight.vertical_share)


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


def dynamic_mass_kg(time_s: Series, height_m: Series, vertical_force_n: Series) -> float:
    """Mass for which the vertical force explains the height of the geometric centre of mass.

    All three are gap-free and of equal length. NaN if the fitted mass is not positive.
    """
    t = time_s - time_s[0]
    double = vertical_force_n
    for _ in range(2):
        double = np.append(0.0, np.cumsum(0.5 * np.diff(t) * (double[1:] + double[:-1])))
    A = np.column_stack([np.ones_like(t), t, double])
    per_mass = float(np.linalg.lstsq(A, height_m + 0.5 * GRAVITY_M_S2 * t**2, rcond=None)[0][2])
    return 1.0 / per_mass if per_mass > 0.0 else float("nan")
