"""Random pairs of contact set and CoM position, labelled by whether a posture exists for them.

Two soles are placed as in the measure ``conditioned`` (``Stance``), a hand uniformly in a box beside the trunk. The CoM
is uniform in the bounding box of its support over those contacts, scaled by ``BOX_SCALE`` about its centre; contact
sets without any posture are left out.
"""

from dataclasses import dataclass
from typing import Final

import numpy as np
from jaxtyping import Float, Int

from stridelab.conventions import Mask, Points
from stridelab.reachability.kinematics.ik_ground_truth import ContactBatch, StanceTruth
from stridelab.reachability.kinematics.whole_body_ik import Target
from stridelab.reachability.standing_conditions import Stance, axis_rotations

BOX_SCALE: Final = 1.3
HAND_LOW: Final = (-0.2, -0.8, 0.7)
"""Lower corner of the box of the right hand relative to the mean of the soles, in leg lengths along the heading."""
HAND_HIGH: Final = (0.7, -0.3, 1.4)
SOLES: Final = ("left_foot", "right_foot")
HAND: Final = "right_hand"


@dataclass(frozen=True, eq=False)
class LabelledPairs:
    """``contacts`` and ``com_m`` with the label ``feasible``; pairs with the same ``stance`` share their contacts.

    ``low_m`` and ``high_m`` are the bounding box of the support, ``shares`` the feasible share after every round of
    the search, which shows whether it has converged.
    """

    contacts: ContactBatch
    com_m: Points
    feasible: Mask
    stance: Int[np.ndarray, "n"]
    low_m: Points
    high_m: Points
    shares: Float[np.ndarray, "rounds"]

    def select(self, indices: Int[np.ndarray, "m"]) -> "LabelledPairs":
        """Select pairs by index."""
        boxes = self.low_m[indices], self.high_m[indices]
        return LabelledPairs(
            self.contacts.select(indices),
            self.com_m[indices],
            self.feasible[indices],
            self.stance[indices],
            *boxes,
            shares=self.shares,
        )


def random_contacts(leg_length_m: float, n: int, rng: np.random.Generator, *, hand: bool) -> ContactBatch:
    """``n`` sets of two soles, the left one at the world origin, and optionally a right hand."""
    second, turn = Stance().draw_soles(n, -1.0, rng)
    p = leg_length_m * second
    flat = np.tile(np.eye(3), (n, 1, 1))
    targets = {SOLES[0]: Target(np.zeros((n, 3)), flat), SOLES[1]: Target(p, axis_rotations(2, turn))}
    if hand:
        beside = leg_length_m * rng.uniform(HAND_LOW, HAND_HIGH, (n, 3))
        targets[HAND] = Target(p / 2 + (axis_rotations(2, turn / 2) @ beside[..., None])[..., 0])
    return ContactBatch(targets, turn / 2)


def random_pairs(
    truth: StanceTruth, stances: int, per_stance: int, seed: int, *, hand: bool, walkers: int, rounds: int
) -> LabelledPairs:
    """``per_stance`` labelled pairs for each of ``stances`` random contact sets."""
    rng = np.random.default_rng(seed)
    contacts = random_contacts(truth.leg_length_m, stances, rng, hand=hand)
    low, high, has_posture = truth.com_bounds(contacts, walkers, seed)
    of = np.repeat(np.flatnonzero(has_posture), per_stance)
    drawn = rng.uniform(-0.5, 0.5, (len(of), 3))
    low, high = low[of], high[of]
    com_m = (low + high) / 2 + BOX_SCALE * (high - low) * drawn
    repeated = contacts.select(of)
    feasible, shares = truth.search_feasible(repeated, com_m, rounds, seed)
    return LabelledPairs(repeated, com_m, feasible, of, low, high, shares)


def balance_labels(pairs: LabelledPairs, n: int, min_feasible_share: float, rng: np.random.Generator) -> LabelledPairs:
    """Random subset of ``n`` pairs, at least a share ``min_feasible_share`` of them feasible.

    True and false positive rates at a threshold do not depend on the number of pairs of each label.
    """
    positive, negative = np.flatnonzero(pairs.feasible), np.flatnonzero(~pairs.feasible)
    share = max(min_feasible_share, len(positive) / len(pairs.feasible))
    n_positive = min(len(positive), round(n * share))
    selected = [rng.choice(positive, n_positive, replace=False), rng.choice(negative, n - n_positive, replace=False)]
    return pairs.select(np.sort(np.concatenate(selected)))
