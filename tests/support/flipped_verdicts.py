"""What becomes of a verdict when its number crosses a bound: which claim is then wrong, and which is only not met.

A claim shows the verdict on the number that was computed, not what the verdict on another one would be. Here every
criterion that a claim was made with is evaluated just inside and just outside of its bounds.
"""

import re
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from typing import Any, Final

import pytest

from stridelab.reproduction.claims import Claim, Criterion, Measured

FACTS: Final = re.compile(
    # formulas, ranks and curves, which are as printed or are not
    r"zmp_2_8_printed_m|rank_(force|both|falling)|convex_share"
    # properties of densities, cones and optima that anyone's samples and solver have
    r"|volume_per_contact|volume_over_truth"
    r"|excess_of_true|alpha_fifth"
    # a summary that has to agree with the thesis' own table
    r"|per_second_s"
)
"""Keys of claims that are wrong if our number is outside: on others our result is worse, or people differ.

No bound of ours is among them: it can say what is not met, and not that the thesis is in error.
"""
BETTER: Final = re.compile(
    r"kernel_ns|horizon_hz|wrench_25_s|forces_17_s|time_[123]_u_[cf]|per_second|iterations_.*|iteration_.*_s"
)
"""Keys of claims with a number of the thesis that can be surpassed: times, rates and iterations."""
FAR_BETTER: Final = {"kernel_ns": 0.5, "horizon_hz": 1.5}
"""Where to be better takes more than the printed number: half of a time, one and a half times a rate."""
_made_with: dict[tuple[str, str, float], Criterion] = {}


@contextmanager
def remembered_criteria() -> Iterator[None]:
    """Remember the criterion of every claim that is made."""
    says = Measured.says

    def remember(self: Measured, *words: str, **basis: Any) -> Claim:
        claim = says(self, *words, **basis)
        _made_with[claim.key, claim.says, claim.ours] = self.criterion
        return claim

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Measured, "says", remember)
        yield


def assert_flips(claims: Iterable[Claim]) -> None:
    """Every verdict flips at the bounds of its claim, to "thesis in error" for ``FACTS`` alone, at no bound of ours."""
    for claim in claims:
        criterion = _made_with[claim.key, claim.says, claim.ours]
        outside = "not_met"
        if not claim.aim and FACTS.fullmatch(claim.key):
            assert claim.threshold != "ours", f"{claim.key}: with another bound of the reader's the thesis may hold"
            outside = "thesis_in_error"
        for bound, outwards in ((claim.holds_from, -1.0), (claim.holds_to, 1.0)):
            if bound is None:
                continue
            step = outwards * max(1e-9, 1e-6 * abs(bound))
            assert criterion.verdict(bound + step) == outside, f"{claim.key}: beyond {bound}"
            assert criterion.verdict(float("nan")) == outside, claim.key
            at_bound = criterion.verdict(bound)
            assert (at_bound == outside) == claim.strict, f"{claim.key}: at {bound}"
            assert criterion.verdict(bound, (bound - abs(step), bound + abs(step))) == "undecided", claim.key
        verdicts = {criterion.verdict(value) for value in _inside(claim)}
        if claim.aim:
            assert verdicts == {"beaten"}, claim.key
        else:
            assert ("beaten" in verdicts) == bool(BETTER.fullmatch(claim.key)), f"{claim.key}: {verdicts}"
            if criterion.better_than is not None:
                printed = FAR_BETTER.get(claim.key, 1.0) * float(claim.thesis)
                assert criterion.better_than == pytest.approx(printed), f"{claim.key}: better than {printed}"


def _inside(claim: Claim) -> list[float]:
    """Numbers in the range, from its bounds to far away from them where there is one only."""
    if claim.holds_from is not None and claim.holds_to is not None:
        return [(claim.holds_from + claim.holds_to) / 2.0]
    bound, inwards = (claim.holds_to, -1.0) if claim.holds_from is None else (claim.holds_from, 1.0)
    assert bound is not None
    return [bound + inwards * far * max(abs(bound), 1e-9) for far in (1e-3, 0.3, 0.6, 0.9, 2.0)]
