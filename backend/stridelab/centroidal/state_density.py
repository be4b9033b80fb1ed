"""Normal densities of (c', L_c) and of (c'', L_c') over a contact: what (4.11) has and (4.13) leaves out.

With D = diag(R, R)^T, R the axes of the contact, z_0 = (c', L_c) and z_1 = (c'', L_c'), every contact i adds

    -log p_i = sum_j (D z_j - mu_ij)^T P_ij (D z_j - mu_ij) / 2 + (6 log 2 pi - log det P_ij) / 2

to the cost, so that a phase adds one quadratic in z_0 and one in z_1, whatever the number of its contacts:

    z_j^T A_j z_j / 2 - b_j^T z_j + d,    A_j = sum_i D^T P_ij D,    b_j = sum_i D^T P_ij mu_ij .
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from scipy.linalg import block_diag

from stridelab.contacts.sequence import ContactPhase
from stridelab.conventions import Rotation

N_RATES = 6


@dataclass(frozen=True, eq=False)
class StateDensity:
    """Normal densities of (c', L_c) in m/s and N m s, and of (c'', L_c') in m/s^2 and N m, in the contact's axes.

    ``means`` and ``precisions`` have one row for each of the two.
    """

    means: Float[np.ndarray, "2 6"]
    precisions: Float[np.ndarray, "2 6 6"]

    @classmethod
    def of_samples(cls, velocities: Float[np.ndarray, "n 6"], rates: Float[np.ndarray, "n 6"]) -> "StateDensity":
        """The normal densities with the moments of samples."""
        both = (velocities, rates)
        return cls(np.array([of.mean(axis=0) for of in both]), np.array([np.linalg.inv(np.cov(of.T)) for of in both]))

    def log_density(
        self, velocities: Float[np.ndarray, "n 6"], rates: Float[np.ndarray, "n 6"], rotation: Rotation
    ) -> Float[np.ndarray, "n 2"]:
        """``log p`` of velocities and of rates in world axes, over a contact with the axes ``rotation``."""
        D = block_diag(rotation, rotation)
        columns = []
        for z, mean, P in zip((velocities, rates), self.means, self.precisions, strict=True):
            away = z @ D - mean
            constant = 0.5 * (np.linalg.slogdet(P)[1] - N_RATES * np.log(2.0 * np.pi))
            columns.append(constant - 0.5 * np.einsum("ka,ab,kb->k", away, P, away))
        return np.column_stack(columns)


def phase_quadratic(
    densities: Mapping[str, StateDensity], phase: ContactPhase, momentum_unit_nms: float
) -> Float[np.ndarray, "85"]:
    """``(A_0, b_0, A_1, b_1, d)`` of a phase, matrices by columns; momenta in units of ``momentum_unit_nms``."""
    A, b, d = np.zeros((2, N_RATES, N_RATES)), np.zeros((2, N_RATES)), 0.0
    unit = np.diag([1.0] * 3 + [momentum_unit_nms] * 3)
    for name, contact in phase.contacts.items():
        if name not in densities:
            continue
        density = densities[name]
        D = block_diag(contact.placement.rotation, contact.placement.rotation).T @ unit
        for j, (mean, P) in enumerate(zip(density.means, density.precisions, strict=True)):
            A[j] += D.T @ P @ D
            b[j] += D.T @ P @ mean
            d += 0.5 * (mean @ P @ mean + N_RATES * np.log(2.0 * np.pi) - np.linalg.slogdet(P)[1])
    return np.concatenate([A[0].ravel(), b[0], A[1].ravel(), b[1], [d]])
