"""Cross-validation with withheld force: an estimator uses half of the force samples and predicts the other half.

A small residual against the fused force does not prove accuracy. Here the window is cut into blocks; a first pass
withholds every other block of the force, a second pass the others. The result is the residual ``m (c'' - g) - f`` at
the withheld samples, in an 8 Hz band.

The Kalman filter, the RTS smoother and ``Smoother`` skip the measurements of force and moment there
(``WrenchTrack.withheld``). The complementary filter needs gap-free signals: it uses the substitution of 2.6.2,
``p = g`` and ``a = g''``. No estimator has access to the withheld force.

The residual weighs an error at frequency w with w^4, and it is that of an estimator without force in the block. So it
does not order estimators by their true errors (docs/theory/judging-estimators.md; ``force_path`` does, over groups of
people); it shows how well a model bridges a gap in the force.
"""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from jaxtyping import Float

from stridelab.body.geometric_com import GeometricCom
from stridelab.conventions import Mask
from stridelab.dynamics.wrench import contact_force
from stridelab.estimation.differentiation import smoothed_derivatives, walk_frame, window_span
from stridelab.estimation.estimator import ComEstimate, ComEstimator
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
    velocity, _ = smoothed_derivatives(geometric.com_m[span.around], span.rate_hz)
    squares = [
        force_residual_track_n(estimate, wrench, mass_kg)[held] @ walk_frame(velocity).T
        for held, estimate in withheld_estimates(estimator, geometric, wrench, mass_kg, BLOCK_S)
    ]
    return np.asarray(np.sqrt(np.nanmean(np.concatenate(squares) ** 2, axis=0)))


def withheld_estimates(
    estimator: ComEstimator, geometric: GeometricCom, wrench: WrenchTrack, mass_kg: float, block_s: float
) -> Iterator[tuple[Mask, ComEstimate]]:
    """Yield the withheld samples of the window and the estimate without them: every other block, then the others.

    Raises as the estimator does.
    """
    span = window_span(geometric, wrench)
    block = np.arange(span.inside.stop - span.inside.start) // max(1, round(block_s * span.rate_hz)) % 2 == 1
    for held in (block, ~block):
        yield held, estimator.estimate(geometric, withhold_samples(geometric, wrench, mass_kg, held), mass_kg)


def withhold_samples(geometric: GeometricCom, wrench: WrenchTrack, mass_kg: float, held: Mask) -> WrenchTrack:
    """Mark samples of the window as withheld; their wrench becomes that of the geometry without angular momentum."""
    span = window_span(geometric, wrench)
    acceleration = smoothed_derivatives(geometric.com_m[span.around], span.rate_hz)[1][span.within]
    force, moment = wrench.force_n.copy(), wrench.moment_nm.copy()
    at = np.arange(span.inside.start, span.inside.stop)[held]
    force[at] = contact_force(acceleration[held], mass_kg)
    moment[at] = np.cross(geometric.com_m[at], force[at])
    withheld = np.zeros(len(wrench.time_s), dtype=np.bool_)
    withheld[at] = True
    return replace(wrench, force_n=force, moment_nm=moment, withheld=withheld)
