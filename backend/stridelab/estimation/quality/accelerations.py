"""Compares the force predicted from the markers alone with that of the plates: m (g'' - gravity) - f without fusion.

A fused estimate follows the force, and a smoother with learned noise levels may attribute a reversed force channel to
marker noise. The geometric centre of mass does not depend on the force, so its acceleration validates it per axis.
"""

from typing import Final

import numpy as np

from stridelab.body.geometric_com import GeometricCom
from stridelab.conventions import GRAVITY_M_S2
from stridelab.dynamics.newton_euler import contact_force
from stridelab.estimation.differentiation import low_pass, smoothed_derivatives
from stridelab.estimation.evaluation.physics_residuals import MOMENTUM_BAND_HZ
from stridelab.estimation.walk_frame import walk_frame
from stridelab.recordings.gap_filling import true_runs
from stridelab.recordings.recording import WrenchTrack

AXES: Final = ("along the walk", "across the walk", "vertically")
EDGE: Final = 0.6
"""Periods of the band that are excluded at either end because of filter transients."""
_MIN_SAMPLES = 10


def acceleration_difference(geometric: GeometricCom, wrench: WrenchTrack, mass_kg: float) -> tuple[str, float] | None:
    """The axis on which markers and force differ most, and the standard deviation of that difference over the weight.

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
    apart = (contact_force(acceleration, mass_kg) - force_n)[edge:-edge] @ walk_frame(velocity).T
    share = apart.std(axis=0) / (mass_kg * GRAVITY_M_S2)
    worst = int(np.argmax(share))
    return AXES[worst], float(share[worst])
