"""Accuracy of the reachability proxy of a contact set compared with ground truth: figure 4.5 as numbers.

The ground truth is the kernel density of the CoM over postures sampled by inverse kinematics (``StanceTruth``);
thresholds of its level sets come from held-out samples, so that its 95 % set contains 95 % of them. The comparison
uses the smallest sets of a given probability mass, of the ground truth and of the product of densities.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from scipy.stats import norm

from stridelab.conventions import Points, Series, Vector3
from stridelab.dynamics.spatial import Placement
from stridelab.reachability.kinematics.ik_ground_truth import ContactBatch, StanceTruth
from stridelab.reachability.learning.kde import KernelDensity
from stridelab.reachability.proxy.contact_set_proxy import ContactSet
from stridelab.reachability.proxy.effector_proxy import Proxy
from stridelab.reproduction.common.intervals import Interval, share_interval

MASSES: Final = (0.5, 0.8, 0.95)
BANDWIDTH_M: Final = 0.04
DRAWS: Final = 1500
"""Number of postures for the kernels, and the same number for the thresholds."""
PROBES: Final = 300
"""Number of CoM positions in the product's set for which a posture is searched."""
ROUNDS: Final = 10
PRODUCT_DRAWS: Final = 20_000
TAIL: Final = 0.025
"""Probability that a 95 % interval lies above, or below, the number."""


@dataclass(frozen=True, eq=False)
class Truth:
    """Kernel density and held-out samples with their log-densities (nats, per m^3)."""

    kernels: KernelDensity
    unseen_m: Points
    log_p: Series

    @staticmethod
    def of(truth: StanceTruth, contacts: Mapping[str, Placement], draws: int = DRAWS, seed: int = 0) -> "Truth":
        """Estimate from ``2 draws`` postures. Raises ``NotEstimable`` (``contacts-out-of-reach``)."""
        return Truth.from_postures(truth.sample_com(contacts, 2 * draws, seed), BANDWIDTH_M)

    @staticmethod
    def from_postures(com_m: Points, bandwidth_m: float) -> "Truth":
        """Estimate from the CoM of postures: kernels at the first half, thresholds from the second."""
        half = len(com_m) // 2
        kernels = KernelDensity(com_m[:half], bandwidth_m)
        return Truth(kernels, com_m[half:], kernels.log_density(com_m[half:]))

    def volume_m3(self, mass: float, seed: int = 0) -> float:
        """Volume of the level set of the kernel density that contains the share ``mass`` of the held-out samples."""
        log_p = self.kernels.log_density(self.kernels.sample(10 * len(self.log_p), np.random.default_rng(seed)))
        return float(np.exp(-log_p[log_p >= np.quantile(self.log_p, 1.0 - mass)]).sum() / len(log_p))


@dataclass(frozen=True)
class Comparison:
    """Comparison for one contact set and one choice of densities.

    Volumes (m^3) are those of the smallest sets with the probabilities ``MASSES``. ``mass_inside`` is the share of the
    product inside the 95 % set of the truth, ``truth_inside`` the share of the truth inside the 95 % set of the
    product. ``false_feasible`` is the share of the volume of the product's set without a posture. ``density_at_mode``
    is the truth's density at the product's mode relative to its maximum, ``denser_than_mode`` the share of the truth
    with a higher density than there (``share_denser``): at most 0.5 if the mode lies in the smallest set with half of
    the truth.
    """

    contacts: str
    densities: str
    truth_volumes_m3: tuple[float, ...]
    product_volumes_m3: tuple[float, ...]
    mass_inside: float
    truth_inside: float
    false_feasible: float
    mode_m: tuple[float, float, float]
    density_at_mode: float
    denser_than_mode: float
    denser_interval: Interval


def compare_densities(
    search: StanceTruth,
    name: str,
    placements: Mapping[str, Placement],
    truth: Truth,
    densities: Mapping[str, Mapping[str, Proxy]],
    probes: int = PROBES,
    sets: int = 1,
) -> list[Comparison]:
    """Compare the product of every choice of ``densities`` for one contact set with its ``truth``.

    The contact set is one of ``sets``, for all of which ``denser_interval`` holds at once.
    """
    contacts = ContactBatch.from_placements(search.robot, [placements])
    heading_rad = float(contacts.heading_rad[0])
    volumes = tuple(truth.volume_m3(mass) for mass in MASSES)
    edge = float(np.quantile(truth.log_p, 1.0 - MASSES[-1]))
    top = max(float(truth.log_p.max()), float(truth.kernels.log_density(truth.kernels.centres_m).max()))
    comparisons = []
    for label, proxies in densities.items():
        rng = np.random.default_rng(0)
        product = ContactSet.from_placements(proxies, placements, heading_rad)
        draws = product.sample(PRODUCT_DRAWS, rng)
        log_q = product.log_density(draws)
        threshold = float(np.quantile(log_q, 1.0 - MASSES[-1]))
        mode = product.mode_m()
        log_p_mode = float(truth.kernels.log_density(mode[None])[0])
        comparisons.append(
            Comparison(
                name,
                label,
                volumes,
                tuple(product.volumes_m3(MASSES).tolist()),
                float((truth.kernels.log_density(draws) >= edge).mean()),
                float((product.log_density(truth.unseen_m) >= threshold).mean()),
                _false_feasible(search, contacts, draws, log_q, threshold, probes),
                _as_triple(mode),
                float(np.exp(log_p_mode - top)),
                *share_denser(truth, mode, sets),
            )
        )
    return comparisons


