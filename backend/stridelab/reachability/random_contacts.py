"""Random contact sets and places of the CoM, with the truth whether a posture joins them.

Two soles are placed as the measure ``conditioned`` places them (``Stance``), a hand anywhere in a box beside the
trunk. The CoM is uniform in the bounding box of its support over those contacts, grown ``GROWN`` times about its
middle; pairs whose contacts no posture holds are left out.
"""

from dataclasses import dataclass
from typing import Final

import numpy as np
from jaxtyping import Float, Int

from stridelab.conventions import Mask, Points
from stridelab.reachability.kinematics.ik_ground_truth import Contacts, StanceTruth
from stridelab.reachability.kinematics.whole_body_ik import Target
from stridelab.reachability.standing_conditions import Stance, about

GROWN: Final = 1.3
HAND_LOW: Final = (-0.2, -0.8, 0.7)
"""The box of a right hand over the middle of the soles, in leg lengths along the mean heading."""
HAND_HIGH: Final = (0.7, -0.3, 1.4)
SOLES: Final = ("left_foot", "right_foot")
HAND: Final = "right_hand"


@dataclass(frozen=True, eq=False)
class Pairs:
    """``contacts`` and ``com_m`` with their truth ``feasible``; pairs with the same ``stance`` share their contacts.

    ``low_m`` and ``high_m`` are the bounding box of the support, ``shares`` the feasible share after every round of
    the search, which tells whether it is exhausted.
    """

    contacts: Contacts
    com_m: Points
    feasible: Mask
    stance: Int[np.ndarray, "n"]
    low_m: Points
    high_m: Points
    shares: Float[np.ndarray, "rounds"]

    def taken(self, of: Int[np.ndarray, "m"]) -> "Pairs":
        """Those with these numbers."""
        boxes = self.low_m[of], self.high_m[of]
        return Pairs(
            self.contacts.taken(of), self.com_m[of], self.feasible[of], self.stance[of], *boxes, shares=self.shares
        )


def random_contacts(leg_length_m: float, n: int, rng: np.random.Generator, *, hand: bool) -> Contacts:
    """``n`` sets of two soles, the left one at the world's origin, and a right hand if asked."""
    second, turn = Stance().drawn_soles(n, -1.0, rng)
    p = leg_length_m * second
    flat = np.tile(np.eye(3), (n, 1, 1))
    targets = {SOLES[0]: Target(np.zeros((n, 3)), flat), SOLES[1]: Target(p, about(2, turn))}
    if hand:
        beside = leg_length_m * rng.uniform(HAND_LOW, HAND_HIGH, (n, 3))
        targets[HAND] = Target(p / 2 + (about(2, turn / 2) @ beside[..., None])[..., 0])
    return Contacts(targets, turn / 2)


def random_pairs(
    truth: StanceTruth, stances: int, per_stance: int, seed: int, *, hand: bool, walkers: int, rounds: int
) -> Pairs:
    """``per_stance`` pairs for each of ``stances`` random contact sets, with their truth."""
    rng = np.random.default_rng(seed)
    contacts = random_contacts(truth.leg_length_m, stances, rng, hand=hand)
    low, high, there = truth.extent(contacts, walkers, seed)
    of = np.repeat(np.flatnonzero(there), per_stance)
    drawn = rng.uniform(-0.5, 0.5, (len(of), 3))
    low, high = low[of], high[of]
    com_m = (low + high) / 2 + GROWN * (high - low) * drawn
    repeated = contacts.taken(of)
    feasible, shares = truth.feasible(repeated, com_m, rounds, seed)
    return Pairs(repeated, com_m, feasible, of, low, high, shares)


def balanced(pairs: Pairs, n: int, least: float, rng: np.random.Generator) -> Pairs:
    """``n`` pairs, at least a share ``least`` of them feasible: others are left out at random.

    Neither the rate of true nor that of false positives at a threshold depends on how many of a kind are kept.
    """
    positive, negative = np.flatnonzero(pairs.feasible), np.flatnonzero(~pairs.feasible)
    share = max(least, len(positive) / len(pairs.feasible))
    wanted = min(len(positive), round(n * share))
    kept = [rng.choice(positive, wanted, replace=False), rng.choice(negative, n - wanted, replace=False)]
    return pairs.taken(np.sort(np.concatenate(kept)))
