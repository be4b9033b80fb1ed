"""How well an estimate agrees with the force, and how far it is from the geometry."""

import numpy as np

from stridelab.body.geometric_com import GeometricCom
from stridelab.conventions import Points, Vector3
from stridelab.dynamics.newton_euler import contact_force
from stridelab.estimation.derivatives import BAND_HZ, derivatives, low_pass
from stridelab.estimation.estimate import ComEstimate
from stridelab.recordings.recording import WrenchTrack


def force_residual_n(estimate: ComEstimate, wrench: WrenchTrack, mass_kg: float, band_hz: float = BAND_HZ) -> Vector3:
    """RMS of ``m (c'' - g) - f`` per axis over the window, both sides low-passed to ``band_hz`` (zero phase).

    c'' is the second derivative of the estimated *position*. The first and last ``0.6 / band_hz`` seconds, where the
    filters see beyond the window, do not count. A small residual is consistency, not proof: an estimator that
    integrates the force agrees with it by construction.
    """
    r = force_residual_track_n(estimate, wrench, mass_kg, band_hz)
    return np.asarray(np.sqrt(np.nanmean(r**2, axis=0)))


def force_residual_track_n(
    estimate: ComEstimate, wrench: WrenchTrack, mass_kg: float, band_hz: float = BAND_HZ
) -> Points:
    """``m (c'' - g) - f`` at the estimate's samples, as ``force_residual_n`` takes it; NaN near the ends."""
    rate_hz = (len(estimate.time_s) - 1) / (estimate.time_s[-1] - estimate.time_s[0])
    first = int(np.argmin(np.abs(wrench.time_s - estimate.time_s[0])))
    f = low_pass(wrench.force_n[first : first + len(estimate.time_s)], rate_hz, band_hz)
    acceleration = derivatives(estimate.com_m, rate_hz, band_hz)[1]
    edge = int(np.ceil(0.6 * rate_hz / band_hz))
    r = contact_force(acceleration, mass_kg) - f
    r[:edge] = r[-edge:] = np.nan
    return np.asarray(r)


def bias_m(estimate: ComEstimate, geometric: GeometricCom) -> Vector3:
    """Estimate minus geometry, mean over the window, per axis: what the force changed in the table's CoM."""
    first = int(np.argmin(np.abs(geometric.time_s - estimate.time_s[0])))
    g = geometric.com_m[first : first + len(estimate.time_s)]
    return np.asarray(np.mean(estimate.com_m - g, axis=0))