def share_denser(truth: Truth, point_m: Vector3, sets: int = 1) -> tuple[float, Interval]:
    """Share of all postures x_a at which the others are denser than all are at a point c, and its 95 % interval.

        p(c) = mean_a K(c - x_a),    s^2 = var_a K(c - x_a) / n,    p_b = (n p(x_b) - K(0)) / (n - 1)

    The interval is that of the share with ``p_b > p(c) (1 +- z s / p(c))``, the product in logarithms. It holds for
    ``sets`` shares at once, each with an error of the density and one of the count (Bonferroni). No bootstrap: a
    posture that is drawn twice is dense by itself.
    """
    com_m, h = np.vstack([truth.kernels.centres_m, truth.unseen_m]), truth.kernels.bandwidth_m
    n, kernels = len(com_m), KernelDensity(com_m, h)
    top = KernelDensity(np.zeros((1, 3)), h)
    at_point, (at_centre,) = np.exp(top.log_density(com_m - point_m)), np.exp(top.log_density(np.zeros((1, 3))))
    others = (n * np.exp(kernels.log_density(com_m)) - at_centre) / (n - 1)
    p, s = float(at_point.mean()), float(at_point.std() / np.sqrt(n))
    tail = TAIL / (2 * sets)
    error = np.exp(norm.isf(tail) * s / p)
    fewest, count, most = (int((others > density).sum()) for density in (p * error, p, p / error))
    return count / n, (share_interval(fewest, n, tail)[0], share_interval(most, n, tail)[1])


def _false_feasible(
    search: StanceTruth, contacts: ContactBatch, draws: Points, log_q: Series, threshold: float, probes: int
) -> float:
    """Share of a set's volume without a posture, from samples of the set weighted to be uniform in it."""
    inside = log_q >= threshold
    weights = np.exp(threshold - log_q[inside])
    probe_indices = np.random.default_rng(1).choice(np.flatnonzero(inside), probes, p=weights / weights.sum())
    repeated = contacts.select(np.zeros(probes, dtype=int))
    feasible, _ = search.search_feasible(repeated, draws[probe_indices], ROUNDS, seed=2)
    return float(1.0 - feasible.mean())


def _as_triple(point: Vector3) -> tuple[float, float, float]:
    x, y, z = (float(value) for value in point)
    return x, y, z


def stair_contacts(robot_name: str) -> dict[str, dict[str, Placement]]:
    """Two, three and four contacts on a stair of 0.30 m by 0.15 m with rails on both sides, as in figure 4.5."""
    aside, hand = {"talos": (0.09, (0.37, 0.50, 0.95)), "hrp2": (0.105, (0.30, 0.45, 0.75))}[robot_name]
    x, y, z = hand
    two = {"left_foot": Placement.from_wxyz((0.0, aside, 0.0)), "right_foot": Placement.from_wxyz((0.30, -aside, 0.15))}
    three = two | {"right_hand": Placement.from_wxyz((x, -y, z))}
    return {"2 contacts": two, "3 contacts": three, "4 contacts": three | {"left_hand": Placement.from_wxyz((x, y, z))}}


def four_stances(robot_name: str) -> dict[str, dict[str, Placement]]:
    """Stances of two soles: side by side, on stairs of 10 and 15 cm, and half a stride apart."""
    aside = {"talos": 0.09, "hrp2": 0.105}[robot_name]
    ahead: Sequence[tuple[str, float, float]] = (
        ("flat", 0.0, 0.0),
        ("stair of 0.10 m", 0.30, 0.10),
        ("stair of 0.15 m", 0.30, 0.15),
        ("half stride", 0.45, 0.0),
    )
    left = Placement.from_wxyz((0.0, aside, 0.0))
    return {name: {"left_foot": left, "right_foot": Placement.from_wxyz((x, -aside, z))} for name, x, z in ahead}
