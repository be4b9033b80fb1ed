"""Does the proxy of section 4.3 tell feasible from not? Areas under the ROC curve on random pairs (contacts, CoM).

A score ranks the pairs. The area is the chance that a feasible pair is ranked above one that is not (Mann and Whitney
1947); its standard error comes from drawing the contact sets anew, since pairs over the same contacts are not
independent. The baseline is what peers ship: one box per effector, a place scored by how deep it lies in all of them.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np
from jaxtyping import Float
from scipy.stats import rankdata

from stridelab.conventions import Mask, Series
from stridelab.reachability.card import Measure, ReachabilityCard
from stridelab.reachability.proxy.effector_proxy import Proxy
from stridelab.reachability.proxy.feasibility_correction import log_density, seen_from
from stridelab.reachability.random_contacts import Pairs
from stridelab.reachability.standing_conditions import about
from stridelab.reachability.store import load_card, load_proxies

RESAMPLES: Final = 200


@dataclass(frozen=True)
class Area:
    """Area under the ROC curve of one ``score``, and its standard error."""

    score: str
    area: float
    area_sd: float


def areas(robot_name: str, pairs: Pairs, corrected: Mapping[str, Proxy]) -> list[Area]:
    """Of the product of densities for both measures, of the corrected one, and of boxes for both."""
    measures: tuple[Measure, ...] = ("uniform", "conditioned")
    scores = {
        f"product, {measure}": log_density(load_proxies(robot_name, measure), pairs.contacts, pairs.com_m)
        for measure in measures
    }
    scores["product, corrected"] = log_density(corrected, pairs.contacts, pairs.com_m)
    scores |= {f"boxes, {measure}": depth(load_card(robot_name, measure), pairs) for measure in measures}
    return [Area(name, area(pairs.feasible, score), area_sd(pairs, score)) for name, score in scores.items()]


def area(positive: Mask, score: Series) -> float:
    """The area under the ROC curve; ties count half."""
    n = int(positive.sum())
    m = len(positive) - n
    return float((rankdata(score)[positive].sum() - n * (n + 1) / 2) / (n * m))


def area_sd(pairs: Pairs, score: Series, seed: int = 0) -> float:
    """Standard error of the area by drawing the contact sets anew, with replacement."""
    rng = np.random.default_rng(seed)
    members = [np.flatnonzero(pairs.stance == stance) for stance in np.unique(pairs.stance)]
    found = []
    for _ in range(RESAMPLES):
        of = np.concatenate([members[k] for k in rng.integers(len(members), size=len(members))])
        found.append(area(pairs.feasible[of], score[of]))
    return float(np.std(found, ddof=1))


def depth(card: ReachabilityCard, pairs: Pairs) -> Series:
    """Distance (m) inside the intersection of the effectors' boxes, negative outside, to the nearest face."""
    found = np.full(len(pairs.com_m), np.inf)
    for name in pairs.contacts.targets:
        effector = card.effectors[name]
        x = seen_from(effector.frame, pairs.contacts, name, pairs.com_m)
        low, high = (np.array(end) for end in (effector.reach.com_low_m, effector.reach.com_high_m))
        found = np.minimum(found, np.minimum(x - low, high - x).min(axis=1))
    return found


def features(pairs: Pairs) -> Float[np.ndarray, "n f"]:
    """The CoM and the contacts seen from the middle of the soles along their heading, and the soles' turn.

    What a logistic regression takes, the other correction that was tried.
    """
    back = about(2, pairs.contacts.heading_rad).swapaxes(1, 2)
    middle = pairs.contacts.middle_m
    seen = [pairs.com_m - middle]
    seen += [p - middle for name, (p, _) in pairs.contacts.targets.items() if name != "left_foot"]
    return np.hstack([(back @ one[..., None])[..., 0] for one in seen] + [2 * pairs.contacts.heading_rad[:, None]])
