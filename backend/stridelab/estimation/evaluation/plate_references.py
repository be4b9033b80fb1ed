"""Where plates measure their moments, from people who walk over them: errors of corners and of moment references.

With the angular momentum of the segments known up to a factor k, the moments of a walk over several plates show where
each plate's moments refer to. If they refer to a point o_i away from the one that the file states, what is read is

    nu = nu_true - sum_i o_i x f_i ,    int (nu - c x f) dt = L_0 + k L_segments + b int f_z dt - sum_i int o_i x f_i dt

for both horizontal axes; b is the constant error of the segment table. An offset that all plates share horizontally has
the effect of b, so the horizontal offsets are relative to their mean. The height is common to all plates; the table's
error of the height, 20 mm, has the same effect, so only a larger one is an error of the plates.

Every recording gives normal equations without its own unknowns (L_0, k, b). They are summed over people, and the
standard deviation is a bootstrap over people: two plates that are wrong are wrong for everybody, in the axes of the
laboratory, whichever way people walk.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from jaxtyping import Float
from scipy.integrate import cumulative_trapezoid

from stridelab.body.geometric_com import GeometricCom
from stridelab.conventions import GRAVITY_M_S2
from stridelab.dynamics.wrench import Wrench, momentum_rate
from stridelab.estimation.differentiation import window_span
from stridelab.estimation.evaluation.force_path import momentum_of_segments_nms
from stridelab.recordings.recording import WrenchTrack

FEWEST_PEOPLE: Final = 5
"""Fewer people have no spread to speak of."""
RESAMPLES: Final = 500
CERTAIN_SDS: Final = 3.0
"""Standard deviations beyond which an offset is one of the plates."""
LEAST_M: Final = (0.005, 0.04)
"""Smallest horizontal offset, and height, that is reported: the table's height alone errs by 20 mm."""
LOADED_N: Final = 20.0

PlateForces = Float[np.ndarray, "plates n 3"]


@dataclass(frozen=True)
class PlateEvidence:
    """Normal equations of one recording for x and y of every plate and the common height: 2 plates + 1 unknowns."""

    gram: Float[np.ndarray, "k k"]
    right: Float[np.ndarray, "k"]


@dataclass(frozen=True)
class PlateReferences:
    """Offsets in metres, in the axes of the laboratory: from the stated reference of the moments to the true one.

    ``horizontal_m`` has x and y of every plate less their mean. ``height_m`` is negative below the surface.
    The standard deviations are over people.
    """

    horizontal_m: Float[np.ndarray, "plates 2"]
    horizontal_sd_m: Float[np.ndarray, "plates 2"]
    height_m: float
    height_sd_m: float
    people: int

    @property
    def displaced_plates(self) -> tuple[int, ...]:
        """Positions of the plates whose horizontal offset is certain."""
        size = np.abs(self.horizontal_m)
        certain = (size > LEAST_M[0]) & (size > CERTAIN_SDS * self.horizontal_sd_m)
        return tuple(int(i) for i in np.flatnonzero(certain.any(axis=1)))

    @property
    def is_high(self) -> bool:
        """Whether the height is certainly that of the plates."""
        return abs(self.height_m) > max(LEAST_M[1], CERTAIN_SDS * self.height_sd_m)


def plate_evidence(
    geometric: GeometricCom, wrench: WrenchTrack, plate_force_n: PlateForces, mass_kg: float
) -> PlateEvidence | None:
    """Evidence of one recording; ``plate_force_n`` has the force of every plate at the samples of the wrench.

    None unless at least two plates carry the body in the window and all segments are known there.
    Raises ``NotEstimable`` or ``InvalidInput`` as ``window_span`` does.
    """
    span = window_span(geometric, wrench)
    inside, rate_hz = span.inside, span.rate_hz
    forces = np.nan_to_num(plate_force_n[:, inside])
    known = momentum_of_segments_nms(geometric, inside, mass_kg, rate_hz)
    if known is None or np.count_nonzero((forces[..., 2] > LOADED_N).any(axis=1)) < 2:
        return None
    total = Wrench(wrench.force_n[inside], wrench.moment_nm[inside])
    weight = mass_kg * GRAVITY_M_S2

    def integrate_once(x: Float[np.ndarray, "n k"]) -> Float[np.ndarray, "n k"]:
        return np.asarray(cumulative_trapezoid(x, dx=1 / rate_hz, axis=0, initial=0.0) / weight)

    size = 2 * len(forces) + 1
    gram, right = np.zeros((size, size)), np.zeros(size)
    rate = momentum_rate(geometric.com_m[inside], total)
    for about in (0, 1):
        own = np.column_stack([np.ones(len(known)), integrate_once(total.force_n[:, 2:]), known[:, about] / weight])
        basis = np.linalg.qr(own)[0]
        design = integrate_once(_moment_per_metre(forces, about))
        target = integrate_once(rate[:, about : about + 1])[:, 0]
        design, target = design - basis @ (basis.T @ design), target - basis @ (basis.T @ target)
        gram += design.T @ design / len(known)
        right += design.T @ target / len(known)
    return PlateEvidence(gram, right)


def plate_references(people: Mapping[str, Sequence[PlateEvidence]], seed: int = 0) -> PlateReferences | None:
    """Offsets of plates that all recordings share, by the evidence of each person; None below ``FEWEST_PEOPLE``."""
    own = [(sum(one.gram for one in of_one), sum(one.right for one in of_one)) for of_one in people.values() if of_one]
    if len(own) < FEWEST_PEOPLE:
        return None
    grams, rights = (np.array([pair[k] for pair in own]) for k in (0, 1))
    free = np.arange(2, grams.shape[1])  # relative to the first plate, until the mean is subtracted

    def solve_recordings(chosen: np.ndarray) -> np.ndarray:
        gram, right = grams[chosen].sum(axis=0), rights[chosen].sum(axis=0)
        offsets = np.zeros(len(right))
        offsets[free] = np.linalg.lstsq(gram[np.ix_(free, free)], right[free], rcond=1e-9)[0]
        horizontal = offsets[:-1].reshape(-1, 2)
        horizontal -= horizontal.mean(axis=0)
        return offsets

    best = solve_recordings(np.arange(len(own)))
    drawn = np.random.default_rng(seed).integers(0, len(own), (RESAMPLES, len(own)))
    sd = np.std([solve_recordings(chosen) for chosen in drawn], axis=0)
    return PlateReferences(
        horizontal_m=best[:-1].reshape(-1, 2),
        horizontal_sd_m=sd[:-1].reshape(-1, 2),
        height_m=float(best[-1]),
        height_sd_m=float(sd[-1]),
        people=len(own),
    )


def _moment_per_metre(forces: PlateForces, about: int) -> Float[np.ndarray, "n k"]:
    """Columns of what an offset of each plate (x, y), and a height of all, adds to the moment about x (0) or y (1).

    It is -o x f: (o x f)_x = o_y f_z - o_z f_y and (o x f)_y = o_z f_x - o_x f_z.
    """
    columns = []
    for force in forces:
        still = np.zeros(len(force))
        columns += [still, -force[:, 2]] if about == 0 else [force[:, 2], still]
    total = forces.sum(axis=0)
    columns.append(total[:, 1] if about == 0 else -total[:, 0])
    return np.column_stack(columns)
