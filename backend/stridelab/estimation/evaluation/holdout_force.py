"""Cross-validation with withheld force: an estimator uses half of the force samples and predicts the other half.

A small residual against the fused force does not prove accuracy. Here the window is cut into blocks; a first pass
withholds every other block of the force, a second pass the others. The result is the residual ``m (c'' - g) - f`` at
the withheld samples, in an 8 Hz band.

The Kalman filter, the RTS smoother and ``Smoother`` skip the measurements of force and moment there
(``WrenchTrack.withheld``). The complementary filter needs gap-free signals: it uses the substitution of 2.6.2,
``p = g`` and ``a = g''``. No estimator has access to the withheld force.

In the withheld blocks only the geometry is measured, so no estimator can be much better than the geometry; one that is
worse has fitted noise, or gives the geometry too little weight.
"""

from dataclasses import replace

import numpy as np
from jaxtyping import Float

from stridelab.body.geometric_com import GeometricCom
from stridelab.conventions import Mask
from stridelab.dynamics.wrench import contact_force
from stridelab.estimation.differentiation import smoothed_derivatives, walk_frame, window_span
from stridelab.estimation.estimator import ComEstimator
from stridelab.estimation.evaluation.physics_residuals import force_residual_track_n
from stridelab.recordings.recording import WrenchTrack

BLOCK_S = 0.15
"""Twice the correlation length of a signal in the 8 Hz band."""


def withheld_residual_n(
    estimator: ComEstimator, geometric: GeometricCom, wrench: WrenchTrack, mass_kg: float
) -> Float[np.ndarray, "3"]:
    """RMS of the residual at the withheld samples along the walk, lateral and vertical, in newtons.

    Raises as the estimator does.
    """
    span = window_span(geometric, wrench)
    velocity, acceleration = smoothed_derivatives(geometric.com_m[span.around], span.rate_hz)
    stand_in_n = contact_force(acceleration[span.within], mass_kg)
    block = np.arange(span.inside.stop - span.inside.start) // max(1, round(BLOCK_S * span.rate_hz)) % 2 == 1
    squares = []
    for held in (block, ~block):
        thinned = _withhold_samples(geometric, wrench, span.inside, held, stand_in_n)
        estimate = estimator.estimate(geometric, thinned, mass_kg)
        squares.append(force_residual_track_n(estimate, wrench, mass_kg)[held] @ walk_frame(velocity).T)
    return np.asarray(np.sqrt(np.nanmean(np.concatenate(squares) ** 2, axis=0)))


def _withhold_samples(
    geometric: GeometricCom,
    wrench: WrenchTrack,
    inside: slice,
    held: Mask,
    stand_in_n: Float[np.ndarray, "n 3"],
) -> WrenchTrack:
    force, moment = wrench.force_n.copy(), wrench.moment_nm.copy()
    at = np.arange(inside.start, inside.stop)[held]
    force[at] = stand_in_n[held]
    moment[at] = np.cross(geometric.com_m[at], force[at])
    withheld = np.zeros(len(wrench.time_s), dtype=np.bool_)
    withheld[at] = True
    return replace(wrench, force_n=force, moment_nm=moment, withheld=withheld)
