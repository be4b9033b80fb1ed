"""Areas under the ROC curve of the reachability proxy of section 4.3 on random (contacts, CoM) pairs.

A score ranks the pairs. The area is the probability that a feasible pair ranks above an infeasible one (Mann and
Whitney 1947); its standard error is a bootstrap over contact sets, since pairs of the same contacts are not
independent. The baseline uses one box per effector and scores a CoM position by its depth inside all of them.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np
from jaxtyping import Float
from scipy.stats import rankdata

from experiments.random_contacts import LabelledPairs
from stridelab.conventions import Mask, Series
from stridelab.reachability.card import Measure, ReachabilityCard
from stridelab.reachability.proxy.effector_proxy import Proxy
from stridelab.reachability.proxy.feasibility_correction import com_in_frame, log_density
from stridelab.reachability.standing_conditions import axis_rotations
from stridelab.reachability.store import load_card, load_proxies

RESAMPLES: Final = 200


@dataclass(frozen=True)
class Area:
    """Area under the ROC curve of one ``score``, and its standard error."""

    score: str
    area: float
    area_sd: float


def roc_areas(robot_name: str, pairs: LabelledPairs, corrected: Mapping[str, Proxy]) -> list[Area]:
    """Areas of the product of densities for both measures, of the corrected product, and of boxes for both measures."""
    measures: tuple[Measure, ...] = ("uniform", "conditioned")
    scores = {
        f"product, {measure}": log_density(load_proxies(robot_name, measure), pairs.contacts, pairs.com_m)
        for measure in measures
    }
    scores["product, corrected"] = log_density(corrected, pairs.contacts, pairs.com_m)
    scores |= {f"boxes, {measure}": box_depth_m(load_card(robot_name, measure), pairs) for measure in measures}
    return [Area(name, roc_area(pairs.feasible, score), roc_area_sd(pairs, score)) for name, score in scores.items()]


def roc_area(positive: Mask, score: Series) -> float:
    """Area under the ROC curve; ties count half."""
    n = int(positive.sum())
    m = len(positive) - n
    return float((rankdata(score)[positive].sum() - n * (n + 1) / 2) / (n * m))


def roc_area_sd(pairs: LabelledPairs, score: Series, seed: int = 0) -> float:
    """Standard error of the area, by bootstrap over the contact sets."""
    rng = np.random.default_rng(seed)
    members = [np.flatnonzero(pairs.stance == stance) for stance in np.unique(pairs.stance)]
    resampled = []
    for _ in range(RESAMPLES):
        rows = np.concatenate([members[k] for k in rng.integers(len(members), size=len(members))])
        resampled.append(roc_area(pairs.feasible[rows], score[rows]))
    return float(np.std(resampled, ddof=1))


def box_depth_m(card: ReachabilityCard, pairs: LabelledPairs) -> Series:
    """Signed distance (m) to the closest face of the intersection of the effectors' boxes, positive inside."""
    depth_m = np.full(len(pairs.com_m), np.inf)
    for name in pairs.contacts.targets:
        effector = card.effectors[name]
        x = com_in_frame(effector.frame, pairs.contacts, name, pairs.com_m)
        low, high = (np.array(end) for end in (effector.reach.com_low_m, effector.reach.com_high_m))
        depth_m = np.minimum(depth_m, np.minimum(x - low, high - x).min(axis=1))
    return depth_m


def regression_features(pairs: LabelledPairs) -> Float[np.ndarray, "n f"]:
    """CoM and contacts relative to the midpoint of the soles in their heading frame, and the angle between the soles.

    Input of a logistic regression, an alternative correction.
    """
    to_heading = axis_rotations(2, pairs.contacts.heading_rad).swapaxes(1, 2)
    middle = pairs.contacts.middle_m
    relative_m = [pairs.com_m - middle]
    relative_m += [p - middle for name, (p, _) in pairs.contacts.targets.items() if name != "left_foot"]
    return np.hstack(
        [(to_heading @ one[..., None])[..., 0] for one in relative_m] + [2 * pairs.contacts.heading_rad[:, None]]
    )
